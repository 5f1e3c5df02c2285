//! Scenario, column map and README of a set.

use super::bridge::{limits, usual_speed_m_s};
use super::port::PortKind;

/// Length of the figure of eight of the J8, m.
const EIGHT_M: f64 = 30.0;

/// Returns the scenario of a vehicle whose treads reach a speed, m/s, where that is known.
pub(super) fn scenario(name: &str, identified: &str, scale: f64, speed_m_s: Option<f64>) -> String {
    let controller = speed_m_s.map_or_else(String::new, |speed_m_s| {
        let limits = limits(speed_m_s);
        format!(
            "\n# Limits of each motor, in m/s and m/s^2, and of a tread, in m/s.\ncontroller: {{limits: {limits}}}\n"
        )
    });
    let usual_m_s = speed_m_s.map_or(f64::INFINITY, usual_speed_m_s);
    let period_s = (scale * EIGHT_M / usual_m_s).ceil().max(60.0);
    format!(
        "# A figure of eight on a hillside of 5 degrees, of a size that fits the vehicle.\n\
         \n\
         # Name in tables and plots.\n\
         name: {name}_figure_eight\n\
         \n\
         # What controllers know of the vehicle, relative to this file; with `plant: icrik` it also moves so.\n\
         vehicle: vehicle.yaml\n\
         \n\
         # What moves the vehicle with `plant: contact`, and what controllers know of it then.\n\
         contact: {{vehicle: contact.yaml, identified: {identified}}}\n\
         \n\
         # Ground: a plane that rises by slope_deg (degrees) towards uphill_heading_deg (degrees,\n\
         # counter-clockwise from Y_g, so 0 is up along +Y_g).\n\
         terrain: {{kind: plane, slope_deg: 5, uphill_heading_deg: 0}}\n\
         \n\
         # Lengths in m, period in s. A recorded route instead: route: {{file: route.gpx}}\n\
         course: {{shape: figure_eight, half_width_m: {width:.2}, half_length_m: {length:.2}, period_s: {period_s}}}\n\
         \n\
         # Controllers, run one after the other.\n\
         controllers: [contact-mpc, icrik-mpc, icrhk-mpc, pure-pursuit]\n\
         \n\
         # What moves the vehicle: icrik (the model itself) or contact (wheels with friction).\n\
         plant: contact\n\
         \n\
         # Seed of everything random, and step of the simulation, s.\n\
         seed: 1\n\
         step_s: 0.005\n\
         {controller}",
        width = 2.4 * scale,
        length = 3.9 * scale,
    )
}

pub(super) const COLUMNS: &str = "\
# Where your logs have their values, for `identify` and `odometry --columns`. As it stands: a CSV made
# of wheel speeds, an imu and poses of ROS 2. Change the names on the right to those of your columns.
time: t                     # s
tread_speed_left: wheel_left
tread_speed_right: wheel_right
tread_speed_scale: 1.0      # to m/s: a wheel's radius in m where the columns are rad/s
# Roll and pitch: kind paper or rep103 with roll and pitch in rad, quaternion with x, y, z, w, or level.
attitude: { kind: quaternion, x: qx, y: qy, z: qz, w: qw }
# Pose in m; heading: kind paper or rep103 with yaw in rad, or quaternion with x, y, z, w.
# repeats: true where the log repeats a pose until there is a new one.
pose: { x: x, y: y, z: z, heading: { kind: quaternion, x: pose_qx, y: pose_qy, z: pose_qz, w: pose_qw }, repeats: true }
";

pub(super) fn readme(name: &str, port: PortKind) -> String {
    let drive = match port {
        PortKind::Ros2 => {
            "4. Drive the virtual rover over ROS 2, in two terminals, and send it a path:\n\
             \n\
             \x20       sidehill vehicle virtual.yaml\n\
             \x20       sidehill run run.yaml\n\
             \x20       ros2 action send_goal /follow_path nav2_msgs/action/FollowPath \"{path: {header: {frame_id: odom}, poses: [{header: {frame_id: odom}, pose: {position: {x: 0.5, y: 0.0}, orientation: {w: 1.0}}}, {header: {frame_id: odom}, pose: {position: {x: 3.0, y: 0.0}, orientation: {w: 1.0}}}]}}\"\n\
             \n\
             5. On the vehicle: set the topics in run.yaml (odometry with the wheels' twist, not one that a filter\n\
             \x20  has smoothed: tread speeds are made of it; imu; cmd_vel and whether it is stamped) and\n\
             \x20  `track_width_m`, by which your base makes wheel speeds of a twist (its wheel separation times\n\
             \x20  multiplier).\n"
        }
        PortKind::Can => {
            "4. Drive the virtual rover over a virtual bus, in two terminals:\n\
             \n\
             \x20       ip link add vcan0 type vcan && ip link set vcan0 up\n\
             \x20       sidehill vehicle virtual.yaml\n\
             \x20       sidehill run run.yaml --arm\n\
             \n\
             5. On the vehicle: put your CAN database in place of j8.dbc and name its messages in can.yaml.\n"
        }
    };
    format!(
        "# {name} with Sidehill\n\
         \n\
         1. Read vehicle.yaml and contact.yaml; correct mass, payload and measures. Then\n\
         \n\
         \x20       sidehill check *.yaml\n\
         \n\
         2. Simulate it on wheels with friction, on 5 degrees, and look at out/report.html:\n\
         \n\
         \x20       sidehill simulate scenario.yaml --out out\n\
         \n\
         3. Log your vehicle: varied driving on level ground, then turning on a slope (tread speeds, roll,\n\
         \x20  pitch, poses). Name its columns in columns.yaml and identify:\n\
         \n\
         \x20       sidehill identify --level level.csv --slope slope.csv --columns columns.yaml --vehicle vehicle.yaml --out identified_from_logs.yaml\n\
         \n\
         \x20  Then name the identified file in scenario.yaml and run.yaml.\n\
         {drive}\
         6. First drive: wheels off the ground, emergency stop in reach, low `speed_m_s`, level ground first.\n"
    )
}
