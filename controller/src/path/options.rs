//! How smooth a path is made.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// How raw points become a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoothing {
    /// Largest curvature of the path, 1/m.
    pub max_curvature_per_m: f64,
    /// Largest distance of a raw point from the path, m.
    pub max_deviation_m: f64,
    /// Distance between the nodes of the smoothing spline, m.
    pub spacing_m: f64,
    /// Standard deviation of the points in each direction, m; none to estimate it from them.
    pub accuracy_m: Option<f64>,
}

impl Default for Smoothing {
    fn default() -> Self {
        Self {
            max_curvature_per_m: 1.0,
            max_deviation_m: 0.5,
            spacing_m: 0.1,
            accuracy_m: None,
        }
    }
}

const CURVATURES: Bounds = Bounds::new(0.01, 10.0, "1/m");

/// How raw points become a path, as a configuration says it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "RawSmoothing", into = "RawSmoothing")]
pub struct SmoothingConfig {
    /// Largest curvature of the path. None: 2 over the distance of the tread ICRs, where the inner tread stands still.
    pub max_curvature_per_m: Option<f64>,
    /// Largest distance of a raw point from the path. None: 0.5 m.
    pub max_deviation_m: Option<f64>,
    /// Distance between the nodes of the smoothing spline. None: 0.1 m.
    pub spacing_m: Option<f64>,
    /// Standard deviation of the points in each direction, 0 for exact ones: the path is as smooth as that asks for.
    /// None: estimated from the points.
    pub accuracy_m: Option<f64>,
}

impl SmoothingConfig {
    /// Returns the smoothing for points that were recorded, for a vehicle with this distance between its tread ICRs.
    ///
    /// By default the largest curvature is that at which the inner tread stands still, 2 over the track width.
    pub fn recorded(&self, track_width_m: f64) -> Smoothing {
        self.with_defaults(2.0 / track_width_m, None)
    }

    /// Returns the smoothing for points that were planned: they are exact, and their corners, which may be twice as
    /// sharp, intended.
    pub fn planned(&self, track_width_m: f64) -> Smoothing {
        self.with_defaults(4.0 / track_width_m, Some(0.0))
    }

    fn with_defaults(&self, curvature_per_m: f64, accuracy_m: Option<f64>) -> Smoothing {
        let by_default = Smoothing::default();
        let curvature_per_m = curvature_per_m.clamp(CURVATURES.low, CURVATURES.high);
        Smoothing {
            max_curvature_per_m: self.max_curvature_per_m.unwrap_or(curvature_per_m),
            max_deviation_m: self.max_deviation_m.unwrap_or(by_default.max_deviation_m),
            spacing_m: self.spacing_m.unwrap_or(by_default.spacing_m),
            accuracy_m: self.accuracy_m.or(accuracy_m),
        }
    }
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RawSmoothing {
    max_curvature_per_m: Option<f64>,
    max_deviation_m: Option<f64>,
    spacing_m: Option<f64>,
    accuracy_m: Option<f64>,
}

impl TryFrom<RawSmoothing> for SmoothingConfig {
    type Error = RangeError;

    fn try_from(raw: RawSmoothing) -> Result<Self, RangeError> {
        let check = |bounds: Bounds, key, value: Option<f64>| {
            value.map(|value| bounds.check(key, value)).transpose()
        };
        let deviations = Bounds::new(1e-3, 100.0, "m");
        let spacings = Bounds::new(0.01, 1.0, "m");
        let accuracies = Bounds::new(0.0, 10.0, "m");
        Ok(Self {
            max_curvature_per_m: check(CURVATURES, "max_curvature_per_m", raw.max_curvature_per_m)?,
            max_deviation_m: check(deviations, "max_deviation_m", raw.max_deviation_m)?,
            spacing_m: check(spacings, "spacing_m", raw.spacing_m)?,
            accuracy_m: check(accuracies, "accuracy_m", raw.accuracy_m)?,
        })
    }
}

impl From<SmoothingConfig> for RawSmoothing {
    fn from(config: SmoothingConfig) -> Self {
        Self {
            max_curvature_per_m: config.max_curvature_per_m,
            max_deviation_m: config.max_deviation_m,
            spacing_m: config.spacing_m,
            accuracy_m: config.accuracy_m,
        }
    }
}
