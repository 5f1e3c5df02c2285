//! Messages of ROS 2 as DDS and bags have them, and what is made of them; the first byte chooses the type.
#![no_main]
use sidehill::drive_log::LivePositions;
use sidehill_bridge::ros2::conversions::{from_pose, from_transform, nanoseconds};
use sidehill_bridge::ros2::convert::{from_twist, pose_and_attitude};
use sidehill_bridge::ros2::joints::TreadJoints;
use sidehill_bridge::ros2::message::cdr::from_cdr;
use sidehill_bridge::ros2::message::{
    Bool, Clock, Costmap, CostmapUpdate, DiagnosticArray, Float64MultiArray, Imu, JointState,
    NavSatFix, OccupancyGrid, OccupancyGridUpdate, Odometry, Path, PoseStamped,
    PoseWithCovarianceStamped, SpeedLimit, TfMessage, TrackingFeedback, Twist, TwistStamped,
};
use sidehill_bridge::ros2::position::AnyPosition;
use sidehill_bridge::ros2::transforms::Transforms;
use sidehill_controller::path::Smoothing;
use sidehill_controller::speed_profile::SpeedLimits;
use sidehill_controller::tracked_point::TrackedPoint;
use sidehill_fuzz::{PATH_MAX_M, target};
use sidehill_ros2::server::requested_path::RequestedPath;
use sidehill_ros2::server::route::{ProfiledRoute, RouteSettings};

target!(|data| {
    let Some((which, bytes)) = data.split_first() else {
        return;
    };
    match which % 20 {
        0 => drop(from_cdr::<Odometry>(bytes).map(|odometry| {
            let _ = from_twist(&odometry.twist.twist);
            LivePositions::default().take(AnyPosition::Odometry(&odometry))
        })),
        1 => drop(from_cdr::<NavSatFix>(bytes).map(|fix| {
            let mut positions = LivePositions::default();
            let _ = positions.take(AnyPosition::Fix(&fix));
            positions.finish()
        })),
        2 => {
            drop(from_cdr::<JointState>(bytes).map(|joints| TreadJoints::default().treads(&joints)))
        }
        3 => drop(from_cdr::<TfMessage>(bytes).map(|message| {
            let mut transforms = Transforms::default();
            for moved in message.transforms {
                let time_s = nanoseconds(moved.header.stamp).map_or(0.0, |ns| 1e-9 * ns as f64);
                if let Ok(pose) = from_transform(&moved.transform) {
                    let (parent, child) = (&moved.header.frame_id, &moved.child_frame_id);
                    transforms.take(parent, child, (time_s, 0.0), pose, which & 32 > 0);
                }
            }
            transforms.look_up("map", "base_link", 0.0, 0.5).is_ok()
        })),
        4 => drop(from_cdr::<Path>(bytes).map(|path| {
            let path = RequestedPath::from_message(&path)?;
            let legs_m = path.poses.windows(2).map(|pair| {
                let [a, b] = [&pair[0], &pair[1]];
                (b.x_m - a.x_m).hypot(b.y_m - a.y_m)
            });
            if legs_m.sum::<f64>() > PATH_MAX_M {
                return Ok(());
            }
            let settings = RouteSettings {
                smoothing: Smoothing::default(),
                limits: SpeedLimits {
                    speed_max_m_s: 1.0,
                    traction_max_m_s: 1.0,
                    steer_max_m_s: 1.0,
                    tread_max_m_s: 2.0,
                    acceleration_m_s2: 1.0,
                    deceleration_m_s2: 1.0,
                    steer_acceleration_m_s2: 1.0,
                    lateral_acceleration_m_s2: 1.0,
                    track_width_m: 2.0,
                },
                tracked_point: TrackedPoint::default(),
                use_orientations: which & 32 > 0,
            };
            ProfiledRoute::build(&path, &path.poses[0], &settings).map(drop)
        })),
        5 => drop(
            from_cdr::<PoseStamped>(bytes)
                .map(|pose| from_pose(&pose.pose).map(|pose| pose_and_attitude(&pose))),
        ),
        6 => drop(from_cdr::<Imu>(bytes)),
        7 => drop(from_cdr::<PoseWithCovarianceStamped>(bytes)),
        8 => drop(from_cdr::<Costmap>(bytes)),
        9 => drop(from_cdr::<CostmapUpdate>(bytes)),
        10 => drop(from_cdr::<OccupancyGrid>(bytes)),
        11 => drop(from_cdr::<OccupancyGridUpdate>(bytes)),
        12 => drop(from_cdr::<Float64MultiArray>(bytes)),
        13 => drop(from_cdr::<SpeedLimit>(bytes)),
        14 => drop(from_cdr::<TrackingFeedback>(bytes)),
        15 => drop(from_cdr::<Twist>(bytes)),
        16 => drop(from_cdr::<TwistStamped>(bytes)),
        17 => drop(from_cdr::<DiagnosticArray>(bytes)),
        18 => drop(from_cdr::<Clock>(bytes)),
        _ => drop(from_cdr::<Bool>(bytes)),
    }
});
