//! A vehicle that makes no progress behind its reference.

use crate::mpc::StageWeights;
use crate::path::Point2;
use crate::reference::Progress;
use crate::trajectory::Motion;
use sidehill_plant::frames::{PlanarPose, wrap_angle};

/// Way along the path that counts as progress, m.
const WAY_M: f64 = 0.05;
/// Turn towards the reference that counts as progress, rad.
const TURN_RAD: f64 = 0.05;
/// Distance behind the reference at which a vehicle should make progress, m.
const BEHIND_M: f64 = 0.2;
/// Time for which a vehicle may make none there before errors along the path gain weight, s.
const PATIENCE_S: f64 = 1.0;
/// Time after that in which their weight reaches that of errors across the path, s.
const GAIN_S: f64 = 1.5;

/// Time for which the vehicle has made no progress behind its reference.
///
/// Where errors along the path weigh little, a plan that stands or goes to and fro can be optimal: with a wrong
/// model every way ahead seems to lead off the path. Staying costs nothing more, and teaches nothing new. So errors
/// along the path gain weight until the vehicle makes progress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Standstill {
    /// Farthest arc length, m, and least heading error since then, rad.
    farthest_m: f64,
    heading_error_rad: f64,
    /// Time since either got better, s.
    since_s: f64,
    /// Time for which the weight has risen, s.
    urged_s: f64,
}

impl Standstill {
    /// Begins with a new path.
    pub(super) const START: Self = Self {
        farthest_m: f64::NEG_INFINITY,
        heading_error_rad: f64::INFINITY,
        since_s: 0.0,
        urged_s: 0.0,
    };

    /// Takes where the vehicle is on its path and the pose that follows it.
    pub(super) fn observe(&mut self, elapsed_s: f64, progress: &Progress, pose: &PlanarPose) {
        let error_rad = wrap_angle(pose.yaw_rad - progress.point.heading_rad).abs();
        let arc_m = progress.arc_length_m;
        let place = Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        };
        // Short of a cusp the nearest point of the path may lie past it, ahead of the reference.
        let behind_m = (progress.point.arc_length_m - arc_m).max(progress.point.ahead_of_m(&place));
        self.since_s += elapsed_s;
        if progress.point.motion != Motion::Drive || arc_m >= self.farthest_m + WAY_M {
            self.farthest_m = arc_m;
            self.heading_error_rad = error_rad;
            self.since_s = 0.0;
        } else if error_rad <= self.heading_error_rad - TURN_RAD {
            self.heading_error_rad = error_rad;
            self.since_s = 0.0;
        }
        let change_s = if self.since_s > PATIENCE_S && behind_m > BEHIND_M {
            elapsed_s
        } else {
            -elapsed_s
        };
        self.urged_s = (self.urged_s + change_s).clamp(0.0, GAIN_S);
    }

    /// Returns weights in which errors along the path weigh more the longer there is no progress, at most as much
    /// as those across it.
    pub(super) fn urge(&self, weights: StageWeights) -> StageWeights {
        let missing = (weights.cross_per_m2 - weights.along_per_m2).max(0.0);
        StageWeights {
            along_per_m2: weights.along_per_m2 + self.urged_s / GAIN_S * missing,
            ..weights
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::config::ControllerConfig;
    use crate::course::{Circle, Course, Cusp};
    use crate::reference::{Reference, Tracking};
    use crate::speed_profile::SpeedConfig;
    use sidehill_plant::vehicle::Vehicle;

    const PERIOD_S: f64 = 0.05;
    const WEIGHTS: StageWeights = StageWeights {
        along_per_m2: 1.0,
        cross_per_m2: 50.0,
        heading_per_rad2: 3.0,
    };

    /// Returns the weights after so long on a circle, `behind_m` behind the reference, with a speed along the
    /// path and a rate at which the heading error falls from half a radian.
    fn weights_after(time_s: f64, behind_m: f64, speed_m_s: f64, turn_rad_s: f64) -> StageWeights {
        let mut reference = Reference::new(
            Circle::default().trajectory().unwrap(),
            Tracking::Path { lead_max_m: 1.0 },
        );
        let there = reference.ahead(1.0);
        let mut progress = reference.advance(0.0, &there.pose());
        let mut standstill = Standstill::START;
        for k in 0..(time_s / PERIOD_S) as usize {
            let at_s = k as f64 * PERIOD_S;
            progress.arc_length_m = 1.0 + speed_m_s * at_s;
            progress.point.arc_length_m = progress.arc_length_m + behind_m;
            let error_rad = 0.5 - turn_rad_s * at_s;
            let pose = PlanarPose {
                yaw_rad: progress.point.heading_rad + error_rad,
                ..progress.point.pose()
            };
            standstill.observe(PERIOD_S, &progress, &pose);
        }
        standstill.urge(WEIGHTS)
    }

    #[test]
    fn errors_along_the_path_gain_weight_without_progress() {
        assert_eq!(weights_after(0.9, 0.5, 0.0, 0.0), WEIGHTS);
        let longer = weights_after(1.8, 0.5, 0.0, 0.0);
        assert!(longer.along_per_m2 > 10.0 && longer.along_per_m2 < 45.0);
        // Away from the path's end, and farther off its heading, there is no progress either.
        let back = weights_after(4.0, 0.5, -0.1, -0.1);
        assert!((back.along_per_m2 - 50.0).abs() < 1e-9, "{back:?}");
        assert_eq!(back.cross_per_m2, 50.0);
    }

    /// The nearest point of the path to a vehicle that stands beside the way back from a cusp is there, ahead of
    /// the reference, which waits short of the cusp.
    #[test]
    fn a_vehicle_that_stands_short_of_a_cusp_is_urged_there() {
        let limits =
            SpeedConfig::default().limits(&ControllerConfig::default().limits, &Vehicle::j8());
        let trajectory = Course::Cusp(Cusp::default()).trajectory(&limits).unwrap();
        let cusp_m = trajectory.path().unwrap().cusps_m().next().unwrap();
        let mut reference = Reference::new(trajectory, Tracking::Path { lead_max_m: 0.3 })
            .starting_at(cusp_m - 0.3);
        let back = reference.path().unwrap().at(cusp_m + 0.6);
        let pose = PlanarPose {
            x_m: back.position.x_m,
            y_m: back.position.y_m,
            yaw_rad: back.heading_rad,
        };
        let mut standstill = Standstill::START;
        for _ in 0..80 {
            let progress = reference.advance(PERIOD_S, &pose);
            assert!(progress.arc_length_m > progress.point.arc_length_m);
            standstill.observe(PERIOD_S, &progress, &pose);
        }
        assert_eq!(standstill.urge(WEIGHTS).along_per_m2, 50.0);
    }

    #[test]
    fn a_vehicle_that_drives_turns_or_is_not_behind_is_not_urged() {
        assert_eq!(weights_after(6.0, 0.5, 0.1, 0.0), WEIGHTS);
        assert_eq!(weights_after(6.0, 0.5, 0.0, 0.07), WEIGHTS);
        assert_eq!(weights_after(6.0, 0.1, 0.0, 0.0), WEIGHTS);
    }
}
