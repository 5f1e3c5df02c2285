//! Friction of the ground, even or in patches.

use crate::bounds::{Bounds, RangeError};
use serde::{Deserialize, Serialize};

/// Coefficient of friction over the ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum FrictionField {
    /// The same everywhere.
    Uniform {
        /// Coefficient of friction.
        coefficient: f64,
    },
    /// Smooth patches: value noise, one random value a grid node and smooth steps between.
    Patches {
        /// Smallest coefficient of friction.
        minimum: f64,
        /// Largest coefficient of friction.
        maximum: f64,
        /// Distance of the grid's nodes, m: about the size of a patch.
        cell_size_m: f64,
        /// Chooses the patches.
        seed: u64,
    },
}

impl FrictionField {
    /// Checks the ranges of all values.
    ///
    /// # Errors
    /// Returns the key, value and range that is wrong.
    pub fn check(&self) -> Result<(), RangeError> {
        let coefficient = |key, value| Bounds::new(0.05, 2.0, "").check(key, value);
        match *self {
            Self::Uniform { coefficient: mu } => coefficient("coefficient", mu).map(drop),
            Self::Patches {
                minimum,
                maximum,
                cell_size_m,
                ..
            } => {
                coefficient("minimum", minimum)?;
                coefficient("maximum", maximum)?;
                Bounds::new(minimum, 2.0, "")
                    .with_note("at least minimum")
                    .check("maximum", maximum)?;
                Bounds::new(0.1, 1000.0, "m")
                    .check("cell_size_m", cell_size_m)
                    .map(drop)
            }
        }
    }

    /// Returns the middle of the range of coefficients.
    pub fn middle(&self) -> f64 {
        match *self {
            Self::Uniform { coefficient } => coefficient,
            Self::Patches {
                minimum, maximum, ..
            } => 0.5 * (minimum + maximum),
        }
    }

    /// Returns the coefficient of friction at a place of the world.
    pub fn coefficient_at(&self, x_m: f64, y_m: f64) -> f64 {
        match *self {
            Self::Uniform { coefficient } => coefficient,
            Self::Patches {
                minimum,
                maximum,
                cell_size_m,
                seed,
            } => {
                let (x, y) = (x_m / cell_size_m, y_m / cell_size_m);
                let (column, row) = (x.floor(), y.floor());
                let (along, up) = (smooth_step(x - column), smooth_step(y - row));
                let node = |right, above| random_share(seed, column + right, row + above);
                let below = mix(node(0.0, 0.0), node(1.0, 0.0), along);
                let above = mix(node(0.0, 1.0), node(1.0, 1.0), along);
                mix(minimum, maximum, mix(below, above, up))
            }
        }
    }
}

/// How a wheel's force depends on its slip and load.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// [Coefficient of friction](#friction) over the ground; with `kind: patches` it has a `seed` too.
    pub field: FrictionField,
    /// Share of the coefficient that acts sideways; 1 is isotropic.
    pub lateral_share: f64,
    /// Slip at which the force is 71 % of its limit.
    pub slip_scale_m_s: f64,
    /// Share of the rolling speed by which the slip scale grows: the carcass of a rolling tyre yields. 0 is a rigid
    /// wheel.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub slip_share: f64,
    /// Distance over which the force of a tyre builds up (its relaxation length). 0 is at once; needs
    /// `yaw_inertia_kg_m2`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub relaxation_length_m: f64,
    /// Rolling resistance, force divided by load.
    pub rolling_resistance: f64,
    /// Radius of gyration of a contact patch: a wheel resists turning on the spot; 0 is a point.
    pub patch_radius_m: f64,
}

/// Returns whether a key with the default 0 may be left out.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn smooth_step(share: f64) -> f64 {
    share * share * (3.0 - 2.0 * share)
}

fn mix(from: f64, to: f64, share: f64) -> f64 {
    from + share * (to - from)
}

/// Returns a number from 0 to 1 that depends on the grid node and the seed alone: the SplitMix64
/// finaliser (Steele et al., "Fast splittable pseudorandom number generators", 2014) in a chain.
fn random_share(seed: u64, column: f64, row: f64) -> f64 {
    let scramble = |value: u64| {
        let value = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let value = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let value = (value ^ (value >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        value ^ (value >> 31)
    };
    let bits = scramble(scramble(scramble(seed) ^ column.to_bits()) ^ row.to_bits());
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PATCHES: FrictionField = FrictionField::Patches {
        minimum: 0.5,
        maximum: 0.9,
        cell_size_m: 2.0,
        seed: 7,
    };

    #[test]
    fn patches_fill_their_range_and_differ_by_seed() {
        let sample = |field: FrictionField| -> Vec<f64> {
            (0..10_000)
                .map(|i| field.coefficient_at(f64::from(i % 100) * 0.7, f64::from(i / 100) * 0.7))
                .collect()
        };
        let values = sample(PATCHES);
        let mean = values.iter().sum::<f64>() / 10_000.0;
        assert!((0.67..0.73).contains(&mean), "{mean}");
        assert!(values.iter().any(|mu| *mu < 0.55) && values.iter().any(|mu| *mu > 0.85));
        let other = FrictionField::Patches {
            minimum: 0.5,
            maximum: 0.9,
            cell_size_m: 2.0,
            seed: 8,
        };
        assert_ne!(values, sample(other));
    }

    proptest! {
        #[test]
        fn patches_are_smooth_and_in_range(x in -50.0..50.0f64, y in -50.0..50.0f64) {
            let mu = PATCHES.coefficient_at(x, y);
            prop_assert!((0.5..=0.9).contains(&mu));
            // A smooth step rises by at most 1.5 a cell in each direction.
            let near = PATCHES.coefficient_at(x + 1e-3, y - 1e-3);
            prop_assert!((mu - near).abs() < 2.0 * 1.5 * 0.4 / 2.0 * 1.1e-3);
        }
    }
}
