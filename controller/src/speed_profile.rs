//! Speeds along a path that motors, bends and ground allow.

use crate::mpc::limits::InputLimits;
use crate::path::{Path, PathError, PathPoint, SAMPLE_STEP_M};
use crate::trajectory::{Ending, Trajectory};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::vehicle::Vehicle;

/// What bounds the speed along a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedLimits {
    /// Speed wanted on the open stretch, m/s.
    pub speed_max_m_s: f64,
    /// Largest traction |tau|, m/s.
    pub traction_max_m_s: f64,
    /// Largest steer |sigma|, m/s.
    pub steer_max_m_s: f64,
    /// Largest speed of a tread, |tau| + |sigma|, m/s; infinite where only the motors bind.
    pub tread_max_m_s: f64,
    /// Largest rate at which the speed grows, m/s^2.
    pub acceleration_m_s2: f64,
    /// Largest rate at which the speed falls, m/s^2.
    pub deceleration_m_s2: f64,
    /// Largest |d sigma/dt|, m/s^2; infinite for none.
    pub steer_acceleration_m_s2: f64,
    /// Largest |curvature| speed^2, m/s^2; infinite for none.
    pub lateral_acceleration_m_s2: f64,
    /// Effective distance D between the tread ICRs, m: sigma = yaw rate * D/2.
    pub track_width_m: f64,
}

/// How fast a path without times is driven, as the configuration file gives it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpeedConfig {
    /// Speed on the open stretch.
    pub speed_m_s: f64,
    /// Share of the motors' limits that the profile uses. The rest is left to feedback and slope.
    pub motor_share: f64,
    /// Largest
    pub lateral_acceleration_m_s2: f64,
}

impl Default for SpeedConfig {
    fn default() -> Self {
        Self {
            speed_m_s: 0.8,
            motor_share: 0.5,
            lateral_acceleration_m_s2: 1.0,
        }
    }
}

impl SpeedConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(0.01, 20.0, "m/s").check("speed.speed_m_s", self.speed_m_s)?;
        Bounds::new(0.05, 1.0, "").check("speed.motor_share", self.motor_share)?;
        Bounds::new(0.01, 100.0, "m/s^2").check(
            "speed.lateral_acceleration_m_s2",
            self.lateral_acceleration_m_s2,
        )?;
        Ok(())
    }

    /// Returns the bounds on the speed of `vehicle` with motors of `limits`.
    pub fn limits(&self, limits: &InputLimits, vehicle: &Vehicle) -> SpeedLimits {
        let share = self.motor_share;
        SpeedLimits {
            speed_max_m_s: self.speed_m_s,
            traction_max_m_s: limits.traction.speed_m_s,
            steer_max_m_s: share * limits.steer.speed_m_s,
            tread_max_m_s: limits.tread_speed_m_s,
            acceleration_m_s2: share * limits.traction.acceleration_m_s2,
            deceleration_m_s2: share * limits.traction.deceleration_m_s2,
            steer_acceleration_m_s2: share * limits.steer.acceleration_m_s2,
            lateral_acceleration_m_s2: self.lateral_acceleration_m_s2,
            track_width_m: vehicle.icrs.right_m - vehicle.icrs.left_m,
        }
    }
}

/// Largest yaw rate at a corner, rad/s.
const TURN_MAX_RAD_S: f64 = 0.5;

impl SpeedLimits {
    /// Returns the yaw rate at a corner, rad/s: the treads move no faster than the vehicle is to drive.
    fn turn_rad_s(&self) -> f64 {
        let tread_m_s = self
            .speed_max_m_s
            .min(self.steer_max_m_s)
            .min(self.tread_max_m_s);
        (2.0 * tread_m_s / self.track_width_m).min(TURN_MAX_RAD_S)
    }

    fn check(&self) -> Result<(), RangeError> {
        // Infinity means no limit.
        let positive = |key, value: f64| {
            if value == f64::INFINITY {
                return Ok(value);
            }
            Bounds::positive("").check(key, value)
        };
        positive("speed_max_m_s", self.speed_max_m_s)?;
        positive("traction_max_m_s", self.traction_max_m_s)?;
        positive("steer_max_m_s", self.steer_max_m_s)?;
        positive("tread_max_m_s", self.tread_max_m_s)?;
        positive("acceleration_m_s2", self.acceleration_m_s2)?;
        positive("deceleration_m_s2", self.deceleration_m_s2)?;
        positive("steer_acceleration_m_s2", self.steer_acceleration_m_s2)?;
        positive("lateral_acceleration_m_s2", self.lateral_acceleration_m_s2)?;
        Bounds::new(1e-3, 50.0, "m/s").check("speed_max_m_s", self.speed_max_m_s)?;
        Bounds::new(1e-3, 100.0, "m").check("track_width_m", self.track_width_m)?;
        Ok(())
    }

    /// Returns the largest speed at a curvature, m/s, by all bounds on speeds.
    fn speed_at(&self, curvature_per_m: f64) -> f64 {
        let curvature = curvature_per_m.abs();
        // sigma = D/2 * curvature * v
        let steer_share = 0.5 * self.track_width_m * curvature;
        self.speed_max_m_s
            .min(self.traction_max_m_s)
            .min(self.steer_max_m_s / steer_share)
            .min(self.tread_max_m_s / (1.0 + steer_share))
            .min((self.lateral_acceleration_m_s2 / curvature).sqrt())
    }

    /// Returns the largest speed, m/s, at which steer follows a curvature that changes along the path, 1/m^2:
    /// d(sigma)/dt = D/2 d(curvature)/ds v^2.
    fn speed_of_change(&self, change_per_m2: f64) -> f64 {
        let yaw_acceleration = 2.0 * self.steer_acceleration_m_s2 / self.track_width_m;
        (yaw_acceleration / change_per_m2.abs()).sqrt()
    }
}

/// Returns `path` with the largest speeds within `limits`, the speeds of its own stretches and, at each point,
/// `speed_cap_m_s` (as for a slope), with a stop at every cusp and corner and at the end.
///
/// Before a slower place they fall by at most the deceleration, and behind it they grow by at most the acceleration. A start and
/// a stop do not lower them: the controller knows how fast its vehicle is. A closed path is driven once round.
///
/// # Errors
/// [`PathError::Range`] for a limit or cap that is not positive.
pub fn speed_profile(
    path: &Path,
    limits: &SpeedLimits,
    speed_cap_m_s: impl Fn(&PathPoint) -> f64,
) -> Result<Trajectory, PathError> {
    limits.check()?;
    let length_m = path.length_m();
    let intervals = (length_m / SAMPLE_STEP_M).ceil().max(4.0) as usize;
    let step_m = length_m / intervals as f64;
    let mut curvatures = Vec::with_capacity(intervals + 1);
    let mut caps = Vec::with_capacity(intervals + 1);
    for i in 0..=intervals {
        // The end of a closed path belongs to this lap.
        let at_m = (i as f64 * step_m).min(length_m.next_down());
        let point = path.at(at_m);
        let cap = speed_cap_m_s(&point);
        if cap.is_nan() || cap <= 0.0 {
            return Err(PathError::Range(RangeError {
                key: "speed_cap_m_s",
                value: cap,
                bounds: Bounds::positive("m/s"),
            }));
        }
        let own = path.slowest_m_s(at_m - step_m, at_m + step_m);
        curvatures.push(point.curvature_per_m);
        caps.push(limits.speed_at(point.curvature_per_m).min(cap).min(own));
    }
    // Neighbours count, so that the bounds hold in between too.
    let beside = |i: usize| &caps[i.saturating_sub(1)..=(i + 1).min(intervals)];
    let mut speeds_m_s: Vec<f64> = (0..=intervals)
        .map(|i| beside(i).iter().copied().fold(f64::INFINITY, f64::min))
        .collect();
    let mut stops_m = path.stops_m().peekable();
    for i in 0..intervals {
        let mut stops = false;
        while stops_m
            .next_if(|stop_m| *stop_m <= (i + 1) as f64 * step_m)
            .is_some()
        {
            stops = true;
        }
        if !stops {
            let change = (curvatures[i + 1] - curvatures[i]) / step_m;
            for j in [i, i + 1] {
                speeds_m_s[j] = speeds_m_s[j].min(limits.speed_of_change(change));
            }
        }
    }
    let reachable =
        |from_m_s: f64, rate_m_s2: f64| from_m_s.hypot((2.0 * rate_m_s2 * step_m).sqrt());
    for i in (0..intervals).rev() {
        speeds_m_s[i] = speeds_m_s[i].min(reachable(speeds_m_s[i + 1], limits.deceleration_m_s2));
    }
    for i in 0..intervals {
        speeds_m_s[i + 1] =
            speeds_m_s[i + 1].min(reachable(speeds_m_s[i], limits.acceleration_m_s2));
    }
    let trajectory = Trajectory::along(path.clone(), Ending::Stop, length_m, speeds_m_s)?;
    Ok(trajectory.turning_at_corners(limits.turn_rad_s()))
}
