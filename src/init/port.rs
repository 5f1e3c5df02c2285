/// Link to the drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum PortKind {
    /// `cmd_vel`, odometry and imu topics of ROS 2.
    #[default]
    Ros2,
    /// A CAN bus, with an example of a CAN database.
    Can,
}
