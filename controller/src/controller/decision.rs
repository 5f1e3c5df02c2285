//! What a cycle decides, and what it has to say of it.

use super::predictions::Ahead;
use crate::estimator::HISTORY_S;
use crate::estimator::{Estimate, Refused};
use crate::guard::{GuardStop, GuardView, SteepMeasure, SteepPlace};
use crate::mpc::{QpFailure, SolveReport};
use crate::reference::Progress;
use serde::{Deserialize, Serialize};
use sidehill_plant::speeds::{MeasuredMotorSpeeds, MotorSpeeds};
use sidehill_plant::vehicle::Vehicle;
use strum::{IntoStaticStr, VariantNames};

/// Validity of a command.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// No attitude and pose yet: the vehicle is kept standing.
    Waiting,
    /// The law's own command.
    Tracking,
    /// This cycle has no solution; the command is the previous plan's, or slows down where there is
    /// none yet.
    Fallback {
        /// Why there is none.
        reason: QpFailure,
        /// Cycles in a row, this one included.
        cycles: u32,
    },
    /// The vehicle is being stopped, and stays so until the controller is re-armed.
    Stopping(StopReason),
    /// The reference has been followed to its end; the vehicle is being stopped there.
    Finished,
}

impl std::fmt::Display for Status {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Waiting => out.write_str("waiting for readings"),
            Self::Tracking => out.write_str("tracking"),
            Self::Fallback { reason, cycles } => write!(out, "fallback, cycle {cycles}: {reason}"),
            Self::Stopping(reason) => write!(out, "stopping: {reason}"),
            Self::Finished => out.write_str("finished"),
        }
    }
}

/// Why the vehicle is stopped.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    thiserror::Error,
    Serialize,
    Deserialize,
    IntoStaticStr,
    VariantNames,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum StopReason {
    /// The newest accepted pose is too old.
    #[error(
        "the pose is {age_s:.2} s old ({gated} newer ones refused as outliers, {late} more than {longest_s} s late)",
        longest_s = HISTORY_S
    )]
    PoseStale {
        /// Its age, s.
        #[serde(with = "crate::serde_form::age")]
        age_s: f64,
        /// Newer poses that the gate refused.
        gated: u32,
        /// Poses since then that came too late.
        #[serde(default)]
        late: u32,
    },
    /// New poses stay the same to the bit while the treads turn: where the vehicle is is not known.
    #[error("the pose stays the same to the bit for {time_s:.1} s while the treads turn")]
    PoseFrozen {
        /// For how long, s.
        time_s: f64,
    },
    /// Where the vehicle is across the path is too uncertain.
    #[error(
        "the position across the path is uncertain by {bound_m:.2} m, the newest pose is {age_s:.2} s old ({late} more than {longest_s} s late)",
        longest_s = HISTORY_S
    )]
    PoseUncertain {
        /// Bound that the position keeps with a probability of 95 %, m.
        bound_m: f64,
        /// Age of the newest accepted pose, s.
        #[serde(with = "crate::serde_form::age")]
        age_s: f64,
        /// Poses since then that came too late.
        #[serde(default)]
        late: u32,
    },
    /// The newest attitude is too old.
    #[error("the attitude is {age_s:.2} s old")]
    AttitudeStale {
        /// Its age, s.
        #[serde(with = "crate::serde_form::age")]
        age_s: f64,
    },
    /// The newest tread speeds are too old.
    #[error("the tread speeds are {age_s:.2} s old")]
    SpeedsStale {
        /// Their age, s.
        #[serde(with = "crate::serde_form::age")]
        age_s: f64,
    },
    /// The vehicle is too far from the path.
    #[error("the vehicle is {:.2} m off the path", .cross_track_m.abs())]
    OffPath {
        /// Distance, m, positive to the left.
        cross_track_m: f64,
    },
    /// The vehicle points too far from where the path goes.
    #[error("the heading is {error_rad:.2} rad off the path's")]
    HeadingOff {
        /// Heading less reference, rad.
        error_rad: f64,
    },
    /// Too many cycles in a row without a solution.
    #[error("no solution for {cycles} cycles: {reason}")]
    NoSolution {
        /// Cycles in a row.
        cycles: u32,
        /// The last failure.
        reason: QpFailure,
    },
    /// The clock did not move on, or jumped.
    #[error("the cycle's time went from {before_s} s to {now_s} s")]
    ClockJump {
        /// Time of the cycle before, s.
        before_s: f64,
        /// Time of this cycle, s.
        now_s: f64,
    },
    /// The vehicle does not move as it should.
    #[error("{stall} for {time_s:.1} s")]
    Stalled {
        /// What does not move it.
        stall: Stall,
        /// For how long, s.
        time_s: f64,
    },
    /// The ground ahead is steeper than the guard allows.
    #[error("too steep: {place}")]
    TooSteep {
        /// Where, and what is beyond its limit there.
        place: SteepPlace,
    },
    /// The vehicle is tilted further than the guard allows.
    #[error("tilted: {measure} {value_deg:.1} deg, beyond {limit_deg} deg")]
    Tilted {
        /// Roll or pitch.
        measure: SteepMeasure,
        /// The angle, deg.
        value_deg: f64,
        /// Its limit, deg.
        limit_deg: f64,
    },
    /// There is nothing to follow.
    #[error("there is no path")]
    NoPath,
    /// It is kept from driving by [`Controller::request_stop`](super::Controller::request_stop).
    #[error("it is held")]
    Requested,
}

impl From<GuardStop> for StopReason {
    fn from(stop: GuardStop) -> Self {
        match stop {
            GuardStop::TooSteep(place) => Self::TooSteep { place },
            GuardStop::Tilted {
                measure,
                value_deg,
                limit_deg,
            } => Self::Tilted {
                measure,
                value_deg,
                limit_deg,
            },
        }
    }
}

/// What does not move a vehicle that should move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stall {
    /// Steer is at its limit and the vehicle does not turn.
    Steer,
    /// Traction is at its limit and the vehicle does not move along its heading.
    Traction,
    /// The reference asks for speed and the vehicle stays where it is.
    Path,
    /// The treads turn and poses show that the vehicle stays where it is.
    Treads,
}

impl std::fmt::Display for Stall {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(match self {
            Self::Steer => "steer is at its limit and the vehicle does not turn",
            Self::Traction => "traction is at its limit and the vehicle does not move",
            Self::Path => "no progress along the path",
            Self::Treads => "the treads turn and the vehicle stays where it is",
        })
    }
}

/// What a cycle decides, and what it is based on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// Instant of the cycle, s.
    pub time_s: f64,
    /// Effective motor speeds until the next cycle, within bounds and rates: the motion of the treads
    /// on the ground. [`Decision::command_for_drives`] is the command that makes the drives do this.
    pub command_effective: MotorSpeeds,
    /// Validity of the command.
    pub status: Status,
    /// The state it is based on.
    pub estimate: Option<Estimate>,
    /// Position of the vehicle relative to the reference; none without a path or an estimate.
    pub progress: Option<Progress>,
    /// Where across the path the vehicle will be in 2 s; none where nothing is planned along a path.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ahead: Option<Ahead>,
    /// The solver's account, where a QP was solved.
    pub solve: Option<SolveReport>,
    /// What the steepness guard says, where it is on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardView>,
    /// Readings left out because they were not finite.
    pub refused: Refused,
    /// Number of the reference that is followed, see
    /// [`Reference::numbered`](crate::reference::Reference::numbered); 0 for none.
    pub reference: u64,
}

impl Decision {
    /// Returns the decision of a law without an estimate, a reference or a solver.
    pub fn of_command(time_s: f64, command_effective: MotorSpeeds, status: Status) -> Self {
        Self {
            time_s,
            command_effective,
            status,
            estimate: None,
            progress: None,
            ahead: None,
            solve: None,
            guard: None,
            refused: Refused::default(),
            reference: 0,
        }
    }

    /// Returns the command to the drives of `vehicle` that makes its treads follow the effective command:
    /// equation (11) solved for the speeds that the drives' own encoders count.
    pub fn command_for_drives(&self, vehicle: &Vehicle) -> MeasuredMotorSpeeds {
        MeasuredMotorSpeeds::reaching(self.command_effective, &vehicle.encoder_scale)
    }

    /// Returns the bound that the distance from the path keeps to its estimate with a probability of 95 %, m; none without
    /// a path or an estimate.
    pub fn cross_track_bound_m(&self) -> Option<f64> {
        let (estimate, progress) = self.estimate.as_ref().zip(self.progress.as_ref())?;
        Some(estimate.bound_across_m(progress.point.heading_rad))
    }
}
