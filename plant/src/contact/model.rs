//! The contact vehicle as a motion model.

use super::balance::{Balance, Contact, InertiaStep, Velocity};
use super::loads::{weight_in_body, write_wheel_loads};
use super::relaxation::Relaxation;
use super::vehicle::{ContactVehicle, Wheel};
use crate::frames::BodyVelocity;
use crate::motion::{GroundState, MotionError, MotionModel};
use crate::speeds::TreadSpeeds;
use nalgebra::{Matrix3, Rotation2, Vector2, Vector3};

/// Motion of a [`ContactVehicle`], with the previous velocity as the start of the next search and,
/// for a vehicle with inertia, as its state; the forces of its tyres are part of that where they build up over a
/// length.
#[derive(Debug, Clone)]
pub struct ContactModel {
    vehicle: ContactVehicle,
    wheels: Vec<Wheel>,
    loads_n: Vec<f64>,
    contacts: Vec<Contact>,
    velocity: Velocity,
    relaxation: Option<Relaxation>,
}

impl ContactModel {
    /// Returns the model of a vehicle at rest.
    pub fn new(vehicle: ContactVehicle) -> Self {
        let wheels = vehicle.wheels();
        Self {
            loads_n: vec![0.0; wheels.len()],
            contacts: Vec::with_capacity(wheels.len()),
            velocity: Vector3::zeros(),
            relaxation: vehicle
                .yaw_inertia_kg_m2
                .and_then(|_| Relaxation::of(&vehicle.friction)),
            vehicle,
            wheels,
        }
    }

    /// Returns the vehicle.
    pub fn vehicle(&self) -> &ContactVehicle {
        &self.vehicle
    }

    /// Collects the wheels on the ground; false where the vehicle does not stand on its wheels.
    fn stand(&mut self, ground: &GroundState, treads: TreadSpeeds, weight: &Vector3<f64>) -> bool {
        if !write_wheel_loads(&self.vehicle, &self.wheels, weight, &mut self.loads_n) {
            return false;
        }
        let position = &ground.position;
        let heading = Rotation2::new(position.yaw_rad);
        self.contacts.clear();
        for (wheel, load_n) in self.wheels.iter().zip(&self.loads_n) {
            // The slope's foreshortening of a wheel base is nothing to patches of friction.
            let place = heading * wheel.position;
            self.contacts.push(Contact {
                position: wheel.position,
                tread_m_s: if wheel.position.x < 0.0 {
                    treads.left_m_s
                } else {
                    treads.right_m_s
                },
                load_n: *load_n,
                friction: self
                    .vehicle
                    .friction
                    .field
                    .coefficient_at(position.x_m + place.x, position.y_m + place.y),
            });
        }
        true
    }

    /// Returns whether static friction has stopped a vehicle with inertia whose treads are held.
    fn is_held(&mut self, ground: &GroundState) -> bool {
        let weight = weight_in_body(self.vehicle.mass_kg, &ground.attitude);
        if !self.stand(ground, TreadSpeeds::default(), &weight) {
            return false;
        }
        let balance = Balance {
            contacts: &self.contacts,
            friction: &self.vehicle.friction,
            drive: self.drive(&weight),
            inertia: None,
        };
        let friction = &self.vehicle.friction;
        balance.solve(Velocity::zeros()).is_ok_and(|creep| {
            let beyond = self.velocity - creep;
            self.contacts.iter().all(|contact| {
                let slip = contact.slip(friction, &beyond);
                slip.x.hypot(slip.y) < friction.slip_scale_m_s
            })
        })
    }

    /// Returns the weight along the ground, newtons to the right and forward, and its moment about the origin, N m.
    fn drive(&self, weight: &Vector3<f64>) -> Vector3<f64> {
        let centre = &self.vehicle.centre_of_mass;
        Vector3::new(
            weight.x,
            weight.y,
            centre.right_m * weight.y - centre.forward_m * weight.x,
        )
    }

    /// Returns the inertia of a step of `dt_s`; none for a quasi-static vehicle.
    fn inertia_step(&self, dt_s: f64) -> Option<InertiaStep> {
        let yaw_inertia = self.vehicle.yaw_inertia_kg_m2?;
        let mass = self.vehicle.mass_kg;
        let (x, y) = (
            self.vehicle.centre_of_mass.right_m,
            self.vehicle.centre_of_mass.forward_m,
        );
        // v_c = (v_x - omega y, v_y + omega x), so kinetic energy couples turning and moving.
        let mass_matrix = Matrix3::new(
            mass,
            0.0,
            -mass * y,
            0.0,
            mass,
            mass * x,
            -mass * y,
            mass * x,
            yaw_inertia + mass * (x * x + y * y),
        );
        // The axes turn under the velocity of the centre of mass, which keeps its direction.
        let centre = Vector2::new(-y, x);
        let turned = Rotation2::new(-self.velocity.z * dt_s)
            * (self.velocity.xy() + self.velocity.z * centre)
            - self.velocity.z * centre;
        Some(InertiaStep {
            mass_per_step: mass_matrix / dt_s,
            before: Vector3::new(turned.x, turned.y, self.velocity.z),
        })
    }
}

impl MotionModel for ContactModel {
    /// Returns the body velocity in balance, see the module's documentation.
    ///
    /// A vehicle with inertia has a velocity of its own: a query (`dt_s` 0) returns it, a step
    /// changes it. Tread speeds hold through the step.
    ///
    /// # Errors
    /// Returns [`MotionError::Overturned`] where the weight acts outside the wheels' support, and
    /// [`MotionError::NotConverged`] where friction does not hold the vehicle on the slope.
    fn body_velocity(
        &mut self,
        ground: &GroundState,
        treads: TreadSpeeds,
        dt_s: f64,
    ) -> Result<BodyVelocity, MotionError> {
        if dt_s <= 0.0 && self.vehicle.yaw_inertia_kg_m2.is_some() {
            return Ok(BodyVelocity::from_vector(&self.velocity));
        }
        let (x_m, y_m) = (ground.position.x_m, ground.position.y_m);
        let not_finite = |quantity| MotionError::NotFinite { quantity, x_m, y_m };
        if !(treads.left_m_s.is_finite() && treads.right_m_s.is_finite()) {
            return Err(not_finite("tread speed"));
        }
        if !(ground.attitude.is_finite() && x_m.is_finite() && y_m.is_finite()) {
            return Err(not_finite("ground state"));
        }
        let weight = weight_in_body(self.vehicle.mass_kg, &ground.attitude);
        if !self.stand(ground, treads, &weight) {
            return Err(MotionError::Overturned { x_m, y_m });
        }
        let mut drive = self.drive(&weight);
        let inertia = self.inertia_step(dt_s);
        if let Some(relaxation) = &mut self.relaxation {
            drive += relaxation.begin(
                &self.vehicle.friction,
                &mut self.contacts,
                &self.velocity,
                drive,
                dt_s,
            );
        }
        let balance = Balance {
            contacts: &self.contacts,
            friction: &self.vehicle.friction,
            drive,
            inertia,
        };
        let velocity =
            balance
                .solve(self.velocity)
                .map_err(|failed| MotionError::NotConverged {
                    residual: failed.residual,
                    iterations: failed.iterations,
                    x_m,
                    y_m,
                })?;
        self.velocity = velocity;
        if let Some(relaxation) = &mut self.relaxation {
            relaxation.end(&self.vehicle.friction, &self.contacts, &velocity);
        }
        Ok(BodyVelocity::from_vector(&velocity))
    }

    /// Returns the body velocity with both treads held, which is zero as soon as static friction holds the vehicle.
    ///
    /// Smoothed friction needs some slip for any force, so a vehicle on a slope creeps on held treads by a
    /// velocity in proportion to the slip scale, with the same forces for every scale. Where there is such a balance,
    /// dry friction, its limit, holds the vehicle. A vehicle with inertia stops once its wheels slip by less than the
    /// slip scale faster than that.
    ///
    /// # Errors
    /// As [`Self::body_velocity`].
    fn braked_velocity(
        &mut self,
        ground: &GroundState,
        dt_s: f64,
    ) -> Result<BodyVelocity, MotionError> {
        let velocity = self.body_velocity(ground, TreadSpeeds::default(), dt_s)?;
        let has_inertia = self.vehicle.yaw_inertia_kg_m2.is_some();
        if has_inertia && (dt_s <= 0.0 || !self.is_held(ground)) {
            return Ok(velocity);
        }
        self.velocity = Velocity::zeros();
        Ok(BodyVelocity::default())
    }
}
