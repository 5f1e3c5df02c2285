//! Definitions of the messages that are recorded, as ROS 2 writes them in `.msg` files.

/// Definitions by type; fields are in the order of the structs in [`sidehill_bridge::ros2::message`].
const DEFINITIONS: [(&str, &str); 28] = [
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    (
        "std_msgs/Header",
        "builtin_interfaces/Time stamp\nstring frame_id\n",
    ),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    (
        "geometry_msgs/Quaternion",
        "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    ),
    (
        "geometry_msgs/Pose",
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    ),
    (
        "geometry_msgs/PoseStamped",
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    ),
    (
        "geometry_msgs/Transform",
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    ),
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    ),
    (
        "tf2_msgs/TFMessage",
        "geometry_msgs/TransformStamped[] transforms\n",
    ),
    (
        "nav_msgs/Path",
        "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n",
    ),
    ("diagnostic_msgs/KeyValue", "string key\nstring value\n"),
    (
        "diagnostic_msgs/DiagnosticStatus",
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\n\
         string hardware_id\ndiagnostic_msgs/KeyValue[] values\n",
    ),
    (
        "diagnostic_msgs/DiagnosticArray",
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
    ),
    (
        "rcl_interfaces/Log",
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n\
         string function\nuint32 line\n",
    ),
    (
        "std_msgs/ColorRGBA",
        "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n",
    ),
    ("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n"),
    ("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n"),
    (
        "sensor_msgs/CompressedImage",
        "std_msgs/Header header\nstring format\nuint8[] data\n",
    ),
    (
        "visualization_msgs/MeshFile",
        "string filename\nuint8[] data\n",
    ),
    (
        "visualization_msgs/Marker",
        "int32 ARROW=0\nint32 CUBE=1\nint32 SPHERE=2\nint32 CYLINDER=3\nint32 LINE_STRIP=4\n\
         int32 LINE_LIST=5\nint32 CUBE_LIST=6\nint32 SPHERE_LIST=7\nint32 POINTS=8\n\
         int32 TEXT_VIEW_FACING=9\nint32 MESH_RESOURCE=10\nint32 TRIANGLE_LIST=11\n\
         int32 ARROW_STRIP=12\nint32 ADD=0\nint32 MODIFY=0\nint32 DELETE=2\nint32 DELETEALL=3\n\
         std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n\
         geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
         builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n\
         std_msgs/ColorRGBA[] colors\nstring texture_resource\n\
         sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\n\
         string text\nstring mesh_resource\nvisualization_msgs/MeshFile mesh_file\n\
         bool mesh_use_embedded_materials\n",
    ),
    (
        "visualization_msgs/MarkerArray",
        "visualization_msgs/Marker[] markers\n",
    ),
    (
        "sensor_msgs/JointState",
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n\
         float64[] effort\n",
    ),
    ("sidehill_msgs/ControllerCycle", CONTROLLER_CYCLE),
    ("sidehill_msgs/LoopCycle", LOOP_CYCLE),
    ("sidehill_msgs/PathCommand", PATH_COMMAND),
    ("sidehill_msgs/GuardState", GUARD_STATE),
    ("sidehill_msgs/FixState", FIX_STATE),
];

/// Definition of `ControllerCycle`.
const CONTROLLER_CYCLE: &str = "\
# One step of the controller. Frames: x_m is X_g, y_m is Y_g, yaw counter-clockwise from Y_g.
uint64 index  # counted from 0; a gap is a lost record
float64 time_s  # time of the cycle
bool engaged  # whether commands reached the drives
uint64 path  # serial of the path command that was applied before this step; 0 for none
bool cut  # whether the deadline ended a solve
uint32 cut_at  # which look at the deadline ended it
bool has_tread_speeds
float64 tread_speeds_time_s
float64 left_m_s  # as measured, before c_l and c_r
float64 right_m_s
bool has_attitude
float64 attitude_time_s
float64 roll_rad
float64 pitch_rad
bool has_pose
float64 pose_time_s
float64 x_m
float64 y_m
float64 z_m
float64 yaw_rad
float64 traction_m_s  # decided: effective traction
float64 steer_m_s  # decided: effective steer
string status
uint64 reference  # number of the path
float64 estimated_x_m
float64 estimated_y_m
float64 estimated_yaw_rad
float64 estimated_roll_rad
float64 estimated_pitch_rad
float64 model_error_m_s
float64 pose_age_s
float64 cross_track_m
float64 arc_length_m
uint32 solver_iterations
string solver_path
float64 solve_us
bool has_yaw_rate  # a reading, as those above
float64 yaw_rate_time_s
float64 yaw_rate_rad_s  # about the body's upward axis, counter-clockwise positive
";

/// Definition of `LoopCycle`.
const LOOP_CYCLE: &str = "\
# One cycle of the control loop.
float64 time_s
float64 lateness_s
float64 slack_s
string state
bool enable
float64 traction_m_s
float64 steer_m_s
bool sent
float64 feedback_traction_m_s
float64 feedback_steer_m_s
float64 feedback_age_s
string link
uint64 refused
uint64 skipped
";

/// Definition of `PathCommand`.
const PATH_COMMAND: &str = "\
# A path for the controller, for replay; to look at it use the topic of nav_msgs/Path.
uint64 serial
bool present  # false: the path was taken away
uint64 number
uint32 laps
bool joined  # whether the vehicle joins the path at from_m, else at its start
float64 from_m
uint8[] trajectory
";

/// Definition of `FixState`.
const FIX_STATE: &str = "\
# A fix of a satellite receiver.
float64 time_s  # when it was measured; nan where its stamp was refused
int8 status  # of sensor_msgs/NavSatStatus: -1 no fix, 0 alone, 1 corrected from satellites, 2 from the ground (RTK)
float64 sigma_m  # larger standard deviation of east and north; nan where the receiver does not tell
bool used  # whether it was good enough for a pose
";

/// Definition of `GuardState`.
const GUARD_STATE: &str = "\
# What the steepness guard finds in a cycle.
float64 time_s
float64 rollover_margin  # 1 at standstill on level ground, 0 where the vehicle tips over
float64 friction_use  # friction needed over friction available
float64 friction  # coefficient of friction that is reckoned with
float64 speed_share  # share of the reference's speed that is driven
bool place_ahead  # whether a place ahead is driven slower or not at all
float64 place_in_s  # time along the reference to that place
";

/// Returns the definition of a type and of all types in it, in the encoding `ros2msg`; empty for a type
/// that is not known.
pub fn schema(kind: &str) -> String {
    let mut kinds = vec![kind];
    let mut text = String::new();
    let mut done = 0;
    while let Some(&kind) = kinds.get(done) {
        let Some((kind, definition)) = DEFINITIONS.iter().find(|(name, _)| *name == kind) else {
            return String::new();
        };
        if done > 0 {
            text.push_str(&"=".repeat(80));
            text.push_str("\nMSG: ");
            text.push_str(kind);
            text.push('\n');
        }
        text.push_str(definition);
        for line in definition.lines() {
            let field = line.split(' ').next().unwrap_or_default();
            let field = field.trim_end_matches("[]");
            if field.contains('/') && !kinds.contains(&field) {
                kinds.push(field);
            }
        }
        done += 1;
    }
    text
}

#[cfg(test)]
mod tests {
    use crate::Topic;

    #[test]
    fn every_topic_has_a_definition_with_all_its_types() {
        for topic in Topic::ALL {
            let schema = topic.schema();
            assert!(!schema.is_empty(), "{topic:?}");
            for line in schema.lines().filter(|line| !line.starts_with('#')) {
                let field = line.split(' ').next().unwrap_or_default();
                let field = field.trim_end_matches("[]");
                let defined = schema.contains(&format!("MSG: {field}\n"));
                assert!(!field.contains('/') || defined, "{topic:?}: {line}");
            }
        }
    }
}
