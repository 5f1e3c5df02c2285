//! A contact vehicle as it is known before it has driven: measured geometry, the rest known or guessed.

use super::friction::{Friction, FrictionField};
use super::vehicle::{Axle, CentreOfMass, ContactVehicle};
use crate::bounds::{Bounds, RangeError};
use crate::speeds::EncoderScale;
use serde::{Deserialize, Serialize};

/// Guesses for what no tape measures: tyres on firm ground, the mass low and in the middle.
mod guess {
    pub(super) const FRICTION: f64 = 0.7;
    pub(super) const LATERAL_SHARE: f64 = 1.0;
    pub(super) const SLIP_SCALE_M_S: f64 = 0.02;
    pub(super) const ROLLING_RESISTANCE: f64 = 0.02;
    /// Height of the centre of mass over the half width.
    pub(super) const HEIGHT_SHARE: f64 = 0.6;
    /// Radius of gyration of a contact patch over the half width.
    pub(super) const PATCH_SHARE: f64 = 0.15;
    /// Inertia over that of a box on the wheels.
    pub(super) const INERTIA: f64 = 1.0;
    /// Relaxation length of the tyres over the half width.
    pub(super) const RELAXATION_SHARE: f64 = 0.05;
    /// Stiffness of an inner axle over that of an outer one.
    pub(super) const INNER_STIFFNESS: f64 = 1.0;
    /// Load of an inner axle over that of an outer one.
    pub(super) const INNER_FACTOR: f64 = 1.5;
}

/// A contact vehicle of which only geometry need be given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct KnownContact {
    /// Lateral distance of the wheel contacts from the origin.
    half_width_m: f64,
    /// Axles: `forward_m` of the origin in m, and `load_share`, given for all or none.
    axles: Vec<KnownAxle>,
    /// Stiffness of the springs and tyres of an inner axle over that of an outer one: which axles take the weight that
    /// a slope or the centre of mass moves. 1 is guessed, as of equal tyres on a rigid frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    inner_stiffness: Option<f64>,
    /// Mass; the motion hardly depends on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mass_kg: Option<f64>,
    /// Centre of mass, to the right of the origin; guessed from the ICRs, otherwise 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    centre_of_mass_right_m: Option<f64>,
    /// Centre of mass, forward of the origin; guessed from the ICRs, otherwise 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    centre_of_mass_forward_m: Option<f64>,
    /// Centre of mass above the ground; 0.6 of the half width is guessed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    centre_of_mass_height_m: Option<f64>,
    /// Coefficient of friction, from 0.05 to 2; 0.7 is guessed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    friction: Option<f64>,
    /// Share of friction that acts sideways; guessed from the ICRs, otherwise 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lateral_share: Option<f64>,
    /// Slip at which friction reaches 71 % of its limit; 0.02 is guessed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    slip_scale_m_s: Option<f64>,
    /// Rolling resistance; 0.02 is guessed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rolling_resistance: Option<f64>,
    /// Radius of gyration of a contact patch; 0.15 of the half width is guessed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    patch_radius_m: Option<f64>,
    /// Yaw inertia over that of a homogeneous box on the wheels, m (w^2 + l^2) / 3 with half width and half length; 1
    /// is guessed. 0 is a vehicle that follows its treads at once, as no real one does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    inertia: Option<f64>,
    /// Distance over which the force of a tyre builds up (its relaxation length); 0.05 of the half width is guessed. 0
    /// is a wheel or track that does not give way, and goes with an `inertia` of 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    relaxation_length_m: Option<f64>,
    /// Factor c_l identified with these; that of the vehicle without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    correction_left: Option<f64>,
    /// Factor c_r identified with these.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    correction_right: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KnownAxle {
    forward_m: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    load_share: Option<f64>,
}

impl KnownContact {
    /// Returns whether anything is known that decides how it turns on level ground.
    pub(crate) fn knows_turns(&self) -> bool {
        self.centre_of_mass_right_m.is_some()
            || self.centre_of_mass_forward_m.is_some()
            || self.lateral_share.is_some()
            || self.axles.iter().any(|axle| axle.load_share.is_some())
    }

    /// Returns the vehicle with guesses for what is not given.
    ///
    /// # Errors
    /// Names the key, its value and its range.
    pub(crate) fn vehicle(&self, name: &str) -> Result<ContactVehicle, RangeError> {
        let positions: Vec<f64> = self.axles.iter().map(|axle| axle.forward_m).collect();
        let mut vehicle = ContactVehicle::of_geometry(name, self.half_width_m, &positions);
        if let Some(shares) = self
            .axles
            .iter()
            .map(|axle| axle.load_share)
            .collect::<Option<Vec<_>>>()
        {
            for (axle, share) in vehicle.axles.iter_mut().zip(shares) {
                axle.load_share = share;
            }
        }
        let put = |to: &mut f64, known: Option<f64>| *to = known.unwrap_or(*to);
        put(&mut vehicle.mass_kg, self.mass_kg);
        put(&mut vehicle.inner_stiffness, self.inner_stiffness);
        let centre = &mut vehicle.centre_of_mass;
        put(&mut centre.right_m, self.centre_of_mass_right_m);
        put(&mut centre.forward_m, self.centre_of_mass_forward_m);
        put(&mut centre.height_m, self.centre_of_mass_height_m);
        let friction = &mut vehicle.friction;
        if let Some(coefficient) = self.friction {
            friction.field = FrictionField::Uniform { coefficient };
        }
        put(&mut friction.lateral_share, self.lateral_share);
        put(&mut friction.slip_scale_m_s, self.slip_scale_m_s);
        put(&mut friction.rolling_resistance, self.rolling_resistance);
        put(&mut friction.patch_radius_m, self.patch_radius_m);
        put(&mut friction.relaxation_length_m, self.relaxation_length_m);
        let inertia = self.inertia.unwrap_or(guess::INERTIA);
        Bounds::new(0.0, 3.0, "").check("inertia", inertia)?;
        if let Some(length_m) = self.relaxation_length_m.filter(|_| inertia == 0.0) {
            Bounds::new(0.0, 0.0, "m")
                .with_note("with an inertia of 0")
                .check("relaxation_length_m", length_m)?;
        }
        // What the yaw inertia follows from is checked first, so that an error names a key that was given.
        vehicle.yaw_inertia_kg_m2 = Some(1.0);
        let mut vehicle = vehicle.validated()?;
        vehicle.set_inertia(inertia);
        vehicle.validated()
    }

    /// Returns the factors of the encoders, where any was identified with this; the other is then `own`'s.
    ///
    /// # Errors
    /// Names the key, its value and its range.
    pub(crate) fn encoder_scale(
        &self,
        own: &EncoderScale,
    ) -> Result<Option<EncoderScale>, RangeError> {
        if self.correction_left.is_none() && self.correction_right.is_none() {
            return Ok(None);
        }
        let check = |key, value: Option<f64>, own| {
            Bounds::new(0.5, 2.0, "").check(key, value.unwrap_or(own))
        };
        Ok(Some(EncoderScale {
            left: check("contact.correction_left", self.correction_left, own.left)?,
            right: check("contact.correction_right", self.correction_right, own.right)?,
        }))
    }

    /// Returns everything of a vehicle as known.
    pub(crate) fn of(vehicle: &ContactVehicle, encoder_scale: Option<EncoderScale>) -> Self {
        let centre = &vehicle.centre_of_mass;
        let friction = &vehicle.friction;
        Self {
            half_width_m: vehicle.half_width_m,
            axles: vehicle
                .axles
                .iter()
                .map(|axle| KnownAxle {
                    forward_m: axle.forward_m,
                    load_share: Some(axle.load_share),
                })
                .collect(),
            inner_stiffness: Some(vehicle.inner_stiffness),
            mass_kg: (vehicle.mass_kg != UNKNOWN_MASS_KG).then_some(vehicle.mass_kg),
            centre_of_mass_right_m: Some(centre.right_m),
            centre_of_mass_forward_m: Some(centre.forward_m),
            centre_of_mass_height_m: Some(centre.height_m),
            friction: Some(friction.field.middle()),
            lateral_share: Some(friction.lateral_share),
            slip_scale_m_s: Some(friction.slip_scale_m_s),
            rolling_resistance: Some(friction.rolling_resistance),
            patch_radius_m: Some(friction.patch_radius_m),
            inertia: Some(vehicle.inertia()),
            relaxation_length_m: Some(friction.relaxation_length_m),
            correction_left: encoder_scale.map(|scale| scale.left),
            correction_right: encoder_scale.map(|scale| scale.right),
        }
    }
}

/// Mass of a vehicle whose mass is not known, kg.
const UNKNOWN_MASS_KG: f64 = 1.0;

impl ContactVehicle {
    /// Returns a vehicle of which only geometry is known: the rest is a guess to start learning from. The mass
    /// is 1 kg, since a motion does not depend on it where the inertia is in proportion.
    pub fn of_geometry(name: &str, half_width_m: f64, axles_forward_m: &[f64]) -> Self {
        let (first, last) = axles_forward_m
            .iter()
            .fold((f64::MIN, f64::MAX), |(first, last), y| {
                (first.max(*y), last.min(*y))
            });
        let load = |y: f64| {
            if y > last && y < first {
                guess::INNER_FACTOR
            } else {
                1.0
            }
        };
        let total: f64 = axles_forward_m.iter().map(|y| load(*y)).sum();
        let mut vehicle = Self {
            name: name.to_owned(),
            mass_kg: UNKNOWN_MASS_KG,
            centre_of_mass: CentreOfMass {
                right_m: 0.0,
                forward_m: 0.0,
                height_m: guess::HEIGHT_SHARE * half_width_m,
            },
            half_width_m,
            axles: axles_forward_m
                .iter()
                .map(|&forward_m| Axle {
                    forward_m,
                    load_share: load(forward_m) / total,
                })
                .collect(),
            inner_stiffness: guess::INNER_STIFFNESS,
            friction: Friction {
                field: FrictionField::Uniform {
                    coefficient: guess::FRICTION,
                },
                lateral_share: guess::LATERAL_SHARE,
                slip_scale_m_s: guess::SLIP_SCALE_M_S,
                slip_share: 0.0,
                relaxation_length_m: guess::RELAXATION_SHARE * half_width_m,
                rolling_resistance: guess::ROLLING_RESISTANCE,
                patch_radius_m: guess::PATCH_SHARE * half_width_m,
            },
            yaw_inertia_kg_m2: None,
        };
        vehicle.set_inertia(guess::INERTIA);
        vehicle
    }

    /// Returns what a tape measures of this vehicle, the rest as a guess.
    #[must_use]
    pub fn geometry_alone(&self) -> Self {
        let positions: Vec<f64> = self.axles.iter().map(|axle| axle.forward_m).collect();
        let mut vehicle = Self {
            mass_kg: self.mass_kg,
            ..Self::of_geometry(&self.name, self.half_width_m, &positions)
        };
        vehicle.set_inertia(guess::INERTIA);
        vehicle
    }

    /// Returns a vehicle on a base rectangle, with four axles evenly spaced. With more or less of the weight on the
    /// inner two it turns as vehicles of two, three and more axles and tracks do; two axles have no such load to learn.
    pub fn of_base(name: &str, half_width_m: f64, half_length_m: f64) -> Self {
        let y = half_length_m;
        Self::of_geometry(name, half_width_m, &[y, y / 3.0, -y / 3.0, -y])
    }
}
