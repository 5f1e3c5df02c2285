//! Plane zones of different slope along one axis, joined by smooth transitions.

use super::Surface;
use crate::bounds::{Bounds, RangeError};
use serde::Deserialize;
use std::sync::Arc;

/// Ground whose slope along an axis goes from zone to zone, blended by a smoothstep, with one
/// constant cross slope; unbounded, the outer zones go on for ever.
///
/// The height is 0 on the axis where the first zone starts, and has a continuous second derivative.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "RawZones")]
pub struct ZonedTerrain {
    /// Width of each transition.
    transition_m: f64,
    axis_in_world: [f64; 2],
    cross_rise: f64,
    /// First zone's rise, and the height where it would cut the axis' station 0.
    first_rise: f64,
    first_height_m: f64,
    joints: Arc<[Joint]>,
}

/// One zone as the configuration states it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Zone {
    /// Station along the axis where the zone starts: the middle of its transition.
    start_m: f64,
    /// Slope along the axis, positive rising.
    slope_deg: f64,
}

/// The transition into a zone; rises are tangents of slopes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Joint {
    /// Station where the transition begins, m.
    begin_m: f64,
    height_at_begin_m: f64,
    rise_before: f64,
    rise_after: f64,
}

impl ZonedTerrain {
    pub(super) fn surface(&self, x_m: f64, y_m: f64) -> Surface {
        let [axis_x, axis_y] = self.axis_in_world;
        let station_m = axis_x * x_m + axis_y * y_m;
        let left_m = -axis_y * x_m + axis_x * y_m;
        let (height_m, rise) = self.profile(station_m);
        Surface::from_gradient(
            height_m + self.cross_rise * left_m,
            [
                rise * axis_x - self.cross_rise * axis_y,
                rise * axis_y + self.cross_rise * axis_x,
            ],
        )
    }

    /// Height on the axis and its derivative at a station.
    fn profile(&self, station_m: f64) -> (f64, f64) {
        let past = self.joints.partition_point(|j| j.begin_m <= station_m);
        match self.joints[..past].last() {
            None => (
                self.first_height_m + self.first_rise * station_m,
                self.first_rise,
            ),
            Some(joint) => joint.profile(station_m, self.transition_m),
        }
    }
}

impl Joint {
    /// Height and rise at a station at or past the transition's begin: the rise follows the
    /// smoothstep 3t^2 - 2t^3, the height its integral t^3 - t^4/2.
    fn profile(&self, station_m: f64, transition_m: f64) -> (f64, f64) {
        let past_m = station_m - self.begin_m;
        let t = (past_m / transition_m).min(1.0);
        let change = self.rise_after - self.rise_before;
        let in_transition_m =
            transition_m * (self.rise_before * t + change * (t.powi(3) - 0.5 * t.powi(4)));
        let beyond_m = (past_m - transition_m).max(0.0);
        (
            self.height_at_begin_m + in_transition_m + self.rise_after * beyond_m,
            self.rise_before + change * t * t * (3.0 - 2.0 * t),
        )
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawZones {
    /// Heading of the axis, counter-clockwise from Y_g.
    #[serde(default)]
    axis_heading_deg: f64,
    /// Slope across the axis, positive rising to its left.
    #[serde(default)]
    cross_slope_deg: f64,
    /// Width of each transition.
    transition_m: f64,
    /// [Zones](#zone) in the order of their starts.
    zones: Vec<Zone>,
}

const ZONES_MAX: usize = 1000;

impl TryFrom<RawZones> for ZonedTerrain {
    type Error = RangeError;

    fn try_from(raw: RawZones) -> Result<Self, RangeError> {
        let heading_deg =
            Bounds::new(-360.0, 360.0, "deg").check("axis_heading_deg", raw.axis_heading_deg)?;
        let cross_deg =
            Bounds::new(-30.0, 30.0, "deg").check("cross_slope_deg", raw.cross_slope_deg)?;
        let transition_m =
            Bounds::new(0.01, 1000.0, "m").check("transition_m", raw.transition_m)?;
        Bounds::new(1.0, ZONES_MAX as f64, "").check("number of zones", raw.zones.len() as f64)?;
        for zone in &raw.zones {
            Bounds::new(-30.0, 30.0, "deg").check("zones.slope_deg", zone.slope_deg)?;
            Bounds::new(-1e6, 1e6, "m").check("zones.start_m", zone.start_m)?;
        }
        for pair in raw.zones.windows(2) {
            Bounds::new(pair[0].start_m + transition_m, 1e6, "m")
                .with_note("at least transition_m after the zone before it")
                .check("zones.start_m", pair[1].start_m)?;
        }
        let rise = |zone: &Zone| zone.slope_deg.to_radians().tan();
        let first_rise = raw.zones.first().map_or(0.0, rise);
        let first_start_m = raw.zones.first().map_or(0.0, |zone| zone.start_m);
        let first_height_m = -first_rise * first_start_m;
        let mut joints: Vec<Joint> = Vec::with_capacity(raw.zones.len());
        for pair in raw.zones.windows(2) {
            let begin_m = pair[1].start_m - 0.5 * transition_m;
            let height_at_begin_m = match joints.last() {
                None => first_height_m + first_rise * begin_m,
                Some(joint) => joint.profile(begin_m, transition_m).0,
            };
            joints.push(Joint {
                begin_m,
                height_at_begin_m,
                rise_before: rise(&pair[0]),
                rise_after: rise(&pair[1]),
            });
        }
        let (sin, cos) = heading_deg.to_radians().sin_cos();
        Ok(Self {
            axis_in_world: [-sin, cos],
            cross_rise: cross_deg.to_radians().tan(),
            first_rise,
            first_height_m,
            joints: joints.into(),
            transition_m,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::{Terrain, tests::assert_normal_is_gradient};
    use proptest::prelude::*;

    fn concrete(axis_heading_deg: f64, cross_slope_deg: f64) -> RawZones {
        let zone = |start_m, slope_deg| Zone { start_m, slope_deg };
        RawZones {
            axis_heading_deg,
            cross_slope_deg,
            transition_m: 2.0,
            zones: vec![
                zone(-5.0, 0.0),
                zone(4.0, 3.6),
                zone(12.0, 5.3),
                zone(20.0, -2.0),
            ],
        }
    }

    fn terrain(raw: RawZones) -> Terrain {
        Terrain::Zones(raw.try_into().unwrap())
    }

    #[test]
    fn each_zone_has_its_slope_beyond_the_transitions() {
        let ground = terrain(concrete(0.0, 0.0));
        for (y, slope_deg) in [(0.0, 0.0), (8.0, 3.6), (16.0, 5.3), (25.0, -2.0_f64)] {
            let attitude = ground.attitude(1.0, y, 0.0).unwrap();
            assert!((attitude.pitch_rad - slope_deg.to_radians()).abs() < 1e-12);
            assert!(attitude.roll_rad.abs() < 1e-12);
        }
    }

    #[test]
    fn beyond_a_transition_the_height_is_that_of_a_sharp_kink() {
        let ground = terrain(concrete(0.0, 0.0));
        let expected = (12.0 - 4.0) * 3.6_f64.to_radians().tan() + 4.0 * 5.3_f64.to_radians().tan();
        assert!((ground.surface(0.0, 16.0).unwrap().height_m - expected).abs() < 1e-12);
        assert_eq!(ground.surface(0.0, -5.0).unwrap().height_m, 0.0);
    }

    #[test]
    fn a_cross_slope_rises_to_the_left_of_the_axis() {
        let ground = terrain(concrete(90.0, 4.0));
        // Along -X_g, so that left of the axis is -Y_g.
        let attitude = ground.attitude(0.0, 0.0, 90.0_f64.to_radians()).unwrap();
        assert!((attitude.roll_rad - 4.0_f64.to_radians()).abs() < 1e-12);
        assert!(ground.surface(0.0, -1.0).unwrap().height_m > 0.05);
    }

    #[test]
    fn overlapping_transitions_and_empty_lists_are_refused() {
        let mut raw = concrete(0.0, 0.0);
        raw.zones[2].start_m = 5.0;
        let error = ZonedTerrain::try_from(raw).unwrap_err();
        assert_eq!((error.key, error.value), ("zones.start_m", 5.0));
        let mut raw = concrete(0.0, 0.0);
        raw.zones.clear();
        assert_eq!(
            ZonedTerrain::try_from(raw).unwrap_err().key,
            "number of zones"
        );
    }

    proptest! {
        #[test]
        fn the_normal_is_the_gradient(heading in -180.0..180.0f64, cross in -10.0..10.0f64,
                                      x in -30.0..30.0f64, y in -30.0..30.0f64) {
            assert_normal_is_gradient(&terrain(concrete(heading, cross)), x, y, 1e-7);
        }

        #[test]
        fn slope_and_height_are_continuous(y in -10.0..30.0f64) {
            let ground = terrain(concrete(0.0, 0.0));
            let (a, b) = (ground.surface(0.0, y).unwrap(), ground.surface(0.0, y + 1e-7).unwrap());
            prop_assert!((a.height_m - b.height_m).abs() < 1e-7);
            prop_assert!((a.normal_in_world - b.normal_in_world).norm() < 1e-7);
        }
    }
}
