//! A virtual drive of CiA 402: a node with its objects, its states, its heartbeat and its PDOs.

use crate::cia402::node::{Emergency, NMT, NmtCommand, NmtState, SYNC};
use crate::cia402::objects::{
    ABORT_OPTION, CONSUMER, COUNTS_PER_TURN, MODE, Objects, POSITION, PRODUCER, QUICK_STOP_OPTION,
    RESOLUTION, RPDO_TIMER, STATUSWORD, TPDO_TIMER, TPDO_TYPE,
};
use crate::cia402::{Cia402, NodeId, PowerState};
use crate::frame::{Frame, FrameId};
use crate::layout::Layout;
use crate::message::{FrameFault, Quantity};
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::MeasuredMotorSpeeds;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Speed below which a motor is at standstill, m/s.
const STANDSTILL_M_S: f64 = 1e-3;
/// Turns of a motor in 1 m where its signal does not count turns.
const TURNS_PER_M: f64 = 10.0;
/// Error code of a lost heartbeat, and its bits of the error register.
const HEARTBEAT_LOST: Emergency = Emergency {
    code: 0x8130,
    register: 0x11,
};
/// Error code of commands that were missed, and its bits.
const COMMANDS_LOST: Emergency = Emergency {
    code: 0x8250,
    register: 0x11,
};
const ERROR_GONE: Emergency = Emergency {
    code: 0,
    register: 0,
};

/// Both drives of a layout, as a vehicle has them.
pub struct VirtualDrives {
    layout: Arc<Layout>,
    master: NodeId,
    drives: [SimulatedDrive; 2],
    /// Frames that wait to be sent.
    outbox: VecDeque<Frame>,
}

impl VirtualDrives {
    /// Returns drives that start with their first step.
    pub fn new(layout: Arc<Layout>, cia402: &Cia402) -> Self {
        Self {
            layout,
            master: cia402.own,
            drives: cia402.nodes.map(SimulatedDrive::new),
            outbox: VecDeque::new(),
        }
    }

    /// Returns the identifiers of the frames that the drives receive.
    pub fn received_ids(&self) -> Vec<FrameId> {
        let mut ids = vec![NMT, SYNC, self.master.heartbeat()];
        ids.extend(self.layout.command.iter().map(|message| message.id()));
        ids.extend(self.drives.iter().map(|drive| drive.node.request()));
        ids
    }

    /// Returns the state of both, the worse of the two.
    pub fn mode(&self) -> DriveMode {
        let [first, second] = &self.drives;
        first.state.mode().worse(second.state.mode())
    }

    /// Takes a frame that arrived at `time_s`; frames of other identifiers have no effect.
    ///
    /// # Errors
    /// Which check the frame failed. It then changes nothing.
    pub fn take(&mut self, frame: &Frame, time_s: f64) -> Result<(), FrameFault> {
        for (i, drive) in self.drives.iter_mut().enumerate() {
            if frame.id == drive.node.request() && frame.length == 8 {
                self.outbox.extend(drive.answer(frame));
            } else if frame.id == NMT && frame.length == 2 {
                drive.manage(frame.data[0], frame.data[1]);
            } else if frame.id == SYNC {
                drive.syncs += 1;
            } else if frame.id == drive.master().heartbeat() {
                drive.heartbeat_received_s = Some(time_s);
            }
            let message = &self.layout.command[i];
            if frame.id == message.id()
                && let Some(contents) = message.decode(frame)?
            {
                let role = self.layout.drives[i].role;
                let word = contents.get(Quantity::Controlword);
                let target_m_s = contents.get(Quantity::Command(role));
                if let (Some(word), Some(target_m_s)) = (word, target_m_s) {
                    drive.obey(word as u16, target_m_s, time_s);
                }
            }
        }
        Ok(())
    }

    /// Moves on to `time_s`, where the motors do `motors`, and returns the speeds they head for.
    ///
    /// # Errors
    /// A speed that does not fit its signal.
    pub fn step(
        &mut self,
        time_s: f64,
        motors: &MeasuredMotorSpeeds,
        emergency_stop: bool,
    ) -> Result<MeasuredMotorSpeeds, FrameFault> {
        let mut targets_m_s = [0.0; 2];
        for (i, drive) in self.drives.iter_mut().enumerate() {
            let codec = &self.layout.drives[i];
            let speed_m_s = codec.role.speed_m_s(motors);
            let rotation_rad_s = codec.message.rotation_rad_s(Quantity::Speed(codec.role));
            let turns_per_m = rotation_rad_s.map_or(TURNS_PER_M, |speed| speed / TAU);
            drive.count(time_s, speed_m_s * turns_per_m);
            let target_m_s = drive.step(time_s, speed_m_s, emergency_stop, &mut self.outbox);
            // It knows speeds by its encoder alone.
            let scale = drive.speed_scale();
            targets_m_s[i] = scale * target_m_s;
            if drive.pdo_is_due(time_s) {
                let value_of = |quantity| match quantity {
                    Quantity::Speed(_) => speed_m_s / scale,
                    Quantity::DriveState => f64::from(drive.state.statusword()),
                    _ => f64::NAN,
                };
                self.outbox.push_back(codec.message.encode(0, value_of)?);
            }
        }
        Ok(self.layout.motors(targets_m_s))
    }

    /// Returns the frame that is to be sent next.
    pub fn next_frame(&mut self) -> Option<Frame> {
        self.outbox.pop_front()
    }
}

/// One drive.
#[derive(Debug, Clone)]
struct SimulatedDrive {
    node: NodeId,
    nmt: NmtState,
    state: PowerState,
    objects: Objects,
    controlword: u16,
    target_m_s: f64,
    /// Turns of the motor since it was made, and until when, s.
    turns: f64,
    counted_s: Option<f64>,
    /// Instant of the master's last heartbeat, s; none before the first.
    heartbeat_received_s: Option<f64>,
    /// Instant of the last command, s; none before the first since the node became operational.
    commanded_s: Option<f64>,
    /// Whether the master or its commands are missing.
    lost: Option<Emergency>,
    heartbeat_s: f64,
    pdo_s: f64,
    /// SYNCs since the last PDO.
    syncs: u32,
}

impl SimulatedDrive {
    fn new(node: NodeId) -> Self {
        Self {
            node,
            nmt: NmtState::BootUp,
            state: PowerState::SwitchOnDisabled,
            objects: Objects::new(),
            controlword: 0,
            target_m_s: 0.0,
            turns: 0.0,
            counted_s: None,
            heartbeat_received_s: None,
            commanded_s: None,
            lost: None,
            heartbeat_s: f64::NEG_INFINITY,
            pdo_s: f64::NEG_INFINITY,
            syncs: 0,
        }
    }

    /// Returns the node whose heartbeat is monitored, or this one if there is none.
    fn master(&self) -> NodeId {
        let number = (self.objects.get(CONSUMER) >> 16) as u8;
        NodeId::new(number).unwrap_or(self.node)
    }

    fn answer(&mut self, request: &Frame) -> Option<Frame> {
        let served = matches!(self.nmt, NmtState::PreOperational | NmtState::Operational);
        self.objects
            .set(STATUSWORD, u32::from(self.state.statusword()));
        served
            .then(|| self.objects.answer(self.node, request))
            .flatten()
    }

    /// Obeys the network management; node 0 means all.
    fn manage(&mut self, command: u8, node: u8) {
        const RESET_NODE: u8 = 0x81;
        const RESET_COMMUNICATION: u8 = 0x82;
        if node != 0 && node != self.node.get() {
            return;
        }
        self.nmt = match command {
            _ if self.nmt == NmtState::BootUp => return,
            c if c == NmtCommand::Start as u8 => NmtState::Operational,
            c if c == NmtCommand::Stop as u8 => NmtState::Stopped,
            c if c == NmtCommand::EnterPreOperational as u8 => NmtState::PreOperational,
            RESET_NODE | RESET_COMMUNICATION => {
                *self = Self {
                    turns: self.turns,
                    ..Self::new(self.node)
                };
                return;
            }
            _ => return,
        };
    }

    fn obey(&mut self, controlword: u16, target_m_s: f64, time_s: f64) {
        if self.nmt == NmtState::Operational {
            self.commanded_s = Some(time_s);
            self.state = self.state.after(controlword, self.controlword);
            self.controlword = controlword;
            self.target_m_s = target_m_s;
        }
    }

    /// Counts turns until `time_s`, where the motor does so many a second.
    fn count(&mut self, time_s: f64, turns_s: f64) {
        let before_s = self.counted_s.replace(time_s);
        self.turns += turns_s * before_s.map_or(0.0, |before_s| time_s - before_s);
        let counts = (f64::from(COUNTS_PER_TURN) * self.turns).round();
        // As the counter of a drive, it begins anew beyond 32 bits.
        self.objects.set(POSITION, counts as i64 as u32);
    }

    /// Returns true over reported speed: other than 1 where the drive was told another resolution than its encoder has.
    fn speed_scale(&self) -> f64 {
        f64::from(self.objects.get(RESOLUTION).max(1)) / f64::from(COUNTS_PER_TURN)
    }

    /// Moves on and returns the speed that the motor heads for, m/s.
    fn step(
        &mut self,
        time_s: f64,
        speed_m_s: f64,
        emergency_stop: bool,
        outbox: &mut VecDeque<Frame>,
    ) -> f64 {
        if self.nmt == NmtState::BootUp {
            outbox.push_back(self.nmt.heartbeat(self.node));
            self.nmt = NmtState::PreOperational;
        }
        let period_s = milliseconds(self.objects.get(PRODUCER));
        if period_s > 0.0 && time_s >= self.heartbeat_s {
            self.heartbeat_s = (self.heartbeat_s + period_s).max(time_s);
            outbox.push_back(self.nmt.heartbeat(self.node));
        }
        self.detect_silence(time_s, outbox);
        if self.state == PowerState::OperationEnabled
            && (self.lost.is_some() || self.nmt == NmtState::Stopped)
        {
            self.state = match self.objects.get(ABORT_OPTION) {
                1 => PowerState::Fault,
                2 => PowerState::SwitchOnDisabled,
                3 => PowerState::QuickStopActive,
                _ => self.state,
            };
        }
        if emergency_stop {
            // Somebody else's quick stop, through the drive's own input.
            self.state = match self.state {
                PowerState::OperationEnabled => PowerState::QuickStopActive,
                PowerState::ReadyToSwitchOn | PowerState::SwitchedOn => {
                    PowerState::SwitchOnDisabled
                }
                state => state,
            };
        }
        let stands = speed_m_s.abs() < STANDSTILL_M_S && !emergency_stop;
        if self.state == PowerState::QuickStopActive {
            self.state = match self.objects.get(QUICK_STOP_OPTION) {
                0 => PowerState::SwitchOnDisabled,
                1 | 2 if stands => PowerState::SwitchOnDisabled,
                _ => self.state,
            };
        }
        let follows = matches!(self.objects.get(MODE), 3 | 9);
        if follows && self.state == PowerState::OperationEnabled {
            self.target_m_s
        } else {
            0.0
        }
    }

    /// Detects the loss of the master's heartbeat, and of its commands while they are received.
    fn detect_silence(&mut self, time_s: f64, outbox: &mut VecDeque<Frame>) {
        if self.nmt != NmtState::Operational {
            self.commanded_s = None;
        }
        let is_late = |since_s: Option<f64>, limit: u32| {
            let limit_s = milliseconds(limit);
            limit_s > 0.0 && since_s.is_some_and(|since_s| time_s - since_s > limit_s)
        };
        let lost = if is_late(
            self.heartbeat_received_s,
            self.objects.get(CONSUMER) & 0xFFFF,
        ) {
            Some(HEARTBEAT_LOST)
        } else if is_late(self.commanded_s, self.objects.get(RPDO_TIMER)) {
            Some(COMMANDS_LOST)
        } else {
            None
        };
        if lost == self.lost {
            return;
        }
        self.lost = lost;
        let emergency = lost.unwrap_or(ERROR_GONE);
        self.objects.keep_error(&emergency);
        outbox.push_back(emergency.frame(self.node));
    }

    fn pdo_is_due(&mut self, time_s: f64) -> bool {
        let kind = self.objects.get(TPDO_TYPE);
        let period_s = milliseconds(self.objects.get(TPDO_TIMER));
        let due = match kind {
            1..=240 => self.syncs >= kind,
            _ => period_s > 0.0 && time_s >= self.pdo_s,
        };
        let due = due && self.nmt == NmtState::Operational;
        if due {
            self.syncs = 0;
            self.pdo_s = (self.pdo_s + period_s).max(time_s);
        }
        due
    }
}

fn milliseconds(bits: u32) -> f64 {
    1e-3 * f64::from(bits)
}

#[cfg(test)]
mod tests;
