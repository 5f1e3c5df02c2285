use crate::drives::{DriveFeedback, DriveMode, LinkState};
use serde::Serialize;
use sidehill_controller::controller::StopReason;
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MotorSpeeds;
use strum::{IntoStaticStr, VariantNames};

/// Output of the controller in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerOutput {
    /// Cycle for which it was decided, s.
    pub time_s: f64,
    /// Effective speeds.
    pub command: MotorSpeeds,
    /// Whether the controller can drive.
    pub state: ControllerState,
}

/// Whether the controller can drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ControllerState {
    /// It waits for its first readings.
    Waiting,
    /// It drives.
    Driving,
    /// It stops the vehicle.
    Stopped(StopReason),
    /// It has followed its reference to the end.
    Finished,
}

/// Requests of an operator, or of a client that acts as one. Each is a level; arming acts on a rising edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OperatorRequests {
    /// Arm.
    pub arm: bool,
    /// Stop on the ramp, and why.
    pub stop: Option<StopCause>,
    /// Zero speed and disable at once, and why.
    pub halt: Option<StopCause>,
}

/// Why an operator, or a client that acts as one, stops the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error, IntoStaticStr, VariantNames)]
#[strum(serialize_all = "snake_case")]
pub enum StopCause {
    /// A person sent a signal to stop.
    #[error("the operator requested a stop")]
    Operator,
    /// The program ends: by a signal, or because the course is finished.
    #[error("the program ends")]
    ProgramEnds,
    /// The time limit of the run is reached.
    #[error("the time limit of the run is reached")]
    TimeOver,
    /// The process was suspended and has been resumed.
    #[error("the program was suspended")]
    Suspended,
    /// The emergency stop of ROS 2 is pressed.
    #[error("the emergency stop is pressed")]
    EmergencyStop,
    /// The publishers of the emergency stop have been silent for too long.
    #[error("the emergency stop is silent")]
    EmergencyStopSilent,
    /// A new emergency-stop publisher was discovered, and its first message has not arrived.
    #[error("a new emergency-stop publisher has not sent anything yet")]
    EmergencyStopUnheard,
    /// A publisher of the emergency stop has another type or an incompatible quality of service.
    #[error("a publisher of the emergency stop cannot be heard")]
    EmergencyStopIncompatible,
    /// The client has cancelled the goal.
    #[error("the goal was cancelled")]
    Cancelled,
    /// The client has left.
    #[error("the client has left")]
    ClientLeft,
    /// The lifecycle node was deactivated.
    #[error("the node was deactivated")]
    Deactivated,
    /// The clock of the ROS graph was set.
    #[error("the clock has jumped")]
    ClockJumped,
    /// The newest path cannot be followed.
    #[error("the newest path cannot be driven")]
    PathRefused,
    /// The transform to the frame of the path is no longer known.
    #[error("the path's frame is no longer known")]
    FrameLost,
    /// The controller finds no plan.
    #[error("there was no plan for longer than tolerated")]
    NoPlan,
    /// The vehicle makes no progress along the path.
    #[error("there was no progress for longer than tolerated")]
    NoProgress,
    /// The handshake with the drives failed.
    #[error("the drives could not be armed")]
    NotArmed,
    /// The path ended while the vehicle was still driving.
    #[error("the path has ended")]
    DriveEnded,
    /// An obstacle is in the way.
    #[error("an obstacle is in the way")]
    Obstacle,
    /// The costmap is missing, too old, or its place is unknown.
    #[error("there is no usable costmap")]
    CostmapUnknown,
    /// The vehicle was armed without a path.
    #[error("the vehicle was armed without a path")]
    NobodyAsked,
}

impl StopCause {
    /// All of them.
    pub const ALL: [Self; 21] = [
        Self::Operator,
        Self::ProgramEnds,
        Self::TimeOver,
        Self::Suspended,
        Self::EmergencyStop,
        Self::EmergencyStopSilent,
        Self::EmergencyStopUnheard,
        Self::EmergencyStopIncompatible,
        Self::Cancelled,
        Self::ClientLeft,
        Self::Deactivated,
        Self::ClockJumped,
        Self::PathRefused,
        Self::FrameLost,
        Self::NoPlan,
        Self::NoProgress,
        Self::NotArmed,
        Self::DriveEnded,
        Self::Obstacle,
        Self::CostmapUnknown,
        Self::NobodyAsked,
    ];

    /// Returns whether this is a fault, rather than a decision of an operator or a client.
    pub fn is_fault(self) -> bool {
        match self {
            Self::Suspended
            | Self::EmergencyStop
            | Self::EmergencyStopSilent
            | Self::EmergencyStopUnheard
            | Self::EmergencyStopIncompatible
            | Self::ClockJumped
            | Self::FrameLost
            | Self::NoPlan
            | Self::NoProgress
            | Self::CostmapUnknown
            | Self::NotArmed => true,
            Self::Operator
            | Self::ProgramEnds
            | Self::TimeOver
            | Self::Cancelled
            | Self::ClientLeft
            | Self::Deactivated
            | Self::PathRefused
            | Self::DriveEnded
            | Self::Obstacle
            | Self::NobodyAsked => false,
        }
    }
}

/// Everything the state machine takes into account in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetyInputs {
    /// Instant, s.
    pub time_s: f64,
    /// Newest output of the controller.
    pub controller: Option<ControllerOutput>,
    /// Newest feedback of both drives, with the older of both instants.
    pub feedback: Option<Stamped<DriveFeedback>>,
    /// The newest command that reached the drives, where a node in between may slow it down.
    pub forwarded: Option<Stamped<MotorSpeeds>>,
    /// State of the link to the drives.
    pub link: LinkState,
    /// Instant of the first of the last commands that could not be sent, s; none where the last one
    /// was.
    pub unsent_since_s: Option<f64>,
    /// The operator's requests.
    pub requests: OperatorRequests,
    /// Whether the vehicle would come too close to the edge of the geofence if it did not brake now.
    pub leaves_geofence: bool,
}

/// State of the state machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SafetyState {
    /// Disabled since the start; waits for an operator.
    Disarmed,
    /// Sends zero speed, disabled, until the drives report standstill and disabled.
    Zeroing,
    /// Sends zero speed, enabled, until the drives report enabled.
    Enabling,
    /// Passes the controller's commands on.
    Driving,
    /// Ramps the speeds to zero.
    Stopping,
    /// Disabled until an operator re-arms.
    Latched,
}

/// Why the state changed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error, IntoStaticStr, VariantNames)]
#[strum(serialize_all = "snake_case")]
pub enum Reason {
    /// An operator armed.
    #[error("armed")]
    Armed,
    /// Zero speed was sent for long enough, and the drives report standstill and disabled.
    #[error("the drives are at standstill and disabled")]
    Standing,
    /// The drives report enabled.
    #[error("the drives are on")]
    Enabled,
    /// The ramp has ended.
    #[error("the ramp has ended")]
    RampEnded,
    /// An operator requested it, on the ramp or at once.
    #[error("{0}")]
    Requested(StopCause),
    /// The drives report an emergency stop.
    #[error("the drives report an emergency stop")]
    EmergencyStop,
    /// A drive reports a fault.
    #[error("a drive reports a fault")]
    DriveFault,
    /// A drive has been disabled by something other than this program.
    #[error("a drive is off that was told to be on")]
    DriveOff,
    /// A drive no longer takes commands.
    #[error("a drive takes no commands: its node is not operational")]
    DriveNotOperational,
    /// A drive no longer follows speeds.
    #[error("a drive does not follow speeds: its mode of operation was changed")]
    DriveMode,
    /// The controller's command is too old.
    #[error("the command is {age_s:.3} s old")]
    CommandTimeout {
        /// Its age, s.
        age_s: f64,
    },
    /// The controller's command is not finite.
    #[error("the command is not finite")]
    CommandNotFinite,
    /// The controller stops the vehicle.
    #[error("the controller stops: {why}")]
    ControllerStopped {
        /// Why.
        why: StopReason,
    },
    /// The controller has followed its reference to the end.
    #[error("the reference has been followed to its end")]
    Finished,
    /// The drives' feedback is too old, or there was none.
    #[error("{}", feedback_age(*age_s))]
    FeedbackTimeout {
        /// Its age, s; infinite where there was none, negative where it is stamped ahead of the clock.
        age_s: f64,
    },
    /// A drive's reported speed does not change although its commands do.
    #[error("a drive's reported speed stays the same to the bit while its commands change")]
    FeedbackFrozen,
    /// Feedback is not what was commanded.
    #[error(
        "traction differs by {traction_m_s:.3} m/s and steer by {steer_m_s:.3} m/s from the command for {time_s:.2} s"
    )]
    Implausible {
        /// Traction beyond the commands, m/s.
        traction_m_s: f64,
        /// Steer beyond the commands, m/s.
        steer_m_s: f64,
        /// For how long, s.
        time_s: f64,
    },
    /// The vehicle is about to leave the geofence, or outside.
    #[error("the edge of the geofence is near, or the vehicle is outside")]
    Geofence,
    /// The link carries no messages, or not this program's alone.
    #[error("{}", link_fault(*state))]
    Link {
        /// Its state.
        state: LinkState,
    },
    /// Nothing could be sent.
    #[error("nothing could be sent for {time_s:.3} s")]
    TransmitTimeout {
        /// For how long, s.
        time_s: f64,
    },
    /// The drives did not answer the handshake.
    #[error("the drives did not follow within {time_s:.2} s, they report {mode:?}")]
    Handshake {
        /// How long the safety waited, s.
        time_s: f64,
        /// What the drives reported last.
        mode: DriveMode,
    },
    /// The time went back or is not finite.
    #[error("the time went from {before_s} s to {now_s} s")]
    Clock {
        /// Of the step before, s.
        before_s: f64,
        /// Of this step, s.
        now_s: f64,
    },
}

impl Reason {
    /// Returns its name without its figures, such as `feedback_timeout`: that of the cause where an operator or a client
    /// stops the vehicle, and that of the controller's reason where the controller does.
    pub fn cause(&self) -> &'static str {
        match self {
            Self::Requested(cause) => cause.into(),
            Self::ControllerStopped { why } => why.into(),
            reason => reason.into(),
        }
    }

    /// Returns whether this ends a drive for a fault, rather than because it is over or somebody has decided so.
    pub fn is_fault(&self) -> bool {
        match self {
            Self::Armed | Self::Standing | Self::Enabled | Self::RampEnded | Self::Finished => {
                false
            }
            Self::Requested(cause) => cause.is_fault(),
            _ => true,
        }
    }

    /// Returns all that [`Reason::cause`] can return, and the names of the two reasons that it looks into.
    pub fn causes() -> impl Iterator<Item = &'static str> {
        let all = [Self::VARIANTS, StopCause::VARIANTS, StopReason::VARIANTS];
        all.into_iter().flatten().copied()
    }
}

fn link_fault(state: LinkState) -> String {
    match state {
        LinkState::Foreign => "another node sends with this program's identifiers".to_owned(),
        state => format!("the link to the drives is {state:?}"),
    }
}

fn feedback_age(age_s: f64) -> String {
    if age_s == f64::INFINITY {
        return "there is no feedback".to_owned();
    }
    if age_s < 0.0 {
        return format!("the feedback is stamped {:.3} s ahead of the clock", -age_s);
    }
    format!("the feedback is {age_s:.3} s old")
}

/// A change of state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transition {
    /// When, s.
    pub time_s: f64,
    /// From.
    pub from: SafetyState,
    /// To.
    pub to: SafetyState,
    /// Why.
    pub reason: Reason,
}
