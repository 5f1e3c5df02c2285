use crate::cia402::node::{NmtCommand, NmtState, NodeReading, SYNC};
use crate::cia402::{Cia402, Controlword, DriveEvent, NodeId, PowerState, SetupFault};
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
    drives: [Drive; 2],
}

impl Master {
    /// Returns a master that has yet to set its drives up.
    pub fn new(layout: Arc<Layout>, cia402: Cia402) -> Self {
        let drives = cia402.nodes.map(Drive::new);
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
        if self.drives[drive].stage != Stage::Running {
            return None;
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
enum Stage {
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

/// Resets of a fault that one arming has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reset {
    Left,
    Commanded,
    Used,
}

#[derive(Debug, Clone)]
struct Drive {
    node: NodeId,
    stage: Stage,
    boots: u32,
    emergencies: u32,
    failed: Option<SetupFault>,
    off_since_s: Option<f64>,
    /// Commanded to be on, and not reported off since.
    on: bool,
    stop_reported: bool,
    reset: Reset,
    arming: bool,
}

impl Drive {
    fn new(node: NodeId) -> Self {
        Self {
            node,
            stage: Stage::Waiting {
                until_s: f64::NEG_INFINITY,
            },
            boots: 0,
            emergencies: 0,
            failed: None,
            off_since_s: None,
            on: false,
            stop_reported: false,
            reset: Reset::Left,
            arming: false,
        }
    }

    /// Begins the setup of a drive that has started or, when an operator arms, of one whose node is not
    /// operational.
    fn notice(
        &mut self,
        now_s: f64,
        node: &NodeReading,
        fault_reset: bool,
        mut report: impl FnMut(DriveEvent),
    ) {
        if node.emergencies != self.emergencies {
            self.emergencies = node.emergencies;
            if let Some(emergency) = node.emergency {
                report(DriveEvent::Emergency(emergency));
            }
        }
        let armed = fault_reset && !self.arming;
        self.arming = fault_reset;
        let idle = self.stage == Stage::Running
            && node
                .nmt
                .is_some_and(|nmt| nmt.value != NmtState::Operational);
        let started = node.boots != self.boots;
        if started {
            self.boots = node.boots;
            report(DriveEvent::Started);
        }
        if started || (armed && idle) {
            self.stage = Stage::Waiting { until_s: now_s };
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
        if enable {
            self.off_since_s = None;
            self.on = true;
            self.stop_reported = false;
            return;
        }
        self.off_since_s.get_or_insert(now_s);
        let fresh = report_s.is_some_and(|report_s| now_s - report_s <= cia402.quick_stop_time_s);
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
        if enable && self.stage == Stage::Running {
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
            Stage::Waiting { until_s } => {
                if now_s >= until_s {
                    send(&NmtCommand::EnterPreOperational.frame(self.node))?;
                    self.stage = Stage::Writing {
                        object: 0,
                        requested: None,
                    };
                }
            }
            Stage::Writing { object, requested } => {
                let setup = &cia402.setup[drive];
                let mut next = object;
                if let (Some((requested_s, answers)), Some((value, _))) =
                    (requested, setup.get(object))
                {
                    let (index, sub) = (value.object, value.sub);
                    let answer = node.answer.filter(|answer| {
                        node.answers != answers && (answer.object, answer.sub) == (index, sub)
                    });
                    let late = !(..=cia402.answer_time_s).contains(&(now_s - requested_s));
                    let fault = match answer.map(|answer| answer.result) {
                        Some(Ok(())) => None,
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
                        self.stage = Stage::Waiting {
                            until_s: now_s + RETRY_S,
                        };
                        return Ok(());
                    }
                    next += 1;
                }
                if let Some((_, frame)) = setup.get(next) {
                    send(frame)?;
                    self.stage = Stage::Writing {
                        object: next,
                        requested: Some((now_s, node.answers)),
                    };
                } else {
                    send(&NmtCommand::Start.frame(self.node))?;
                    self.stage = Stage::Running;
                    self.failed = None;
                    report(DriveEvent::Ready);
                }
            }
            Stage::Running => {
                let off_s = self.off_since_s.map_or(0.0, |since_s| now_s - since_s);
                let nmt = node.nmt.map(|nmt| nmt.value);
                // There CiA 402 lets a drive follow its last target for ever; a stop it must react to (0x6007).
                let deaf = nmt == Some(NmtState::PreOperational);
                let late = off_s > 2.0 * cia402.quick_stop_time_s;
                if self.on && nmt != Some(NmtState::Stopped) && (deaf || late) {
                    send(&NmtCommand::Stop.frame(self.node))?;
                    if !self.stop_reported {
                        self.stop_reported = true;
                        report(if deaf {
                            DriveEvent::LeftOperational
                        } else {
                            DriveEvent::NodeStopped
                        });
                    }
                }
            }
        }
        Ok(())
    }
}
