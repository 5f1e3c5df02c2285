//! Regulated pure pursuit: the geometric baseline, as widely used with Nav2.
//!
//! The vehicle steers along the circle through its origin and a point a look-ahead distance ahead on
//! the path, and slows down in sharp turns and towards the end. It assumes flat ground.
//! After S. Macenski, S. Singh, F. Martin, J. Gines, "Regulated pure pursuit for robot path tracking",
//! Autonomous Robots 47 (2023).

use crate::path::Path;
use crate::trajectory::{Motion, ReferencePoint};
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::HorizontalIcrs;

/// Settings of regulated pure pursuit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PurePursuitSettings {
    /// Time by which the look-ahead grows with speed, s.
    pub lookahead_time_s: f64,
    /// Shortest look-ahead distance, m.
    pub lookahead_min_m: f64,
    /// Longest look-ahead distance, m.
    pub lookahead_max_m: f64,
    /// Radius of the turn below which speed is reduced in proportion, m.
    pub regulated_radius_m: f64,
    /// Distance to the end within which speed is reduced in proportion, m.
    pub approach_distance_m: f64,
    /// Lowest speed of either reduction, m/s.
    pub speed_min_m_s: f64,
    /// Distance from the end at which the vehicle may stop, m.
    pub goal_tolerance_m: f64,
    /// Commanded yaw rate per heading error while turning on the spot, 1/s.
    pub pivot_gain_per_s: f64,
    /// Bearing of the look-ahead point beyond which the vehicle first turns on the spot, rad.
    pub rotate_bearing_rad: f64,
}

impl Default for PurePursuitSettings {
    fn default() -> Self {
        Self {
            lookahead_time_s: 1.5,
            lookahead_min_m: 0.5,
            lookahead_max_m: 0.9,
            regulated_radius_m: 0.9,
            approach_distance_m: 0.6,
            speed_min_m_s: 0.1,
            goal_tolerance_m: 0.05,
            pivot_gain_per_s: 2.0,
            rotate_bearing_rad: 0.785,
        }
    }
}

/// What pure pursuit looks at.
#[derive(Debug, Clone, Copy)]
pub struct PursuitView<'a> {
    /// Estimated pose.
    pub pose: &'a PlanarPose,
    /// Reference of this cycle.
    pub reference: &'a ReferencePoint,
    /// Path, where the reference drives along one.
    pub path: Option<&'a Path>,
    /// Arc length of the nearest point on it, m.
    pub arc_length_m: f64,
    /// Arc length up to which this drive goes: the next cusp or the end; infinite on a closed path.
    pub stop_at_m: f64,
    /// What is left of a turn on the spot, rad, counter-clockwise positive.
    pub turn_to_go_rad: f64,
}

impl PurePursuitSettings {
    /// Returns the motor speeds of this cycle, before limits.
    pub fn command(&self, view: &PursuitView<'_>, icrs: &HorizontalIcrs) -> MotorSpeeds {
        let half_track_m = 0.5 * (icrs.right_m - icrs.left_m);
        let reference = view.reference;
        let turn = |yaw_rate_rad_s: f64| MotorSpeeds {
            traction_m_s: 0.0,
            steer_m_s: half_track_m * yaw_rate_rad_s,
        };
        let path = match (reference.motion, view.path) {
            (Motion::Drive | Motion::Stand, Some(path)) => path,
            (Motion::Pivot, _) => {
                let most_rad_s = reference.yaw_rate_rad_s.abs();
                let wanted_rad_s = self.pivot_gain_per_s * view.turn_to_go_rad;
                return turn(wanted_rad_s.clamp(-most_rad_s, most_rad_s));
            }
            _ => return MotorSpeeds::STOP,
        };
        let to_go_m = view.stop_at_m - view.arc_length_m;
        if to_go_m < self.goal_tolerance_m {
            return MotorSpeeds::STOP;
        }
        let speed = reference.speed_m_s.abs().max(self.speed_min_m_s);
        let lookahead_m =
            (self.lookahead_time_s * speed).clamp(self.lookahead_min_m, self.lookahead_max_m);
        // Short of a cusp, where the path already goes the other way, and of the end. Beyond either the
        // carrot runs on straight: one that stood still would be passed, and circled.
        let wanted_m = view.arc_length_m + lookahead_m;
        let carrot = path.at(wanted_m.min(view.stop_at_m.next_down()));
        let beyond_m = (wanted_m - view.stop_at_m).max(0.0);
        let (sin, cos) = carrot.travel_heading_rad().sin_cos();
        let (dx, dy) = (
            carrot.position.x_m - sin * beyond_m - view.pose.x_m,
            carrot.position.y_m + cos * beyond_m - view.pose.y_m,
        );
        let (sin, cos) = view.pose.yaw_rad.sin_cos();
        // Body axes: right = (cos, sin), forward = (-sin, cos).
        let right = cos * dx + sin * dy;
        let sign = carrot.direction.sign();
        // Counter-clockwise, from the direction of travel to the carrot.
        let bearing_rad = (-sign * right).atan2(sign * (cos * dy - sin * dx));
        if bearing_rad.abs() > self.rotate_bearing_rad {
            return turn(self.pivot_gain_per_s * bearing_rad);
        }
        let distance2 = (dx * dx + dy * dy).max(1e-4);
        // Circle through origin and carrot, tangent to the body's forward axis; left positive.
        let curvature_per_m = -2.0 * right / distance2;
        let radius_m = 1.0 / curvature_per_m.abs().max(1e-6);
        let in_turn = (radius_m / self.regulated_radius_m).min(1.0);
        let near_end = (to_go_m / self.approach_distance_m).clamp(0.0, 1.0);
        let regulated = (speed * in_turn.min(near_end)).max(self.speed_min_m_s);
        let traction_m_s = sign * regulated;
        MotorSpeeds {
            traction_m_s,
            steer_m_s: half_track_m * curvature_per_m * traction_m_s,
        }
    }
}
