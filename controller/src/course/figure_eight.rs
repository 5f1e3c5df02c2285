use crate::path::{ArcLength, CurvePoint, Direction, Path, PathError, Point2, SAMPLE_STEP_M};
use crate::trajectory::{Ending, Trajectory};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use std::f64::consts::TAU;

/// An 8 lying across Y_g, driven as x = a sin(2 w t), y = b sin(w t), w = 2 pi/period.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FigureEight {
    /// Largest x, the amplitude a of x = a sin(2 w t).
    pub half_width_m: f64,
    /// Largest y, the amplitude b of y = b sin(w t).
    pub half_length_m: f64,
    /// Time for one round.
    pub period_s: f64,
}

impl Default for FigureEight {
    fn default() -> Self {
        Self {
            half_width_m: 2.4,
            half_length_m: 3.9,
            period_s: 60.0,
        }
    }
}

impl FigureEight {
    /// Returns the trajectory as parametrised; it is periodic.
    ///
    /// # Errors
    /// [`PathError::Range`] for parameters out of range.
    pub fn trajectory(&self) -> Result<Trajectory, PathError> {
        self.check()?;
        let course = *self;
        let table = ArcLength::new(move |time_s| course.at(time_s), self.period_s, 2000);
        let samples = table.samples(Direction::Forward);
        let path = Path::from_pieces([(Direction::Forward, table.length_m(), samples)], true)?;
        let length_m = table.length_m();
        let intervals = (length_m / SAMPLE_STEP_M).ceil();
        let speeds_m_s = (0..=intervals as usize)
            .map(|i| table.parameter_at(length_m * i as f64 / intervals))
            .map(|time_s| table.point(time_s).speed())
            .collect();
        Trajectory::along(path, Ending::Periodic, length_m, speeds_m_s)
    }

    pub(super) fn check(&self) -> Result<(), RangeError> {
        let extent = |key, value| Bounds::new(0.1, 1e3, "m").check(key, value);
        extent("half_width_m", self.half_width_m)?;
        extent("half_length_m", self.half_length_m)?;
        Bounds::new(1.0, 1e5, "s").check("period_s", self.period_s)?;
        Ok(())
    }

    fn at(&self, time_s: f64) -> CurvePoint {
        let (a, b, w) = (self.half_width_m, self.half_length_m, TAU / self.period_s);
        let (sin, cos) = (w * time_s).sin_cos();
        let (sin_2, cos_2) = (2.0 * w * time_s).sin_cos();
        CurvePoint {
            position: Point2 {
                x_m: a * sin_2,
                y_m: b * sin,
            },
            tangent: [2.0 * a * w * cos_2, b * w * cos],
            second: [-4.0 * a * w * w * sin_2, -b * w * w * sin],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::PROJECTION_WINDOW;

    #[test]
    fn positions_are_those_of_the_formula() {
        let trajectory = FigureEight::default().trajectory().unwrap();
        assert!((trajectory.duration_s() - 60.0).abs() < 0.01);
        let w = TAU / 60.0;
        for i in 0..12_345 {
            let t = f64::from(i) * 0.0117;
            let point = trajectory.at(t);
            let exact = Point2 {
                x_m: 2.4 * (2.0 * w * t).sin(),
                y_m: 3.9 * (w * t).sin(),
            };
            assert!(point.position.distance_m(&exact) < 0.01, "at {t} s");
            let path = trajectory.path().unwrap();
            let nearest = path.nearest_within(&exact, point.arc_length_m, &PROJECTION_WINDOW);
            assert!(nearest.cross_track_m.abs() < 1e-6, "at {t} s");
            let on_path = path.at(point.arc_length_m);
            assert!((on_path.heading_rad - point.heading_rad).abs() < 1e-5);
            let speed = on_path.curvature_per_m * point.speed_m_s - point.yaw_rate_rad_s;
            assert!(speed.abs() < 1e-3, "{speed}");
        }
    }
}
