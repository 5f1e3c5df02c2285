//! The controller: from a sample of the sensors to a command, once a cycle.
//!
//! ```text
//! Sample -> Estimate -> Horizon -> Linearised -> Solution -> Decision
//! ```

mod ahead;
mod decision;
mod drives;
mod horizon;
mod issued;
mod learning;
mod parts;
mod predictions;
mod supervision;
mod walk;
mod watchdog;

pub use decision::{Decision, Stall, Status, StopReason};
pub use drives::{DriveResponse, LearnedMotor};
pub use parts::ControllerError;
pub use predictions::{AHEAD_S, Ahead};

use crate::clock::Instant;
use crate::config::{ControllerConfig, ControllerKind};
use crate::estimator::{Estimate, Estimator};
use crate::guard::Guard;
use crate::memory::Memory;
use crate::mpc::{ExtraError, ExtraTerms, Horizon, Mpc, Plan, QpFailure, Solution, StageTarget};
use crate::pure_pursuit::PursuitView;
use crate::reference::{Progress, Reference};
use crate::tracked_point::TrackedPoint;
use drives::Drives;
use issued::IssuedCommands;
use parts::{Law, Parts, guard, owner};
use predictions::Predictions;
use sidehill_plant::contact::BodyState;
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;
use watchdog::{DigWatch, Watchdog};

/// What the cycle before left behind.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Driving { fallback_cycles: u32 },
    Stopped(StopReason),
    Finished,
}

/// Largest distance between the ends of the horizons of two references for which the plan made for
/// the first is taken up for the second, m.
const PLAN_REUSE_M: f64 = 0.5;

/// Follows a reference; one [`Controller::step`] a control period.
#[derive(Clone)]
pub struct Controller {
    config: ControllerConfig,
    /// The vehicle as the control law models it.
    vehicle: Vehicle,
    /// Map for the preview of the attitude.
    terrain: Option<Terrain>,
    estimator: Estimator,
    /// None without a path: then there is no cross-track error and no reason to drive.
    reference: Option<Reference>,
    law: Law,
    /// Whether the law predicts with what the estimator learns.
    adapts: bool,
    horizon: Horizon,
    phase: Phase,
    watchdog: Watchdog,
    dig: DigWatch,
    guard: Option<Guard>,
    memory: Option<Memory>,
    /// Name and number of vehicle and kind, which identify what was learned.
    owner: String,
    issued: IssuedCommands,
    /// The drives as they respond.
    drives: Drives,
    predictions: Predictions,
    /// What a way like that of the plans until now costs: their errors and slowness over what they drive of the path.
    way_cost_per_m: f64,
    last_time_s: Option<f64>,
}

impl Controller {
    /// Returns a controller for `vehicle` that has nothing to follow until [`Controller::follow`]:
    /// the vehicle stands, and each cycle has an estimate and no progress.
    ///
    /// # Errors
    /// [`ControllerError`] for settings out of range.
    pub fn new(
        kind: ControllerKind,
        config: ControllerConfig,
        vehicle: &Vehicle,
    ) -> Result<Self, ControllerError> {
        config.validate()?;
        let guard = guard(&config, vehicle)?;
        let memory = config.memory.map(Memory::new);
        let owner = owner(vehicle, kind);
        let Parts {
            vehicle,
            mut estimator,
            law,
            adapts,
        } = Parts::of(kind, &config, vehicle)?;
        estimator.keep_learned(config.memory.is_some_and(|memory| memory.keep_gains));
        let half_track_m = 0.5 * (vehicle.icrs.right_m - vehicle.icrs.left_m);
        Ok(Self {
            estimator,
            reference: None,
            horizon: Horizon {
                start: Default::default(),
                moving: BodyState::default(),
                previous: MotorSpeeds::STOP,
                change_weights: config.weights.changes(),
                half_track_m,
                targets: Vec::with_capacity(config.stages),
            },
            issued: IssuedCommands::new(config.period_s),
            drives: Drives::new(&config),
            predictions: Predictions::new(config.period_s),
            watchdog: Watchdog::new(
                &config.supervisor,
                config.limits,
                half_track_m,
                config.period_s,
            ),
            dig: DigWatch::new(&config.estimator, half_track_m),
            phase: Phase::Driving { fallback_cycles: 0 },
            way_cost_per_m: 0.0,
            last_time_s: None,
            adapts,
            guard,
            memory,
            owner,
            law,
            terrain: None,
            vehicle,
            config,
        })
    }

    /// Returns this controller with a map of the ground, from which it takes the attitude along the
    /// horizon where [`AttitudePreview::Terrain`](crate::config::AttitudePreview::Terrain) is set.
    pub fn with_terrain(self, terrain: Terrain) -> Self {
        Self {
            terrain: Some(terrain),
            ..self
        }
    }

    /// Returns the settings.
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// Returns the reference and how far it has been followed; none without a path.
    pub fn reference(&self) -> Option<&Reference> {
        self.reference.as_ref()
    }

    /// Returns the plan of the last cycle, where the law makes one.
    pub fn plan(&self) -> Option<&Plan> {
        match &self.law {
            Law::Mpc(mpc) => mpc.plan(),
            Law::PurePursuit => None,
        }
    }

    /// Returns the law's model-predictive controller, where it is one.
    pub fn mpc(&self) -> Option<&Mpc> {
        match &self.law {
            Law::Mpc(mpc) => Some(mpc),
            Law::PurePursuit => None,
        }
    }

    /// Returns the point of the vehicle that follows the reference: the one configured, on a turn on the
    /// spot the origin.
    pub fn tracked_point(&self) -> TrackedPoint {
        let reference = self.reference.as_ref();
        self.config
            .tracked_point
            .along(reference.and_then(Reference::path))
    }

    /// Returns the targets of the horizon of the last cycle; none of a law without a horizon.
    pub fn targets(&self) -> &[StageTarget] {
        &self.horizon.targets
    }

    /// Follows `reference` from the next cycle on. The estimate and the commands in flight stay; a
    /// stopped controller stays stopped, one that had finished drives again.
    pub fn follow(&mut self, reference: Reference) {
        let next = reference;
        // A plan that leads elsewhere is a bad point to linearise about.
        let horizon_s = self.config.delay_s() + self.config.mpc().stage_times().duration_s();
        let new = next.ahead(horizon_s).position;
        let near = self
            .reference
            .as_ref()
            .is_some_and(|old| old.ahead(horizon_s).position.distance_m(&new) <= PLAN_REUSE_M);
        if !near {
            self.discard_plan();
        }
        if self.phase == Phase::Finished {
            self.phase = Phase::Driving { fallback_cycles: 0 };
        }
        self.reference = Some(next);
        self.predictions.drop_pending();
        self.watchdog.reset();
    }

    /// Adds terms to the cost and the constraints of the plan from the next cycle on, in place of those added before, or
    /// removes these. They stay in force through stops and new references. A cycle in which no plan meets the constraints
    /// is one without a solution: [`Status::Fallback`], then a stop with [`StopReason::NoSolution`]. Allocates.
    ///
    /// # Errors
    /// [`ExtraError`] of a law that does not plan, for terms of another number of stages, and where the solver does not
    /// take the problem; the terms in force stay.
    pub fn set_extra_terms(&mut self, terms: Option<ExtraTerms>) -> Result<(), ExtraError> {
        match &mut self.law {
            Law::Mpc(mpc) => mpc.set_extra_terms(terms),
            Law::PurePursuit => Err(ExtraError::NoPlan),
        }
    }

    /// Drops the reference from the next cycle on: a moving vehicle is stopped.
    pub fn forget_path(&mut self) {
        self.reference = None;
        self.horizon.targets.clear();
        self.discard_plan();
    }

    /// Decides on the command from this cycle's time until the next; `deadline` ends a solve.
    ///
    /// Total: in every case of doubt it makes a controlled stop, with a [`Status`] that says why.
    pub fn step(&mut self, sample: &Sample, deadline: Option<Instant>) -> Decision {
        self.step_within(sample, deadline, None)
    }

    /// Repeats a recorded [`Controller::step`] exactly: its solves end where the deadline ended those
    /// of the original, which [`Controller::was_cut_at`] returned after it.
    pub fn repeat_step(&mut self, sample: &Sample, cut_at: Option<u32>) -> Decision {
        self.step_within(sample, None, cut_at)
    }

    /// Returns which look at the deadline, counted from 0, ended a solve of the last cycle; none where
    /// the deadline ended none.
    pub fn was_cut_at(&self) -> Option<u32> {
        self.mpc().and_then(Mpc::was_cut_at)
    }

    fn step_within(
        &mut self,
        sample: &Sample,
        deadline: Option<Instant>,
        cut_at: Option<u32>,
    ) -> Decision {
        if let Law::Mpc(mpc) = &mut self.law {
            mpc.begin_cycle(cut_at);
        }
        let elapsed_s = self.elapsed(sample.time_s);
        let (estimate, refused) = self.estimator.update(sample);
        // Speeds that have not arrived yet are waited for, as poses and attitudes are; only those that end are stale.
        let estimate = estimate.filter(|estimate| estimate.speeds_age_s.is_finite());
        self.learn_drives(estimate.as_ref(), sample);
        let progress = self.advance_reference(estimate.as_ref(), elapsed_s);
        self.watch_slope(estimate.as_ref(), elapsed_s);
        self.supervise(estimate.as_ref(), progress.as_ref());
        self.watch_treads(estimate.as_ref(), sample, elapsed_s);
        let solved = match (self.phase, &estimate, &progress) {
            (Phase::Driving { .. }, Some(estimate), Some(progress)) => {
                self.look_ahead(estimate, progress, elapsed_s, sample);
                Some(match &mut self.law {
                    Law::Mpc(mpc) => mpc.linearise(&self.horizon).assemble().solve(deadline),
                    Law::PurePursuit => Ok(self.pursue(estimate, progress)),
                })
            }
            _ => None,
        };
        let ahead = match (&solved, &estimate, &progress) {
            (Some(Ok(_)), Some(estimate), Some(progress)) => {
                self.see_ahead(estimate, progress, elapsed_s)
            }
            _ => {
                self.predictions.drop_pending();
                None
            }
        };
        let slowed = self.slowed_share(estimate.as_ref());
        let (status, command_effective) = self.conclude(solved, slowed);
        self.issued.push(sample.time_s, command_effective);
        Decision {
            time_s: sample.time_s,
            command_effective,
            status,
            estimate,
            progress,
            ahead,
            solve: solved.and_then(|solved| solved.ok()?.report),
            guard: self.guard.as_ref().and_then(Guard::view),
            refused,
            reference: self.reference.as_ref().map_or(0, Reference::number),
        }
    }

    /// Returns the command of pure pursuit.
    fn pursue(&self, estimate: &Estimate, progress: &Progress) -> Solution {
        let reference = self.reference.as_ref();
        let command = self.config.pure_pursuit.command(
            &PursuitView {
                pose: &self
                    .tracked_point()
                    .of(&estimate.pose, &estimate.normal_in_world),
                reference: &progress.point,
                path: reference.and_then(Reference::path),
                arc_length_m: progress.arc_length_m,
                stop_at_m: reference.map_or(progress.arc_length_m, Reference::stop_at_m),
                turn_to_go_rad: reference.map_or(0.0, Reference::turn_to_go_rad),
            },
            &self.vehicle.icrs,
        );
        Solution {
            command,
            report: None,
        }
    }

    /// Returns the result of the cycle: the solution's command, `slowed` down, within bounds and rates,
    /// that of the previous plan if there is no solution, or the next step of a stop.
    fn conclude(
        &mut self,
        solved: Option<Result<Solution, QpFailure>>,
        slowed: f64,
    ) -> (Status, MotorSpeeds) {
        let previous = self.issued.last();
        let (status, wanted) = match solved {
            None => (Status::Waiting, MotorSpeeds::STOP),
            Some(Ok(solution)) => {
                self.phase = Phase::Driving { fallback_cycles: 0 };
                (Status::Tracking, self.drives.command(solution.command))
            }
            Some(Err(reason)) => self.fall_back(reason),
        };
        let (limits, period_s) = (&self.config.limits, self.config.period_s);
        match self.phase {
            Phase::Driving { .. } => {
                // Both motors alike, so that the curve stays.
                let wanted = MotorSpeeds {
                    traction_m_s: slowed * wanted.traction_m_s,
                    steer_m_s: slowed * wanted.steer_m_s,
                };
                (status, limits.project(wanted, previous, period_s))
            }
            Phase::Stopped(reason) => (
                Status::Stopping(reason),
                limits.stop_step(previous, period_s),
            ),
            Phase::Finished => (Status::Finished, limits.stop_step(previous, period_s)),
        }
    }

    /// Learns how the drives respond from tread speeds that are new in this cycle.
    fn learn_drives(&mut self, estimate: Option<&Estimate>, sample: &Sample) {
        let (Some(estimate), Some(reading)) = (estimate, &sample.tread_speeds) else {
            return;
        };
        self.drives
            .observe(estimate.treads.into(), reading.time_s, &self.issued);
    }

    /// Returns how the drives respond, as learned.
    pub fn drive_response(&self) -> DriveResponse {
        self.drives.response()
    }

    fn discard_plan(&mut self) {
        self.predictions.drop_pending();
        if let Law::Mpc(mpc) = &mut self.law {
            mpc.discard_plan();
        }
    }
}
