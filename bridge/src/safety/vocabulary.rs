use crate::drives::{DriveFeedback, DriveMode, LinkState};
use serde::Serialize;
use sidehill_controller::controller::StopReason;
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MotorSpeeds;

/// What the controller says in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerOutput {
    /// ControlLoop for which it was decided, s.
    pub time_s: f64,
    /// Speeds it wants.
    pub command: MotorSpeeds,
    /// Whether it can drive.
    pub pilot: ControllerState,
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

/// What an operator asks for, or who acts as one; each is a level, and arming acts where it rises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OperatorRequests {
    /// Drive.
    pub arm: bool,
    /// Stop on the ramp, and why.
    pub stop: Option<StopCause>,
    /// Zero and disable at once, and why.
    pub halt: Option<StopCause>,
}

/// Why an operator, or who acts as one, wants the vehicle to stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StopCause {
    /// A person asked for it by a signal.
    #[error("the operator has asked for a stop")]
    Operator,
    /// The program ends: by a signal, or because all has been driven.
    #[error("the program ends")]
    ProgramEnds,
    /// The time of the run is over.
    #[error("the time of the run is over")]
    TimeOver,
    /// The program was suspended and goes on.
    #[error("the program was suspended")]
    Suspended,
    /// Somebody presses the emergency stop of ROS 2.
    #[error("the emergency stop is pressed")]
    EmergencyStop,
    /// Those who could press it have been silent for too long.
    #[error("the emergency stop is silent")]
    EmergencyStopSilent,
    /// Somebody has come who may press it, and his first word is still on its way.
    #[error("who may press the emergency stop has come and is not heard")]
    EmergencyStopUnheard,
    /// Who wanted the path has taken it back.
    #[error("the goal was cancelled")]
    Cancelled,
    /// Who wanted the path has left.
    #[error("the client has left")]
    ClientLeft,
    /// The node takes no paths any more.
    #[error("the node was deactivated")]
    Deactivated,
    /// The clock that others go by was set.
    #[error("the clock has jumped")]
    ClockJumped,
    /// A path has come that cannot be driven.
    #[error("the newest path cannot be driven")]
    PathRefused,
    /// Where the path lies is no longer known.
    #[error("the path's frame is no longer known")]
    FrameLost,
    /// The controller finds no plan.
    #[error("there was no plan for longer than tolerated")]
    NoPlan,
    /// The vehicle does not get on.
    #[error("there was no progress for longer than tolerated")]
    NoProgress,
    /// The drives did not let themselves be armed.
    #[error("the drives could not be armed")]
    NotArmed,
    /// The drive for the path has ended.
    #[error("the drive for the path has ended")]
    DriveEnded,
    /// The vehicle was armed without a path.
    #[error("nobody has asked for this drive")]
    NobodyAsked,
}

impl StopCause {
    /// All of them.
    pub const ALL: [Self; 18] = [
        Self::Operator,
        Self::ProgramEnds,
        Self::TimeOver,
        Self::Suspended,
        Self::EmergencyStop,
        Self::EmergencyStopSilent,
        Self::EmergencyStopUnheard,
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
        Self::NobodyAsked,
    ];

    /// Returns whether something is wrong, other than that somebody has changed his mind.
    pub fn is_fault(self) -> bool {
        match self {
            Self::Suspended
            | Self::EmergencyStop
            | Self::EmergencyStopSilent
            | Self::EmergencyStopUnheard
            | Self::ClockJumped
            | Self::FrameLost
            | Self::NoPlan
            | Self::NoProgress
            | Self::NotArmed => true,
            Self::Operator
            | Self::ProgramEnds
            | Self::TimeOver
            | Self::Cancelled
            | Self::ClientLeft
            | Self::Deactivated
            | Self::PathRefused
            | Self::DriveEnded
            | Self::NobodyAsked => false,
        }
    }
}

/// Everything the state machine looks at in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetyInputs {
    /// Instant, s.
    pub time_s: f64,
    /// Newest intent of the controller.
    pub intent: Option<ControllerOutput>,
    /// Newest feedback of both drives, with the instant of the older half.
    pub feedback: Option<Stamped<DriveFeedback>>,
    /// State of the link to the drives.
    pub link: LinkState,
    /// Since when nothing could be sent, s; none where the last frame went out.
    pub unsent_since_s: Option<f64>,
    /// The operator.
    pub operator: OperatorRequests,
}

/// Where the state machine is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SafetyState {
    /// Off since the start; waits for an operator.
    Disarmed,
    /// Sends zeros, off, until the drives say that they stand and are off.
    Zeroing,
    /// Sends zeros, on, until the drives say that they are on.
    Enabling,
    /// Passes commands on.
    Driving,
    /// Leads the speeds to zero.
    Stopping,
    /// Off until an operator re-arms.
    Latched,
}

/// Why a state changed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Reason {
    /// An operator armed, or who acts as one.
    #[error("armed")]
    Armed,
    /// Zeros were sent for long enough and the drives stand, off.
    #[error("the drives stand and are off")]
    Standing,
    /// The drives say that they are on.
    #[error("the drives are on")]
    Enabled,
    /// The ramp has ended.
    #[error("the ramp has ended")]
    RampEnded,
    /// An operator wants it, or who acts as one: on the ramp or at once.
    #[error("{0}")]
    Requested(StopCause),
    /// The drives report an emergency stop.
    #[error("the drives report an emergency stop")]
    EmergencyStop,
    /// A drive reports a fault.
    #[error("a drive reports a fault")]
    DriveFault,
    /// A drive is off by itself, or because of others.
    #[error("a drive is off that was told to be on")]
    DriveOff,
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
        /// Its age, s; infinite where there was none.
        age_s: f64,
    },
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
    /// The link to the drives carries no messages.
    #[error("the link to the drives is {state:?}")]
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
    #[error("the drives did not follow within {time_s:.2} s, they are {mode:?}")]
    Handshake {
        /// For how long was waited, s.
        time_s: f64,
        /// What the drives said last.
        mode: DriveMode,
    },
    /// Time went back or is no number.
    #[error("the time went from {before_s} s to {now_s} s")]
    Clock {
        /// Of the step before, s.
        before_s: f64,
        /// Of this step, s.
        now_s: f64,
    },
}

fn feedback_age(age_s: f64) -> String {
    if age_s == f64::INFINITY {
        return "there is no feedback".to_owned();
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
