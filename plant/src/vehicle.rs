//! Parameters of a vehicle, validated once when they are read.

mod motion;
mod outline;
mod turning;

pub use motion::IcrMotion;
pub use outline::Outline;

use crate::bounds::Bounds;
pub use crate::bounds::RangeError;
use crate::contact::{CentreOfMass, ContactVehicle, KnownContact};
use crate::extension::{Extension, ExtensionGains, RawExtension};
use crate::frames::{Attitude, BodyVelocity};
pub use crate::icr_parameters::{HorizontalIcrs, SlideGains};
pub use crate::speeds::EncoderScale as SpeedCorrection;
use crate::speeds::{EncoderScale, TreadSpeeds};
use serde::{Deserialize, Serialize};

/// A skid-steer vehicle as the ICR models know it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawVehicle", into = "RawVehicle")]
pub struct Vehicle {
    /// Name for tables and plots.
    pub name: String,
    /// ICRs on level ground.
    pub icrs: HorizontalIcrs,
    /// Slide gains; both zero makes ICRIK equal ICRHK.
    pub slide: SlideGains,
    /// v_y^m, m/s: largest longitudinal speed for which the model was identified.
    pub speed_max_m_s: f64,
    /// x_m, m: half width of the base rectangle.
    pub base_half_width_m: f64,
    /// y_m, m: half length of the base rectangle.
    pub base_half_length_m: f64,
    /// c_l and c_r of equation (11); keys `correction_left` and `correction_right` of its file.
    pub encoder_scale: EncoderScale,
    /// Terms beyond ICRIK and the parameters identified with them; none is ICRIK alone.
    pub extension: Option<Extension>,
    /// Where its mass is with what it carries, as the steepness guard knows it; none is that of `contact`.
    pub centre_of_mass: Option<CentreOfMass>,
    /// What is known of it as a vehicle on wheels with friction: where `contact-mpc` starts from.
    pub contact: Option<ContactVehicle>,
    /// c_l and c_r identified with `contact`; without them those above hold for it.
    pub contact_encoder_scale: Option<EncoderScale>,
}

impl Vehicle {
    /// Returns the vehicle with the parameters of its extended model in place of its own, the terms
    /// among them; a vehicle without an extension as it is.
    pub fn extended(&self) -> Self {
        let mut vehicle = self.clone();
        if let Some(extension) = &self.extension {
            vehicle.icrs = extension.icrs;
            vehicle.slide = extension.slide;
            vehicle.encoder_scale = extension.encoder_scale;
        }
        vehicle
    }

    /// Returns the vehicle with the factors of the encoders that hold for it as a vehicle on wheels.
    pub fn on_wheels(&self) -> Self {
        Self {
            encoder_scale: self.contact_encoder_scale.unwrap_or(self.encoder_scale),
            ..self.clone()
        }
    }

    /// Returns the gains of the terms beyond ICRIK; zeros without an extension.
    pub fn extension_gains(&self) -> ExtensionGains {
        self.extension
            .map_or_else(ExtensionGains::default, |e| e.gains)
    }

    /// Returns the body velocity of ICRIK with this vehicle's own parameters, and of the terms of its
    /// extension. For the extended model call it on [`Vehicle::extended`].
    pub fn extended_velocity(&self, attitude: Attitude, treads: TreadSpeeds) -> BodyVelocity {
        let icrik = self.body_velocity(attitude, treads);
        match &self.extension {
            Some(extension) => extension.gains.extend(icrik, attitude, treads),
            None => icrik,
        }
    }

    /// Returns the parameters of the paper's models as those of an extension without terms.
    fn own_parameters(&self) -> Extension {
        Extension {
            gains: ExtensionGains::default(),
            icrs: self.icrs,
            slide: self.slide,
            encoder_scale: self.encoder_scale,
        }
    }
}

impl Vehicle {
    /// Returns the Argo J8 of the paper's Table I, a rover of about one tonne with eight wheels, on
    /// smooth concrete.
    pub fn j8() -> Self {
        Self {
            name: "j8".to_owned(),
            icrs: HorizontalIcrs {
                left_m: -0.980,
                right_m: 1.073,
                forward_m: 0.206,
            },
            slide: SlideGains {
                shift_s_per_rad: 1.222,
                aggravated_s_per_rad: 4.965,
            },
            speed_max_m_s: 1.0,
            base_half_width_m: 0.6,
            base_half_length_m: 1.06,
            encoder_scale: EncoderScale {
                left: 1.004,
                right: 1.011,
            },
            extension: None,
            centre_of_mass: None,
            contact: None,
            contact_encoder_scale: None,
        }
    }

    /// Returns the vehicle on wheels with friction: as known, or as guessed from the base rectangle and the ICRs.
    pub fn contact_vehicle(&self) -> ContactVehicle {
        self.contact.clone().unwrap_or_else(|| {
            ContactVehicle::of_base(&self.name, self.base_half_width_m, self.base_half_length_m)
                .turning_as(self)
        })
    }

    /// Returns the same vehicle without slide and without an extension: ICRIK then equals ICRHK.
    pub fn on_level_ground(&self) -> Self {
        Self {
            extension: None,
            slide: SlideGains {
                shift_s_per_rad: 0.0,
                aggravated_s_per_rad: 0.0,
            },
            ..self.clone()
        }
    }

    /// Returns an ideal differential drive with its wheels on the base rectangle's sides.
    pub fn as_differential_drive(&self) -> Self {
        Self {
            icrs: HorizontalIcrs {
                left_m: -self.base_half_width_m,
                right_m: self.base_half_width_m,
                forward_m: 0.0,
            },
            ..self.on_level_ground()
        }
    }
}

impl Vehicle {
    /// Returns the vehicle if all its parameters are in range.
    ///
    /// # Errors
    /// Names the key, its value and its range.
    pub fn validated(self) -> Result<Self, RangeError> {
        Self::try_from(RawVehicle::from(self))
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawVehicle {
    /// Name for tables and plots.
    name: String,
    /// Left tread ICR on level ground, to the right of the origin, so negative.
    x_icr_left_m: f64,
    /// Right tread ICR on level ground, to the right of the origin.
    x_icr_right_m: f64,
    /// Both tread ICRs, forward of the origin.
    y_icr_m: f64,
    /// Slide gain of equations (9) and (10).
    lambda_1_s_per_rad: f64,
    /// Additional slide gain of one tread when the vehicle points mostly up or down.
    lambda_2_s_per_rad: f64,
    /// Largest longitudinal speed of the identification, v_y^m.
    speed_max_m_s: f64,
    /// Half the width of the rectangle of wheel contacts, x_m. It limits the ICRs.
    base_half_width_m: f64,
    /// Half its length, y_m.
    base_half_length_m: f64,
    /// Factor c_l from motor-side to effective speed of the left tread, equation (11).
    correction_left: f64,
    /// Factor c_r of the right tread.
    correction_right: f64,
    /// [Terms beyond ICRIK](#extension) and the parameters identified with them. None: ICRIK.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    extension: Option<RawExtension>,
    /// [Where the mass is](#centre-of-mass), with what the vehicle carries, for the steepness guard. Without it, that
    /// of `contact`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    centre_of_mass: Option<CentreOfMass>,
    /// [Known parameters of its wheels](#known-contact-vehicle): where `contact-mpc` starts from. Without it, four
    /// axles evenly spaced along the base rectangle. Give the positions of the axles where the vehicle has others:
    /// `half_width_m` and `axles` are enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    contact: Option<KnownContact>,
}

impl TryFrom<RawVehicle> for Vehicle {
    type Error = RangeError;

    fn try_from(raw: RawVehicle) -> Result<Self, RangeError> {
        let half_width =
            Bounds::new(0.01, 20.0, "m").check("base_half_width_m", raw.base_half_width_m)?;
        let half_length =
            Bounds::new(0.01, 20.0, "m").check("base_half_length_m", raw.base_half_length_m)?;
        let own_scale = EncoderScale {
            left: Bounds::new(0.5, 2.0, "").check("correction_left", raw.correction_left)?,
            right: Bounds::new(0.5, 2.0, "").check("correction_right", raw.correction_right)?,
        };
        let known = raw.contact.as_ref();
        let contact = known.map(|known| known.vehicle(&raw.name)).transpose()?;
        let contact_encoder_scale = known
            .and_then(|known| known.encoder_scale(&own_scale).transpose())
            .transpose()?;
        if let Some(centre) = &raw.centre_of_mass {
            centre.validate()?;
        }
        let mut vehicle = Self {
            name: raw.name,
            centre_of_mass: raw.centre_of_mass,
            contact,
            contact_encoder_scale,
            icrs: HorizontalIcrs {
                left_m: Bounds::new(-50.0, -half_width, "m")
                    .with_note("at most -base_half_width_m")
                    .check("x_icr_left_m", raw.x_icr_left_m)?,
                right_m: Bounds::new(half_width, 50.0, "m")
                    .with_note("at least base_half_width_m")
                    .check("x_icr_right_m", raw.x_icr_right_m)?,
                forward_m: Bounds::new(-half_length, half_length, "m")
                    .with_note("within base_half_length_m")
                    .check("y_icr_m", raw.y_icr_m)?,
            },
            slide: SlideGains {
                shift_s_per_rad: Bounds::new(0.0, 100.0, "s/rad")
                    .check("lambda_1_s_per_rad", raw.lambda_1_s_per_rad)?,
                aggravated_s_per_rad: Bounds::new(0.0, 100.0, "s/rad")
                    .check("lambda_2_s_per_rad", raw.lambda_2_s_per_rad)?,
            },
            speed_max_m_s: Bounds::new(0.01, 20.0, "m/s")
                .check("speed_max_m_s", raw.speed_max_m_s)?,
            base_half_width_m: half_width,
            base_half_length_m: half_length,
            encoder_scale: own_scale,
            extension: None,
        };
        // Where nothing is known of loads and lateral grip, the ICRs tell.
        if known.is_some_and(|known| !known.knows_turns()) {
            let contact = vehicle.contact.take();
            vehicle.contact = contact.map(|contact| contact.turning_as(&vehicle));
        }
        let half_base_m = (vehicle.base_half_width_m, vehicle.base_half_length_m);
        let extension = raw
            .extension
            .map(|raw| raw.checked(&vehicle.own_parameters(), half_base_m))
            .transpose()?;
        vehicle.extension = extension;
        Ok(vehicle)
    }
}

impl From<Vehicle> for RawVehicle {
    fn from(v: Vehicle) -> Self {
        Self {
            name: v.name,
            x_icr_left_m: v.icrs.left_m,
            x_icr_right_m: v.icrs.right_m,
            y_icr_m: v.icrs.forward_m,
            lambda_1_s_per_rad: v.slide.shift_s_per_rad,
            lambda_2_s_per_rad: v.slide.aggravated_s_per_rad,
            speed_max_m_s: v.speed_max_m_s,
            base_half_width_m: v.base_half_width_m,
            base_half_length_m: v.base_half_length_m,
            correction_left: v.encoder_scale.left,
            correction_right: v.encoder_scale.right,
            extension: v.extension.map(RawExtension::from),
            centre_of_mass: v.centre_of_mass,
            contact: v
                .contact
                .as_ref()
                .map(|contact| KnownContact::of(contact, v.contact_encoder_scale)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_j8_of_the_file_is_that_of_the_paper() {
        let file = include_str!("../../config/vehicles/j8.yaml");
        assert_eq!(
            serde_yaml::from_str::<Vehicle>(file).unwrap(),
            Vehicle::j8()
        );
    }

    #[test]
    fn icrs_tell_the_loads_of_known_wheels_unless_these_are_known_too() {
        let j8 = include_str!("../../config/vehicles/j8.yaml");
        let of = |known: &str| {
            let contact = format!(
                "contact: {{half_width_m: 0.6, axles: [{{forward_m: 1}}, {{forward_m: -1}}]{known}}}"
            );
            serde_yaml::from_str::<Vehicle>(&format!("{j8}\n{contact}\n")).unwrap()
        };
        let told = of(", friction: 0.5");
        assert!(told.contact_vehicle().centre_of_mass.forward_m > 0.05);
        assert_eq!(told.contact_vehicle().friction.field.middle(), 0.5);
        for known in [", centre_of_mass_forward_m: 0", ", lateral_share: 0.9"] {
            assert_eq!(of(known).contact_vehicle().centre_of_mass.forward_m, 0.0);
        }
        // Writing and reading it changes nothing.
        let text = serde_yaml::to_string(&told).unwrap();
        assert_eq!(serde_yaml::from_str::<Vehicle>(&text).unwrap(), told);
        let base = Vehicle::j8().contact_vehicle();
        assert!(base.centre_of_mass.forward_m > 0.05 && base.inner_share() > 0.6);
    }
}
