//! Speeds that stretches of a path have of their own.

use super::{Path, PathError, RawPoint};
use sidehill_plant::bounds::Bounds;

/// Speeds that a stretch may have, m/s. A slower vehicle would stand.
pub const ROUTE_SPEEDS: Bounds = Bounds::new(0.01, 20.0, "m/s");

/// The largest speed from an arc length on, up to the next stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedStretch {
    /// Where it begins, m.
    pub from_m: f64,
    /// Largest speed, m/s; none where only the settings limit it.
    pub speed_m_s: Option<f64>,
}

impl Path {
    /// Returns this path with stretches, in the order of travel, in place of those it has.
    ///
    /// # Errors
    /// [`PathError::Range`] for a speed outside [`ROUTE_SPEEDS`], or arc lengths that decrease or are not finite.
    pub(crate) fn with_speeds(mut self, speeds: Vec<SpeedStretch>) -> Result<Self, PathError> {
        let mut before_m = 0.0;
        for stretch in &speeds {
            Bounds::new(before_m, f64::MAX, "m").check("from_m", stretch.from_m)?;
            if let Some(speed_m_s) = stretch.speed_m_s {
                ROUTE_SPEEDS.check("speed_m_s", speed_m_s)?;
            }
            before_m = stretch.from_m;
        }
        self.speeds = speeds;
        Ok(self)
    }

    /// Returns the stretches with speeds of their own, in the order of travel; empty where the settings alone limit
    /// the speed.
    pub fn speeds(&self) -> &[SpeedStretch] {
        &self.speeds
    }

    /// Returns the smallest of the speeds of the stretches between two arc lengths, m/s; infinite where none has one.
    pub(crate) fn slowest_m_s(&self, from_m: f64, to_m: f64) -> f64 {
        let first = self.speeds.partition_point(|next| next.from_m <= from_m);
        self.speeds[first.saturating_sub(1)..]
            .iter()
            .take_while(|stretch| stretch.from_m <= to_m)
            .filter_map(|stretch| stretch.speed_m_s)
            .fold(f64::INFINITY, f64::min)
    }

    /// Returns the largest speed of the stretch at an arc length, m/s; none where it has none of its own.
    pub fn speed_m_s(&self, arc_length_m: f64) -> Option<f64> {
        let after = self
            .speeds
            .partition_point(|next| next.from_m <= arc_length_m);
        self.speeds[..after].last()?.speed_m_s
    }
}

/// Returns the stretches between points that are at these arc lengths of the path, m.
pub(super) fn stretches(points: &[RawPoint], arc_lengths_m: &[f64]) -> Vec<SpeedStretch> {
    let mut found: Vec<SpeedStretch> = Vec::new();
    // No stretch begins at the last point.
    let beginnings = points.len().saturating_sub(1);
    for (point, &from_m) in points.iter().zip(arc_lengths_m).take(beginnings) {
        // Of points at one place the last says how to go on.
        if found.last().is_some_and(|last| last.from_m >= from_m) {
            found.pop();
        }
        if found.last().and_then(|last| last.speed_m_s) != point.speed_m_s {
            found.push(SpeedStretch {
                from_m,
                speed_m_s: point.speed_m_s,
            });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::{Aside, Point2, Smoothing, smooth};
    use super::*;

    fn points(rows: &[(f64, f64, Option<f64>)]) -> Vec<RawPoint> {
        rows.iter()
            .map(|&(x_m, y_m, speed_m_s)| RawPoint {
                position: Point2 { x_m, y_m },
                speed_m_s,
                ..RawPoint::default()
            })
            .collect()
    }

    fn line() -> Path {
        let rows = [
            (0.0, 0.0, None),
            (0.0, 3.0, Some(0.3)),
            (0.0, 5.0, Some(0.2)),
            (0.0, 6.0, None),
            (0.0, 9.0, Some(0.1)),
        ];
        smooth(&points(&rows), &Smoothing::default()).unwrap().path
    }

    #[test]
    fn a_stretch_goes_from_its_point_to_the_next() {
        let path = line();
        let at = |arc_length_m| path.speed_m_s(arc_length_m);
        assert_eq!([at(0.0), at(2.9), at(3.1)], [None, None, Some(0.3)]);
        assert_eq!(
            [at(4.9), at(5.1), at(5.9)],
            [Some(0.3), Some(0.2), Some(0.2)]
        );
        // At the last point none begins.
        assert_eq!([at(6.1), at(9.0)], [None, None]);
        assert_eq!(path.slowest_m_s(2.0, 2.9), f64::INFINITY);
        assert_eq!(path.slowest_m_s(2.0, 4.0), 0.3);
        assert_eq!(path.slowest_m_s(4.0, 9.0), 0.2);
    }

    #[test]
    fn of_points_at_one_place_the_last_says_how_to_go_on() {
        let rows = [
            (0.0, 0.0, Some(0.5)),
            (0.0, 2.0, Some(0.1)),
            (0.0, 2.0, Some(0.4)),
            (0.0, 4.0, None),
        ];
        let path = smooth(&points(&rows), &Smoothing::default()).unwrap().path;
        assert_eq!(path.slowest_m_s(0.0, 4.0), 0.4);
        assert_eq!(path.speeds().len(), 2);
    }

    #[test]
    fn a_speed_at_which_the_vehicle_would_stand_is_refused() {
        for speed_m_s in [0.0, -0.5, 25.0, f64::NAN] {
            let rows = [(0.0, 0.0, Some(speed_m_s)), (0.0, 2.0, None)];
            let error = smooth(&points(&rows), &Smoothing::default()).unwrap_err();
            assert!(error.to_string().contains("speed_m_s"), "{error}");
        }
    }

    #[test]
    fn stretches_stay_where_they_are_on_a_path_beside() {
        // A quarter circle to the left with a radius of 4 m, slow over its second half.
        let rows: Vec<_> = (0..=30)
            .map(|i| {
                let (sin, cos) = (std::f64::consts::FRAC_PI_2 * f64::from(i) / 30.0).sin_cos();
                (4.0 * cos, 4.0 * sin, (i >= 15).then_some(0.2))
            })
            .collect();
        let path = smooth(&points(&rows), &Smoothing::default()).unwrap().path;
        let aside = Aside {
            left_m: 1.0,
            ..Aside::NONE
        };
        let moved = path.moved_aside(|_| aside).unwrap();
        let [original_m, moved_m] = [&path, &moved.path].map(|path| path.speeds()[0].from_m);
        let places = [path.at(original_m), moved.path.at(moved_m)].map(|point| point.position);
        let angles = places.map(|place| place.y_m.atan2(place.x_m).to_degrees());
        assert!(
            angles.iter().all(|angle| (angle - 45.0).abs() < 0.5),
            "{angles:?}"
        );
        assert!((moved.original_m(moved_m) - original_m).abs() < 1e-6);
        assert!(original_m - moved_m > 0.7);
    }
}
