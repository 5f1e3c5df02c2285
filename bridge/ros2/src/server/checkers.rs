//! Progress and goal checkers, as those of Nav2.

use sidehill_plant::frames::{PlanarPose, wrap_angle};

/// Checks that the vehicle makes progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct ProgressChecker {
    /// Time and pose of the last progress.
    last: Option<(f64, PlanarPose)>,
}

impl ProgressChecker {
    /// Returns false where the vehicle has not moved by `radius_m` for longer than `time_s`.
    pub fn made_progress(
        &mut self,
        now_s: f64,
        pose: &PlanarPose,
        radius_m: f64,
        time_s: f64,
    ) -> bool {
        let (since_s, from) = *self.last.get_or_insert((now_s, *pose));
        if (pose.x_m - from.x_m).hypot(pose.y_m - from.y_m) >= radius_m {
            self.last = Some((now_s, *pose));
            return true;
        }
        now_s - since_s <= time_s
    }

    /// Starts over.
    pub fn reset(&mut self) {
        self.last = None;
    }
}

/// Distance and heading error to a goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalError {
    /// Distance, m.
    pub distance_m: f64,
    /// Heading less the goal's, rad, from -pi to pi.
    pub heading_rad: f64,
}

impl GoalError {
    /// Returns the error of `pose` to `goal`.
    pub fn of(pose: &PlanarPose, goal: &PlanarPose) -> Self {
        Self {
            distance_m: (pose.x_m - goal.x_m).hypot(pose.y_m - goal.y_m),
            heading_rad: wrap_angle(pose.yaw_rad - goal.yaw_rad),
        }
    }

    /// Returns whether it is within both tolerances.
    pub fn within(&self, distance_m: f64, heading_rad: f64) -> bool {
        self.distance_m <= distance_m && self.heading_rad.abs() <= heading_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f64, yaw_rad: f64) -> PlanarPose {
        PlanarPose {
            x_m,
            y_m: 0.0,
            yaw_rad,
        }
    }

    #[test]
    fn standing_and_pivoting_are_no_progress() {
        let mut checker = ProgressChecker::default();
        let mut made_progress =
            |now_s: f64, x_m: f64| checker.made_progress(now_s, &at(x_m, now_s), 0.5, 10.0);
        assert!(made_progress(0.0, 0.0) && made_progress(9.0, 0.4) && made_progress(9.5, 0.5));
        assert!(made_progress(19.0, 0.9));
        assert!(!made_progress(19.6, 0.9));
        checker.reset();
        assert!(checker.made_progress(40.0, &at(0.9, 0.0), 0.5, 10.0));
    }

    #[test]
    fn a_goal_is_a_place_and_a_heading() {
        let goal = at(1.0, 3.1);
        assert!(GoalError::of(&at(1.2, -3.1), &goal).within(0.25, 0.25));
        assert!(!GoalError::of(&at(1.3, 3.1), &goal).within(0.25, 0.25));
        assert!(!GoalError::of(&at(1.0, 2.8), &goal).within(0.25, 0.25));
        assert!(!GoalError::of(&at(f64::NAN, 3.1), &goal).within(0.25, 0.25));
    }
}
