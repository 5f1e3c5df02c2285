//! The frame of a path in that of the odometry, in the plane.

use nalgebra::Isometry3;
use sidehill_bridge::ros2::convert::pose_and_attitude;
use sidehill_controller::path::Point2;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use std::f64::consts::FRAC_PI_2;

/// Smallest motion of a frame at the vehicle that is followed, m and rad.
const MOVED_M: f64 = 0.01;
const MOVED_RAD: f64 = 0.002;

/// Returns a frame's place in the plane, turned by its heading.
pub(crate) fn planar(frame: &Isometry3<f64>) -> PlanarPose {
    // A frame that is not turned has its x axis forward, which is a heading of -90 deg.
    let mut pose = pose_and_attitude(frame).0.planar();
    pose.yaw_rad += FRAC_PI_2;
    pose
}

/// Returns a pose that is given in a frame in the parent of that frame.
pub(crate) fn pose_in(pose: &PlanarPose, frame: &PlanarPose) -> PlanarPose {
    let at = Point2 {
        x_m: pose.x_m,
        y_m: pose.y_m,
    }
    .seen_from(frame);
    PlanarPose {
        x_m: at.x_m,
        y_m: at.y_m,
        yaw_rad: pose.yaw_rad + frame.yaw_rad,
    }
}

/// Returns the parent of a frame as seen from the frame.
pub(crate) fn inverse(frame: &PlanarPose) -> PlanarPose {
    let (sin, cos) = frame.yaw_rad.sin_cos();
    PlanarPose {
        x_m: -cos * frame.x_m - sin * frame.y_m,
        y_m: sin * frame.x_m - cos * frame.y_m,
        yaw_rad: -frame.yaw_rad,
    }
}

/// Returns whether a frame has moved from `before` to `now`, as seen at a pose in its parent.
pub(crate) fn has_moved(before: &PlanarPose, now: &PlanarPose, at: &PlanarPose) -> bool {
    let turned_rad = wrap_angle(now.yaw_rad - before.yaw_rad);
    // The point of the frame that was at the pose is now elsewhere.
    let (sin, cos) = turned_rad.sin_cos();
    let (x_m, y_m) = (at.x_m - before.x_m, at.y_m - before.y_m);
    let moved_m =
        (now.x_m + cos * x_m - sin * y_m - at.x_m).hypot(now.y_m + sin * x_m + cos * y_m - at.y_m);
    moved_m > MOVED_M || turned_rad.abs() > MOVED_RAD
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: PlanarPose = PlanarPose {
        x_m: 0.0,
        y_m: 0.0,
        yaw_rad: 0.0,
    };

    #[test]
    fn the_inverse_of_a_frame_takes_back() {
        let frame = PlanarPose {
            x_m: 1.0,
            y_m: -2.0,
            yaw_rad: 0.7,
        };
        let pose = PlanarPose {
            x_m: 0.3,
            y_m: 0.4,
            yaw_rad: -0.2,
        };
        let back = pose_in(&pose_in(&pose, &frame), &inverse(&frame));
        assert!((back.x_m - pose.x_m).abs() < 1e-12 && (back.y_m - pose.y_m).abs() < 1e-12);
        assert!((back.yaw_rad - pose.yaw_rad).abs() < 1e-12);
    }

    #[test]
    fn motion_counts_where_the_vehicle_is() {
        let at = PlanarPose {
            x_m: 20.0,
            ..ORIGIN
        };
        let moved = |x_m, yaw_rad| {
            let now = PlanarPose {
                x_m,
                yaw_rad,
                ..ORIGIN
            };
            [
                has_moved(&ORIGIN, &now, &ORIGIN),
                has_moved(&ORIGIN, &now, &at),
            ]
        };
        assert_eq!(moved(0.009, 0.0), [false, false]);
        assert_eq!(moved(0.011, 0.0), [true, true]);
        // 0.001 rad is 2 cm at 20 m.
        assert_eq!(moved(0.0, 0.001), [false, true]);
        assert_eq!(moved(0.0, -0.003), [true, true]);
    }
}
