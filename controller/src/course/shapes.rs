use crate::path::{ArcLength, CurvePoint, Direction, Path, PathError, Point2};
use crate::speed_profile::{SpeedLimits, speed_profile};
use crate::trajectory::{Ending, Trajectory};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use std::f64::consts::TAU;

/// Which way a curve turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Turn {
    /// Counter-clockwise.
    #[default]
    Left,
    /// Clockwise.
    Right,
}

impl Turn {
    fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }
}

/// A circle from the origin, first along +Y_g, at constant speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Circle {
    /// Radius.
    pub radius_m: f64,
    /// Speed.
    pub speed_m_s: f64,
    /// Rounds until the end. A whole number repeats periodically; others end with a stop.
    pub turns: f64,
    /// Left or right.
    pub turn: Turn,
}

impl Default for Circle {
    fn default() -> Self {
        Self {
            radius_m: 4.0,
            speed_m_s: 0.4,
            turns: 1.0,
            turn: Turn::Left,
        }
    }
}

impl Circle {
    pub(super) fn check(&self) -> Result<(), RangeError> {
        length("radius_m", self.radius_m)?;
        speed(self.speed_m_s)?;
        Bounds::new(0.01, 1e3, "").check("turns", self.turns)?;
        Ok(())
    }

    pub(crate) fn trajectory(&self) -> Result<Trajectory, PathError> {
        let whole = self.turns.fract() == 0.0;
        let arc = Arc {
            start: Point2::default(),
            heading_rad: 0.0,
            radius_m: self.radius_m,
            turn: self.turn,
            direction: Direction::Forward,
        };
        let path = Path::from_pieces(
            [arc.piece(if whole { TAU } else { self.turns * TAU })],
            whole,
        )?;
        let length_m = self.turns * TAU * self.radius_m;
        let ending = if whole {
            Ending::Periodic
        } else {
            Ending::Stop
        };
        Trajectory::along(path, ending, length_m, vec![self.speed_m_s; 2])
    }
}

/// A straight line from the origin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Straight {
    /// Length.
    pub length_m: f64,
    /// Speed.
    pub speed_m_s: f64,
    /// Heading, counter-clockwise from Y_g.
    pub heading_deg: f64,
}

impl Default for Straight {
    fn default() -> Self {
        Self {
            length_m: 20.0,
            speed_m_s: 0.5,
            heading_deg: 0.0,
        }
    }
}

impl Straight {
    pub(super) fn check(&self) -> Result<(), RangeError> {
        length("length_m", self.length_m)?;
        speed(self.speed_m_s)?;
        let heading = self.heading_deg;
        Bounds::new(-360.0, 360.0, "deg").check("heading_deg", heading)?;
        Ok(())
    }

    pub(super) fn trajectory(&self, limits: &SpeedLimits) -> Result<Trajectory, PathError> {
        let (sin, cos) = self.heading_deg.to_radians().sin_cos();
        let line = move |along_m: f64| CurvePoint {
            position: Point2 {
                x_m: -sin * along_m,
                y_m: cos * along_m,
            },
            tangent: [-sin, cos],
            second: [0.0, 0.0],
        };
        profiled([piece(line, self.length_m)], self.speed_m_s, limits)
    }
}

/// A sine about the Y_g axis: X_g = amplitude * sin(2 pi Y_g/wavelength).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Slalom {
    /// Extent along Y_g.
    pub length_m: f64,
    /// Amplitude.
    pub amplitude_m: f64,
    /// Wavelength.
    pub wavelength_m: f64,
    /// Speed.
    pub speed_m_s: f64,
}

impl Default for Slalom {
    fn default() -> Self {
        Self {
            length_m: 24.0,
            amplitude_m: 1.0,
            wavelength_m: 8.0,
            speed_m_s: 0.5,
        }
    }
}

impl Slalom {
    pub(super) fn check(&self) -> Result<(), RangeError> {
        length("length_m", self.length_m)?;
        Bounds::new(0.0, 100.0, "m").check("amplitude_m", self.amplitude_m)?;
        length("wavelength_m", self.wavelength_m)?;
        speed(self.speed_m_s)
    }

    pub(super) fn trajectory(&self, limits: &SpeedLimits) -> Result<Trajectory, PathError> {
        let (a, w) = (self.amplitude_m, TAU / self.wavelength_m);
        let sine = move |y_m: f64| {
            let (sin, cos) = (w * y_m).sin_cos();
            CurvePoint {
                position: Point2 { x_m: a * sin, y_m },
                tangent: [a * w * cos, 1.0],
                second: [-a * w * w * sin, 0.0],
            }
        };
        profiled([piece(sine, self.length_m)], self.speed_m_s, limits)
    }
}

/// An arc forward from the origin, first along +Y_g, and an arc in reverse on which the heading
/// turns on the same way: the first two moves of a three-point turn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Cusp {
    /// Radius of both arcs.
    pub radius_m: f64,
    /// Turn of the heading on each arc.
    pub angle_deg: f64,
    /// Left or right.
    pub turn: Turn,
    /// Speed.
    pub speed_m_s: f64,
}

impl Default for Cusp {
    fn default() -> Self {
        Self {
            radius_m: 4.0,
            angle_deg: 60.0,
            turn: Turn::Left,
            speed_m_s: 0.4,
        }
    }
}

impl Cusp {
    pub(super) fn check(&self) -> Result<(), RangeError> {
        length("radius_m", self.radius_m)?;
        let angle = self.angle_deg;
        Bounds::new(1.0, 360.0, "deg").check("angle_deg", angle)?;
        speed(self.speed_m_s)
    }

    pub(super) fn trajectory(&self, limits: &SpeedLimits) -> Result<Trajectory, PathError> {
        let angle_rad = self.angle_deg.to_radians();
        let forward = Arc {
            start: Point2::default(),
            heading_rad: 0.0,
            radius_m: self.radius_m,
            turn: self.turn,
            direction: Direction::Forward,
        };
        let reverse = Arc {
            start: forward.at(angle_rad).position,
            heading_rad: self.turn.sign() * angle_rad,
            direction: Direction::Reverse,
            ..forward
        };
        profiled(
            [forward.piece(angle_rad), reverse.piece(angle_rad)],
            self.speed_m_s,
            limits,
        )
    }
}

/// A circular arc on which the heading turns one way.
#[derive(Debug, Clone, Copy)]
struct Arc {
    start: Point2,
    /// Heading of the vehicle at the start.
    heading_rad: f64,
    radius_m: f64,
    turn: Turn,
    direction: Direction,
}

impl Arc {
    /// Returns the arc after the heading has turned by `angle_rad`, with derivatives by the angle.
    fn at(&self, angle_rad: f64) -> CurvePoint {
        let (sign, travel) = (self.turn.sign(), self.direction.sign());
        let (sin_0, cos_0) = self.heading_rad.sin_cos();
        let (sin, cos) = (self.heading_rad + sign * angle_rad).sin_cos();
        // d position/d angle = radius * travel * (-sin psi, cos psi)
        let r = self.radius_m * travel;
        CurvePoint {
            position: Point2 {
                x_m: self.start.x_m + r * sign * (cos - cos_0),
                y_m: self.start.y_m + r * sign * (sin - sin_0),
            },
            tangent: [-r * sin, r * cos],
            second: [-r * sign * cos, -r * sign * sin],
        }
    }

    fn piece(self, angle_rad: f64) -> PathPiece {
        let table = ArcLength::new(move |angle| self.at(angle), angle_rad, 64);
        (
            self.direction,
            table.length_m(),
            table.samples(self.direction),
        )
    }
}

type PathPiece = (Direction, f64, Vec<crate::path::PathSample>);

fn piece(curve: impl Fn(f64) -> CurvePoint, end: f64) -> PathPiece {
    let intervals = (end / 0.05).ceil().max(64.0) as usize;
    let table = ArcLength::new(curve, end, intervals);
    let samples = table.samples(Direction::Forward);
    (Direction::Forward, table.length_m(), samples)
}

fn profiled<const N: usize>(
    pieces: [PathPiece; N],
    speed_m_s: f64,
    limits: &SpeedLimits,
) -> Result<Trajectory, PathError> {
    let path = Path::from_pieces(pieces, false)?;
    speed_profile(&path, limits, |_| speed_m_s)
}

fn length(key: &'static str, value: f64) -> Result<(), RangeError> {
    Bounds::new(0.1, 1e4, "m").check(key, value).map(|_| ())
}

fn speed(value: f64) -> Result<(), RangeError> {
    Bounds::new(0.01, 20.0, "m/s")
        .check("speed_m_s", value)
        .map(|_| ())
}
