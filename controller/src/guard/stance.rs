//! How near a vehicle is to tipping over, and how much of its friction it uses.

use nalgebra::Vector3;
use sidehill_plant::contact::{CentreOfMass, GRAVITY_M_S2};
use sidehill_plant::frames::Attitude;
use sidehill_plant::vehicle::Vehicle;

/// How a vehicle drives at a place, as far as its stance depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Turning {
    /// Longitudinal speed, m/s.
    pub speed_m_s: f64,
    /// Yaw rate, rad/s, counter-clockwise.
    pub yaw_rate_rad_s: f64,
}

/// The two measures of a stance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// Tip-over margin: 1 at standstill on level ground, 0 where it tips over, negative beyond.
    pub rollover: f64,
    /// Friction needed over friction available.
    pub friction_use: f64,
}

/// The wheels' rectangle and the centre of mass above it.
///
/// The tip-over margin is the force-angle measure of E. Papadopoulos and D. A. Rey, "A new measure of
/// tipover stability margin for mobile manipulators", ICRA 1996: for each line a_i through neighbouring
/// ground contacts, with the part l_i of the way from the centre of mass to it and the part f_i of the
/// net force on the centre of mass that are normal to the line,
///
/// ```text
/// theta_i = angle from l_i to f_i about a_i
/// alpha = min_i theta_i |f_i|,   margin = alpha / alpha at standstill on level ground
/// ```
///
/// The net force is that of gravity and of the turn, m (g - omega x v).
///
/// The use of friction is a balance of Coulomb forces: with the part t of the net force along the ground and
/// n normal to it, |t| / (mu n). At 1 a vehicle at rest begins to slide. A skid-steer vehicle in a turn drags
/// its wheels sideways; a lateral force moves the line about which they turn ahead by that use times half
/// the length of the contacts, so at 1 it is at their front and the turn is out of control (J. Y. Wong, "Theory
/// of Ground Vehicles", chapter 6, for a uniform load).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stance {
    half_width_m: f64,
    front_m: f64,
    rear_m: f64,
    centre: CentreOfMass,
    level: f64,
}

impl Stance {
    /// Returns the stance of a vehicle; none where the height of its centre of mass is not known.
    pub fn of(vehicle: &Vehicle) -> Option<Self> {
        let contact = vehicle.contact.as_ref();
        let centre = vehicle
            .centre_of_mass
            .or_else(|| contact.map(|contact| contact.centre_of_mass))?;
        let (half_width_m, front_m, rear_m) = match contact {
            Some(contact) => {
                let places = || contact.axles.iter().map(|axle| axle.forward_m);
                (
                    contact.half_width_m,
                    places().fold(f64::NEG_INFINITY, f64::max),
                    places().fold(f64::INFINITY, f64::min),
                )
            }
            None => {
                let half_m = vehicle.base_half_length_m;
                (vehicle.base_half_width_m, half_m, -half_m)
            }
        };
        let mut stance = Self {
            half_width_m,
            front_m,
            rear_m,
            centre,
            level: 1.0,
        };
        stance.level = stance.force_angle(&Vector3::new(0.0, 0.0, -GRAVITY_M_S2));
        Some(stance)
    }

    /// Returns whether the vehicle stands on level ground: its centre of mass is above its wheels.
    pub fn stands(&self) -> bool {
        self.level > 0.0
    }

    /// Returns both measures at an attitude on ground of a coefficient of friction.
    pub fn margins(&self, attitude: &Attitude, turning: &Turning, friction: f64) -> Margins {
        let (s_alpha, c_alpha) = attitude.roll_rad.sin_cos();
        let (s_phi, c_phi) = attitude.pitch_rad.sin_cos();
        let Turning {
            speed_m_s,
            yaw_rate_rad_s,
        } = *turning;
        // omega x v points to the left of a forward drive that turns left; its reaction to the right.
        let force = GRAVITY_M_S2 * Vector3::new(s_alpha, -s_phi * c_alpha, -c_phi * c_alpha)
            + Vector3::new(speed_m_s * yaw_rate_rad_s, 0.0, 0.0);
        Margins {
            rollover: self.force_angle(&force) / self.level,
            friction_use: force.x.hypot(force.y) / (friction * -force.z).max(1e-9),
        }
    }

    /// Returns the force-angle measure of a net force per mass on the centre of mass, m rad/s^2.
    fn force_angle(&self, force: &Vector3<f64>) -> f64 {
        let w = self.half_width_m;
        // Counter-clockwise, seen from above.
        let corners = [
            (w, self.rear_m),
            (w, self.front_m),
            (-w, self.front_m),
            (-w, self.rear_m),
        ]
        .map(|(right, forward)| {
            Vector3::new(
                right - self.centre.right_m,
                forward - self.centre.forward_m,
                -self.centre.height_m,
            )
        });
        (0..4)
            .map(|i| {
                let (here, next) = (&corners[i], &corners[(i + 1) % 4]);
                let axis = (next - here).normalize();
                let across = |vector: &Vector3<f64>| vector - axis * axis.dot(vector);
                let (arm, force) = (across(next), across(force));
                arm.cross(&force).dot(&axis).atan2(arm.dot(&force)) * force.norm()
            })
            .fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STANDING: Turning = Turning {
        speed_m_s: 0.0,
        yaw_rate_rad_s: 0.0,
    };

    fn j8(right_m: f64, forward_m: f64, height_m: f64) -> Stance {
        let vehicle = Vehicle {
            centre_of_mass: Some(CentreOfMass {
                right_m,
                forward_m,
                height_m,
            }),
            ..Vehicle::j8()
        };
        Stance::of(&vehicle).unwrap()
    }

    fn tilted(roll_deg: f64, pitch_deg: f64) -> Attitude {
        Attitude {
            roll_rad: roll_deg.to_radians(),
            pitch_rad: pitch_deg.to_radians(),
        }
    }

    #[test]
    fn the_margin_is_one_on_level_ground_and_zero_where_the_wheels_lift() {
        let stance = j8(0.0, 0.0, 0.5);
        let rollover = |attitude: &Attitude| stance.margins(attitude, &STANDING, 0.8).rollover;
        assert!((rollover(&Attitude::LEVEL) - 1.0).abs() < 1e-12);
        let tips_deg = (0.6_f64 / 0.5).atan().to_degrees();
        for sign in [1.0, -1.0] {
            assert!(rollover(&tilted(sign * tips_deg, 0.0)).abs() < 1e-9);
            assert!(rollover(&tilted(sign * (tips_deg + 1.0), 0.0)) < 0.0);
            assert!(rollover(&tilted(sign * (tips_deg - 1.0), 0.0)) > 0.0);
            let pitches_deg = (1.06_f64 / 0.5).atan().to_degrees();
            assert!(rollover(&tilted(0.0, sign * pitches_deg)).abs() < 1e-9);
        }
        let between = rollover(&tilted(20.0, 0.0));
        let expected = (tips_deg - 20.0) / tips_deg;
        assert!((between - expected).abs() < 1e-9, "{between} {expected}");
    }

    #[test]
    fn a_turn_uphill_takes_margin_and_one_downhill_gives_it() {
        // Right side down, so a turn to the left throws it further over.
        let (stance, slope) = (j8(0.0, 0.0, 0.8), tilted(15.0, 0.0));
        let at = |yaw_rate_rad_s| {
            let turning = Turning {
                speed_m_s: 2.0,
                yaw_rate_rad_s,
            };
            stance.margins(&slope, &turning, 0.8).rollover
        };
        assert!(at(0.5) < at(0.0) && at(0.0) < at(-0.5));
    }

    #[test]
    fn a_mass_off_the_middle_tips_to_its_side() {
        let stance = j8(0.2, 0.0, 0.5);
        let rollover = |roll_deg| {
            stance
                .margins(&tilted(roll_deg, 0.0), &STANDING, 0.8)
                .rollover
        };
        assert!(rollover(10.0) < rollover(-10.0));
        assert!(!j8(0.7, 0.0, 0.5).stands());
    }

    #[test]
    fn standing_uses_the_tangent_of_the_slope_over_the_friction() {
        let stance = j8(0.0, 0.0, 0.4);
        for attitude in [tilted(20.0, 0.0), tilted(0.0, -20.0)] {
            let used = stance.margins(&attitude, &STANDING, 0.5).friction_use;
            let expected = 20.0_f64.to_radians().tan() / 0.5;
            assert!((used - expected).abs() < 1e-9, "{used} {expected}");
        }
        // Right side down: a turn to the left adds its reaction to the slope's pull.
        let turning = Turning {
            speed_m_s: 0.5,
            yaw_rate_rad_s: 0.4,
        };
        let turn = stance
            .margins(&tilted(20.0, 0.0), &turning, 0.5)
            .friction_use;
        let standing = stance
            .margins(&tilted(20.0, 0.0), &STANDING, 0.5)
            .friction_use;
        let added = 0.5 * 0.4 / (0.5 * GRAVITY_M_S2 * 20.0_f64.to_radians().cos());
        assert!((turn - standing - added).abs() < 1e-9, "{turn} {standing}");
    }
}
