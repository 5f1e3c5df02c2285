//! The topics of a recording, and the messages that ROS 2 has no type for.

use super::schema;
use sidehill_bridge::ros2::message::{Time, wire};

/// What is recorded and shown live.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// Every step of the controller: what it got, exactly, and what it decided.
    ControllerCycle,
    /// Every cycle of the control loop.
    LoopCycle,
    /// Paths as the controller got them.
    PathCommand,
    /// Estimated pose; the true one without a controller.
    Pose,
    /// True pose, of a simulation.
    TruePose,
    /// Where the vehicle should be.
    ReferencePose,
    /// Estimated pose as a transform.
    Transforms,
    /// The path that is followed.
    Path,
    /// Poses that the controller predicts.
    PredictedPath,
    /// Poses of the reference over the horizon.
    ReferencePath,
    /// Speeds of treads and motors.
    Treads,
    /// Margins against tipping over and sliding off, where the steepness guard is on.
    Guard,
    /// Fixes of a satellite receiver, where poses come from one.
    Fix,
    /// Ground, path, vehicle, slide and ICRs, to be looked at.
    Scene,
    /// States of controller, safety and recording.
    Diagnostics,
    /// What happened.
    Events,
}

impl Topic {
    /// All of them.
    pub const ALL: [Self; 16] = [
        Self::ControllerCycle,
        Self::LoopCycle,
        Self::PathCommand,
        Self::Pose,
        Self::TruePose,
        Self::ReferencePose,
        Self::Transforms,
        Self::Path,
        Self::PredictedPath,
        Self::ReferencePath,
        Self::Treads,
        Self::Guard,
        Self::Fix,
        Self::Scene,
        Self::Diagnostics,
        Self::Events,
    ];

    /// Returns the name of the topic.
    pub fn name(self) -> &'static str {
        match self {
            Self::ControllerCycle => "/sidehill/controller_cycle",
            Self::LoopCycle => "/sidehill/loop_cycle",
            Self::PathCommand => "/sidehill/path_command",
            Self::Pose => "/sidehill/pose",
            Self::TruePose => "/sidehill/true_pose",
            Self::ReferencePose => "/sidehill/reference_pose",
            Self::Transforms => "/tf",
            Self::Path => "/sidehill/path",
            Self::PredictedPath => "/sidehill/predicted_path",
            Self::ReferencePath => "/sidehill/reference_path",
            Self::Treads => "/sidehill/treads",
            Self::Guard => "/sidehill/guard",
            Self::Fix => "/sidehill/fix",
            Self::Scene => "/sidehill/scene",
            Self::Diagnostics => "/diagnostics",
            Self::Events => "/rosout",
        }
    }

    /// Returns the type of its messages, without `msg/`.
    fn short_type(self) -> &'static str {
        match self {
            Self::ControllerCycle => "sidehill_msgs/ControllerCycle",
            Self::LoopCycle => "sidehill_msgs/LoopCycle",
            Self::PathCommand => "sidehill_msgs/PathCommand",
            Self::Pose | Self::TruePose | Self::ReferencePose => "geometry_msgs/PoseStamped",
            Self::Transforms => "tf2_msgs/TFMessage",
            Self::Path | Self::PredictedPath | Self::ReferencePath => "nav_msgs/Path",
            Self::Treads => "sensor_msgs/JointState",
            Self::Guard => "sidehill_msgs/GuardState",
            Self::Fix => "sidehill_msgs/FixState",
            Self::Scene => "visualization_msgs/MarkerArray",
            Self::Diagnostics => "diagnostic_msgs/DiagnosticArray",
            Self::Events => "rcl_interfaces/Log",
        }
    }

    /// Returns the type of its messages as ROS 2 names it, such as `nav_msgs/msg/Path`.
    pub fn type_name(self) -> String {
        self.short_type().replace('/', "/msg/")
    }

    /// Returns the definition of its messages in the encoding `ros2msg`.
    pub fn schema(self) -> String {
        schema(self.short_type())
    }
}

wire! {
    /// One step of the controller. What it got is in the first half, exactly, with NaN where a reading
    /// was absent; what it decided in the second. The yaw rate came later and is therefore last.
    ControllerCycle = "sidehill_msgs" / "ControllerCycle" {
        index: u64,
        time_s: f64,
        engaged: bool,
        path: u64,
        cut: bool,
        cut_at: u32,
        has_tread_speeds: bool,
        tread_speeds_time_s: f64,
        left_m_s: f64,
        right_m_s: f64,
        has_attitude: bool,
        attitude_time_s: f64,
        roll_rad: f64,
        pitch_rad: f64,
        has_pose: bool,
        pose_time_s: f64,
        x_m: f64,
        y_m: f64,
        z_m: f64,
        yaw_rad: f64,
        traction_m_s: f64,
        steer_m_s: f64,
        status: String,
        reference: u64,
        estimated_x_m: f64,
        estimated_y_m: f64,
        estimated_yaw_rad: f64,
        estimated_roll_rad: f64,
        estimated_pitch_rad: f64,
        model_error_m_s: f64,
        pose_age_s: f64,
        cross_track_m: f64,
        arc_length_m: f64,
        solver_iterations: u32,
        solver_path: String,
        solve_us: f64,
        has_yaw_rate: bool,
        yaw_rate_time_s: f64,
        yaw_rate_rad_s: f64,
    }
    /// One cycle of the control loop, as `cycles.csv` has it.
    LoopCycle = "sidehill_msgs" / "LoopCycle" {
        time_s: f64,
        lateness_s: f64,
        slack_s: f64,
        state: String,
        enable: bool,
        traction_m_s: f64,
        steer_m_s: f64,
        sent: bool,
        feedback_traction_m_s: f64,
        feedback_steer_m_s: f64,
        feedback_age_s: f64,
        link: String,
        refused: u64,
        skipped: u64,
    }
    /// What the steepness guard finds in a cycle.
    GuardState = "sidehill_msgs" / "GuardState" {
        time_s: f64,
        rollover_margin: f64,
        friction_use: f64,
        friction: f64,
        speed_share: f64,
        place_ahead: bool,
        place_in_s: f64,
    }
    /// A fix of a satellite receiver: when it was measured, its status as sensor_msgs/NavSatStatus has it, its standard
    /// deviation, NaN where the receiver does not tell it, and whether it was good enough for a pose.
    FixState = "sidehill_msgs" / "FixState" {
        time_s: f64,
        status: i8,
        sigma_m: f64,
        used: bool,
    }
    /// A path for the controller. `trajectory` is CDR of this version of the program.
    PathCommand = "sidehill_msgs" / "PathCommand" {
        serial: u64,
        present: bool,
        number: u64,
        laps: u32,
        joined: bool,
        from_m: f64,
        trajectory: Vec<u8>,
    }
    /// A line of a log.
    LogLine = "rcl_interfaces" / "Log" {
        stamp: Time,
        level: u8,
        name: String,
        msg: String,
        file: String,
        function: String,
        line: u32,
    }
}

impl LogLine {
    /// Level of informational messages.
    pub const INFO: u8 = 20;
    /// Level of what somebody should look at.
    pub const WARN: u8 = 30;
}
