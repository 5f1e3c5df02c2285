use crate::can::layout::DriveMode;
use serde::Serialize;
use sidehill_controller::controller::StopReason;
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MotorSpeeds;

/// What the controller says in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intent {
    /// Cycle for which it was decided, s.
    pub time_s: f64,
    /// Speeds it wants.
    pub command: MotorSpeeds,
    /// Whether it can drive.
    pub pilot: PilotState,
}

/// Whether the controller can drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PilotState {
    /// It waits for its first readings.
    Waiting,
    /// It drives.
    Driving,
    /// It stops the vehicle.
    Stopped(StopReason),
    /// It has followed its reference to the end.
    Finished,
}

/// What both drives say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveFeedback {
    /// Effective speeds reached.
    pub speeds: MotorSpeeds,
    /// State; the worse of the two drives'.
    pub mode: DriveMode,
}

/// State of the bus as far as the port knows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BusState {
    /// In order.
    #[default]
    Active,
    /// Many errors.
    Warning,
    /// Too many errors: the node only listens for them.
    Passive,
    /// The node has left the bus.
    BusOff,
    /// The interface is down.
    Down,
    /// There is no interface.
    Absent,
}

impl BusState {
    /// Returns whether frames may get through.
    pub fn carries(self) -> bool {
        matches!(self, Self::Active | Self::Warning | Self::Passive)
    }
}

/// What an operator asks for; each is a level, and arming acts where it rises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Operator {
    /// Drive.
    pub arm: bool,
    /// Stop on the ramp.
    pub stop: bool,
    /// Zero and disable at once: an emergency stop, or the program ends.
    pub halt: bool,
}

/// Everything the state machine looks at in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Instant, s.
    pub time_s: f64,
    /// Newest intent of the controller.
    pub intent: Option<Intent>,
    /// Newest feedback of both drives, with the instant of the older half.
    pub feedback: Option<Stamped<DriveFeedback>>,
    /// State of the bus.
    pub bus: BusState,
    /// Since when nothing could be sent, s; none where the last frame went out.
    pub unsent_since_s: Option<f64>,
    /// The operator.
    pub operator: Operator,
}

/// What the drives are told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Order {
    /// Effective speeds.
    pub speeds: MotorSpeeds,
    /// Whether the drives shall be on.
    pub enable: bool,
    /// Whether drives that can be told to do so may forget a fault: only after an operator has armed.
    pub fault_reset: bool,
}

impl Order {
    /// Zero, and off.
    pub const OFF: Self = Self {
        speeds: MotorSpeeds::STOP,
        enable: false,
        fault_reset: false,
    };
}

/// Where the state machine is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
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
    /// An operator armed.
    #[error("armed by the operator")]
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
    /// An operator asked for a stop.
    #[error("a stop was asked for")]
    OperatorStop,
    /// An emergency stop or the end of the program.
    #[error("halted by the operator or the end of the program")]
    Halted,
    /// The drives report an emergency stop.
    #[error("the drives report an emergency stop")]
    EmergencyStop,
    /// A drive reports a fault.
    #[error("a drive reports a fault")]
    DriveFault,
    /// A drive has switched itself off.
    #[error("a drive has switched itself off")]
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
    #[error("the feedback is {age_s:.3} s old")]
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
    /// The bus carries nothing.
    #[error("the bus is {state:?}")]
    Bus {
        /// Its state.
        state: BusState,
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

/// A change of state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transition {
    /// When, s.
    pub time_s: f64,
    /// From.
    pub from: State,
    /// To.
    pub to: State,
    /// Why.
    pub reason: Reason,
}
