//! The controller: from a sample of the sensors to a command, once a cycle.
//!
//! ```text
//! Sample -> Estimate -> Horizon -> Linearised -> Solution -> Decision
//! ```

mod decision;
mod preview;
mod supervision;

pub use decision::{Decision, Status, StopReason};

use crate::config::{ControllerConfig, ControllerKind};
use crate::estimator::{Estimate, Estimator};
use crate::mpc::{Mpc, Plan, QpFailure, StageTarget};
use crate::pure_pursuit::PursuitView;
use crate::reference::{Reference, Tracking};
use crate::trajectory::Trajectory;
use preview::preview;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::prediction::PredictionModel;
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::{RangeError, Vehicle};
use std::time::Instant;

/// Why a controller cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// A setting is out of its range.
    #[error("controller setting {0}")]
    Range(#[from] RangeError),
    /// The solver does not take the problem.
    #[error("the MPC cannot be set up: {0}")]
    Solver(#[from] QpFailure),
}

/// What turns estimate and reference into a command.
enum Law {
    Mpc { mpc: Box<Mpc>, planned: bool },
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

/// Poses in a row that the gate may refuse while the vehicle stands, before it is taken to have been
/// carried to where they say.
const CARRIED_POSES: u32 = 10;
/// Largest distance between the ends of the horizons of two references for which the plan made for
/// the first is taken up for the second, m.
const PLAN_REUSE_M: f64 = 0.5;

/// Follows a reference; one [`Controller::step`] a control period.
pub struct Controller {
    config: ControllerConfig,
    vehicle: Vehicle,
    terrain: Option<Terrain>,
    estimator: Estimator,
    /// None: there is no path, so nothing to be off, and nothing to drive for.
    reference: Option<Reference>,
    reference_number: u64,
    law: Law,
    /// Whether the law predicts with what the estimator learns.
    adapts: bool,
    targets: Vec<StageTarget>,
    phase: Phase,
    /// Commands of the last second, the newest last: those in flight are among them.
    issued: Vec<Issued>,
    last_time_s: Option<f64>,
}

impl Controller {
    /// Returns a controller that will follow `trajectory`, given in time or along its path.
    ///
    /// `vehicle` is the model it steers by, `terrain` a map for its preview, if it has one.
    ///
    /// # Errors
    /// [`ControllerError`] for settings out of range.
    pub fn new(
        kind: ControllerKind,
        config: ControllerConfig,
        vehicle: &Vehicle,
        trajectory: Trajectory,
        tracking: Tracking,
        laps: u32,
        terrain: Option<Terrain>,
    ) -> Result<Self, ControllerError> {
        let mut controller = Self::without_path(kind, config, vehicle, terrain)?;
        let tracking = match controller.law {
            Law::Mpc { .. } => tracking,
            // A geometric law knows no time: its reference waits for the vehicle.
            Law::PurePursuit => controller.config.along_path_by_cusps(),
        };
        controller.reference = Some(Reference::new(trajectory, tracking, laps));
        Ok(controller)
    }

    /// Returns a controller that has nothing to follow until [`Controller::follow`]: the vehicle
    /// stands, and each cycle has an estimate and no progress.
    ///
    /// # Errors
    /// [`ControllerError`] for settings out of range.
    pub fn without_path(
        kind: ControllerKind,
        config: ControllerConfig,
        vehicle: &Vehicle,
        terrain: Option<Terrain>,
    ) -> Result<Self, ControllerError> {
        config.validate()?;
        // An adapted model is estimated with as it predicts. A law that does not adapt leaves
        // dead reckoning to the best model there is.
        let adaptation = config.estimator.adaptation;
        let adapts = match kind {
            ControllerKind::IcrikMpc => adaptation.is_on(),
            ControllerKind::IcrhkMpc => adaptation.is_on() && adaptation.of_icrhk,
            ControllerKind::DiffdriveMpc | ControllerKind::PurePursuit => false,
        };
        let estimator = if kind == ControllerKind::IcrhkMpc && adapts {
            let mut settings = config.estimator;
            settings.adaptation.slope_sigma = 0.0;
            Estimator::new(settings, vehicle.on_level_ground())
        } else {
            Estimator::new(config.estimator, vehicle.extended())
        };
        let vehicle = match kind {
            ControllerKind::IcrikMpc => vehicle.extended(),
            ControllerKind::IcrhkMpc | ControllerKind::PurePursuit => vehicle.on_level_ground(),
            ControllerKind::DiffdriveMpc => vehicle.as_differential_drive(),
        };
        let law = if kind == ControllerKind::PurePursuit {
            Law::PurePursuit
        } else {
            let model = PredictionModel::new(vehicle.clone(), config.smoothing_m_s);
            Law::Mpc {
                mpc: Box::new(Mpc::new(config.mpc(), model)?),
                planned: false,
            }
        };
        let commands = (1.0 / config.period_s).ceil() as usize + 2;
        Ok(Self {
            estimator,
            reference: None,
            reference_number: 0,
            targets: Vec::with_capacity(config.stages),
            issued: Vec::with_capacity(commands + 1),
            phase: Phase::Driving { fallback_cycles: 0 },
            last_time_s: None,
            adapts,
            law,
            terrain,
            vehicle,
            config,
        })
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
            Law::Mpc { mpc, planned: true } => Some(mpc.plan()),
            _ => None,
        }
    }

    /// Returns the targets of the horizon of the last cycle.
    pub fn targets(&self) -> &[StageTarget] {
        &self.targets
    }

    /// Follows `trajectory` along its path from the next cycle on, beginning at the arc length
    /// `from_m`, under a number of the caller's. The estimate and the commands in flight stay; a
    /// stopped controller stays stopped, one that had finished drives again.
    pub fn follow(&mut self, number: u64, trajectory: Trajectory, from_m: f64) {
        let tracking = match self.law {
            Law::Mpc { .. } => self.config.along_path(),
            Law::PurePursuit => self.config.along_path_by_cusps(),
        };
        let next = Reference::new(trajectory, tracking, 1).starting_at(from_m);
        // A plan that leads elsewhere is a bad point to linearise about.
        let horizon_s = self.config.delay_s() + self.config.step_s * self.config.stages as f64;
        let new = next.ahead(horizon_s).position;
        let near = self
            .reference
            .as_ref()
            .is_some_and(|old| old.ahead(horizon_s).position.distance_m(&new) <= PLAN_REUSE_M);
        if let Law::Mpc { planned, .. } = &mut self.law {
            *planned &= near;
        }
        if self.phase == Phase::Finished {
            self.phase = Phase::Driving { fallback_cycles: 0 };
        }
        self.reference = Some(next);
        self.reference_number = number;
    }

    /// Has nothing to follow from the next cycle on: a vehicle that drives is stopped.
    pub fn forget_path(&mut self) {
        self.reference = None;
        self.reference_number = 0;
        self.targets.clear();
        if let Law::Mpc { planned, .. } = &mut self.law {
            *planned = false;
        }
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
        self.phase = Phase::Driving { fallback_cycles: 0 };
        self.last_time_s = None;
        if let Law::Mpc { planned, .. } = &mut self.law {
            *planned = false;
        }
    }

    /// Decides on the command from this cycle's time until the next; `deadline` ends a solve.
    ///
    /// Total: every doubt ends in a controlled stop and a [`Status`] that says why.
    pub fn step(&mut self, sample: &Sample, deadline: Option<Instant>) -> Decision {
        if self
            .last_time_s
            .is_some_and(|before_s| sample.time_s < before_s)
        {
            // What was read under the clock before it was put back is not older than what comes now.
            self.estimator.restart();
        }
        let (estimate, refused) = self.estimator.update(sample);
        let mut decision = Decision {
            time_s: sample.time_s,
            command: MotorSpeeds::STOP,
            status: Status::Waiting,
            estimate,
            progress: None,
            solve: None,
            refused,
            reference: self.reference_number,
        };
        let elapsed_s = self.elapsed(sample.time_s);
        if let Some(estimate) = &estimate {
            // The reference waits for a vehicle that has been stopped.
            let reference_s = match self.phase {
                Phase::Stopped(_) => 0.0,
                Phase::Driving { .. } | Phase::Finished => elapsed_s,
            };
            decision.progress = self
                .reference
                .as_mut()
                .map(|reference| reference.advance(reference_s, &estimate.pose));
            self.supervise_readings(estimate);
            self.supervise_path(estimate, decision.progress.as_ref());
            self.decide(estimate, elapsed_s, deadline, &mut decision);
            // A vehicle that stands may have been carried elsewhere.
            let stands = self.last_command() == MotorSpeeds::STOP;
            let stopped = matches!(self.phase, Phase::Stopped(_));
            if stopped && stands && estimate.poses_gated >= CARRIED_POSES {
                self.estimator.restart();
            }
        } else if let Phase::Stopped(reason) = self.phase {
            decision.status = Status::Stopping(reason);
        }
        self.issue(&mut decision);
        decision
    }

    /// Fills in command and status as the phase has it.
    fn decide(
        &mut self,
        estimate: &Estimate,
        elapsed_s: f64,
        deadline: Option<Instant>,
        decision: &mut Decision,
    ) {
        let Phase::Driving { fallback_cycles } = self.phase else {
            return;
        };
        let (Some(reference), Some(progress)) = (&self.reference, decision.progress) else {
            return;
        };
        let previous = self.last_command();
        if let Law::Mpc { mpc, .. } = &mut self.law
            && self.adapts
        {
            let half_track_m = 0.5 * (self.vehicle.icrs.right_m - self.vehicle.icrs.left_m);
            mpc.model_mut()
                .set_correction(&estimate.bounded_gains(half_track_m, progress.cross_track_m));
        }
        let horizon_start = self.roll_forward(estimate);
        match &mut self.law {
            Law::PurePursuit => {
                decision.status = Status::Tracking;
                decision.command = self.config.pure_pursuit.command(
                    &PursuitView {
                        pose: &horizon_start,
                        reference: &progress.point,
                        path: reference.path(),
                        arc_length_m: progress.arc_length_m,
                        stop_at_m: reference.stop_at_m(),
                    },
                    &self.vehicle.icrs,
                );
            }
            Law::Mpc { mpc, planned } => {
                let caution = if self.adapts {
                    (estimate.model_error_m_s / self.config.caution.error_m_s)
                        .powi(2)
                        .min(1.0)
                } else {
                    0.0
                };
                mpc.set_steer_change_weight(self.config.steer_change_weight(caution));
                preview(
                    &self.config,
                    &self.vehicle,
                    reference,
                    self.terrain.as_ref(),
                    estimate,
                    caution,
                    &mut self.targets,
                );
                let solved = if *planned {
                    let end = self
                        .targets
                        .last()
                        .map_or(estimate.normal_in_world, |t| t.normal_in_world);
                    mpc.shift(elapsed_s, &end);
                    for (target, state) in self.targets.iter_mut().zip(&mpc.plan().states[1..]) {
                        let error_rad = wrap_angle(state.z - target.pose.yaw_rad);
                        target.weights.heading_per_rad2 +=
                            self.config.heading_excess_weight(error_rad);
                    }
                    mpc.solve(&horizon_start, previous, &self.targets, deadline)
                } else {
                    mpc.start(&horizon_start, previous, &self.targets, deadline)
                };
                *planned |= solved.is_ok();
                match solved {
                    Ok(report) => {
                        decision.solve = Some(report);
                        decision.status = Status::Tracking;
                        decision.command = mpc.plan().inputs[0];
                        self.phase = Phase::Driving { fallback_cycles: 0 };
                    }
                    Err(reason) => {
                        let cycles = fallback_cycles + 1;
                        if cycles <= self.config.supervisor.fallback_cycles {
                            decision.status = Status::Fallback { reason, cycles };
                            decision.command = if *planned {
                                mpc.plan().inputs[0]
                            } else {
                                let limits = &self.config.limits;
                                limits.stop_step(previous, self.config.period_s)
                            };
                            self.phase = Phase::Driving {
                                fallback_cycles: cycles,
                            };
                        } else {
                            self.stop(StopReason::NoSolution { cycles, reason });
                        }
                    }
                }
            }
        }
    }

    /// Puts the command within limits, or leads it to zero, and remembers it.
    fn issue(&mut self, decision: &mut Decision) {
        let previous = self.last_command();
        let (limits, period_s) = (&self.config.limits, self.config.period_s);
        decision.command = match self.phase {
            Phase::Driving { .. } => limits.project(decision.command, previous, period_s),
            Phase::Stopped(reason) => {
                decision.status = Status::Stopping(reason);
                limits.stop_step(previous, period_s)
            }
            Phase::Finished => {
                decision.status = Status::Finished;
                limits.stop_step(previous, period_s)
            }
        };
        if self.issued.len() + 1 > self.issued.capacity() {
            self.issued.remove(0);
        }
        self.issued.push(Issued {
            time_s: decision.time_s,
            command: decision.command,
        });
    }

    fn last_command(&self) -> MotorSpeeds {
        self.issued
            .last()
            .map_or(MotorSpeeds::STOP, |issued| issued.command)
    }

    /// Returns where the vehicle will be when a command given now acts: the estimate moved on
    /// through the commands in flight.
    fn roll_forward(&self, estimate: &Estimate) -> PlanarPose {
        let delay_s = self.config.delay_s();
        let mut pose = estimate.pose;
        let Law::Mpc { mpc, .. } = &self.law else {
            return pose;
        };
        let begin_s = estimate.time_s - delay_s;
        for (i, issued) in self.issued.iter().enumerate() {
            let until_s = self
                .issued
                .get(i + 1)
                .map_or(estimate.time_s, |next| next.time_s);
            let time_s = until_s - issued.time_s.max(begin_s);
            if time_s > 0.0 {
                let step = mpc.model().step_on_plane(
                    &estimate.normal_in_world,
                    pose.yaw_rad,
                    issued.command,
                    time_s,
                );
                pose.x_m += step.increment.x;
                pose.y_m += step.increment.y;
                pose.yaw_rad += step.increment.z;
            }
        }
        pose
    }
}
