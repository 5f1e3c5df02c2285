//! The command channel between the loop and the client that gives it paths.
//!
//! ```text
//! CommandClient -> LoopEnd (arm, stop, halt),  ControllerEnd (paths)
//! CommandClient <- LoopEnd (rows, reasons),    ControllerEnd (decisions, plans)
//! ```
//!
//! No end waits for another: requests are flags and the newest path, answers are the newest of their
//! kind.

use super::record::CycleRow;
use super::tap::{PathLog, PathRecord, PlanView, RecordedPath};
use super::timing::LoopTiming;
use crate::safety::{OperatorRequests, Reason, SafetyState, StopCause};
use sidehill_controller::controller::{Controller, Decision, DriveResponse};
use sidehill_controller::reference::Reference;
use sidehill_controller::trajectory::Trajectory;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use triple_buffer::{Input, Output, TripleBuffer, triple_buffer};

/// A path for the controller.
pub struct PathCommand {
    /// Number that decisions on this path carry; above 0.
    pub number: u64,
    /// What is followed.
    pub trajectory: Trajectory,
    /// Arc length at which the vehicle joins it, m.
    pub from_m: f64,
}

/// A cause of a stop, or none, that threads share.
#[derive(Debug, Default)]
pub struct SharedCause(AtomicU8);

impl SharedCause {
    /// Sets or clears the cause.
    pub fn set(&self, cause: Option<StopCause>) {
        let code = cause.map_or(0, |cause| cause as u8 + 1);
        self.0.store(code, Ordering::Relaxed);
    }

    /// Returns the cause.
    pub fn get(&self) -> Option<StopCause> {
        let index = usize::from(self.0.load(Ordering::Relaxed)).checked_sub(1)?;
        // A code that no cause has still stops.
        StopCause::ALL.get(index).or(StopCause::ALL.last()).copied()
    }
}

/// Requests of the client to the loop.
#[derive(Default)]
struct LoopRequests {
    /// Number of the newest request to arm; 0 for none.
    arm: AtomicU64,
    stop: SharedCause,
    halt: SharedCause,
}

/// What the loop reports.
#[derive(Debug, Clone, Copy)]
pub struct LoopStatus {
    /// The newest cycle.
    pub row: CycleRow,
    /// Number of the newest request to arm that was carried out.
    pub armed: u64,
    /// Why the last drive or handshake ended.
    pub stopped_by: Option<Reason>,
    /// How well the loop keeps its times.
    pub timing: LoopTiming,
}

/// What the controller reports.
#[derive(Debug, Clone, Default)]
pub struct ControllerStatus {
    /// The newest decision.
    pub decision: Option<Decision>,
    /// How the drives respond, as learned; none before the first decision.
    pub drives: Option<DriveResponse>,
    /// Its newest plan.
    pub view: PlanView,
}

/// Returns the three ends of a new channel. The controller's horizon has at most `stages`.
pub fn command_channel(stages: usize) -> (CommandClient, LoopEnd, ControllerEnd) {
    let requests = Arc::new(LoopRequests::default());
    let (loop_input, loop_status) = triple_buffer(&None::<LoopStatus>);
    // A clone of an empty vector has no capacity: the first cycles allocate that of each buffer.
    let (controller_input, controller_status) = triple_buffer(&ControllerStatus::default());
    let (path_input, path_output) = TripleBuffer::default().split();
    (
        CommandClient {
            requests: Arc::clone(&requests),
            path: path_input,
            serial: 0,
            log: None,
            loop_status,
            controller_status,
        },
        LoopEnd {
            requests,
            status: loop_input,
            arming: 0,
            armed: 0,
        },
        ControllerEnd {
            path: path_output,
            status: controller_input,
            stages,
        },
    )
}

/// The end of the client, which gives paths and requests.
pub struct CommandClient {
    requests: Arc<LoopRequests>,
    path: Input<(u64, Option<PathCommand>)>,
    /// Paths given so far.
    serial: u64,
    log: Option<PathLog>,
    loop_status: Output<Option<LoopStatus>>,
    controller_status: Output<ControllerStatus>,
}

/// Halts the drives from any thread; a clone of part of a [`CommandClient`].
#[derive(Clone)]
pub struct HaltSwitch(Arc<LoopRequests>);

impl HaltSwitch {
    /// Keeps the drives at zero speed and disabled while there is a cause.
    pub fn set(&self, cause: Option<StopCause>) {
        self.0.halt.set(cause);
    }
}

impl CommandClient {
    /// Leaves a copy of each path for a recording.
    pub fn log_paths(&mut self, log: PathLog) {
        self.log = Some(log);
    }

    /// Replaces the controller's path, or removes it.
    pub fn set_path(&mut self, path: Option<PathCommand>) {
        self.serial += 1;
        if let Some(log) = &self.log {
            log.push(PathRecord {
                serial: self.serial,
                path: path.as_ref().map(|path| RecordedPath {
                    trajectory: path.trajectory.clone(),
                    number: path.number,
                    laps: 1,
                    from_m: Some(path.from_m),
                }),
            });
        }
        self.path.write((self.serial, path));
    }

    /// Requests to arm as soon as the safety accepts it. [`LoopStatus::armed`] then has this number.
    /// 0 withdraws the request.
    pub fn arm(&self, number: u64) {
        self.requests.arm.store(number, Ordering::Relaxed);
    }

    /// Requests to stop on the ramp, and to stay stopped while there is a cause.
    pub fn stop(&self, cause: Option<StopCause>) {
        self.requests.stop.set(cause);
    }

    /// Returns a switch that halts the drives.
    pub fn halt_switch(&self) -> HaltSwitch {
        HaltSwitch(Arc::clone(&self.requests))
    }

    /// Returns the newest status of the loop; none before its first cycle.
    pub fn loop_status(&mut self) -> Option<LoopStatus> {
        *self.loop_status.read()
    }

    /// Returns the newest status of the controller.
    pub fn controller_status(&mut self) -> &ControllerStatus {
        self.controller_status.read()
    }
}

/// The loop's end.
pub struct LoopEnd {
    requests: Arc<LoopRequests>,
    status: Input<Option<LoopStatus>>,
    /// Number of the arming requested in this cycle; 0 for none.
    arming: u64,
    armed: u64,
}

impl LoopEnd {
    /// Returns the union of `local` and the client's requests, for a cycle that begins in `state`.
    pub fn merge(&mut self, local: OperatorRequests, state: SafetyState) -> OperatorRequests {
        let stop = local.stop.or(self.requests.stop.get());
        let halt = local.halt.or(self.requests.halt.get());
        let requested = self.requests.arm.load(Ordering::Relaxed);
        let off = matches!(state, SafetyState::Disarmed | SafetyState::Latched);
        let free = stop.or(halt).is_none();
        // The safety arms on a rising edge: after a cycle without effect, the request falls once.
        let arm = requested > self.armed && off && free && self.arming == 0;
        self.arming = if arm { requested } else { 0 };
        OperatorRequests {
            arm: local.arm || arm,
            stop,
            halt,
        }
    }

    /// Publishes the status after a cycle.
    pub fn publish(&mut self, row: CycleRow, stopped_by: Option<Reason>, timing: LoopTiming) {
        if self.arming > 0 && row.state == SafetyState::Zeroing {
            self.armed = self.arming;
        }
        self.status.write(Some(LoopStatus {
            row,
            armed: self.armed,
            stopped_by,
            timing,
        }));
    }
}

/// The controller's end.
pub struct ControllerEnd {
    path: Output<(u64, Option<PathCommand>)>,
    status: Input<ControllerStatus>,
    stages: usize,
}

impl ControllerEnd {
    /// Gives the controller the newest path if one has arrived, or removes the one it has, and
    /// returns its serial; 0 if none has arrived.
    pub fn apply_path(&mut self, controller: &mut Controller) -> u64 {
        if !self.path.update() {
            return 0;
        }
        let (serial, path) = self.path.output_buffer_mut();
        match path.take() {
            Some(path) => {
                let reference = Reference::new(path.trajectory)
                    .starting_at(path.from_m)
                    .numbered(path.number);
                controller.follow(reference);
            }
            None => controller.forget_path(),
        }
        *serial
    }

    /// Publishes the status after a decision at a time, s.
    pub fn publish(&mut self, time_s: f64, decision: &Decision, controller: &Controller) {
        let status = self.status.input_buffer_mut();
        status.decision = Some(*decision);
        status.drives = Some(controller.drive_response());
        status.view.set(time_s, controller, self.stages);
        self.status.publish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDLE: OperatorRequests = OperatorRequests {
        arm: false,
        stop: None,
        halt: None,
    };

    #[test]
    fn a_request_to_arm_is_repeated_until_the_safety_accepts_it() {
        let (client, mut loop_end, _controller) = command_channel(10);
        assert_eq!(loop_end.merge(IDLE, SafetyState::Disarmed), IDLE);
        client.arm(3);
        for state in [
            SafetyState::Zeroing,
            SafetyState::Driving,
            SafetyState::Stopping,
        ] {
            assert!(!loop_end.merge(IDLE, state).arm);
        }
        // It falls after a cycle without effect, so that it can rise again.
        let requested: Vec<bool> = (0..4)
            .map(|_| loop_end.merge(IDLE, SafetyState::Latched).arm)
            .collect();
        assert_eq!(requested, [true, false, true, false]);
        client.arm(0);
        assert!(!loop_end.merge(IDLE, SafetyState::Latched).arm);
    }

    #[test]
    fn a_stop_or_a_halt_prevents_arming() {
        let (client, mut loop_end, _controller) = command_channel(10);
        client.arm(1);
        client.stop(Some(StopCause::Cancelled));
        let merged = loop_end.merge(IDLE, SafetyState::Latched);
        let cancelled = OperatorRequests {
            stop: Some(StopCause::Cancelled),
            ..IDLE
        };
        assert_eq!(merged, cancelled);
        client.stop(None);
        client.halt_switch().set(Some(StopCause::EmergencyStop));
        let merged = loop_end.merge(IDLE, SafetyState::Latched);
        let pressed = OperatorRequests {
            halt: Some(StopCause::EmergencyStop),
            ..IDLE
        };
        assert_eq!(merged, pressed);
        client.halt_switch().set(None);
        assert!(loop_end.merge(IDLE, SafetyState::Latched).arm);
        // A local request is kept.
        let own = OperatorRequests {
            stop: Some(StopCause::Operator),
            ..IDLE
        };
        assert_eq!(loop_end.merge(own, SafetyState::Driving).stop, own.stop);
    }

    #[test]
    fn every_cause_is_shared_unchanged() {
        let shared = SharedCause::default();
        assert_eq!(shared.get(), None);
        for cause in StopCause::ALL {
            shared.set(Some(cause));
            assert_eq!(shared.get(), Some(cause));
        }
        shared.set(None);
        assert_eq!(shared.get(), None);
    }
}
