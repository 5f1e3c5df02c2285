//! Points of the plane and of paths.

use serde::{Deserialize, Serialize};
use sidehill_plant::frames::PlanarPose;
use std::f64::consts::PI;

/// A position in the horizontal plane of the world.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Point2 {
    /// X_g, m.
    pub x_m: f64,
    /// Y_g, m.
    pub y_m: f64,
}

impl Point2 {
    /// Returns the distance to `other`, m.
    pub fn distance_m(&self, other: &Self) -> f64 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }

    /// Returns this point as seen from a frame in which the origin of its own is at `frame`.
    pub fn seen_from(&self, frame: &PlanarPose) -> Self {
        let (sin, cos) = frame.yaw_rad.sin_cos();
        Self {
            x_m: frame.x_m + cos * self.x_m - sin * self.y_m,
            y_m: frame.y_m + sin * self.x_m + cos * self.y_m,
        }
    }

    /// Returns whether both coordinates are finite.
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite()
    }
}

/// Which way the vehicle drives along a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// The vehicle's forward axis points along the direction of travel.
    #[default]
    Forward,
    /// The vehicle's forward axis points against the direction of travel.
    Reverse,
}

impl Direction {
    /// Returns 1 for forward and -1 for reverse: the sign of the longitudinal speed.
    pub fn sign(self) -> f64 {
        match self {
            Self::Forward => 1.0,
            Self::Reverse => -1.0,
        }
    }

    /// Returns the other direction.
    pub fn reversed(self) -> Self {
        match self {
            Self::Forward => Self::Reverse,
            Self::Reverse => Self::Forward,
        }
    }
}

/// A point of a [`Path`](super::Path).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Distance travelled from the start of the path, m.
    pub arc_length_m: f64,
    /// Position in the world.
    pub position: Point2,
    /// Heading psi of the vehicle, rad, unwrapped; against the direction of travel in reverse.
    pub heading_rad: f64,
    /// Curvature d(heading)/d(arc length), 1/m, positive where the heading turns
    /// counter-clockwise.
    pub curvature_per_m: f64,
    /// Which way the vehicle drives here.
    pub direction: Direction,
}

impl PathPoint {
    /// Returns the pose of a vehicle that is on the path here.
    pub fn pose(&self) -> PlanarPose {
        PlanarPose {
            x_m: self.position.x_m,
            y_m: self.position.y_m,
            yaw_rad: self.heading_rad,
        }
    }

    /// Returns the heading of the direction of travel, rad.
    pub fn travel_heading_rad(&self) -> f64 {
        match self.direction {
            Direction::Forward => self.heading_rad,
            Direction::Reverse => self.heading_rad + PI,
        }
    }

    /// Returns how far `place` is ahead and to the left of the point, in the direction of travel, m.
    pub(crate) fn offsets_to(&self, place: &Point2) -> (f64, f64) {
        let (sin, cos) = self.travel_heading_rad().sin_cos();
        let (x, y) = (place.x_m - self.position.x_m, place.y_m - self.position.y_m);
        (-sin * x + cos * y, -cos * x - sin * y)
    }
}

/// A point of a route as it was recorded or drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RawPoint {
    /// Position in the world.
    pub position: Point2,
    /// Z_g, m, where known.
    pub elevation_m: Option<f64>,
    /// Which way to drive from this point to the next, where given.
    pub direction: Option<Direction>,
    /// Largest speed from this point to the next, m/s, positive; none where only the settings limit it.
    pub speed_m_s: Option<f64>,
}

/// Returns the finite number that a text is.
pub(super) fn finite(text: &str) -> Option<f64> {
    text.trim()
        .parse()
        .ok()
        .filter(|value: &f64| value.is_finite())
}
