//! Between the cycle and whoever gives it paths: orders one way, what has become of them the other.
//!
//! ```text
//! Dispatcher -> CycleDesk (arm, stop, halt), PilotDesk (paths)
//! Dispatcher <- CycleDesk (rows, reasons),   PilotDesk (decisions, plans)
//! ```
//!
//! No side waits for another: orders are flags and the newest path, answers are the newest of their
//! kind.

use crate::cycle::{Cycle, Timing};
use crate::pilot::Pilot;
use crate::port::Port;
use crate::record::CycleRow;
use crate::safety::{Operator, Reason, State, StopCause};
use sidehill_controller::controller::{Controller, Decision};
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::frames::PlanarPose;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use triple_buffer::{Input, Output, TripleBuffer, triple_buffer};

/// A path for the controller.
pub struct Assignment {
    /// Number under which decisions on it come back; above 0.
    pub number: u64,
    /// What is followed.
    pub trajectory: Trajectory,
    /// Arc length at which it is taken up, m.
    pub from_m: f64,
}

/// A cause of a stop, or none, that threads share.
#[derive(Debug, Default)]
pub struct SharedCause(AtomicU8);

impl SharedCause {
    /// Says that there is a cause, or that there is none any more.
    pub fn set(&self, cause: Option<StopCause>) {
        let code = cause.map_or(0, |cause| cause as u8 + 1);
        self.0.store(code, Ordering::Relaxed);
    }

    /// Returns the cause.
    pub fn get(&self) -> Option<StopCause> {
        let index = usize::from(self.0.load(Ordering::Relaxed)).checked_sub(1)?;
        // Whatever is there stops.
        Some(StopCause::ALL[index.min(StopCause::ALL.len() - 1)])
    }
}

/// What the cycle is asked for.
#[derive(Default)]
struct Asked {
    /// Number of the newest arming asked for; 0 for none.
    arm: AtomicU64,
    stop: SharedCause,
    halt: SharedCause,
}

/// What the cycle says of itself.
#[derive(Debug, Clone, Copy)]
pub struct CycleView {
    /// The newest cycle.
    pub row: CycleRow,
    /// Number of the newest arming that was asked for and carried out.
    pub armed: u64,
    /// Why the last drive or handshake ended.
    pub stopped_by: Option<Reason>,
    /// How well the cycle keeps its times.
    pub timing: Timing,
}

/// What the controller says of itself.
#[derive(Debug, Clone, Default)]
pub struct PilotView {
    /// The newest decision.
    pub decision: Option<Decision>,
    /// Predicted poses, the present first; empty without a plan.
    pub plan: Vec<PlanarPose>,
    /// Where the reference is over the same time.
    pub reference: Vec<PlanarPose>,
}

/// Returns the three ends; the controller's horizon has at most `stages`.
pub fn desks(stages: usize) -> (Dispatcher, CycleDesk, PilotDesk) {
    let asked = Arc::new(Asked::default());
    let (cycle_view, cycle) = triple_buffer(&None::<CycleView>);
    // A clone of an empty vector has no capacity: the first cycles give each buffer its own.
    let (pilot_view, pilot) = triple_buffer(&PilotView::default());
    let (assignments, paths) = TripleBuffer::default().split();
    (
        Dispatcher {
            asked: Arc::clone(&asked),
            assignments,
            cycle,
            pilot,
        },
        CycleDesk {
            asked,
            view: cycle_view,
            asking: 0,
            armed: 0,
        },
        PilotDesk {
            paths,
            view: pilot_view,
            stages,
        },
    )
}

/// Who gives paths and orders.
pub struct Dispatcher {
    asked: Arc<Asked>,
    assignments: Input<Option<Assignment>>,
    cycle: Output<Option<CycleView>>,
    pilot: Output<PilotView>,
}

/// Halts the cycle from any thread.
#[derive(Clone)]
pub struct Brake(Arc<Asked>);

impl Brake {
    /// Keeps the drives at zero and off as long as there is a cause.
    pub fn set(&self, cause: Option<StopCause>) {
        self.0.halt.set(cause);
    }
}

impl Dispatcher {
    /// Gives the controller a path instead of the one it has, or none.
    pub fn assign(&mut self, assignment: Option<Assignment>) {
        self.assignments.write(assignment);
    }

    /// Asks to arm as soon as the safety lets itself be armed; [`CycleView::armed`] then has this
    /// number. 0 takes the wish back.
    pub fn arm(&self, number: u64) {
        self.asked.arm.store(number, Ordering::Relaxed);
    }

    /// Asks to stop on the ramp and to stay so as long as there is a cause.
    pub fn stop(&self, cause: Option<StopCause>) {
        self.asked.stop.set(cause);
    }

    /// Returns the brake.
    pub fn brake(&self) -> Brake {
        Brake(Arc::clone(&self.asked))
    }

    /// Returns the newest of the cycle.
    pub fn cycle(&mut self) -> Option<CycleView> {
        *self.cycle.read()
    }

    /// Returns the newest of the controller.
    pub fn pilot(&mut self) -> &PilotView {
        self.pilot.read()
    }
}

/// The cycle's end.
pub struct CycleDesk {
    asked: Arc<Asked>,
    view: Input<Option<CycleView>>,
    /// Arming asked for in this cycle; 0 for none.
    asking: u64,
    armed: u64,
}

impl CycleDesk {
    /// Returns what `operator` asks for and what is asked for here, for a cycle that begins in
    /// `state`.
    pub fn operator(&mut self, operator: Operator, state: State) -> Operator {
        let stop = operator.stop.or(self.asked.stop.get());
        let halt = operator.halt.or(self.asked.halt.get());
        let wish = self.asked.arm.load(Ordering::Relaxed);
        let off = matches!(state, State::Disarmed | State::Latched);
        // The safety arms on a rising edge: where it did not, the wish falls before it rises again.
        let free = stop.or(halt).is_none();
        let arm = wish > self.armed && off && free && self.asking == 0;
        self.asking = if arm { wish } else { 0 };
        Operator {
            arm: operator.arm || arm,
            stop,
            halt,
        }
    }

    /// Leaves what a cycle did.
    pub fn leave<P: Port, Q: Pilot>(&mut self, row: CycleRow, cycle: &Cycle<P, Q>) {
        if self.asking > 0 && row.state == State::Zeroing {
            self.armed = self.asking;
        }
        self.view.write(Some(CycleView {
            row,
            armed: self.armed,
            stopped_by: cycle.stopped_by(),
            timing: cycle.timing(),
        }));
    }
}

/// The controller's end.
pub struct PilotDesk {
    paths: Output<Option<Assignment>>,
    view: Input<PilotView>,
    stages: usize,
}

impl PilotDesk {
    /// Gives the controller the newest path, where one has come, or takes away the one it has.
    pub fn take_path(&mut self, controller: &mut Controller) {
        if !self.paths.update() {
            return;
        }
        match self.paths.output_buffer_mut().take() {
            Some(path) => {
                let reference = controller
                    .config()
                    .reference(path.trajectory)
                    .starting_at(path.from_m)
                    .numbered(path.number);
                controller.follow(reference);
            }
            None => controller.forget_path(),
        }
    }

    /// Leaves what a cycle decided.
    pub fn leave(&mut self, decision: &Decision, controller: &Controller) {
        let view = self.view.input_buffer_mut();
        view.decision = Some(*decision);
        view.plan.clear();
        view.plan.reserve_exact(self.stages + 1);
        if let Some(plan) = controller.plan() {
            view.plan.extend(plan.states.iter().map(|state| PlanarPose {
                x_m: state.x,
                y_m: state.y,
                yaw_rad: state.z,
            }));
        }
        view.reference.clear();
        view.reference.reserve_exact(self.stages + 1);
        let targets = controller.targets().iter().map(|target| target.pose);
        view.reference.extend(targets);
        self.view.publish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDLE: Operator = Operator {
        arm: false,
        stop: None,
        halt: None,
    };

    #[test]
    fn an_arming_is_asked_for_until_the_safety_takes_it_and_only_where_it_can() {
        let (dispatcher, mut desk, _pilot) = desks(10);
        assert_eq!(desk.operator(IDLE, State::Disarmed), IDLE);
        dispatcher.arm(3);
        for state in [State::Zeroing, State::Driving, State::Stopping] {
            assert!(!desk.operator(IDLE, state).arm);
        }
        // It falls where it was not taken, so that it can rise again.
        let asked: Vec<bool> = (0..4)
            .map(|_| desk.operator(IDLE, State::Latched).arm)
            .collect();
        assert_eq!(asked, [true, false, true, false]);
        dispatcher.arm(0);
        assert!(!desk.operator(IDLE, State::Latched).arm);
    }

    #[test]
    fn a_stop_or_a_halt_forbids_to_arm() {
        let (dispatcher, mut desk, _pilot) = desks(10);
        dispatcher.arm(1);
        dispatcher.stop(Some(StopCause::Cancelled));
        let asked = desk.operator(IDLE, State::Latched);
        let cancelled = Operator {
            stop: Some(StopCause::Cancelled),
            ..IDLE
        };
        assert_eq!(asked, cancelled);
        dispatcher.stop(None);
        dispatcher.brake().set(Some(StopCause::EmergencyStop));
        let asked = desk.operator(IDLE, State::Latched);
        let pressed = Operator {
            halt: Some(StopCause::EmergencyStop),
            ..IDLE
        };
        assert_eq!(asked, pressed);
        dispatcher.brake().set(None);
        assert!(desk.operator(IDLE, State::Latched).arm);
        // What an operator asks for on his own is kept.
        let own = Operator {
            stop: Some(StopCause::Operator),
            ..IDLE
        };
        assert_eq!(desk.operator(own, State::Driving).stop, own.stop);
    }

    #[test]
    fn every_cause_comes_as_it_went() {
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
