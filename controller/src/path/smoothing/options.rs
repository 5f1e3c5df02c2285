//! How smooth a path is made.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// How raw points become a path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawSmoothing", into = "RawSmoothing")]
pub struct Smoothing {
    /// Largest curvature of the path, 1/m.
    pub max_curvature_per_m: f64,
    /// Largest distance of a raw point from the path, m.
    pub max_deviation_m: f64,
    /// Distance between the nodes of the smoothing spline, m.
    pub spacing_m: f64,
}

impl Default for Smoothing {
    fn default() -> Self {
        Self {
            max_curvature_per_m: 1.0,
            max_deviation_m: 0.5,
            spacing_m: 0.1,
        }
    }
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RawSmoothing {
    max_curvature_per_m: f64,
    max_deviation_m: f64,
    spacing_m: f64,
}

impl Default for RawSmoothing {
    fn default() -> Self {
        Smoothing::default().into()
    }
}

impl TryFrom<RawSmoothing> for Smoothing {
    type Error = RangeError;

    fn try_from(raw: RawSmoothing) -> Result<Self, RangeError> {
        Ok(Self {
            max_curvature_per_m: Bounds::new(0.01, 10.0, "1/m")
                .check("max_curvature_per_m", raw.max_curvature_per_m)?,
            max_deviation_m: Bounds::new(1e-3, 100.0, "m")
                .check("max_deviation_m", raw.max_deviation_m)?,
            spacing_m: Bounds::new(0.01, 1.0, "m").check("spacing_m", raw.spacing_m)?,
        })
    }
}

impl From<Smoothing> for RawSmoothing {
    fn from(options: Smoothing) -> Self {
        Self {
            max_curvature_per_m: options.max_curvature_per_m,
            max_deviation_m: options.max_deviation_m,
            spacing_m: options.spacing_m,
        }
    }
}
