//! What the ICRs of a vehicle tell about the loads of its wheels.

use super::Vehicle;
use crate::contact::{ContactPrediction, ContactVehicle, Parameter, ParameterVector};
use crate::frames::Attitude;
use crate::speeds::{MotorSpeeds, TreadSpeeds};
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Standard deviation of the turns that the ICRs say, over the yaw rate: ICRs are identified, or guessed.
const TURN_SHARE: f64 = 0.15;
/// Traction and steer of the turns that are compared, over the largest speed.
const TRACTION_SHARE: f64 = 0.4;
const STEER_SHARE: f64 = 0.3;
/// Gauss-Newton steps: the parameters hardly change after the fourth.
const STEPS: usize = 8;

/// What ICRs on level ground depend on most, besides geometry.
const TOLD: [Parameter; 4] = [
    Parameter::CentreRight,
    Parameter::CentreForward,
    Parameter::InnerShare,
    Parameter::LateralShare,
];

impl ContactVehicle {
    /// Returns this vehicle with the centre of mass, load of the inner axles and lateral share of friction with which
    /// it turns on level ground as the ICRs of `vehicle` say.
    ///
    /// A vehicle turns about the axles that carry most: its ICRs lie further ahead with the centre of mass, and closer
    /// together the more its inner axles carry. Its own values count as a guess with the usual standard deviations, and
    /// the ICRs as known to 15 %: the result is the most probable vehicle for both (maximum a posteriori).
    #[must_use]
    pub fn turning_as(&self, vehicle: &Vehicle) -> Self {
        // Axles that do not carry a vehicle are reported where it is to drive.
        let Ok(mut model) = ContactPrediction::new(self) else {
            return self.clone();
        };
        let (half_width_m, half_length_m) = (self.half_width_m, self.half_length_m());
        let guess = *model.parameters();
        let free = TOLD.map(|parameter| {
            let none = parameter.is_of_inner_axles() && !self.has_inner_axles();
            let sigma = parameter.guess_sigma(half_width_m, half_length_m);
            if none { 0.0 } else { sigma }
        });
        let icrs = vehicle.on_level_ground();
        let level = Attitude::default();
        let mut parameters = guess;
        for _ in 0..STEPS {
            model.set_parameters(&parameters);
            // In units of the guesses' standard deviations.
            let mut curvature = SMatrix::<f64, { TOLD.len() }, { TOLD.len() }>::identity();
            let mut descent = SMatrix::<f64, { TOLD.len() }, 1>::zeros();
            for (i, parameter) in TOLD.iter().enumerate().filter(|(i, _)| free[*i] > 0.0) {
                let entry = parameter.index();
                descent[i] = (guess[entry] - parameters[entry]) / free[i];
            }
            for side in [-1.0, 1.0] {
                let motors = MotorSpeeds {
                    traction_m_s: TRACTION_SHARE * icrs.speed_max_m_s,
                    steer_m_s: side * STEER_SHARE * icrs.speed_max_m_s,
                };
                let wanted = icrs.body_velocity(level, TreadSpeeds::from(motors));
                let predicted = model.predict(level, motors);
                let found = &predicted.linearised.velocity;
                let missing = wanted.vector() - found.vector();
                let turn_rad_s = TURN_SHARE * wanted.yaw_rate_rad_s.abs();
                let sigma = turn_rad_s * Vector3::new(half_length_m, half_width_m, 1.0);
                let scale = Matrix3::from_diagonal(&sigma.map(f64::recip));
                let by = SMatrix::<f64, 3, { TOLD.len() }>::from_fn(|row, i| {
                    free[i] * predicted.by_parameters[(row, TOLD[i].index())]
                });
                let by = scale * by;
                curvature += by.transpose() * by;
                descent += by.transpose() * (scale * missing);
            }
            let Some(step) = curvature.cholesky().map(|factor| factor.solve(&descent)) else {
                break;
            };
            let mut next: ParameterVector = parameters;
            for (i, parameter) in TOLD.iter().enumerate() {
                next[parameter.index()] += free[i] * step[i];
            }
            parameters = model.within_ranges(&next);
        }
        self.with_parameters(&parameters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::HorizontalIcrs;

    fn geometry() -> ContactVehicle {
        ContactVehicle::of_geometry("eight wheels", 0.6, &[1.06, 0.353, -0.353, -1.06])
    }

    /// Distance of the line of the ICRs ahead of the origin in a turn to the left on level ground, m.
    fn icr_forward_m(vehicle: &ContactVehicle) -> f64 {
        let motors = MotorSpeeds {
            traction_m_s: 0.4,
            steer_m_s: 0.3,
        };
        let mut model = ContactPrediction::new(vehicle).unwrap();
        let velocity = model.body_velocity(Attitude::default(), motors).velocity;
        velocity.right_m_s / velocity.yaw_rate_rad_s
    }

    #[test]
    fn the_icrs_of_the_j8_tell_that_its_mass_is_ahead_and_left_and_its_inner_axles_carry_most() {
        let j8 = Vehicle::j8();
        let guess = geometry();
        let told = guess.turning_as(&j8);
        // As the vehicle of config/vehicles/j8_contact.yaml: 0.193, -0.034 and 0.743.
        assert!(
            (0.08..0.21).contains(&told.centre_of_mass.forward_m),
            "{told:?}"
        );
        assert!(
            (-0.05..-0.01).contains(&told.centre_of_mass.right_m),
            "{told:?}"
        );
        assert!((0.63..0.8).contains(&told.inner_share()), "{told:?}");
        let off_m = |vehicle| (icr_forward_m(vehicle) - j8.icrs.forward_m).abs();
        assert!(off_m(&told) < 0.6 * off_m(&guess));
        // The ground and the height are no matter of ICRs.
        assert_eq!(told.friction.field.middle(), guess.friction.field.middle());
        assert_eq!(told.centre_of_mass.height_m, guess.centre_of_mass.height_m);
    }

    #[test]
    fn a_vehicle_that_turns_as_its_icrs_say_stays_as_it_is() {
        let guess = geometry();
        let mut vehicle = Vehicle::j8();
        vehicle.icrs = HorizontalIcrs {
            left_m: -1.0,
            right_m: 1.0,
            forward_m: 0.0,
        };
        let told = guess.turning_as(&vehicle);
        assert!(
            told.centre_of_mass.right_m.abs() < 1e-6 && told.centre_of_mass.forward_m.abs() < 1e-6
        );
        let wider = HorizontalIcrs {
            left_m: -1.4,
            right_m: 1.4,
            ..vehicle.icrs
        };
        let wide = guess.turning_as(&Vehicle {
            icrs: wider,
            ..vehicle
        });
        assert!(wide.inner_share() < told.inner_share());
    }

    #[test]
    fn two_axles_have_no_inner_load_to_tell() {
        let guess = ContactVehicle::of_geometry("four wheels", 0.3, &[0.25, -0.25]);
        let told = guess.turning_as(&Vehicle::j8());
        assert_eq!(told.inner_share(), 0.0);
        assert!(told.centre_of_mass.forward_m > 0.0);
    }
}
