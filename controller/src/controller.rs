//! The controller: from a sample of the sensors to a command, once a cycle.
//!
//! ```text
//! Sample -> Estimate -> Horizon -> Linearised -> Solution -> Decision
//! ```

mod decision;
mod horizon;
mod supervision;
mod watchdog;

pub use decision::{Decision, Stall, Status, StopReason};

use crate::config::{AttitudePreview, ControllerConfig, ControllerKind};
use crate::estimator::{Estimate, Estimator};
use crate::guard::{Guard, Stance, Surroundings};
use crate::memory::{Learned, Memory, RecallError};
use crate::mpc::{Horizon, Model, Mpc, Plan, QpFailure, Solution, StageTarget};
use crate::path::Point2;
use crate::pure_pursuit::PursuitView;
use crate::reference::{PROJECTION_WINDOW, Progress, Reference};
use crate::tracked_point::TrackedPoint;
use sidehill_plant::bounds::RangeError;
use sidehill_plant::contact::ContactPrediction;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::prediction::PredictionModel;
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;
use std::time::Instant;
use watchdog::Watchdog;

/// Why a controller cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// A setting is out of its range.
    #[error("controller setting {0}")]
    Range(#[from] RangeError),
    /// What was learned before is not that of this vehicle, or makes no sense.
    #[error("what was learned is refused: {0}")]
    Recall(#[from] RecallError),
    /// The steepness guard needs to know where the mass is.
    #[error(
        "guard: the vehicle file has no centre_of_mass, and none in contact; the guard needs its height"
    )]
    CentreOfMass,
    /// The centre of mass is not above the wheels.
    #[error("guard: centre_of_mass is beside the wheels, so the vehicle tips over on level ground")]
    TipsOver,
    /// The solver does not take the problem.
    #[error("the MPC cannot be set up: {0}")]
    Solver(#[from] QpFailure),
}

/// What turns estimate and reference into a command.
enum Law {
    Mpc(Box<Mpc>),
    PurePursuit,
}

/// What the cycle before left behind.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Driving { fallback_cycles: u32 },
    Stopped(StopReason),
    Finished,
}

/// A command and the instant from which it was given.
#[derive(Debug, Clone, Copy)]
struct Issued {
    time_s: f64,
    command: MotorSpeeds,
}

/// Largest distance between the ends of the horizons of two references for which the plan made for
/// the first is taken up for the second, m.
const PLAN_REUSE_M: f64 = 0.5;

/// Share of the motors' deceleration with which the guard brakes before a steep place.
const BRAKING_SHARE: f64 = 0.25;

/// Follows a reference; one [`Controller::step`] a control period.
pub struct Controller {
    config: ControllerConfig,
    /// The vehicle as the law knows it.
    vehicle: Vehicle,
    /// Map for the preview of the attitude.
    terrain: Option<Terrain>,
    estimator: Estimator,
    /// None: there is no path, so nothing to be off, and nothing to drive for.
    reference: Option<Reference>,
    law: Law,
    /// Whether the law predicts with what the estimator learns.
    adapts: bool,
    horizon: Horizon,
    phase: Phase,
    watchdog: Watchdog,
    guard: Option<Guard>,
    memory: Option<Memory>,
    /// Name and number of vehicle and kind, by which what was learned is known again.
    owner: String,
    /// Commands of the last second, the newest last: those in flight are among them.
    issued: Vec<Issued>,
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
        let config = if kind == ControllerKind::ContactMpc {
            config.for_contact()
        } else {
            config
        };
        // An adapted model is estimated with as it predicts. A law that does not adapt leaves
        // dead reckoning to the best model there is.
        let adaptation = config.estimator.adaptation;
        let adapts = match kind {
            ControllerKind::IcrikMpc => adaptation.is_on(),
            ControllerKind::IcrhkMpc => adaptation.is_on() && adaptation.of_icrhk,
            ControllerKind::ContactMpc => config.estimator.contact.is_on(),
            ControllerKind::DiffdriveMpc | ControllerKind::PurePursuit => false,
        };
        let contact = if kind == ControllerKind::ContactMpc {
            Some(ContactPrediction::new(&vehicle.contact_vehicle())?)
        } else {
            None
        };
        let estimator = if let Some(contact) = &contact {
            Estimator::with_contact(config.estimator, &vehicle.on_wheels(), contact.clone())
        } else if kind == ControllerKind::IcrhkMpc && adapts {
            let mut settings = config.estimator;
            settings.adaptation.slope_sigma = 0.0;
            Estimator::new(settings, vehicle.on_level_ground())
        } else {
            Estimator::new(config.estimator, vehicle.extended())
        };
        let guard = match config.guard {
            Some(settings) => {
                let stance = Stance::of(vehicle).ok_or(ControllerError::CentreOfMass)?;
                if !stance.stands() {
                    return Err(ControllerError::TipsOver);
                }
                let braking_m_s2 = BRAKING_SHARE * config.limits.traction.deceleration_m_s2;
                Some(Guard::new(settings, stance, braking_m_s2))
            }
            None => None,
        };
        let memory = config.memory.map(Memory::new);
        let mut estimator = estimator;
        estimator.keep_learned(config.memory.is_some_and(|memory| memory.keep_gains));
        let owner = owner(vehicle, kind);
        let vehicle = match kind {
            ControllerKind::IcrikMpc => vehicle.extended(),
            ControllerKind::ContactMpc => vehicle.on_wheels(),
            ControllerKind::IcrhkMpc | ControllerKind::PurePursuit => vehicle.on_level_ground(),
            ControllerKind::DiffdriveMpc => vehicle.as_differential_drive(),
        };
        let law = if kind == ControllerKind::PurePursuit {
            Law::PurePursuit
        } else {
            let model = match contact {
                Some(contact) => Model::from(contact),
                None => PredictionModel::new(vehicle.clone(), config.smoothing_m_s).into(),
            };
            Law::Mpc(Box::new(Mpc::new(config.mpc(), model)?))
        };
        let commands = (1.0 / config.period_s).ceil() as usize + 2;
        Ok(Self {
            estimator,
            reference: None,
            horizon: Horizon {
                elapsed_s: 0.0,
                start: Default::default(),
                previous: MotorSpeeds::STOP,
                change_weights: config.change_weights(0.0),
                targets: Vec::with_capacity(config.stages),
            },
            issued: Vec::with_capacity(commands + 1),
            watchdog: Watchdog::new(
                &config.supervisor,
                config.limits,
                0.5 * (vehicle.icrs.right_m - vehicle.icrs.left_m),
                config.period_s,
            ),
            phase: Phase::Driving { fallback_cycles: 0 },
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
    /// horizon where [`AttitudePreview::Terrain`] is set.
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
        match self.reference.as_ref().and_then(Reference::path) {
            Some(_) => self.config.tracked_point,
            None => TrackedPoint::ORIGIN,
        }
    }

    /// Returns the targets of the horizon of the last cycle; none of a law without a horizon.
    pub fn targets(&self) -> &[StageTarget] {
        &self.horizon.targets
    }

    /// Follows `reference` from the next cycle on. The estimate and the commands in flight stay; a
    /// stopped controller stays stopped, one that had finished drives again.
    ///
    /// Pure pursuit is geometric and knows no time: its reference always waits for the vehicle.
    pub fn follow(&mut self, reference: Reference) {
        let next = match self.law {
            Law::Mpc(_) => reference,
            Law::PurePursuit => reference.for_pursuit(self.config.lead_max_m),
        };
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
        self.watchdog.reset();
    }

    /// Has nothing to follow from the next cycle on: a vehicle that drives is stopped.
    pub fn forget_path(&mut self) {
        self.reference = None;
        self.horizon.targets.clear();
        self.discard_plan();
    }

    /// Stops the vehicle at its decelerations from the next cycle on.
    pub fn request_stop(&mut self) {
        if !matches!(self.phase, Phase::Stopped(_)) {
            self.phase = Phase::Stopped(StopReason::Requested);
        }
    }

    /// Lets a stopped controller drive again, with an estimate and a plan made from nothing: readings
    /// may have been missing for so long that the filter would refuse the poses that come now.
    pub fn rearm(&mut self) {
        self.estimator.restart();
        if let Some(guard) = &mut self.guard {
            guard.reset();
        }
        if let Some(memory) = &mut self.memory {
            memory.reset();
        }
        self.phase = Phase::Driving { fallback_cycles: 0 };
        self.last_time_s = None;
        self.discard_plan();
    }

    /// Decides on the command from this cycle's time until the next; `deadline` ends a solve.
    ///
    /// Total: every doubt ends in a controlled stop and a [`Status`] that says why.
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
        let progress = self.advance_reference(estimate.as_ref(), elapsed_s);
        self.watch_slope(estimate.as_ref(), elapsed_s);
        self.supervise(estimate.as_ref(), progress.as_ref());
        let solved = match (self.phase, &estimate, &progress) {
            (Phase::Driving { .. }, Some(estimate), Some(progress)) => {
                self.learn_error(estimate, sample);
                self.look_ahead(estimate, progress, elapsed_s);
                Some(match &mut self.law {
                    Law::Mpc(mpc) => mpc.linearise(&self.horizon).condense().solve(deadline),
                    Law::PurePursuit => Ok(self.pursue(estimate, progress)),
                })
            }
            _ => None,
        };
        let mut slowed = slowed_share(estimate.as_ref());
        if let (Law::PurePursuit, Some(guard)) = (&self.law, &self.guard) {
            slowed *= guard.share();
        }
        let (status, command_effective) = self.conclude(solved, slowed);
        self.remember(sample.time_s, command_effective);
        Decision {
            time_s: sample.time_s,
            command_effective,
            status,
            estimate,
            progress,
            solve: solved.and_then(|solved| solved.ok()?.report),
            guard: self.guard.as_ref().and_then(Guard::view),
            refused,
            reference: self.reference.as_ref().map_or(0, Reference::number),
        }
    }

    /// Moves the reference on; it waits for a vehicle that has been stopped.
    fn advance_reference(
        &mut self,
        estimate: Option<&Estimate>,
        elapsed_s: f64,
    ) -> Option<Progress> {
        let elapsed_s = match self.phase {
            Phase::Stopped(_) => 0.0,
            Phase::Driving { .. } | Phase::Finished => match &self.guard {
                Some(guard) => elapsed_s * guard.share(),
                None => elapsed_s,
            },
        };
        let pose = &estimate?.pose;
        let point = self.tracked_point().of(pose, &estimate?.normal_in_world);
        Some(self.reference.as_mut()?.advance(elapsed_s, &point))
    }

    /// Returns everything that was learned, to be kept; none where memory is off.
    pub fn learned(&self) -> Option<Learned> {
        let memory = self.memory.as_ref()?;
        Some(Learned {
            owner: self.owner.clone(),
            gains: self.estimator.learned().filter(|_| self.adapts),
            cell_m: memory.config.cell_m,
            cells: memory.cells(),
        })
    }

    /// Begins with what was learned before, by this vehicle under this controller.
    ///
    /// # Errors
    /// [`RecallError`] for what belongs to another one or makes no sense; nothing is then taken over.
    pub fn recall(&mut self, learned: &Learned) -> Result<(), RecallError> {
        let memory = self.memory.as_mut().ok_or(RecallError::Off)?;
        if learned.owner != self.owner {
            return Err(RecallError::Foreign {
                found: learned.owner.clone(),
                expected: self.owner.clone(),
            });
        }
        if learned.cell_m != memory.config.cell_m {
            return Err(RecallError::Wrong("cells have another size"));
        }
        if let Some(gains) = &learned.gains {
            self.estimator.recall(gains).map_err(RecallError::Wrong)?;
        }
        memory.recall(&learned.cells);
        Ok(())
    }

    /// Measures how far beside its path the vehicle was where its newest pose was taken.
    fn learn_error(&mut self, estimate: &Estimate, sample: &Sample) {
        let point = self.tracked_point();
        let (Some(memory), Some(reference), Some(pose)) =
            (&mut self.memory, &self.reference, &sample.pose)
        else {
            return;
        };
        let moving = estimate.treads.left_m_s != 0.0 || estimate.treads.right_m_s != 0.0;
        let (Some(path), true) = (reference.path(), moving && estimate.poses_gated == 0) else {
            return;
        };
        let pose = point.of(&pose.value.planar(), &estimate.normal_in_world);
        let seen = Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        };
        if seen.x_m.is_finite() && seen.y_m.is_finite() {
            let around_m = reference.ahead(0.0).arc_length_m;
            let nearest = path
                .nearest_within(&seen, around_m, &PROJECTION_WINDOW)
                .point;
            let place = PlanarPose {
                x_m: nearest.position.x_m,
                y_m: nearest.position.y_m,
                yaw_rad: nearest.heading_rad,
            };
            memory.observe(sample.time_s, &seen, &place);
        }
    }

    /// Lets the guard look at the ground here and ahead.
    fn watch_slope(&mut self, estimate: Option<&Estimate>, elapsed_s: f64) {
        let half_track_m = 0.5 * (self.vehicle.icrs.right_m - self.vehicle.icrs.left_m);
        let command = self.last_command();
        let (Some(guard), Some(estimate), Some(reference)) =
            (&mut self.guard, estimate, &self.reference)
        else {
            return;
        };
        let map = self
            .terrain
            .as_ref()
            .filter(|_| self.config.attitude_preview == AttitudePreview::Terrain);
        let stop = guard.look(&Surroundings {
            estimate,
            reference,
            map,
            half_track_m,
            elapsed_s,
            command,
        });
        if let Some(reason) = stop {
            self.stop(reason.into());
        }
    }

    /// Returns what pure pursuit wants.
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
            },
            &self.vehicle.icrs,
        );
        Solution {
            command,
            report: None,
        }
    }

    /// Returns what the cycle comes to: the solution's command, `slowed` down, within bounds and rates,
    /// that of the previous plan where there is no solution, or the next step of a stop.
    fn conclude(
        &mut self,
        solved: Option<Result<Solution, QpFailure>>,
        slowed: f64,
    ) -> (Status, MotorSpeeds) {
        let previous = self.last_command();
        let (status, wanted) = match solved {
            None => (Status::Waiting, MotorSpeeds::STOP),
            Some(Ok(solution)) => {
                self.phase = Phase::Driving { fallback_cycles: 0 };
                (Status::Tracking, solution.command)
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

    fn remember(&mut self, time_s: f64, command: MotorSpeeds) {
        if self.issued.len() + 1 > self.issued.capacity() {
            self.issued.remove(0);
        }
        self.issued.push(Issued { time_s, command });
    }

    fn last_command(&self) -> MotorSpeeds {
        self.issued
            .last()
            .map_or(MotorSpeeds::STOP, |issued| issued.command)
    }

    fn discard_plan(&mut self) {
        if let Law::Mpc(mpc) = &mut self.law {
            mpc.discard_plan();
        }
    }
}

/// Returns the name of a vehicle under a kind of controller, with a number that is another where any of its
/// parameters is.
fn owner(vehicle: &Vehicle, kind: ControllerKind) -> String {
    let text = format!("{vehicle:?}");
    let number = text.bytes().fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    });
    format!("{} {number:016x} {}", vehicle.name, kind.name())
}

/// Share of the speed with which a vehicle drives whose poses are refused.
const DOUBTED_SHARE: f64 = 0.5;
/// Time that refused poses agree before the vehicle is slowed down, s.
const DOUBTED_MIN_S: f64 = 0.25;

/// Returns the share of the wanted speeds that is driven with.
fn slowed_share(estimate: Option<&Estimate>) -> f64 {
    let doubted = estimate.and_then(|estimate| estimate.poses_doubted_s);
    match doubted {
        Some((doubted_s, _)) if doubted_s >= DOUBTED_MIN_S => DOUBTED_SHARE,
        _ => 1.0,
    }
}
