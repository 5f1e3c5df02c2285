//! The heading of a vehicle from its motion: a gyroscope turns it on, and straight stretches between fixes correct it.
//!
//! Between two places of the vehicle the chord has the mean heading, if the vehicle turned little and evenly:
//!
//! ```text
//! psi = atan2(-dx, dy) + turn / 2,    sigma^2 = 2 sigma_fix^2 / d^2 + SLIDE_RAD^2 + (TURN_SHARE turn)^2
//! ```
//!
//! At standstill nothing shows the heading. It is held then, the rate of the gyroscope is its bias, and a vehicle that is
//! turned by other forces than its treads has the wrong heading until it has driven straight again.

use nalgebra::{Rotation3, Vector3};
use sidehill_plant::frames::{Attitude, BodyVelocity, pose_rate, ros_quaternion, wrap_angle};
use std::collections::VecDeque;

/// Largest standard deviation of a heading that is known, rad.
const KNOWN_RAD: f64 = 0.1;
/// Shortest chord, m.
const CHORD_M: f64 = 1.5;
/// Longest chord, m, and shortest way between two corrections.
const CHORD_MAX_M: f64 = 3.0;
const STEP_M: f64 = 0.5;
/// Share of the way that is driven in one direction along a chord.
const ONE_WAY: f64 = 0.98;
/// Largest turn along a chord, rad.
const TURN_MAX_RAD: f64 = 0.2;
/// Share of a turn by which the chord may be off.
const TURN_SHARE: f64 = 0.2;
/// Slide across the heading that a straight drive on a slope may have, rad.
const SLIDE_RAD: f64 = 0.02;
/// How much the length of a chord and the way of the treads may differ, of the latter: slip.
const SLIP: f64 = 0.3;
/// Growth of the standard deviation by the gyroscope while the vehicle moves, rad/s.
const GROWTH_RAD_S: f64 = 0.003;
/// Standard deviations by which heading and course may differ; beyond, the heading is as wrong as it looks.
const OUTLIER: f64 = 3.0;
/// How far a place between its ends may be beside a chord, m, and standard deviations of fixes beyond that.
const BESIDE_M: f64 = 0.1;
const BESIDE_SIGMAS: f64 = 4.0;
/// Time after which standing treads mean a standing vehicle, s.
const STANDING_S: f64 = 0.5;
/// Time over which the gyroscope's bias is averaged, s.
const BIAS_S: f64 = 2.0;
/// Interval between two readings that is a gap, s.
const GAP_S: f64 = 0.3;
/// Marks kept: those of the longest chord at 20 Hz and 0.1 m/s.
const MARKS: usize = 600;

/// Returns where a direction of base_link points, seen from above, counter-clockwise from Y_g, rad.
pub(super) fn azimuth_rad(direction: &Vector3<f64>, attitude: &Attitude, yaw_rad: f64) -> f64 {
    let in_world = ros_quaternion(attitude, yaw_rad) * direction;
    (-in_world.x).atan2(in_world.y)
}

/// Where an antenna was.
#[derive(Debug, Clone, Copy)]
struct ChordEnd {
    antenna: Vector3<f64>,
    /// The antenna in the vehicle's level axes.
    lever: Vector3<f64>,
    yaw_rad: f64,
    /// Where forward is seen from above, from the heading on: on a slope not where the heading is.
    ahead_rad: f64,
    /// Way with its sign, and without, m.
    travelled_m: f64,
    driven_m: f64,
}

/// The heading; before it is known, how far the vehicle has turned.
#[derive(Debug, Default)]
pub(super) struct HeadingFromMotion {
    yaw_rad: f64,
    /// None before the first straight stretch.
    sigma_rad: Option<f64>,
    attitude: Attitude,
    rate_at_s: Option<f64>,
    bias_rad_s: f64,
    speeds_at_s: Option<f64>,
    moved_at_s: f64,
    speed_m_s: f64,
    travelled_m: f64,
    driven_m: f64,
    corrected_at_m: f64,
    marks: VecDeque<ChordEnd>,
}

impl HeadingFromMotion {
    /// Way after which the heading is known, m.
    pub(super) const NEEDED_M: f64 = 2.0;

    pub(super) fn is_known(&self) -> bool {
        self.sigma_rad
            .is_some_and(|sigma_rad| sigma_rad <= KNOWN_RAD)
    }

    pub(super) fn attitude(&mut self, attitude: Attitude) {
        self.attitude = attitude;
    }

    pub(super) fn speeds(&mut self, time_s: f64, traction_m_s: f64, steer_m_s: f64) {
        let before_s = self.speeds_at_s.replace(time_s);
        let interval_s = before_s.map_or(0.0, |before_s| time_s - before_s);
        if (0.0..=GAP_S).contains(&interval_s) {
            let way_m = 0.5 * (self.speed_m_s + traction_m_s) * interval_s;
            self.travelled_m += way_m;
            self.driven_m += way_m.abs();
        } else {
            self.marks.clear();
        }
        self.speed_m_s = traction_m_s;
        if traction_m_s != 0.0 || steer_m_s != 0.0 {
            self.moved_at_s = time_s;
        }
    }

    /// Takes the rate about the vehicle's upward axis; returns the heading after it.
    pub(super) fn yaw_rate(&mut self, time_s: f64, rad_s: f64) -> f64 {
        let before_s = self.rate_at_s.replace(time_s);
        let interval_s = before_s.map_or(0.0, |before_s| time_s - before_s);
        let stands = self
            .speeds_at_s
            .is_some_and(|at_s| at_s - self.moved_at_s > STANDING_S);
        if stands {
            let share = (interval_s / BIAS_S).clamp(0.0, 1.0);
            self.bias_rad_s += share * (rad_s - self.bias_rad_s);
        } else if (0.0..=GAP_S).contains(&interval_s) {
            let turning = BodyVelocity {
                yaw_rate_rad_s: rad_s - self.bias_rad_s,
                ..BodyVelocity::default()
            };
            self.yaw_rad +=
                interval_s * pose_rate(&turning, &self.attitude, self.yaw_rad).yaw_rad_s;
            self.sigma_rad = self
                .sigma_rad
                .map(|sigma| sigma + GROWTH_RAD_S * interval_s);
        } else {
            self.sigma_rad = None;
            self.marks.clear();
        }
        self.yaw_rad
    }

    /// Takes the place of the antenna at an instant at which the heading was `yaw_rad`; returns by how much all headings
    /// have to be corrected, rad. `lever` is the antenna in base_link.
    pub(super) fn antenna(
        &mut self,
        antenna: &Vector3<f64>,
        (yaw_rad, attitude): (f64, &Attitude),
        lever: &Vector3<f64>,
        sigma_m: f64,
    ) -> f64 {
        let here = ChordEnd {
            antenna: *antenna,
            lever: ros_quaternion(attitude, 0.0) * lever,
            yaw_rad,
            ahead_rad: azimuth_rad(&Vector3::x(), attitude, 0.0),
            travelled_m: self.travelled_m,
            driven_m: self.driven_m,
        };
        let measured = self.measured(&here, sigma_m);
        let far = |mark: &ChordEnd| here.driven_m - mark.driven_m > CHORD_MAX_M;
        while self.marks.front().is_some_and(far) || self.marks.len() == MARKS {
            self.marks.pop_front();
        }
        // Standing, one mark says all.
        if self
            .marks
            .back()
            .is_none_or(|last| last.driven_m < here.driven_m)
        {
            self.marks.push_back(here);
        }
        let Some((measured_rad, variance)) = measured else {
            return 0.0;
        };
        self.corrected_at_m = self.driven_m;
        let off_rad = wrap_angle(measured_rad - yaw_rad);
        let (gain, sigma_rad) = match self.sigma_rad {
            None => (1.0, variance.sqrt()),
            Some(sigma_rad) => {
                let known = sigma_rad * sigma_rad;
                let contradicts = off_rad.powi(2) > OUTLIER.powi(2) * (known + variance);
                let before = if contradicts { off_rad.powi(2) } else { known };
                let gain = before / (before + variance);
                (gain, (gain * variance).sqrt())
            }
        };
        // The slide of a slope lasts: no number of chords shows it.
        self.sigma_rad = Some(sigma_rad.max(SLIDE_RAD));
        let corrected_rad = gain * off_rad;
        self.yaw_rad += corrected_rad;
        self.marks
            .iter_mut()
            .for_each(|mark| mark.yaw_rad += corrected_rad);
        corrected_rad
    }

    /// Returns the heading by the longest usable chord that ends here, and its variance.
    fn measured(&self, here: &ChordEnd, sigma_m: f64) -> Option<(f64, f64)> {
        if self.sigma_rad.is_some() && self.driven_m - self.corrected_at_m < STEP_M {
            return None;
        }
        let marks = 0..self.marks.len();
        marks.into_iter().find_map(|index| {
            let (from, between) = (self.marks.get(index)?, self.marks.range(index..));
            chord(from, between, here, sigma_m)
        })
    }
}

/// Returns the heading at the end of a chord, and its variance; none where the vehicle did not drive straight along it.
fn chord<'a>(
    from: &ChordEnd,
    mut between: impl Iterator<Item = &'a ChordEnd> + Clone,
    here: &ChordEnd,
    sigma_m: f64,
) -> Option<(f64, f64)> {
    let way_m = here.travelled_m - from.travelled_m;
    let driven_m = here.driven_m - from.driven_m;
    let one_way = way_m.abs() > ONE_WAY * driven_m;
    let straight = |mark: &ChordEnd| (here.yaw_rad - mark.yaw_rad).abs() <= TURN_MAX_RAD;
    if !one_way || !(CHORD_M..=CHORD_MAX_M).contains(&driven_m) || !between.clone().all(straight) {
        return None;
    }
    let turn_rad = here.yaw_rad - from.yaw_rad;
    let apart = here.antenna - from.antenna;
    let (mut yaw_rad, mut moved) = (0.0, apart);
    // The lever arm turns with the heading that is asked for.
    for _ in 0..3 {
        let chord_rad = match way_m < 0.0 {
            true => moved.x.atan2(-moved.y),
            false => (-moved.x).atan2(moved.y),
        };
        yaw_rad = chord_rad + 0.5 * (turn_rad - here.ahead_rad - from.ahead_rad);
        let turned = |mark: &ChordEnd, yaw_rad| {
            Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad) * mark.lever
        };
        moved = apart - turned(here, yaw_rad) + turned(from, yaw_rad - turn_rad);
    }
    let length_m = moved.xy().norm();
    if (length_m - way_m.abs()).abs() > SLIP * way_m.abs() + 6.0 * sigma_m {
        return None;
    }
    let along = apart.xy().try_normalize(1e-6)?;
    let limit_m = BESIDE_M + BESIDE_SIGMAS * sigma_m;
    let beside = |mark: &ChordEnd| {
        let off = mark.antenna.xy() - from.antenna.xy();
        (along.x * off.y - along.y * off.x).abs() > limit_m
    };
    if between.any(beside) {
        return None;
    }
    let variance = 2.0 * sigma_m.powi(2) / length_m.powi(2)
        + SLIDE_RAD.powi(2)
        + (TURN_SHARE * turn_rad).powi(2);
    Some((yaw_rad, variance))
}
