//! Positions of a running topic, for a path.

use super::fixes::Fixes;
use super::positions::Positions;
use anyhow::{Result, bail, ensure};
use sidehill_bridge::ros2::conversions::{from_pose, nanoseconds};
use sidehill_bridge::ros2::position::AnyPosition;

/// Positions collected so far.
#[derive(Default)]
pub struct LivePositions {
    /// Frame of the first odometry.
    frame: Option<String>,
    points_m: Vec<[f64; 3]>,
    fixes: Fixes,
}

impl LivePositions {
    /// Takes a message.
    ///
    /// # Errors
    /// Why the message has no position that continues the previous ones.
    pub fn take(&mut self, message: AnyPosition<'_>) -> Result<()> {
        match message {
            AnyPosition::Odometry(odometry) => {
                let at = from_pose(&odometry.pose.pose)?.translation;
                let frame = &odometry.header.frame_id;
                let first = self.frame.get_or_insert_with(|| frame.clone());
                ensure!(
                    first == frame,
                    "its frame is \"{frame}\", that of the first message is \"{first}\""
                );
                self.points_m.push([at.x, at.y, at.z]);
            }
            AnyPosition::Fix(fix) => {
                let before = self.fixes.len();
                let time_ns = nanoseconds(fix.header.stamp).map_err(Into::into);
                self.fixes.take(time_ns, fix)?;
                if self.fixes.len() == before {
                    bail!("a fix without a position (status {})", fix.status.status);
                }
            }
        }
        Ok(())
    }

    /// Returns how many positions there are.
    pub fn count(&self) -> usize {
        self.points_m.len() + self.fixes.len()
    }

    /// Returns the positions.
    pub fn finish(mut self) -> Positions {
        let origin = self.fixes.origin();
        let has_heights = self.fixes.has_heights();
        self.points_m.extend(self.fixes.positions_m());
        Positions {
            points_m: self.points_m,
            origin,
            has_heights,
            notes: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_bridge::ros2::message::{NavSatFix, NavSatStatus, Odometry};

    fn odometry(frame: &str, x_m: f64, w: f64) -> Odometry {
        let mut odometry = Odometry::default();
        odometry.header.frame_id = frame.to_owned();
        odometry.pose.pose.position.x = x_m;
        odometry.pose.pose.orientation.w = w;
        odometry
    }

    #[test]
    fn odometry_that_does_not_continue_the_drive_is_left_out() {
        let mut live = LivePositions::default();
        let mut take = |message: Odometry| live.take(AnyPosition::Odometry(&message));
        take(odometry("odom", 1.0, 1.0)).unwrap();
        for (message, reason) in [
            (odometry("map", 2.0, 1.0), "its frame is \"map\""),
            (odometry("odom", f64::NAN, 1.0), "not finite"),
            (odometry("odom", 2.0, 0.0), "orientation"),
        ] {
            let error = take(message).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
        take(odometry("odom", 3.0, 1.0)).unwrap();
        assert_eq!(live.count(), 2);
        let found = live.finish();
        assert_eq!(found.points_m, [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
        assert_eq!(found.origin, None);
    }

    #[test]
    fn fixes_are_projected_from_the_first_with_a_position() {
        let fix = |status, latitude, altitude| NavSatFix {
            status: NavSatStatus { status, service: 1 },
            latitude,
            longitude: -4.5,
            altitude,
            ..NavSatFix::default()
        };
        let mut live = LivePositions::default();
        let mut take = |message: NavSatFix| live.take(AnyPosition::Fix(&message));
        let error = take(fix(-1, 0.0, 0.0)).unwrap_err().to_string();
        assert!(error.contains("status -1"), "{error}");
        take(fix(0, 36.7, 60.0)).unwrap();
        take(fix(0, 36.701, 62.0)).unwrap();
        let found = live.finish();
        assert_eq!(found.origin.unwrap().latitude_deg, 36.7);
        let [east_m, north_m, up_m] = found.points_m[1];
        // A thousandth of a degree of the meridian at this latitude.
        assert!((north_m - 110.98).abs() < 0.05, "{north_m}");
        assert!(east_m.abs() < 1e-3 && up_m == 2.0, "{east_m} {up_m}");
    }
}
