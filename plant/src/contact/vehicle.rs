//! A vehicle as wheel-ground contact knows it.

use super::friction::Friction;
use crate::bounds::{Bounds, RangeError};
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

/// One axle: a wheel on each side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axle {
    /// Wheel contacts forward of the origin.
    pub forward_m: f64,
    /// Share of the weight on level ground with the centre of mass above the origin. All axles together carry 1.
    pub load_share: f64,
}

/// Where the mass is, in the body frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CentreOfMass {
    /// To the right of the origin.
    pub right_m: f64,
    /// Ahead of the origin.
    pub forward_m: f64,
    /// Above the ground.
    pub height_m: f64,
}

impl CentreOfMass {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub(crate) fn validate(&self) -> Result<(), RangeError> {
        let length = Bounds::new(-10.0, 10.0, "m");
        length.check("centre_of_mass.right_m", self.right_m)?;
        length.check("centre_of_mass.forward_m", self.forward_m)?;
        Bounds::new(0.0, 10.0, "m").check("centre_of_mass.height_m", self.height_m)?;
        Ok(())
    }
}

/// A skid-steer vehicle for [`ContactModel`](super::ContactModel).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawContactVehicle", into = "RawContactVehicle")]
pub struct ContactVehicle {
    /// Name for tables and plots.
    pub name: String,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Where the mass is.
    pub centre_of_mass: CentreOfMass,
    /// Lateral distance of the wheel contacts from the origin, m.
    pub half_width_m: f64,
    /// Axles, in any order.
    pub axles: Vec<Axle>,
    /// Stiffness of an inner axle's springs and tyres over that of an outer one: how weight that moves is shared.
    pub inner_stiffness: f64,
    /// Wheel-ground friction.
    pub friction: Friction,
    /// Yaw inertia about the centre of mass, kg m^2; without it the motion is quasi-static.
    pub yaw_inertia_kg_m2: Option<f64>,
}

/// Returns the squared radius of gyration, m^2, of a homogeneous box about its vertical axis.
pub(super) fn box_gyration_squared_m2(half_width_m: f64, half_length_m: f64) -> f64 {
    (half_width_m.powi(2) + half_length_m.powi(2)) / 3.0
}

/// A wheel's contact with the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wheel {
    pub(super) position: Vector2<f64>,
    pub(super) load_share: f64,
    /// Over that of the outer axles' wheels.
    pub(super) stiffness: f64,
}

impl ContactVehicle {
    /// Returns the vehicle if all its parameters are in range.
    ///
    /// # Errors
    /// Names the key, its value and its range.
    pub fn validated(self) -> Result<Self, RangeError> {
        Self::try_from(RawContactVehicle::from(self))
    }

    /// Returns the distance of the outermost wheel contacts from the origin along the body, m.
    pub fn half_length_m(&self) -> f64 {
        let lengths = self.axles.iter().map(|axle| axle.forward_m.abs());
        lengths.fold(0.0, f64::max)
    }

    /// Returns the yaw inertia over that of a homogeneous box on the wheels; 0 of a quasi-static vehicle.
    pub fn inertia(&self) -> f64 {
        let of_box = self.yaw_inertia_of_box_kg_m2();
        self.yaw_inertia_kg_m2
            .map_or(0.0, |inertia| inertia / of_box)
    }

    /// Sets the yaw inertia to so much of that of a homogeneous box on the wheels; with 0 the motion is quasi-static, and
    /// tyres do not relax.
    pub fn set_inertia(&mut self, inertia: f64) {
        let of_box = self.yaw_inertia_of_box_kg_m2();
        self.yaw_inertia_kg_m2 = (inertia > 0.0).then_some(inertia * of_box);
        if self.yaw_inertia_kg_m2.is_none() {
            self.friction.relaxation_length_m = 0.0;
        }
    }

    fn yaw_inertia_of_box_kg_m2(&self) -> f64 {
        self.mass_kg * box_gyration_squared_m2(self.half_width_m, self.half_length_m())
    }

    /// Returns whether an axle is an inner one: neither the first nor the last along the body.
    pub(super) fn is_inner(&self, axle: &Axle) -> bool {
        let positions = || self.axles.iter().map(|axle| axle.forward_m);
        let first = positions().fold(f64::NEG_INFINITY, f64::max);
        let last = positions().fold(f64::INFINITY, f64::min);
        axle.forward_m > last && axle.forward_m < first
    }

    /// Returns whether it has inner axles, whose share of the weight can vary.
    pub(crate) fn has_inner_axles(&self) -> bool {
        self.axles.iter().any(|axle| self.is_inner(axle))
    }

    /// Returns the share of the weight on the inner axles, 0 without any.
    pub fn inner_share(&self) -> f64 {
        let inner = self.axles.iter().filter(|axle| self.is_inner(axle));
        inner.map(|axle| axle.load_share).sum()
    }

    /// Moves weight between inner and outer axles, each keeping its part of its group; without inner
    /// axles nothing changes.
    pub(super) fn set_inner_share(&mut self, share: f64) {
        let before = self.inner_share();
        if !self.has_inner_axles() {
            return;
        }
        let inner: Vec<bool> = self.axles.iter().map(|axle| self.is_inner(axle)).collect();
        for group in [true, false] {
            let (target, carried) = if group {
                (share, before)
            } else {
                (1.0 - share, 1.0 - before)
            };
            let count = inner.iter().filter(|is| **is == group).count() as f64;
            for (axle, _) in self
                .axles
                .iter_mut()
                .zip(&inner)
                .filter(|(_, is)| **is == group)
            {
                axle.load_share = if carried > 1e-6 {
                    axle.load_share * target / carried
                } else {
                    target / count
                };
            }
        }
    }

    /// Returns the wheels, the left ones first.
    pub(super) fn wheels(&self) -> Vec<Wheel> {
        let side = |right_m: f64| {
            self.axles.iter().map(move |axle| Wheel {
                position: Vector2::new(right_m, axle.forward_m),
                load_share: 0.5 * axle.load_share,
                stiffness: if self.is_inner(axle) {
                    self.inner_stiffness
                } else {
                    1.0
                },
            })
        };
        side(-self.half_width_m)
            .chain(side(self.half_width_m))
            .collect()
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawContactVehicle {
    /// Name for tables and plots.
    name: String,
    /// Mass.
    mass_kg: f64,
    /// Centre of mass, to the right of the origin.
    centre_of_mass_right_m: f64,
    /// Centre of mass, forward of the origin.
    centre_of_mass_forward_m: f64,
    /// Centre of mass above the ground.
    centre_of_mass_height_m: f64,
    /// Lateral distance of the wheel contacts from the origin.
    half_width_m: f64,
    /// [Axles](#axle), in any order.
    axles: Vec<Axle>,
    /// Stiffness of the springs and tyres of an inner axle over that of an outer one.
    #[serde(default = "as_stiff", skip_serializing_if = "is_as_stiff")]
    inner_stiffness: f64,
    /// [Wheel-ground friction](#wheel-friction).
    friction: Friction,
    /// Yaw inertia about the centre of mass. Without it the motion is quasi-static.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    yaw_inertia_kg_m2: Option<f64>,
}

/// Stiffness of inner axles that are as stiff as the outer ones.
fn as_stiff() -> f64 {
    1.0
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde passes a reference"
)]
fn is_as_stiff(stiffness: &f64) -> bool {
    *stiffness == as_stiff()
}

impl TryFrom<RawContactVehicle> for ContactVehicle {
    type Error = RangeError;

    fn try_from(raw: RawContactVehicle) -> Result<Self, RangeError> {
        Bounds::new(0.01, 20.0, "m").check("half_width_m", raw.half_width_m)?;
        let length = |key, value| Bounds::new(-10.0, 10.0, "m").check(key, value);
        Bounds::new(2.0, 16.0, "axles").check("axles", raw.axles.len() as f64)?;
        for axle in &raw.axles {
            length("forward_m", axle.forward_m)?;
            Bounds::new(0.0, 1.0, "").check("load_share", axle.load_share)?;
        }
        let shares: f64 = raw.axles.iter().map(|axle| axle.load_share).sum();
        Bounds::new(0.999, 1.001, "")
            .with_note("all axles together carry 1")
            .check("load_share", shares)?;
        raw.friction.field.check()?;
        Bounds::new(0.1, 2.0, "").check("lateral_share", raw.friction.lateral_share)?;
        Bounds::new(1e-4, 1.0, "m/s").check("slip_scale_m_s", raw.friction.slip_scale_m_s)?;
        Bounds::new(0.0, 1.0, "").check("slip_share", raw.friction.slip_share)?;
        Bounds::new(0.0, 0.5, "").check("rolling_resistance", raw.friction.rolling_resistance)?;
        Bounds::new(0.0, 1.0, "m").check("patch_radius_m", raw.friction.patch_radius_m)?;
        let yaw_inertia_kg_m2 = raw
            .yaw_inertia_kg_m2
            .map(|value| Bounds::new(1e-9, 1e9, "kg m^2").check("yaw_inertia_kg_m2", value))
            .transpose()?;
        let relaxation = if yaw_inertia_kg_m2.is_some() {
            Bounds::new(0.0, 5.0, "m")
        } else {
            Bounds::new(0.0, 0.0, "m").with_note("without yaw_inertia_kg_m2")
        };
        relaxation.check("relaxation_length_m", raw.friction.relaxation_length_m)?;
        Ok(Self {
            name: raw.name,
            mass_kg: Bounds::new(0.1, 1e5, "kg").check("mass_kg", raw.mass_kg)?,
            centre_of_mass: CentreOfMass {
                right_m: length("centre_of_mass_right_m", raw.centre_of_mass_right_m)?,
                forward_m: length("centre_of_mass_forward_m", raw.centre_of_mass_forward_m)?,
                height_m: Bounds::new(0.0, 10.0, "m")
                    .check("centre_of_mass_height_m", raw.centre_of_mass_height_m)?,
            },
            half_width_m: raw.half_width_m,
            axles: raw.axles,
            inner_stiffness: Bounds::new(0.05, 20.0, "")
                .check("inner_stiffness", raw.inner_stiffness)?,
            friction: raw.friction,
            yaw_inertia_kg_m2,
        })
    }
}

impl From<ContactVehicle> for RawContactVehicle {
    fn from(vehicle: ContactVehicle) -> Self {
        Self {
            name: vehicle.name,
            mass_kg: vehicle.mass_kg,
            centre_of_mass_right_m: vehicle.centre_of_mass.right_m,
            centre_of_mass_forward_m: vehicle.centre_of_mass.forward_m,
            centre_of_mass_height_m: vehicle.centre_of_mass.height_m,
            half_width_m: vehicle.half_width_m,
            axles: vehicle.axles,
            inner_stiffness: vehicle.inner_stiffness,
            friction: vehicle.friction,
            yaw_inertia_kg_m2: vehicle.yaw_inertia_kg_m2,
        }
    }
}
