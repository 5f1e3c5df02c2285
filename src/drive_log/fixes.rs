//! Positions from the fixes of a satellite receiver.

use super::interpolation::{Timed, at, seconds};
use anyhow::{Result, bail};
use nalgebra::{UnitQuaternion, Vector3};
use sidehill_bridge::ros2::message::NavSatFix;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_plant::frames::{Pose, paper_attitude};
use sidehill_plant::statistics::median;
use std::f64::consts::{FRAC_PI_2, PI};

/// A fix with a position.
#[derive(Debug, Clone, Copy)]
struct Fix {
    latitude_deg: f64,
    longitude_deg: f64,
    /// NaN where the receiver has none.
    altitude_m: f64,
}

/// Fixes of a topic, in the order of its messages.
#[derive(Default)]
pub(super) struct Fixes {
    fixes: Timed<Fix>,
    without_position: usize,
}

impl Fix {
    /// Returns the position for a route: on the ellipsoid, with heights relative to the first one.
    fn position(&self, origin: &GeodeticOrigin) -> Option<[f64; 3]> {
        let at = origin.project(self.latitude_deg, self.longitude_deg);
        let height_m = self.altitude_m - origin.elevation_m;
        Some([
            at.x_m,
            at.y_m,
            if height_m.is_finite() { height_m } else { 0.0 },
        ])
    }
}

/// Faster than this no vehicle of this program drives, m/s.
const SPEED_MAX_M_S: f64 = 50.0;
/// Shortest jump that counts as one, m: receivers err by less.
const JUMP_MIN_M: f64 = 30.0;
/// Shortest gap that is worth a note, m.
const GAP_MIN_M: f64 = 2.0;

/// Shortest jump that two publishers of one topic show, m, and its least speed, m/s, often enough that no noise is so.
const PUBLISHERS_APART_M: f64 = 0.5;
const PUBLISHERS_APART_M_S: f64 = 20.0;
const RETURNS_MIN: usize = 10;

/// Refuses positions that jump away and back again and again, as those of two publishers of one topic do.
///
/// # Errors
/// How often they do.
pub(super) fn one_publisher(positions: &[(i64, [f64; 3])]) -> Result<()> {
    let leg_m = |from: &[f64; 3], to: &[f64; 3]| (to[0] - from[0]).hypot(to[1] - from[1]);
    let returns = positions.windows(3).filter(|three| {
        let [(_, before), (away_ns, away), (back_ns, back)] = three else {
            return false;
        };
        let back_m = leg_m(away, back);
        back_m > PUBLISHERS_APART_M.max(PUBLISHERS_APART_M_S * seconds(*away_ns, *back_ns))
            && leg_m(before, back) < 0.5 * back_m
    });
    let count = returns.count();
    if count >= RETURNS_MIN && 20 * count > positions.len() {
        bail!(
            "{count} of {} times the position jumps away and is back with the next message: two programs publish on one \
             topic; record each on a topic of its own",
            positions.len()
        );
    }
    Ok(())
}

/// Returns a note about the longest straight line between two positions that nothing was recorded of.
///
/// # Errors
/// Names the first jump that no vehicle makes.
pub(super) fn gap(positions: &[(i64, [f64; 3])]) -> Result<Option<String>> {
    let Some((start_ns, _)) = positions.first() else {
        return Ok(None);
    };
    one_publisher(positions)?;
    let steps: Vec<(f64, f64, f64)> = positions
        .windows(2)
        .map(|pair| {
            let ((from_ns, from), (to_ns, to)) = (pair[0], pair[1]);
            let length_m = (to[0] - from[0]).hypot(to[1] - from[1]);
            (
                seconds(*start_ns, from_ns),
                seconds(from_ns, to_ns),
                length_m,
            )
        })
        .collect();
    let jump = |(_, duration_s, length_m): &&(f64, f64, f64)| {
        *length_m > JUMP_MIN_M.max(SPEED_MAX_M_S * duration_s)
    };
    if let Some((at_s, duration_s, length_m)) = steps.iter().find(jump) {
        let length = if *length_m < 1e6 {
            format!("{length_m:.0} m")
        } else {
            "more than 1000 km".to_owned()
        };
        bail!(
            "positions jump by {length} within {duration_s:.2} s, {at_s:.2} s after the first: the receiver or \
             the localisation lost its place there; cut the recording before or after it"
        );
    }
    let usual_m = median(steps.iter().map(|step| step.2).collect()).unwrap_or(0.0);
    let usual_s = median(steps.iter().map(|step| step.1).collect()).unwrap_or(0.0);
    let gaps = steps.iter().filter(|(_, duration_s, length_m)| {
        *length_m > GAP_MIN_M.max(5.0 * usual_m) && *duration_s > 3.0 * usual_s
    });
    let (mut count, mut longest) = (0, (0.0, 0.0, 0.0));
    for gap in gaps {
        count += 1;
        if gap.2 > longest.2 {
            longest = *gap;
        }
    }
    let (at_s, duration_s, length_m) = longest;
    Ok((count > 0).then(|| {
        format!(
            "positions are missing {count} times, for {duration_s:.1} s and {length_m:.1} m at the longest, {at_s:.1} s \
             after the first: what lies between counts as straight"
        )
    }))
}

impl Fixes {
    /// Takes a message; `time_ns` matters only if it has a position.
    ///
    /// # Errors
    /// The error of `time_ns`, or a position that does not exist on earth.
    pub(super) fn take(&mut self, time_ns: Result<i64>, fix: &NavSatFix) -> Result<()> {
        let is_finite = fix.latitude.is_finite() && fix.longitude.is_finite();
        // 0, 0 is what a receiver reports that has not yet found its place.
        let is_zero = fix.latitude == 0.0 && fix.longitude == 0.0;
        if fix.status.status < 0 || !is_finite || is_zero {
            self.without_position += 1;
            return Ok(());
        }
        if fix.latitude.abs() > 90.0 || fix.longitude.abs() > 180.0 {
            bail!(
                "latitude {} and longitude {} are out of range",
                fix.latitude,
                fix.longitude
            );
        }
        let time_ns = time_ns?;
        let fix = Fix {
            latitude_deg: fix.latitude,
            longitude_deg: fix.longitude,
            altitude_m: if fix.altitude.is_finite() {
                fix.altitude
            } else {
                f64::NAN
            },
        };
        self.fixes.push((time_ns, fix));
        Ok(())
    }

    /// Returns the number of fixes with a position.
    pub(super) fn len(&self) -> usize {
        self.fixes.len()
    }

    /// Returns the place of the first fix, the origin of the world.
    pub(super) fn origin(&self) -> Option<GeodeticOrigin> {
        let (_, first) = self.fixes.first()?;
        Some(GeodeticOrigin {
            latitude_deg: first.latitude_deg,
            longitude_deg: first.longitude_deg,
            elevation_m: if self.has_heights() {
                first.altitude_m
            } else {
                0.0
            },
        })
    }

    /// Returns whether all fixes have a height.
    pub(super) fn has_heights(&self) -> bool {
        self.fixes.iter().all(|(_, fix)| fix.altitude_m.is_finite())
    }

    /// Returns notes about fixes without a position, gaps and heights.
    ///
    /// # Errors
    /// A jump that no vehicle makes.
    pub(super) fn notes(&self) -> Result<Vec<String>> {
        let mut notes = Vec::new();
        let without = self.without_position;
        if self.fixes.is_empty() && without > 0 {
            bail!(
                "none of its {without} fixes has a position: the receiver had no fix, or no view of the sky; record anew"
            );
        }
        if without > 0 {
            notes.push(format!("{without} fixes without a position are left out"));
        }
        if !self.has_heights() {
            notes.push("fixes have no altitude: heights are unknown and count as 0".to_owned());
        }
        let points = self.positions_m();
        notes.extend(self.radians(&points));
        let times = self.fixes.iter().map(|(time_ns, _)| *time_ns);
        let placed: Timed<[f64; 3]> = times.zip(points).collect();
        notes.extend(gap(&placed)?);
        Ok(notes)
    }

    /// Returns a note where the numbers are those of radians, which as degrees are places in the Gulf of Guinea.
    fn radians(&self, positions_m: &[[f64; 3]]) -> Option<String> {
        /// Larger drives in radians are of 3 km and more, m.
        const REACH_MAX_M: f64 = 50.0;
        /// Nearer to 0, 0 a simulator may be, deg.
        const FROM_ZERO_DEG: f64 = 0.01;
        let origin = self.origin()?;
        let (latitude, longitude) = (origin.latitude_deg, origin.longitude_deg);
        let is_angle = latitude.abs() <= FRAC_PI_2 && longitude.abs() <= PI;
        let reach_m = positions_m.iter().map(|[x_m, y_m, _]| x_m.hypot(*y_m));
        let reach_m = reach_m.fold(0.0, f64::max);
        (is_angle && latitude.hypot(longitude) > FROM_ZERO_DEG && reach_m < REACH_MAX_M).then(|| {
            format!(
                "all fixes are within {reach_m:.2} m of latitude {latitude:.6}, longitude {longitude:.6}, at sea: are they in \
                 radians? NavSatFix has degrees"
            )
        })
    }

    /// Returns poses of the vehicle's origin at fixes during which its orientation is known.
    pub(super) fn poses(
        &self,
        rotations: &[(i64, UnitQuaternion<f64>)],
        antenna_m: &[f64; 3],
    ) -> Timed<Pose> {
        let Some(origin) = self.origin() else {
            return Vec::new();
        };
        let pose = |(time_ns, fix): &(i64, Fix)| {
            let rotation = at(rotations, *time_ns, |a, b, share| a.slerp(b, share))?;
            let lever = rotation * Vector3::from(*antenna_m);
            let [x_m, y_m, z_m] = fix.position(&origin)?;
            let (_, yaw_rad) = paper_attitude(&rotation);
            let pose = Pose {
                x_m: x_m - lever.x,
                y_m: y_m - lever.y,
                z_m: z_m - lever.z,
                yaw_rad,
            };
            Some((*time_ns, pose))
        };
        self.fixes.iter().filter_map(pose).collect()
    }

    /// Returns east, north and height of every fix from the origin, m.
    pub(super) fn positions_m(&self) -> Vec<[f64; 3]> {
        let origin = self.origin();
        let point = |(_, fix): &(i64, Fix)| fix.position(&origin?);
        self.fixes.iter().filter_map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_bridge::ros2::message::NavSatFix;

    #[test]
    fn radians_are_recognised_and_a_simulator_at_zero_is_none() {
        let notes = |unit: f64, latitude: f64, longitude: f64| {
            let mut fixes = Fixes::default();
            for i in 0..100 {
                let fix = NavSatFix {
                    latitude: unit * (latitude + 1e-6 * f64::from(i)),
                    longitude: unit * longitude,
                    altitude: 10.0,
                    ..NavSatFix::default()
                };
                fixes.take(Ok(i64::from(i) * 100_000_000), &fix).unwrap();
            }
            fixes.notes().unwrap().join("; ")
        };
        let in_radians = notes(1_f64.to_radians(), 36.717, -4.489);
        assert!(
            in_radians.starts_with("all fixes are within 0.19 m of latitude 0.640833"),
            "{in_radians}"
        );
        assert_eq!(notes(1.0, 36.717, -4.489), "");
        assert_eq!(notes(1.0, 1e-6, 0.0), "");
    }

    #[test]
    fn two_publishers_of_one_topic_are_refused_and_noise_is_not() {
        let drive = |aside_m: &dyn Fn(i64) -> f64, period_ns: i64| {
            let place = |step| (step * period_ns, [0.03 * step as f64, aside_m(step), 0.0]);
            let positions: Vec<_> = (0..200).map(place).collect();
            one_publisher(&positions).map_err(|error| error.to_string())
        };
        let two = |step: i64| if step % 2 == 0 { 0.0 } else { 1.5 };
        let error = drive(&two, 25_000_000).unwrap_err();
        assert!(
            error.contains("198 of 200 times") && error.contains("two programs publish"),
            "{error}"
        );
        // One that publishes at a fifth of the other's rate.
        let rare = |step: i64| if step % 6 == 5 { 2.0 } else { 0.0 };
        assert!(drive(&rare, 20_000_000).is_err());
        // The noise of a receiver at 5 Hz, and stray positions.
        drive(&two, 200_000_000).unwrap();
        drive(
            &|step| f64::from(u8::from(step % 70 == 50)) * 20.0,
            25_000_000,
        )
        .unwrap();
    }
}
