//! The gyroscope: how long a reading holds, and whether poses confirm it.
//!
//! While poses confirm it, the heading follows the gyroscope, and what the model says of the yaw rate is
//! learned from it. A gyroscope that reads nothing, has another sign or is mounted otherwise turns away from
//! the poses; it is then left out until it turns with them again.

use super::EstimatorSettings;
use sidehill_plant::frames::wrap_angle;

/// How long a reading holds, s.
pub(super) const HOLDS_S: f64 = 0.2;
/// Shortest time that a reading stands for, s.
pub(super) const INTERVAL_MIN_S: f64 = 0.005;
/// Growth of the bias's uncertainty, rad/s/sqrt(s).
pub(super) const BIAS_WALK_RAD_S_PER_SQRT_S: f64 = 1e-4;

/// Time over which turns are compared, s.
const WINDOW_S: f64 = 2.0;
/// Standard deviations of a pose's heading by which they may differ: eight of the difference of two poses, because
/// noise may be twice what settings say.
const HEADING_SIGMAS: f64 = 8.0 * std::f64::consts::SQRT_2;
/// Standard deviations of the bias by which they may differ.
const BIAS_SIGMAS: f64 = 3.0;
/// Share of a turn by which they may differ.
const SHARE: f64 = 0.1;
/// Poses in a row that contradict before the gyroscope is left out: one may be an outlier.
const CONTRADICTIONS: u32 = 3;
/// Turn with which a gyroscope that was left out is confirmed, rad.
const CONFIRMS_RAD: f64 = 0.4;

/// A reading of the yaw rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct YawRate {
    pub(super) time_s: f64,
    /// As read, with the sensor's bias, rad/s.
    pub(super) rad_s: f64,
}

/// What the gyroscope reads during an interval, and whether it is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GyroInterval {
    pub(super) rad_s: f64,
    pub(super) confirmed: bool,
}

/// Heading of a pose, and how far the vehicle had turned by the gyroscope by then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TurnReading {
    pub(super) time_s: f64,
    pub(super) heading_rad: f64,
    pub(super) gyro_rad: f64,
}

/// A turn in progress.
#[derive(Debug, Clone, Copy)]
struct TurnInProgress {
    since: TurnReading,
    newest_heading_rad: f64,
    /// Turn by poses since then, not wrapped.
    by_poses_rad: f64,
    /// Newest poses in a row that contradict.
    contradictions: u32,
}

/// Compares turns of the gyroscope with those of poses.
#[derive(Debug, Clone, Copy)]
pub(super) struct GyroCheck {
    tolerance_rad: f64,
    window: Option<TurnInProgress>,
    confirmed: bool,
}

impl GyroCheck {
    /// Returns a check that takes the gyroscope for right until poses say otherwise.
    pub(super) fn new(settings: &EstimatorSettings) -> Self {
        Self {
            tolerance_rad: HEADING_SIGMAS * settings.pose_sigma_rad
                + WINDOW_S * BIAS_SIGMAS * settings.gyro_bias_sigma_rad_s,
            window: None,
            confirmed: true,
        }
    }

    /// Returns whether the gyroscope is used.
    pub(super) fn confirmed(&self) -> bool {
        self.confirmed
    }

    /// Forgets the turn in progress: the gyroscope did not read all of it.
    pub(super) fn interrupt(&mut self) {
        self.window = None;
    }

    /// Takes the turn at a new pose, and whether the filter accepts that pose, as it must to begin a comparison; returns
    /// whether the gyroscope is left out from now on.
    pub(super) fn observe(&mut self, now: TurnReading, accepted: bool) -> bool {
        let begins = accepted.then_some(TurnInProgress {
            since: now,
            newest_heading_rad: now.heading_rad,
            by_poses_rad: 0.0,
            contradictions: 0,
        });
        let Some(before) = self.window.or(begins) else {
            return false;
        };
        let by_poses =
            before.by_poses_rad + wrap_angle(now.heading_rad - before.newest_heading_rad);
        let by_gyro = now.gyro_rad - before.since.gyro_rad;
        let tolerance = self.tolerance_rad + SHARE * by_poses.abs().max(by_gyro.abs());
        let contradictions = if (by_poses - by_gyro).abs() > tolerance {
            before.contradictions + 1
        } else {
            0
        };
        let wrong = contradictions >= CONTRADICTIONS;
        let over = contradictions == 0 && now.time_s - before.since.time_s >= WINDOW_S;
        self.window = (!wrong && !over).then_some(TurnInProgress {
            newest_heading_rad: now.heading_rad,
            by_poses_rad: by_poses,
            contradictions,
            ..before
        });
        let was_confirmed = self.confirmed;
        if wrong {
            self.confirmed = false;
        } else if over && by_poses.abs() >= CONFIRMS_RAD {
            self.confirmed = true;
        }
        was_confirmed && wrong
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Poses and a gyroscope that turn at constant rates; returns when the gyroscope was left out, s.
    fn run(check: &mut GyroCheck, from_s: f64, to_s: f64, rates: [f64; 2]) -> Option<f64> {
        let mut left_out_s = None;
        let cycles = ((to_s - from_s) / 0.1).round() as u32;
        for cycle in 0..=cycles {
            let time_s = from_s + 0.1 * f64::from(cycle);
            let [heading_rad, gyro_rad] = rates.map(|rate| rate * time_s);
            let turn = TurnReading {
                time_s,
                heading_rad: wrap_angle(heading_rad),
                gyro_rad,
            };
            if check.observe(turn, true) {
                left_out_s = Some(time_s);
            }
        }
        left_out_s
    }

    #[test]
    fn a_turn_that_poses_do_not_make_leaves_out_until_they_turn_together() {
        let mut check = GyroCheck::new(&EstimatorSettings::default());
        assert_eq!(run(&mut check, 0.0, 30.0, [0.5, 0.52]), None);
        assert!(check.confirmed());
        check.interrupt();
        let left_out_s = run(&mut check, 30.0, 40.0, [0.5, -0.5]).unwrap();
        assert!((30.2..30.8).contains(&left_out_s), "{left_out_s}");
        assert!(!check.confirmed());
        check.interrupt();
        // Straight ahead proves nothing.
        run(&mut check, 40.0, 60.0, [0.0, 0.0]);
        assert!(!check.confirmed());
        check.interrupt();
        run(&mut check, 60.0, 62.5, [0.5, 0.5]);
        assert!(check.confirmed());
    }

    #[test]
    fn outliers_among_poses_do_not_leave_it_out() {
        let mut check = GyroCheck::new(&EstimatorSettings::default());
        for cycle in 0..200 {
            let time_s = 0.1 * f64::from(cycle);
            let outlier = cycle % 5 < 2;
            let turn = TurnReading {
                time_s,
                heading_rad: wrap_angle(0.3 * time_s + if outlier { 1.5 } else { 0.0 }),
                gyro_rad: 0.3 * time_s,
            };
            assert!(!check.observe(turn, !outlier), "{time_s}");
        }
    }
}
