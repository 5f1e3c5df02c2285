//! The plant of a simulation, friction of the ground, and errors of the controllers' model.

use super::variation::VehicleVariation;
use serde::Deserialize;
use sidehill_plant::bounds::RangeError;
use sidehill_plant::contact::{ContactModel, ContactVehicle, FrictionField, Parameter};
use sidehill_plant::motion::Motion;
use sidehill_plant::speeds::EncoderScale;
use sidehill_plant::vehicle::IcrMotion;
use sidehill_plant::vehicle::{HorizontalIcrs, SlideGains, Vehicle};
use std::path::PathBuf;

/// What moves the simulated vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum PlantKind {
    /// The exact ICRIK model.
    Icrik,
    /// Wheels with friction on the ground.
    Contact,
}

impl PlantKind {
    /// Returns the name used on command lines and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Icrik => "icrik",
            Self::Contact => "contact",
        }
    }
}

/// What moves the vehicle, with its parameters.
#[derive(Debug, Clone)]
pub enum Plant {
    /// The exact ICRIK model of a vehicle.
    Icrik(Box<Vehicle>),
    /// Wheels with friction on the ground.
    Contact {
        /// The vehicle on wheels.
        vehicle: Box<ContactVehicle>,
        /// Its true c_l and c_r: those of the scenario's vehicle.
        encoder_scale: EncoderScale,
    },
}

impl Plant {
    /// Returns which kind it is.
    pub fn kind(&self) -> PlantKind {
        match self {
            Self::Icrik(_) => PlantKind::Icrik,
            Self::Contact { .. } => PlantKind::Contact,
        }
    }

    /// Returns its true c_l and c_r.
    pub fn encoder_scale(&self) -> EncoderScale {
        match self {
            Self::Icrik(vehicle) => vehicle.encoder_scale,
            Self::Contact { encoder_scale, .. } => *encoder_scale,
        }
    }

    /// Returns the mean coefficient of friction of the ground, where the plant has one.
    pub fn friction(&self) -> Option<f64> {
        match self {
            Self::Icrik(_) => None,
            Self::Contact { vehicle, .. } => Some(vehicle.friction.field.middle()),
        }
    }

    pub(super) fn motion(&self) -> Box<dyn Motion> {
        match self {
            Self::Icrik(vehicle) => Box::new(IcrMotion {
                vehicle: (**vehicle).clone(),
                inclined: true,
            }),
            Self::Contact { vehicle, .. } => Box::new(ContactModel::new((**vehicle).clone())),
        }
    }
}

/// Friction of the ground, instead of that in the contact vehicle's file.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum GroundFriction {
    /// The same everywhere.
    Uniform {
        /// Coefficient of friction.
        coefficient: f64,
    },
    /// Smooth patches, chosen by the run's seed.
    Patches {
        /// Smallest coefficient of friction.
        minimum: f64,
        /// Largest coefficient of friction.
        maximum: f64,
        /// About the size of a patch.
        cell_size_m: f64,
    },
}

impl GroundFriction {
    pub(super) fn field(&self, seed: u64) -> FrictionField {
        match *self {
            Self::Uniform { coefficient } => FrictionField::Uniform { coefficient },
            Self::Patches {
                minimum,
                maximum,
                cell_size_m,
            } => FrictionField::Patches {
                minimum,
                maximum,
                cell_size_m,
                seed,
            },
        }
    }

    /// Checks the ranges of all values.
    ///
    /// # Errors
    /// Names the key, value and range that is wrong.
    pub fn check(&self) -> Result<(), RangeError> {
        self.field(0).check()
    }
}

/// Errors of the parameters that controllers use: factors, 1 by default, and offsets, 0 by default.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ModelError {
    /// Factor on `x_icr_left_m`.
    x_icr_left: f64,
    /// Factor on `x_icr_right_m`.
    x_icr_right: f64,
    /// Factor on `y_icr_m`.
    y_icr: f64,
    /// Factor on `lambda_1_s_per_rad`.
    lambda_1: f64,
    /// Factor on `lambda_2_s_per_rad`.
    lambda_2: f64,
    /// Factor on `correction_left`.
    correction_left: f64,
    /// Factor on `correction_right`.
    correction_right: f64,
    /// Factor on the friction of the [contact vehicle](#vehicle) that controllers know.
    friction: f64,
    /// Factor on its lateral share.
    lateral_share: f64,
    /// Factor on its slip scale.
    slip_scale: f64,
    /// Factor on its rolling resistance.
    rolling_resistance: f64,
    /// Added to the lateral position of its centre of mass.
    centre_of_mass_right_m: f64,
    /// Added to the longitudinal position of its centre of mass.
    centre_of_mass_forward_m: f64,
    /// Added to the height of its centre of mass.
    centre_of_mass_height_m: f64,
    /// Added to its share of the weight on the inner axles.
    inner_load_share: f64,
}

impl Default for ModelError {
    fn default() -> Self {
        Self {
            x_icr_left: 1.0,
            x_icr_right: 1.0,
            y_icr: 1.0,
            lambda_1: 1.0,
            lambda_2: 1.0,
            correction_left: 1.0,
            correction_right: 1.0,
            friction: 1.0,
            lateral_share: 1.0,
            slip_scale: 1.0,
            rolling_resistance: 1.0,
            centre_of_mass_right_m: 0.0,
            centre_of_mass_forward_m: 0.0,
            centre_of_mass_height_m: 0.0,
            inner_load_share: 0.0,
        }
    }
}

impl ModelError {
    /// Returns the vehicle that controllers assume instead of `vehicle`, with wheels at the places of `wheels` where
    /// its own are not known.
    pub(super) fn apply(
        &self,
        mut vehicle: Vehicle,
        wheels: Option<&ContactVehicle>,
    ) -> Result<Vehicle, RangeError> {
        self.scale(
            &mut vehicle.icrs,
            &mut vehicle.slide,
            &mut vehicle.encoder_scale,
        );
        if let Some(extension) = &mut vehicle.extension {
            self.scale(
                &mut extension.icrs,
                &mut extension.slide,
                &mut extension.encoder_scale,
            );
        }
        if let Some(scale) = &mut vehicle.contact_encoder_scale {
            scale.left *= self.correction_left;
            scale.right *= self.correction_right;
        }
        if vehicle.contact.is_none() {
            vehicle.contact = wheels.map(|wheels| wheels.geometry_alone().turning_as(&vehicle));
        }
        if let Some(contact) = &vehicle.contact {
            vehicle.contact = Some(self.apply_to_contact(contact)?);
        }
        vehicle.validated()
    }

    fn scale(
        &self,
        icrs: &mut HorizontalIcrs,
        slide: &mut SlideGains,
        encoder_scale: &mut EncoderScale,
    ) {
        icrs.left_m *= self.x_icr_left;
        icrs.right_m *= self.x_icr_right;
        icrs.forward_m *= self.y_icr;
        slide.shift_s_per_rad *= self.lambda_1;
        slide.aggravated_s_per_rad *= self.lambda_2;
        encoder_scale.left *= self.correction_left;
        encoder_scale.right *= self.correction_right;
    }

    fn apply_to_contact(&self, contact: &ContactVehicle) -> Result<ContactVehicle, RangeError> {
        let mut parameters = contact.parameters();
        for (parameter, factor) in [
            (Parameter::Friction, self.friction),
            (Parameter::LateralShare, self.lateral_share),
            (Parameter::SlipScale, self.slip_scale),
            (Parameter::RollingResistance, self.rolling_resistance),
        ] {
            let entry = &mut parameters[parameter.index()];
            *entry = parameter.entry(factor * parameter.value(*entry));
        }
        for (parameter, offset) in [
            (Parameter::CentreRight, self.centre_of_mass_right_m),
            (Parameter::CentreForward, self.centre_of_mass_forward_m),
            (Parameter::CentreHeight, self.centre_of_mass_height_m),
            (Parameter::InnerShare, self.inner_load_share),
        ] {
            parameters[parameter.index()] += offset;
        }
        contact.with_parameters(&parameters).validated()
    }
}

/// Files of the contact plant, relative to the scenario.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ContactFiles {
    /// [Contact vehicle](#contact-vehicle) file: what moves.
    pub(super) vehicle: PathBuf,
    /// [Vehicle](#vehicle) file: what identification found of it, for the controllers.
    pub(super) identified: PathBuf,
    /// [How the vehicle differs from its file](#variation).
    #[serde(default)]
    pub(super) variation: VehicleVariation,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wheels_that_are_guessed_from_icrs_have_the_errors_of_these() {
        let wheels = ContactVehicle::of_base("wheels", 0.6, 1.06);
        let forward_m = |errors: &str| {
            let errors: ModelError = serde_yaml::from_str(errors).unwrap();
            let known = errors.apply(Vehicle::j8(), Some(&wheels)).unwrap();
            known.contact.unwrap().centre_of_mass.forward_m
        };
        let right_m = forward_m("{}");
        assert!(right_m > 0.05);
        assert!(forward_m("{y_icr: 0.5}") < 0.6 * right_m);
        let moved_m = forward_m("{centre_of_mass_forward_m: 0.1}");
        assert!((moved_m - right_m - 0.1).abs() < 1e-12);
    }
}
