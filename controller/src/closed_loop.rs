//! A controller that drives a plant, cycle by cycle, and how well it does.

mod figures;
mod own_law;

pub use figures::{Account, LapFigures, TrackingErrors, TrackingFigures};
pub use own_law::OwnLaw;

use crate::clock::Instant;
use crate::config::ControllerConfig;
use crate::controller::{Controller, Decision, Status, StopReason};
use crate::path::Point2;
use crate::reference::Reference;
use crate::tracked_point::TrackedPoint;
use crate::trajectory::ReferencePoint;
use sidehill_plant::sample::Sample;
use sidehill_plant::simulation::{Plant, TrueState};
use sidehill_plant::speeds::MotorSpeeds;
use std::time::Duration;

/// What drives a plant: a [`Controller`], or a law of the user's own ([`OwnLaw`]).
pub trait Driver {
    /// Decides on the command from this sample's time until the next.
    fn step(&mut self, sample: &Sample) -> Decision;

    /// Returns the reference and how far it has been followed; none without a path.
    fn reference(&self) -> Option<&Reference>;

    /// Returns the settings.
    fn config(&self) -> &ControllerConfig;

    /// Returns the point of the vehicle that follows the reference: the one configured, on a turn on the
    /// spot the origin.
    fn tracked_point(&self) -> TrackedPoint {
        let path = self.reference().and_then(Reference::path);
        self.config().tracked_point.along(path)
    }
}

impl Driver for Controller {
    fn step(&mut self, sample: &Sample) -> Decision {
        Self::step(self, sample, None)
    }

    fn reference(&self) -> Option<&Reference> {
        Self::reference(self)
    }

    fn config(&self) -> &ControllerConfig {
        Self::config(self)
    }
}

/// A controller and the plant it drives.
pub struct ClosedLoop<P, C = Controller> {
    plant: P,
    controller: C,
    steps_per_cycle: u32,
    give_up_s: f64,
    /// Where the reference is in this cycle.
    reference: ReferencePoint,
    command: MotorSpeeds,
    account: Account,
}

/// One control cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cycle {
    /// What was true when the sensors were read.
    pub state: TrueState,
    /// What they read.
    pub sample: Sample,
    /// Where the vehicle should have been.
    pub reference: ReferencePoint,
    /// Where its tracked point was, where that is not the origin.
    pub tracked: Option<Point2>,
    /// How far it was from there.
    pub errors: TrackingErrors,
    /// What the controller decided.
    pub decision: Decision,
    /// Time the controller took.
    pub duration: Duration,
    /// Share of the reference that has been followed, 0 to 1.
    pub progress: f64,
    /// Why this cycle is the last; the plant no longer moves.
    pub ending: Option<RunEnd>,
}

/// Why a closed loop ended.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RunEnd {
    /// The reference has been followed to its end.
    #[error("finished")]
    Finished,
    /// The controller has stopped the vehicle.
    #[error("{0}")]
    Stopped(StopReason),
    /// The reference takes far longer than it should.
    #[error("not at the end after {after_s:.0} s")]
    TimedOut {
        /// Time allowed, s.
        after_s: f64,
    },
}

/// Why a controller and a plant cannot be combined into a loop.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ClosedLoopError {
    /// The controller has nothing to follow.
    #[error("there is nothing to follow")]
    NoReference,
    /// The control period is not a whole number of the plant's steps.
    #[error("the control period of {period_s} s is not a whole number of steps of {step_s} s")]
    Steps {
        /// Control period, s.
        period_s: f64,
        /// The plant's step, s.
        step_s: f64,
    },
}

impl<P: Plant, C: Driver> ClosedLoop<P, C> {
    /// Returns the loop of a plant and a controller that has something to follow.
    ///
    /// # Errors
    /// [`ClosedLoopError`] where they do not fit.
    pub fn new(plant: P, controller: C) -> Result<Self, ClosedLoopError> {
        let reference = controller.reference().ok_or(ClosedLoopError::NoReference)?;
        let (period_s, step_s) = (controller.config().period_s, plant.step_s());
        let steps = period_s / step_s;
        if !(steps.round() >= 1.0 && (steps - steps.round()).abs() <= 1e-6) {
            return Err(ClosedLoopError::Steps { period_s, step_s });
        }
        Ok(Self {
            account: Account::new(reference, controller.config()),
            give_up_s: 10.0 * reference.end_s() + 60.0,
            reference: reference.ahead(0.0),
            command: MotorSpeeds::STOP,
            steps_per_cycle: steps.round() as u32,
            plant,
            controller,
        })
    }

    /// Runs until the controller has finished or stopped; `each` sees every cycle.
    ///
    /// # Errors
    /// The plant's, where it cannot go on.
    pub fn run(&mut self, mut each: impl FnMut(&Cycle)) -> Result<RunEnd, P::Error> {
        loop {
            let cycle = self.decide();
            each(&cycle);
            if let Some(ending) = cycle.ending {
                return Ok(ending);
            }
            self.advance()?;
        }
    }

    /// Reads the sensors and decides on the command until the next cycle.
    pub fn decide(&mut self) -> Cycle {
        let state = self.plant.state();
        let sample = self.plant.sample();
        let begin = Instant::now();
        let decision = self.controller.step(&sample);
        let duration = begin.elapsed();
        let mut progress = 0.0;
        if let Some(reference) = self.controller.reference() {
            self.reference = reference.ahead(0.0);
            progress = (reference.time_s() / reference.end_s()).min(1.0);
        }
        self.command = decision.command_effective;
        let path = self.controller.reference().and_then(Reference::path);
        let errors = self
            .account
            .cycle(path, &state, &self.reference, self.command);
        self.account.judge(decision.status, duration);
        let point = self.controller.tracked_point();
        let tracked = (!point.is_origin()).then(|| figures::tracked_position(&point, &state));
        let ending = match decision.status {
            Status::Finished => Some(RunEnd::Finished),
            Status::Stopping(reason) if self.command == MotorSpeeds::STOP => {
                Some(RunEnd::Stopped(reason))
            }
            _ if state.time_s > self.give_up_s => Some(RunEnd::TimedOut {
                after_s: self.give_up_s,
            }),
            _ => None,
        };
        Cycle {
            state,
            sample,
            reference: self.reference,
            tracked,
            errors,
            decision,
            duration,
            progress,
            ending,
        }
    }

    /// Moves the plant on to the next cycle under the last command.
    ///
    /// # Errors
    /// The plant's, where it cannot go on.
    pub fn advance(&mut self) -> Result<(), P::Error> {
        let path = self.controller.reference().and_then(Reference::path);
        for _ in 0..self.steps_per_cycle {
            let state = self.plant.step(self.command)?;
            self.account.step(path, &state, &self.reference);
        }
        Ok(())
    }

    /// Returns how well the reference has been followed so far.
    pub fn figures(&self) -> TrackingFigures {
        self.account
            .figures(self.controller.reference(), &self.reference)
    }

    /// Returns how well each lap of a periodic course has been driven so far.
    pub fn laps(&self) -> &[LapFigures] {
        self.account.laps()
    }

    /// Returns the plant.
    pub fn plant(&self) -> &P {
        &self.plant
    }

    /// Returns the plant, which a test or a hand may change between two cycles.
    pub fn plant_mut(&mut self) -> &mut P {
        &mut self.plant
    }

    /// Returns the controller.
    pub fn controller(&self) -> &C {
        &self.controller
    }
}
