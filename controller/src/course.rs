//! Named analytic courses, for scenarios and tests.

mod figure_eight;
mod pivot;
mod shapes;

pub use figure_eight::FigureEight;
pub use pivot::Pivot;
pub use shapes::{Circle, Cusp, Slalom, Straight, Turn};

use crate::path::PathError;
use crate::speed_profile::SpeedLimits;
use crate::trajectory::Trajectory;
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::RangeError;

/// A course with its parameters; each has a default.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawCourse", tag = "shape", rename_all = "snake_case")]
pub enum Course {
    /// An 8, given as a trajectory.
    FigureEight(FigureEight),
    /// A circle at constant speed.
    Circle(Circle),
    /// A straight line.
    Straight(Straight),
    /// A sine.
    Slalom(Slalom),
    /// A turn on the spot at constant yaw rate.
    Pivot(Pivot),
    /// An arc forward and an arc in reverse.
    Cusp(Cusp),
}

impl Course {
    /// Returns the trajectory of the course, which starts at the origin of the world.
    ///
    /// `figure_eight`, `circle` and `pivot` are given in time and ignore `limits`; the others get
    /// the speed profile within `limits` and their own speed.
    ///
    /// # Errors
    /// [`PathError::Range`] for parameters or limits out of range.
    pub fn trajectory(&self, limits: &SpeedLimits) -> Result<Trajectory, PathError> {
        self.check()?;
        match self {
            Self::FigureEight(course) => course.trajectory(),
            Self::Circle(course) => course.trajectory(),
            Self::Straight(course) => course.trajectory(limits),
            Self::Slalom(course) => course.trajectory(limits),
            Self::Pivot(course) => Ok(course.trajectory()),
            Self::Cusp(course) => course.trajectory(limits),
        }
    }

    fn check(&self) -> Result<(), RangeError> {
        match self {
            Self::FigureEight(course) => course.check(),
            Self::Circle(course) => course.check(),
            Self::Straight(course) => course.check(),
            Self::Slalom(course) => course.check(),
            Self::Pivot(course) => course.check(),
            Self::Cusp(course) => course.check(),
        }
    }
}

#[derive(Deserialize)]
#[serde(tag = "shape", rename_all = "snake_case")]
enum RawCourse {
    FigureEight(FigureEight),
    Circle(Circle),
    Straight(Straight),
    Slalom(Slalom),
    Pivot(Pivot),
    Cusp(Cusp),
}

impl TryFrom<RawCourse> for Course {
    type Error = RangeError;

    fn try_from(raw: RawCourse) -> Result<Self, RangeError> {
        let course = match raw {
            RawCourse::FigureEight(course) => Self::FigureEight(course),
            RawCourse::Circle(course) => Self::Circle(course),
            RawCourse::Straight(course) => Self::Straight(course),
            RawCourse::Slalom(course) => Self::Slalom(course),
            RawCourse::Pivot(course) => Self::Pivot(course),
            RawCourse::Cusp(course) => Self::Cusp(course),
        };
        course.check()?;
        Ok(course)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::Path;
    use crate::trajectory::{Ending, Motion};
    use std::f64::consts::PI;

    fn limits() -> SpeedLimits {
        SpeedLimits {
            speed_max_m_s: 1.0,
            traction_max_m_s: 1.0,
            steer_max_m_s: 1.0,
            tread_max_m_s: f64::INFINITY,
            acceleration_m_s2: 0.5,
            deceleration_m_s2: 0.5,
            steer_acceleration_m_s2: 1.0,
            lateral_acceleration_m_s2: f64::INFINITY,
            track_width_m: 2.05,
        }
    }

    fn course(yaml: &str) -> Result<Course, String> {
        serde_yaml::from_str(yaml).map_err(|error| error.to_string())
    }

    #[test]
    fn every_course_is_read_with_its_defaults_and_moves_as_its_velocity_says() {
        for name in [
            "figure_eight",
            "circle",
            "straight",
            "slalom",
            "pivot",
            "cusp",
        ] {
            let course = course(&format!("shape: {name}")).unwrap();
            let trajectory = course.trajectory(&limits()).unwrap();
            let step_s = 1e-3;
            for i in 1..500 {
                let time_s = trajectory.duration_s() * f64::from(i) / 500.0;
                let mut stops = trajectory.path().into_iter().flat_map(Path::stops_m);
                if stops.any(|stop_m| (trajectory.time_at(stop_m) - time_s).abs() < 0.01) {
                    continue;
                }
                let (before, here, after) = (
                    trajectory.at(time_s - step_s),
                    trajectory.at(time_s),
                    trajectory.at(time_s + step_s),
                );
                let (sin, cos) = here.heading_rad.sin_cos();
                let rate = |a: f64, b: f64| (b - a) / (2.0 * step_s);
                let x_m_s = rate(before.position.x_m, after.position.x_m);
                let y_m_s = rate(before.position.y_m, after.position.y_m);
                let yaw_rad_s = rate(before.heading_rad, after.heading_rad);
                let at = format!("{name} at {time_s} s: {here:?}");
                assert!((x_m_s + sin * here.speed_m_s).abs() < 5e-3, "{at}");
                assert!((y_m_s - cos * here.speed_m_s).abs() < 5e-3, "{at}");
                assert!(
                    (yaw_rad_s - here.yaw_rate_rad_s).abs() < 2e-2,
                    "{at} {yaw_rad_s}"
                );
                assert!(after.arc_length_m >= before.arc_length_m, "{at}");
                if here.motion == Motion::Drive {
                    assert!(
                        (trajectory.time_at(here.arc_length_m) - time_s).abs() < 1e-3,
                        "{at}"
                    );
                    let on_path = trajectory.path().unwrap().at(here.arc_length_m);
                    assert!(on_path.position.distance_m(&here.position) < 1e-3, "{at}");
                }
            }
        }
    }

    #[test]
    fn a_circle_goes_on_and_keeps_turning() {
        let course = course("{shape: circle, radius_m: 2, turn: right, turns: 1}").unwrap();
        let trajectory = course.trajectory(&limits()).unwrap();
        assert_eq!(trajectory.ending(), Ending::Periodic);
        let (one, three) = (
            trajectory.at(1.0),
            trajectory.at(1.0 + 2.0 * trajectory.duration_s()),
        );
        assert!(one.position.distance_m(&three.position) < 1e-9);
        assert!((three.heading_rad - one.heading_rad + 4.0 * PI).abs() < 1e-9);
        assert!((three.arc_length_m - one.arc_length_m - 8.0 * PI).abs() < 1e-6);
        assert!(
            one.position.x_m > 0.0,
            "a right turn from +Y_g leads to +X_g"
        );
    }

    #[test]
    fn a_straight_course_stands_before_its_start_and_after_its_end() {
        let course = course("{shape: straight, length_m: 5, heading_deg: -90}").unwrap();
        let trajectory = course.trajectory(&limits()).unwrap();
        let (before, after) = (trajectory.at(-1.0), trajectory.at(1e4));
        assert_eq!((before.motion, before.speed_m_s), (Motion::Stand, 0.0));
        assert_eq!((after.motion, after.speed_m_s), (Motion::Stand, 0.0));
        assert!(before.position.x_m.abs() < 1e-12);
        assert!((after.position.x_m - 5.0).abs() < 1e-9 && after.position.y_m.abs() < 1e-9);
    }

    #[test]
    fn the_cusp_course_reverses_with_a_continuous_heading() {
        let trajectory = course("shape: cusp")
            .unwrap()
            .trajectory(&limits())
            .unwrap();
        let cusp_m = trajectory.path().unwrap().cusps_m().next().unwrap();
        let cusp_s = trajectory.time_at(cusp_m);
        assert!(trajectory.at(cusp_s - 1.0).speed_m_s > 0.1);
        assert!(trajectory.at(cusp_s + 1.0).speed_m_s < -0.1);
        let turn =
            trajectory.at(cusp_s + 0.01).heading_rad - trajectory.at(cusp_s - 0.01).heading_rad;
        assert!(turn.abs() < 0.01);
    }

    #[test]
    fn bad_parameters_are_named() {
        let error = course("{shape: circle, radius_m: -1}").unwrap_err();
        assert!(error.contains("radius_m: -1 is out of range"), "{error}");
        let error = course("{shape: straight, length_m: 0}").unwrap_err();
        assert!(error.contains("length_m: 0 is out of range"), "{error}");
        let error = course("{shape: circle, radios_m: 1}").unwrap_err();
        assert!(error.contains("radios_m"), "{error}");
        let error = course("{shape: spiral}").unwrap_err();
        assert!(error.contains("spiral"), "{error}");
    }
}
