//! How far elevations of a route are smoothed.

use crate::bounds::{Bounds, RangeError};
use serde::{Deserialize, Serialize};

/// How far route elevations are smoothed, and how far to the side they are valid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawRouteSmoothing")]
pub struct RouteSmoothing {
    /// Length over which heights are smoothed along the route.
    pub(super) smoothing_length_m: f64,
    /// Distance from the route up to which the ground is known.
    pub(super) distance_max_m: f64,
}

impl RouteSmoothing {
    /// Returns a smoothing that weighs elevations within `smoothing_length_m` (weight (1 - d^2/L^2)^3
    /// at distance d) and gives ground within `distance_max_m` of the route.
    ///
    /// # Errors
    /// Names the value that is out of range: length from 0.5 to 500 m, distance from 0.5 to 100 m.
    pub fn new(smoothing_length_m: f64, distance_max_m: f64) -> Result<Self, RangeError> {
        Ok(Self {
            smoothing_length_m: Bounds::new(0.5, 500.0, "m")
                .check("smoothing_length_m", smoothing_length_m)?,
            distance_max_m: Bounds::new(0.5, 100.0, "m").check("distance_max_m", distance_max_m)?,
        })
    }

    /// Spacing of the places at which the route is sampled for fitting, m.
    pub(super) fn sample_spacing_m(&self) -> f64 {
        self.smoothing_length_m / 16.0
    }

    /// Distance at which a tangent plane stops to count, m.
    pub(super) fn blend_m(&self) -> f64 {
        1.5 * self.distance_max_m
    }

    /// Spacing of the tangent planes along the route, m.
    pub(super) fn plane_spacing_m(&self) -> f64 {
        self.blend_m() / 6.0
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawRouteSmoothing {
    smoothing_length_m: f64,
    distance_max_m: f64,
}

impl TryFrom<RawRouteSmoothing> for RouteSmoothing {
    type Error = RangeError;

    fn try_from(raw: RawRouteSmoothing) -> Result<Self, RangeError> {
        Self::new(raw.smoothing_length_m, raw.distance_max_m)
    }
}
