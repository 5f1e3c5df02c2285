//! The contact vehicle by itself: against the paper, its inertia, and its tyres.

mod inertia;
mod paper;
mod relaxation;
mod vehicle;

use super::*;
use crate::frames::{Attitude, BodyVelocity};
use crate::motion::{GroundState, MotionError, MotionModel};
use crate::speeds::TreadSpeeds;
use crate::test_support::motors;

/// The J8 of `config/vehicles/j8_contact.yaml`.
pub(in crate::contact) fn j8() -> ContactVehicle {
    serde_yaml::from_str(include_str!("../../../../config/vehicles/j8_contact.yaml")).unwrap()
}

/// A vehicle of the Warthog's size (two axles 0.91 m apart, treads 1.08 m) with planar inertia.
fn warthog() -> ContactVehicle {
    let mut vehicle = j8();
    vehicle.mass_kg = 350.0;
    vehicle.half_width_m = 0.54;
    vehicle.axles = vec![
        Axle {
            forward_m: 0.455,
            load_share: 0.5,
        },
        Axle {
            forward_m: -0.455,
            load_share: 0.5,
        },
    ];
    vehicle.centre_of_mass = CentreOfMass {
        right_m: 0.0,
        forward_m: 0.0,
        height_m: 0.3,
    };
    vehicle.friction.field = FrictionField::Uniform { coefficient: 0.7 };
    vehicle.yaw_inertia_kg_m2 = Some(350.0 * (1.2 * 1.2 + 1.1 * 1.1) / 12.0);
    vehicle
}

/// Where the vehicle stands on a slope, and how its motors turn.
#[derive(Clone, Copy, Default)]
struct Drive {
    slope_deg: f64,
    heading_from_uphill_deg: f64,
    traction_m_s: f64,
    steer_m_s: f64,
}

impl Drive {
    fn attitude(&self) -> Attitude {
        Attitude::from_slope(
            self.slope_deg.to_radians(),
            self.heading_from_uphill_deg.to_radians(),
        )
    }

    fn treads(&self) -> TreadSpeeds {
        motors(self.traction_m_s, self.steer_m_s).into()
    }

    fn try_velocity(&self, vehicle: &ContactVehicle) -> Result<BodyVelocity, MotionError> {
        let ground = GroundState {
            attitude: self.attitude(),
            ..GroundState::default()
        };
        ContactModel::new(vehicle.clone()).body_velocity(&ground, self.treads(), 0.0)
    }

    fn velocity(&self, vehicle: &ContactVehicle) -> BodyVelocity {
        self.try_velocity(vehicle).unwrap()
    }

    /// Slide down the slope and along its horizon that the slope adds, m/s.
    fn slide(&self, vehicle: &ContactVehicle) -> (f64, f64) {
        let level = Self {
            slope_deg: 0.0,
            ..*self
        };
        let (here, there) = (self.velocity(vehicle), level.velocity(vehicle));
        let (right, forward) = (
            here.right_m_s - there.right_m_s,
            here.forward_m_s - there.forward_m_s,
        );
        let (sin, cos) = self.heading_from_uphill_deg.to_radians().sin_cos();
        // Uphill in body axes is (sin gamma, cos gamma).
        (-(sin * right + cos * forward), cos * right - sin * forward)
    }
}

/// Velocity of a steady turn on level ground, the vehicle's own inertia included.
fn steady_turn(vehicle: &ContactVehicle, traction_m_s: f64, steer_m_s: f64) -> BodyVelocity {
    let mut model = ContactModel::new(vehicle.clone());
    let treads = motors(traction_m_s, steer_m_s).into();
    let mut velocity = BodyVelocity::default();
    for _ in 0..1000 {
        velocity = model
            .body_velocity(&GroundState::default(), treads, 0.01)
            .unwrap();
    }
    velocity
}

/// kappa and b of the extended model that a steady turn shows, see [`crate::extension`].
fn outward_slip_and_loss(
    vehicle: &ContactVehicle,
    traction_m_s: f64,
    steer_m_s: f64,
) -> (f64, f64) {
    let turn = steady_turn(vehicle, traction_m_s, steer_m_s);
    (
        turn.right_m_s / (turn.yaw_rate_rad_s * turn.forward_m_s),
        (traction_m_s / turn.forward_m_s - 1.0) / turn.yaw_rate_rad_s,
    )
}
