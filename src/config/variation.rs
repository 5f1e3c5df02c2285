//! Variations of a contact vehicle from its file.

use serde::Deserialize;
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::contact::{ContactVehicle, FrictionField, Parameter};
use sidehill_plant::vehicle::Vehicle;

/// Variation of a contact vehicle's file, for a family of vehicles. Shares refer to the half width (right, height)
/// or the half length (forward), scaled by `size`. Controllers know `size` only.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct VehicleVariation {
    /// Factor on all lengths; the mass grows with its cube.
    size: f64,
    /// Further factor on the mass.
    density: f64,
    /// Load of the inner axles: 0 for equal loads of all axles, 1 for 90 % of the weight.
    inner_load: Option<f64>,
    /// Stiffness of an inner axle over that of an outer one.
    inner_stiffness: Option<f64>,
    /// Centre of mass to the right, over the half width.
    centre_of_mass_right_share: Option<f64>,
    /// Centre of mass forward, over the half length.
    centre_of_mass_forward_share: Option<f64>,
    /// Height of the centre of mass, over the half width.
    centre_of_mass_height_share: Option<f64>,
    /// Share of friction that acts sideways.
    lateral_share: Option<f64>,
    /// Slip at which friction reaches 71 % of its limit.
    slip_scale_m_s: Option<f64>,
    /// Growth of the slip scale with speed.
    slip_share: Option<f64>,
    /// Rolling resistance.
    rolling_resistance: Option<f64>,
    /// Radius of gyration of a contact patch, over the half width; 0 is a point.
    patch_radius_share: Option<f64>,
    /// Relaxation length of the tyres over the half width; 0 where the vehicle moves without inertia.
    relaxation_length_share: Option<f64>,
    /// Yaw inertia over that of a homogeneous box on the wheels; 0 moves without inertia.
    inertia: Option<f64>,
}

impl Default for VehicleVariation {
    fn default() -> Self {
        Self {
            size: 1.0,
            density: 1.0,
            inner_load: None,
            inner_stiffness: None,
            centre_of_mass_right_share: None,
            centre_of_mass_forward_share: None,
            centre_of_mass_height_share: None,
            lateral_share: None,
            slip_scale_m_s: None,
            slip_share: None,
            rolling_resistance: None,
            patch_radius_share: None,
            relaxation_length_share: None,
            inertia: None,
        }
    }
}

/// Load of the inner axles at `inner_load` 1.
const INNER_LOAD_MAX: f64 = 0.9;

impl VehicleVariation {
    /// Returns the vehicle that moves.
    pub(super) fn of_truth(&self, file: &ContactVehicle) -> Result<ContactVehicle, RangeError> {
        Bounds::new(0.1, 10.0, "").check("size", self.size)?;
        Bounds::new(0.01, 100.0, "").check("density", self.density)?;
        let mut vehicle = file.clone();
        let size = self.size;
        vehicle.half_width_m *= size;
        for axle in &mut vehicle.axles {
            axle.forward_m *= size;
        }
        let centre = &mut vehicle.centre_of_mass;
        centre.right_m *= size;
        centre.forward_m *= size;
        centre.height_m *= size;
        vehicle.friction.patch_radius_m *= size;
        vehicle.mass_kg *= self.density * size.powi(3);
        let (half_width_m, half_length_m) = (vehicle.half_width_m, vehicle.half_length_m());
        for (key, value) in [
            ("inner_stiffness", self.inner_stiffness),
            ("lateral_share", self.lateral_share),
            ("slip_scale_m_s", self.slip_scale_m_s),
        ] {
            // The parameters are logarithms of these.
            value.map_or(Ok(0.0), |value| Bounds::positive("").check(key, value))?;
        }
        let mut parameters = vehicle.parameters();
        for (parameter, value) in [
            (
                Parameter::CentreRight,
                scaled(self.centre_of_mass_right_share, half_width_m),
            ),
            (
                Parameter::CentreForward,
                scaled(self.centre_of_mass_forward_share, half_length_m),
            ),
            (
                Parameter::CentreHeight,
                scaled(self.centre_of_mass_height_share, half_width_m),
            ),
            (Parameter::InnerShare, self.inner_share(&vehicle)?),
            (Parameter::InnerStiffness, self.inner_stiffness),
            (Parameter::LateralShare, self.lateral_share),
            (Parameter::SlipScale, self.slip_scale_m_s),
            (Parameter::RollingResistance, self.rolling_resistance),
        ] {
            if let Some(value) = value {
                parameters[parameter.index()] = parameter.entry(value);
            }
        }
        let field: FrictionField = vehicle.friction.field;
        vehicle = vehicle.with_parameters(&parameters);
        vehicle.friction.field = field;
        if let Some(share) = self.slip_share {
            vehicle.friction.slip_share = share;
        }
        if let Some(share) = self.patch_radius_share {
            Bounds::new(0.0, 1.0, "").check("patch_radius_share", share)?;
            vehicle.friction.patch_radius_m = share * half_width_m;
        }
        if let Some(factor) = self.inertia {
            Bounds::new(0.0, 10.0, "").check("inertia", factor)?;
            vehicle.set_inertia(factor);
        }
        if let Some(share) = self.relaxation_length_share {
            Bounds::new(0.0, 5.0, "").check("relaxation_length_share", share)?;
            if vehicle.yaw_inertia_kg_m2.is_some() {
                vehicle.friction.relaxation_length_m = share * half_width_m;
            }
        }
        vehicle.validated()
    }

    /// Returns the model of the controllers, scaled by `size`; wheel slip and slide scale with it.
    pub(super) fn of_identified(&self, mut vehicle: Vehicle) -> Result<Vehicle, RangeError> {
        let size = self.size;
        if size == 1.0 {
            return Ok(vehicle);
        }
        // Extension and wheels in the file belong to another vehicle.
        vehicle.extension = None;
        vehicle.contact = None;
        vehicle.contact_encoder_scale = None;
        vehicle.icrs.left_m *= size;
        vehicle.icrs.right_m *= size;
        vehicle.icrs.forward_m *= size;
        vehicle.base_half_width_m *= size;
        vehicle.base_half_length_m *= size;
        vehicle.slide.shift_s_per_rad *= size;
        vehicle.slide.aggravated_s_per_rad *= size;
        vehicle.validated()
    }

    fn inner_share(&self, vehicle: &ContactVehicle) -> Result<Option<f64>, RangeError> {
        let Some(share) = self.inner_load else {
            return Ok(None);
        };
        Bounds::new(0.0, 1.0, "").check("inner_load", share)?;
        let axles = vehicle.axles.len() as f64;
        let equal = (axles - 2.0) / axles;
        Ok(Some(equal + share * (INNER_LOAD_MAX - equal)))
    }
}

fn scaled(share: Option<f64>, length_m: f64) -> Option<f64> {
    share.map(|share| share * length_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn j8() -> ContactVehicle {
        serde_yaml::from_str(include_str!("../../config/vehicles/j8_contact.yaml")).unwrap()
    }

    fn varied(yaml: &str) -> Result<ContactVehicle, RangeError> {
        let variation: VehicleVariation = serde_yaml::from_str(yaml).unwrap();
        variation.of_truth(&j8())
    }

    #[test]
    fn nothing_varied_is_the_file() {
        let same = varied("{}").unwrap();
        assert!((same.parameters() - j8().parameters()).norm() < 1e-12);
        assert_eq!(same.half_width_m, j8().half_width_m);
    }

    #[test]
    fn loads_go_from_equal_to_nine_tenths_inside() {
        for (inner_load, outer) in [(0.0, 0.25), (1.0, 0.05)] {
            let vehicle = varied(&format!("{{inner_load: {inner_load}}}")).unwrap();
            assert!((vehicle.axles[0].load_share - outer).abs() < 1e-12);
        }
    }

    #[test]
    fn inner_axles_may_be_stiffer() {
        let vehicle = varied("{size: 2, inner_stiffness: 2.5}").unwrap();
        assert!((vehicle.inner_stiffness - 2.5).abs() < 1e-12);
        assert_eq!(varied("{size: 2}").unwrap().inner_stiffness, 1.0);
    }

    #[test]
    fn a_vehicle_of_half_the_size_has_an_eighth_of_the_mass_and_its_inertia() {
        let vehicle = varied("{size: 0.5, inertia: 1, centre_of_mass_right_share: 0.1}").unwrap();
        assert!((vehicle.mass_kg - j8().mass_kg / 8.0).abs() < 1e-9);
        assert!((vehicle.centre_of_mass.right_m - 0.03).abs() < 1e-12);
        let box_inertia = vehicle.mass_kg * (0.3_f64.powi(2) + 0.53_f64.powi(2)) / 3.0;
        assert!((vehicle.yaw_inertia_kg_m2.unwrap() - box_inertia).abs() < 1e-9);
    }

    #[test]
    fn tyres_relax_over_a_share_of_the_half_width_where_there_is_inertia() {
        let length_m = |yaml| varied(yaml).unwrap().friction.relaxation_length_m;
        assert_eq!(length_m("{inertia: 1}"), 0.0);
        let with = length_m("{inertia: 1, size: 2, relaxation_length_share: 0.5}");
        assert!((with - 0.6).abs() < 1e-12, "{with}");
        assert_eq!(length_m("{inertia: 0, relaxation_length_share: 0.5}"), 0.0);
    }

    #[test]
    fn a_patch_has_a_share_of_the_half_width_and_may_be_a_point() {
        let radius_m = |yaml| varied(yaml).unwrap().friction.patch_radius_m;
        assert!((radius_m("{size: 2, patch_radius_share: 0.3}") - 0.36).abs() < 1e-12);
        assert_eq!(radius_m("{patch_radius_share: 0}"), 0.0);
        // That of the file otherwise, which grows with the vehicle.
        assert!((radius_m("{size: 2}") - 2.0 * j8().friction.patch_radius_m).abs() < 1e-12);
    }

    #[test]
    fn what_is_out_of_range_is_named() {
        for (key, value) in [
            ("inner_load", 1.5),
            ("inner_stiffness", 0.0),
            ("lateral_share", -0.5),
            ("slip_scale_m_s", -0.02),
            ("patch_radius_share", -0.1),
            ("patch_radius_share", 1.1),
        ] {
            let error = varied(&format!("{{{key}: {value}}}")).unwrap_err();
            assert!(
                error.to_string().starts_with(&format!("{key}: {value} is")),
                "{error}"
            );
        }
    }
}
