use crate::cia402::node::{NmtCommand, NmtState, NodeReading, SYNC};
use crate::cia402::{Cia402, Controlword, DriveEvent, NodeId, PowerState, SdoRequest, SetupFault};
use crate::controller_side::{MotorReport, Readings};
use crate::frame::Frame;
use crate::layout::Layout;
use crate::message::{FrameFault, Quantity};
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::MotorCommand;
use sidehill_plant::sample::Stamped;
use std::sync::Arc;

/// Pause after a setup that failed, s.
const RETRY_S: f64 = 1.0;

/// Sets both drives up, takes them through their states and commands their speeds. It has no socket and
/// no clock.
pub struct Master {
    layout: Arc<Layout>,
    cia402: Cia402,
    drives: [CommandedDrive; 2],
}

impl Master {
    /// Returns a master that has yet to set its drives up.
    pub fn new(layout: Arc<Layout>, cia402: Cia402) -> Self {
        let drives = cia402.nodes.map(CommandedDrive::new);
        Self {
            layout,
            cia402,
            drives,
        }
    }

    /// Returns a drive's report as the safety may take it: none before the drive is set up, as old
    /// as the older of PDO and heartbeat, off where the node has just started, and not operational where it exchanges
    /// no PDOs.
    pub fn report(&self, drive: usize, readings: &Readings) -> Option<Stamped<MotorReport>> {
        let nmt = readings.nodes[drive].nmt?;
        let mut report = readings.drives[drive]?;
        if self.drives[drive].stage != SetupStage::Running {
            return None;
        }
        if self.drives[drive].mode.is_other {
            report.value.mode = report.value.mode.worse(DriveMode::OtherMode);
        }
        report.time_s = report.time_s.min(nmt.time_s);
        match nmt.value {
            NmtState::Operational => {}
            NmtState::PreOperational | NmtState::Stopped
                if readings.nodes[drive].boots == self.drives[drive].boots =>
            {
                report.value.mode = DriveMode::NotOperational;
            }
            _ => report.value.mode = DriveMode::Disabled,
        }
        Some(report)
    }

    /// Passes the frames of one cycle to `send` until one fails, those that move first.
    ///
    /// `fault_reset` says that faults of the drives may be reset, each once until it is false again.
    /// `report` takes the number of a node and its news.
    ///
    /// # Errors
    /// A speed that does not fit its signal, or what `send` returned.
    pub fn write<E: From<FrameFault>>(
        &mut self,
        now_s: f64,
        command: &MotorCommand,
        fault_reset: bool,
        readings: &Readings,
        mut report: impl FnMut(u8, DriveEvent),
        mut send: impl FnMut(&Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        for (i, drive) in self.drives.iter_mut().enumerate() {
            let node = drive.node.get();
            drive.notice(now_s, &readings.nodes[i], fault_reset, |event| {
                report(node, event)
            });
            let feedback_s = readings.drives[i].map(|report| report.time_s);
            drive.follow(
                now_s,
                command.enable,
                &readings.nodes[i],
                feedback_s,
                &self.cia402,
            );
            let power = readings.nodes[i].power;
            let word = drive.controlword(now_s, command.enable, fault_reset, power, &self.cia402);
            let moves = word == Controlword::ENABLE_OPERATION
                && power == Some(PowerState::OperationEnabled);
            let value_of = |quantity| match quantity {
                Quantity::Controlword => f64::from(word),
                Quantity::Command(role) if moves => role.speed_m_s(&command.speeds),
                Quantity::Command(_) => 0.0,
                _ => f64::NAN,
            };
            send(&self.layout.command[i].encode(0, value_of)?)?;
        }
        if self.cia402.sync {
            let data = [0; 8];
            send(&Frame {
                id: SYNC,
                length: 0,
                data,
            })?;
        }
        send(&NmtState::Operational.heartbeat(self.cia402.own))?;
        for (i, drive) in self.drives.iter_mut().enumerate() {
            let node = drive.node.get();
            let report = |event| report(node, event);
            drive.manage(
                now_s,
                i,
                &readings.nodes[i],
                &self.cia402,
                report,
                &mut send,
            )?;
        }
        Ok(())
    }
}

/// How far a drive has been set up.
#[derive(Debug, Clone, Copy, PartialEq)]
enum SetupStage {
    /// Not begun before this time, s.
    Waiting { until_s: f64 },
    /// An object is due, or was written at this time after so many answers.
    Writing {
        object: usize,
        requested: Option<(f64, u32)>,
    },
    /// It exchanges PDOs.
    Running,
}

/// Watches the mode of operation of a drive that is on: another node can change it by an SDO.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct ModeWatch {
    /// When it is read next, s.
    next_s: f64,
    /// When it was asked for, s, after so many answers.
    requested: Option<(f64, u32)>,
    /// The mode that it must be in.
    expected: Option<u32>,
    /// Answers in a row with another.
    others: u32,
    is_other: bool,
    unread: bool,
    /// The drive does not have the object.
    absent: bool,
}

impl ModeWatch {
    /// Time between two looks, s.
    const PERIOD_S: f64 = 0.1;
    /// Answers in a row that convince: a display may lag behind the drive that is switched on.
    const CONVINCING: u32 = 2;

    /// Takes an answer and asks again. `expected` is the setup's mode; without one the first that the drive shows
    /// counts.
    fn watch<E>(
        &mut self,
        now_s: f64,
        drive: &NodeReading,
        (node, expected): (NodeId, Option<u32>),
        answer_time_s: f64,
        mut report: impl FnMut(DriveEvent),
        send: &mut impl FnMut(&Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        let request = SdoRequest::read(node, 0x6061, 0, 0);
        if let Some((requested_s, answers)) = self.requested {
            let answer = drive.answer_to(&request, answers);
            let late = !(..=answer_time_s).contains(&(now_s - requested_s));
            match answer.map(|answer| answer.result) {
                Some(Ok(read)) => {
                    let mode = read.unwrap_or(0) & 0xFF;
                    let expected = *self.expected.get_or_insert(expected.unwrap_or(mode));
                    self.others = if mode == expected { 0 } else { self.others + 1 };
                    if self.others >= Self::CONVINCING && !self.is_other {
                        self.is_other = true;
                        report(DriveEvent::OtherMode(mode as u8 as i8));
                    }
                }
                None if !late => return Ok(()),
                answer => {
                    self.absent = answer.is_some();
                    if !self.unread {
                        self.unread = true;
                        report(DriveEvent::ModeUnread);
                    }
                }
            }
            self.requested = None;
        }
        if now_s >= self.next_s && !self.absent {
            send(&request.frame)?;
            self.requested = Some((now_s, drive.answers.count()));
            self.next_s = now_s + Self::PERIOD_S;
        }
        Ok(())
    }
}

/// Resets of a fault that one arming has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reset {
    Left,
    Commanded,
    Used,
}

#[derive(Debug, Clone)]
struct CommandedDrive {
    node: NodeId,
    stage: SetupStage,
    boots: u32,
    emergencies: u32,
    failed: Option<SetupFault>,
    off_since_s: Option<f64>,
    /// Commanded to be on, and not reported off since.
    on: bool,
    /// Whether its newest report says that it is on.
    seen_on: bool,
    stop_reported: bool,
    reset: Reset,
    arming: bool,
    mode: ModeWatch,
}

impl CommandedDrive {
    fn new(node: NodeId) -> Self {
        Self {
            node,
            stage: SetupStage::Waiting {
                until_s: f64::NEG_INFINITY,
            },
            boots: 0,
            emergencies: 0,
            failed: None,
            off_since_s: None,
            on: false,
            seen_on: false,
            stop_reported: false,
            reset: Reset::Left,
            arming: false,
            mode: ModeWatch::default(),
        }
    }

    /// Begins the setup of a drive that has started or, when an operator arms, of one whose node is not
    /// operational or whose mode of operation was changed.
    fn notice(
        &mut self,
        now_s: f64,
        node: &NodeReading,
        fault_reset: bool,
        mut report: impl FnMut(DriveEvent),
    ) {
        for emergency in node.emergencies.since(self.emergencies) {
            report(DriveEvent::Emergency(emergency));
        }
        self.emergencies = node.emergencies.count();
        let armed = fault_reset && !self.arming;
        self.arming = fault_reset;
        let idle = self.stage == SetupStage::Running
            && node
                .nmt
                .is_some_and(|nmt| nmt.value != NmtState::Operational);
        let started = node.boots != self.boots;
        if started {
            self.boots = node.boots;
            report(DriveEvent::Started);
        }
        if started || (armed && (idle || self.mode.is_other)) {
            self.stage = SetupStage::Waiting { until_s: now_s };
            self.on = false;
        }
    }

    /// Tracks whether the drive may be on, and since when it is commanded off.
    fn follow(
        &mut self,
        now_s: f64,
        enable: bool,
        node: &NodeReading,
        report_s: Option<f64>,
        cia402: &Cia402,
    ) {
        let fresh = report_s.is_some_and(|report_s| now_s - report_s <= cia402.quick_stop_time_s);
        self.seen_on = fresh && node.power == Some(PowerState::OperationEnabled);
        if enable {
            self.off_since_s = None;
            self.on = true;
            self.stop_reported = false;
            return;
        }
        self.off_since_s.get_or_insert(now_s);
        let off = node
            .power
            .is_some_and(|power| matches!(power.mode(), DriveMode::Disabled | DriveMode::Fault));
        if fresh && off {
            self.on = false;
        }
    }

    fn controlword(
        &mut self,
        now_s: f64,
        enable: bool,
        fault_reset: bool,
        power: Option<PowerState>,
        cia402: &Cia402,
    ) -> u16 {
        if enable && self.stage == SetupStage::Running {
            return power.map_or(Controlword::DISABLE_VOLTAGE, PowerState::controlword_on);
        }
        let fault = power == Some(PowerState::Fault);
        self.reset = match self.reset {
            _ if !fault_reset => Reset::Left,
            Reset::Left | Reset::Commanded if fault => Reset::Commanded,
            Reset::Commanded => Reset::Used,
            reset => reset,
        };
        let off_s = self.off_since_s.map_or(0.0, |since_s| now_s - since_s);
        if self.reset == Reset::Commanded {
            Controlword::FAULT_RESET
        } else if off_s <= cia402.quick_stop_time_s {
            Controlword::QUICK_STOP
        } else {
            // Leaves a quick stop that the drive would hold.
            Controlword::DISABLE_VOLTAGE
        }
    }

    /// Sends what belongs to the setup, or stops the node.
    fn manage<E>(
        &mut self,
        now_s: f64,
        drive: usize,
        node: &NodeReading,
        cia402: &Cia402,
        mut report: impl FnMut(DriveEvent),
        send: &mut impl FnMut(&Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        match self.stage {
            SetupStage::Waiting { until_s } => {
                if now_s >= until_s {
                    send(&NmtCommand::EnterPreOperational.frame(self.node))?;
                    self.stage = SetupStage::Writing {
                        object: 0,
                        requested: None,
                    };
                }
            }
            SetupStage::Writing { object, requested } => {
                let setup = &cia402.setup[drive];
                let mut next = object;
                if let (Some((requested_s, answers)), Some(request)) =
                    (requested, setup.get(object))
                {
                    let (index, sub) = (request.object, request.sub);
                    let answer = node.answer_to(request, answers);
                    let late = !(..=cia402.answer_time_s).contains(&(now_s - requested_s));
                    let fault = match answer.map(|answer| answer.result) {
                        Some(Ok(read)) if read == request.expected => None,
                        Some(Ok(read)) => Some(SetupFault::Differs {
                            object: index,
                            sub,
                            written: request.expected.unwrap_or(0),
                            read: read.unwrap_or(0),
                        }),
                        Some(Err(code)) => Some(SetupFault::Refused {
                            object: index,
                            sub,
                            code,
                        }),
                        None if late => Some(SetupFault::Silent { object: index, sub }),
                        None => return Ok(()),
                    };
                    if let Some(fault) = fault {
                        if self.failed.replace(fault) != Some(fault) {
                            report(DriveEvent::SetupFailed(fault));
                        }
                        self.stage = SetupStage::Waiting {
                            until_s: now_s + RETRY_S,
                        };
                        return Ok(());
                    }
                    next += 1;
                }
                if let Some(request) = setup.get(next) {
                    send(&request.frame)?;
                    self.stage = SetupStage::Writing {
                        object: next,
                        requested: Some((now_s, node.answers.count())),
                    };
                } else {
                    send(&NmtCommand::Start.frame(self.node))?;
                    self.stage = SetupStage::Running;
                    self.failed = None;
                    self.off_since_s = self.off_since_s.map(|_| now_s);
                    self.stop_reported = false;
                    self.mode = ModeWatch::default();
                    report(DriveEvent::Ready);
                    if !cia402.deadline[drive] {
                        report(DriveEvent::NoDeadline);
                    }
                }
            }
            SetupStage::Running => {
                let off_s = self.off_since_s.map_or(0.0, |since_s| now_s - since_s);
                let nmt = node.nmt.map(|nmt| nmt.value);
                // There CiA 402 lets a drive follow its last target for ever; a stop it must react to (0x6007).
                let deaf = nmt == Some(NmtState::PreOperational);
                let late = off_s > 2.0 * cia402.quick_stop_time_s;
                // It was off, or has been told for long enough since its setup.
                let by_another = !self.on && self.seen_on && off_s > cia402.quick_stop_time_s;
                let must_stop = by_another || (self.on && (deaf || late));
                if must_stop && nmt != Some(NmtState::Stopped) {
                    send(&NmtCommand::Stop.frame(self.node))?;
                    if !self.stop_reported {
                        self.stop_reported = true;
                        report(match (by_another, deaf) {
                            (true, _) => DriveEvent::SwitchedOnByAnother,
                            (false, true) => DriveEvent::LeftOperational,
                            (false, false) => DriveEvent::NodeStopped,
                        });
                    }
                }
                if self.seen_on && nmt == Some(NmtState::Operational) {
                    let mode = (self.node, cia402.mode[drive]);
                    let answer_s = cia402.answer_time_s;
                    self.mode.watch(now_s, node, mode, answer_s, report, send)?;
                } else {
                    self.mode.requested = None;
                }
            }
        }
        Ok(())
    }
}
