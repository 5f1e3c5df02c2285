use crate::path::{ArcLength, CurvePoint, Direction, Path, PathError, Point2};
use crate::trajectory::{Ending, Motion, NODE_STEP_S, Node, Trajectory};
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
    /// Returns the trajectory exactly as parametrised; it is periodic.
    ///
    /// # Errors
    /// [`PathError::Range`] for parameters out of range.
    pub fn trajectory(&self) -> Result<Trajectory, PathError> {
        self.check()?;
        let course = *self;
        let table = ArcLength::new(move |time_s| course.at(time_s), self.period_s, 2000);
        let samples = table.samples(Direction::Forward);
        let path = Path::from_pieces([(Direction::Forward, table.length_m(), samples)], true)?;
        let intervals = (self.period_s / NODE_STEP_S).ceil() as usize;
        let step_s = self.period_s / intervals as f64;
        let mut heading_rad = table.point(0.0).travel_heading_rad();
        let nodes = (0..=intervals)
            .map(|i| {
                let time_s = i as f64 * step_s;
                let point = table.point(time_s);
                let wrapped = point.travel_heading_rad();
                heading_rad = wrapped + ((heading_rad - wrapped) / TAU).round() * TAU;
                Node {
                    arc_length_m: table.at_parameter(time_s),
                    position: point.position,
                    heading_rad,
                    speed_m_s: point.speed(),
                    yaw_rate_rad_s: point.speed() * point.curvature_per_m(),
                    motion: Motion::Drive,
                }
            })
            .collect();
        Trajectory::from_nodes(nodes, step_s, Some(path), Ending::Periodic)
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

    #[test]
    fn positions_are_those_of_the_formula() {
        let trajectory = FigureEight::default().trajectory().unwrap();
        let w = TAU / 60.0;
        for i in 0..12_345 {
            let t = f64::from(i) * 0.0117;
            let point = trajectory.at(t);
            let exact = Point2 {
                x_m: 2.4 * (2.0 * w * t).sin(),
                y_m: 3.9 * (w * t).sin(),
            };
            assert!(point.position.distance_m(&exact) < 1e-8, "at {t} s");
            let on_path = trajectory.path().unwrap().at(point.arc_length_m);
            assert!(on_path.position.distance_m(&exact) < 1e-6, "at {t} s");
            assert!((on_path.heading_rad - point.heading_rad).abs() < 1e-5);
            let speed = on_path.curvature_per_m * point.speed_m_s - point.yaw_rate_rad_s;
            assert!(speed.abs() < 1e-3, "{speed}");
        }
    }
}
