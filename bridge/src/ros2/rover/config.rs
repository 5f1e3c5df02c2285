//! Settings of a virtual vehicle on the graph.

use crate::ros2::joints::TreadJoints;
use crate::ros2::settings::topics::AntennaConfig;
use crate::rover::{Fault, FaultWindow};
use serde::{Deserialize, Serialize};
use sidehill_controller::path::GeodeticOrigin;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// The `ros2:` section of a vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleNodeConfig {
    /// Name of the node. `--ros-args -r __node:=NAME` overrides it.
    pub node: String,
    /// Kind of command that the drives obey.
    pub command: CommandKind,
    /// Track width for converting between twist and tread speeds. None: the distance of the vehicle's tread ICRs.
    pub track_width_m: Option<f64>,
    /// [The joints](#joints) of the treads.
    pub joints: TreadJoints,
    /// [Names of the frames](#frames-of-the-virtual-rover).
    pub frames: VehicleFrames,
    /// [Pose of the odometry frame](#map-offset) in the map, whose axes are X_g, Y_g and Z_g.
    pub map_from_odom: PlanarOffset,
    /// Simulated seconds per second. With a factor, the vehicle publishes `/clock` and stamps with it. None: the time
    /// of the machine.
    pub clock_factor: Option<f64>,
    /// [Satellite receiver](#satellite-receiver-of-the-virtual-rover) in place of perfect odometry.
    pub gnss: Option<GnssConfig>,
    /// [Faults](#fault-on-ros-2) to inject.
    pub faults: Vec<VehicleFault>,
}

/// A satellite receiver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GnssConfig {
    /// [Place on earth](#datum) at which the world has x = 0, y = 0.
    pub datum: GeodeticOrigin,
    /// [Place of the antenna](#antenna).
    #[serde(default)]
    pub antenna: AntennaConfig,
}

impl Default for VehicleNodeConfig {
    fn default() -> Self {
        Self {
            node: "virtual_rover".to_owned(),
            command: CommandKind::default(),
            track_width_m: None,
            joints: TreadJoints::default(),
            frames: VehicleFrames::default(),
            map_from_odom: PlanarOffset::default(),
            clock_factor: None,
            gnss: None,
            faults: Vec::new(),
        }
    }
}

impl VehicleNodeConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        self.joints.validate()?;
        if let Some(factor) = self.clock_factor {
            let key = "ros2.clock_factor";
            Bounds::new(0.1, 20.0, "").check(key, factor)?;
        }
        if let Some(gnss) = &self.gnss {
            gnss.antenna.validate()?;
        }
        let offset = &self.map_from_odom;
        for (key, value) in [
            ("ros2.map_from_odom.x_m", offset.x_m),
            ("ros2.map_from_odom.y_m", offset.y_m),
            ("ros2.map_from_odom.yaw_deg", offset.yaw_deg),
        ] {
            Bounds::new(-1e6, 1e6, "").check(key, value)?;
        }
        self.faults.iter().try_for_each(check_fault)
    }
}

/// What the drives obey.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CommandKind {
    /// geometry_msgs/Twist on cmd_vel.
    #[default]
    Twist,
    /// geometry_msgs/TwistStamped on cmd_vel.
    TwistStamped,
    /// std_msgs/Float64MultiArray on tread_velocities/commands: of the left and the right joint.
    TreadVelocities,
    /// std_msgs/Float64, m/s, on traction/command and steer/command: the two motors.
    Motors,
}

/// Names of the frames.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleFrames {
    /// Frame of the world.
    pub map: String,
    /// Frame of odometry.
    pub odom: String,
    /// Frame of the vehicle.
    pub base: String,
    /// Level frame at the vehicle (REP-120), for nodes that know only a plane. Empty: none.
    pub footprint: String,
}

impl Default for VehicleFrames {
    fn default() -> Self {
        Self {
            map: "map".to_owned(),
            odom: "odom".to_owned(),
            base: "base_link".to_owned(),
            footprint: "base_footprint".to_owned(),
        }
    }
}

/// A frame's place in another on level ground.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlanarOffset {
    /// Along x of the map.
    pub x_m: f64,
    /// Along y of the map.
    pub y_m: f64,
    /// Counter-clockwise.
    pub yaw_deg: f64,
}

/// An injected fault and when it is active.
pub type VehicleFault = FaultWindow<VehicleFaultKind>;

/// What can go wrong.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VehicleFaultKind {
    /// These are not published.
    Stop(Vec<Stream>),
    /// All stamps stand.
    FreezeStamps,
    /// What is published arrives late by so many seconds.
    DelayS(f64),
    /// All stamps, and the clock if it is published, jump by so many seconds.
    ClockJumpS(f64),
    /// These contain NaN.
    NotANumber(Stream),
    /// These name a frame that does not exist.
    WrongFrame(Stream),
    /// The emergency stop is pressed.
    EmergencyStop,
    /// The motors go on as they did and no longer obey.
    IgnoreCommands,
}

/// What a vehicle publishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stream {
    /// odom.
    Odometry,
    /// imu.
    Imu,
    /// /tf.
    Transforms,
    /// joint_states.
    JointStates,
    /// /clock.
    Clock,
    /// fix.
    Fix,
}

impl Fault for VehicleFaultKind {
    fn presses_emergency_stop(&self) -> bool {
        *self == Self::EmergencyStop
    }

    fn ignores_commands(&self) -> bool {
        *self == Self::IgnoreCommands
    }

    fn delay_s(&self) -> f64 {
        match self {
            Self::DelayS(delay_s) => *delay_s,
            _ => 0.0,
        }
    }
}

fn check_fault(fault: &VehicleFault) -> Result<(), RangeError> {
    fault.validate([
        "ros2.faults.after_enabled_s",
        "ros2.faults.for_s",
        "ros2.faults.delay_s",
    ])?;
    if let VehicleFaultKind::ClockJumpS(jump_s) = fault.fault {
        let key = "ros2.faults.clock_jump_s";
        Bounds::new(-1e5, 1e5, "s").check(key, jump_s)?;
    }
    Ok(())
}
