//! Balance of wheel forces and weight: a convex potential, minimised by a safeguarded Newton method.

use super::friction::Friction;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Body velocity (v_x, v_y, omega): m/s, m/s, rad/s.
pub(super) type Velocity = Vector3<f64>;

/// A wheel that presses on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contact {
    /// Contact point in the body frame, m.
    pub(super) position: Vector2<f64>,
    /// Speed V that the tread imposes on the wheel, m/s.
    pub(super) tread_m_s: f64,
    /// Normal load N, newtons.
    pub(super) load_n: f64,
    /// Coefficient of friction mu there.
    pub(super) friction: f64,
}

/// Slip of a wheel, and the root q over which friction distributes its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slip {
    /// To the right, m/s.
    pub(super) x: f64,
    /// Forward, m/s.
    pub(super) y: f64,
    /// r^2 omega of the contact patch, m^2/s.
    pub(super) spin: f64,
    /// q of the module's documentation, m/s.
    pub(super) q: f64,
}

impl Contact {
    /// Returns the slip at a body velocity.
    pub(super) fn slip(&self, friction: &Friction, velocity: &Velocity) -> Slip {
        let (v_x, v_y, omega) = (velocity.x, velocity.y, velocity.z);
        let (x, y) = (self.position.x, self.position.y);
        let (s_x, s_y) = (v_x - omega * y, v_y + omega * x - self.tread_m_s);
        let lateral_squared = friction.lateral_share * friction.lateral_share;
        let spin = friction.patch_radius_m * friction.patch_radius_m * omega;
        let give = friction.slip_share * self.tread_m_s;
        let q = (lateral_squared * s_x * s_x
            + s_y * s_y
            + spin * omega
            + friction.slip_scale_m_s * friction.slip_scale_m_s
            + give * give)
            .sqrt();
        Slip {
            x: s_x,
            y: s_y,
            spin,
            q,
        }
    }

    /// Returns the force of friction, N to the right and forward, and its moment about the wheel's own
    /// middle, N m.
    pub(super) fn friction_force(&self, friction: &Friction, velocity: &Velocity) -> Vector3<f64> {
        let slip = self.slip(friction, velocity);
        let lateral_squared = friction.lateral_share * friction.lateral_share;
        -self.friction * self.load_n / slip.q
            * Vector3::new(lateral_squared * slip.x, slip.y, slip.spin)
    }
}

/// Inertia of an implicit Euler step: kinetic term `(u - u_0)' M (u - u_0) / 2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct InertiaStep {
    /// Mass matrix over the step's length, for (v_x, v_y, omega) of the origin.
    pub(super) mass_per_step: Matrix3<f64>,
    /// Velocity before the step, in the axes after it.
    pub(super) before: Velocity,
}

/// What has to balance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Balance<'a> {
    pub(super) contacts: &'a [Contact],
    pub(super) friction: &'a Friction,
    /// Weight along the ground, newtons to the right and forward, and its moment about the origin, N m.
    pub(super) drive: Vector3<f64>,
    pub(super) inertia: Option<InertiaStep>,
}

/// Value, gradient and Hessian of the potential.
#[derive(Debug, Clone, Copy)]
struct BalanceExpansion {
    value: f64,
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
    /// Curvature of a parabola that touches the potential here and lies above it elsewhere: that of
    /// sqrt(z) is below its tangent in z = q^2 (iteratively reweighted least squares).
    majorant: Matrix3<f64>,
}

/// Why Newton's method gave no velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NotBalanced {
    /// Force and moment left over, as a share of the normal loads.
    pub(super) residual: f64,
    /// Iterations spent.
    pub(super) iterations: usize,
}

/// Left-over force as a share of the loads at which the balance counts as solved.
const TOLERANCE: f64 = 1e-10;
const MAX_ITERATIONS: usize = 60;
/// Beyond this speed, m/s or rad/s, the vehicle has lost its hold.
const MAX_SPEED: f64 = 1e3;

impl Balance<'_> {
    /// Returns the velocity in balance, searched from `start`.
    ///
    /// # Errors
    /// Returns what was left over when the iterations ran out, as where the ground is steeper than
    /// friction holds.
    pub(super) fn solve(&self, start: Velocity) -> Result<Velocity, NotBalanced> {
        let scale = 1.0 / self.contacts.iter().map(|c| c.load_n).sum::<f64>();
        let mut velocity = start;
        let mut here = self.expand(&velocity);
        for iterations in 0..MAX_ITERATIONS {
            let residual = here.gradient.norm() * scale;
            let failed = NotBalanced {
                residual,
                iterations,
            };
            if residual < TOLERANCE {
                return Ok(velocity);
            }
            let Some((candidate, there)) = self.improve(&velocity, &here) else {
                return Err(failed);
            };
            if !candidate.norm().is_finite() || candidate.norm() > MAX_SPEED {
                return Err(failed);
            }
            (velocity, here) = (candidate, there);
        }
        Err(NotBalanced {
            residual: here.gradient.norm() * scale,
            iterations: MAX_ITERATIONS,
        })
    }

    /// Returns a better velocity: by Newton's step where that descends, otherwise by the step to the
    /// minimum of a parabola that lies above the potential everywhere, which descends always.
    fn improve(
        &self,
        velocity: &Velocity,
        here: &BalanceExpansion,
    ) -> Option<(Velocity, BalanceExpansion)> {
        [(here.hessian, 1e-4), (here.majorant, 0.0)]
            .into_iter()
            .find_map(|(curvature, share)| {
                let step = -curvature.cholesky()?.solve(&here.gradient);
                let candidate = velocity + step;
                let there = self.expand(&candidate);
                let descends = there.value < here.value + share * here.gradient.dot(&step);
                // Near the minimum, rounding hides the descent of the potential, not of its gradient.
                let flattens = there.gradient.norm() < 0.7 * here.gradient.norm();
                (descends || flattens).then_some((candidate, there))
            })
    }

    /// Returns the potential of the module's documentation with its derivatives.
    fn expand(&self, velocity: &Velocity) -> BalanceExpansion {
        let Friction {
            lateral_share,
            slip_scale_m_s,
            rolling_resistance,
            patch_radius_m,
            ..
        } = *self.friction;
        let patch_squared = patch_radius_m * patch_radius_m;
        let scale_squared = slip_scale_m_s * slip_scale_m_s;
        let lateral_squared = lateral_share * lateral_share;
        let (v_y, omega) = (velocity.y, velocity.z);
        let mut value = -self.drive.dot(velocity);
        let mut gradient = -self.drive;
        let mut hessian = Matrix3::zeros();
        let mut majorant = Matrix3::zeros();
        for contact in self.contacts {
            let (x, y) = (contact.position.x, contact.position.y);
            let rolling = v_y + omega * x;
            // d s_x / du = (1, 0, -y) and d s_y / du = (0, 1, x).
            let slip = contact.slip(self.friction, velocity);
            let (s_x, s_y, spin, q) = (slip.x, slip.y, slip.spin, slip.q);
            let limit = contact.friction * contact.load_n;
            let (f_x, f_y) = (lateral_squared * s_x / q, s_y / q);
            let mut weight_yy = limit / q;
            let weight_xx = lateral_squared * weight_yy;
            let weight_zz = patch_squared * weight_yy;
            let (mut along, mut curve_yy) = (limit * f_y, limit * (1.0 - f_y * f_y) / q);
            value += limit * q;
            if rolling_resistance > 0.0 {
                let resistance = rolling_resistance * contact.load_n;
                let p = (rolling * rolling + scale_squared).sqrt();
                value += resistance * p;
                along += resistance * rolling / p;
                curve_yy += resistance * scale_squared / (p * p * p);
                weight_yy += resistance / p;
            }
            let across = limit * f_x;
            let curve_xx = limit * (lateral_squared - f_x * f_x) / q;
            let curve_xy = -limit * f_x * f_y / q;
            gradient += Vector3::new(across, along, x * along - y * across + limit * spin / q);
            // The spin of the patch adds (r omega)^2 to q^2.
            let f_z = spin / q;
            let (curve_xz, curve_yz) = (-limit * f_x * f_z / q, -limit * f_y * f_z / q);
            let curve_zz = limit * (patch_squared - f_z * f_z) / q;
            let (xz, yz) = (x * curve_xy - y * curve_xx, x * curve_yy - y * curve_xy);
            hessian += Matrix3::new(
                curve_xx,
                curve_xy,
                xz + curve_xz,
                curve_xy,
                curve_yy,
                yz + curve_yz,
                xz + curve_xz,
                yz + curve_yz,
                x * yz - y * xz + 2.0 * (x * curve_yz - y * curve_xz) + curve_zz,
            );
            majorant += Matrix3::new(
                weight_xx,
                0.0,
                -y * weight_xx,
                0.0,
                weight_yy,
                x * weight_yy,
                -y * weight_xx,
                x * weight_yy,
                y * y * weight_xx + x * x * weight_yy + weight_zz,
            );
        }
        if let Some(inertia) = &self.inertia {
            let change = velocity - inertia.before;
            let momentum = inertia.mass_per_step * change;
            value += 0.5 * change.dot(&momentum);
            gradient += momentum;
            hessian += inertia.mass_per_step;
            majorant += inertia.mass_per_step;
        }
        BalanceExpansion {
            value,
            gradient,
            hessian,
            majorant,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::friction::FrictionField;
    use super::*;
    use proptest::prelude::*;

    const ROUGH: Friction = Friction {
        field: FrictionField::Uniform { coefficient: 0.9 },
        lateral_share: 0.8,
        slip_scale_m_s: 0.02,
        slip_share: 0.1,
        relaxation_length_m: 0.0,
        rolling_resistance: 0.03,
        patch_radius_m: 0.1,
    };

    fn four_wheels(left_m_s: f64, right_m_s: f64) -> Vec<Contact> {
        let wheel = |x: f64, y: f64, load_n: f64| Contact {
            position: Vector2::new(x, y),
            tread_m_s: if x < 0.0 { left_m_s } else { right_m_s },
            load_n,
            friction: 0.7 + 0.1 * y,
        };
        vec![
            wheel(-0.6, 1.0, 900.0),
            wheel(-0.6, -1.0, 700.0),
            wheel(0.6, 1.0, 800.0),
            wheel(0.6, -1.0, 1000.0),
        ]
    }

    #[test]
    fn ground_steeper_than_friction_is_reported() {
        let contacts = four_wheels(0.3, -0.3);
        let balance = Balance {
            contacts: &contacts,
            friction: &ROUGH,
            drive: Vector3::new(0.0, -3400.0, 0.0),
            inertia: None,
        };
        let failed = balance.solve(Vector3::zeros()).unwrap_err();
        assert!(failed.residual > 0.01, "{failed:?}");
    }

    proptest! {
        #[test]
        fn derivatives_are_central_differences(v_x in -1.0..1.0f64, v_y in -1.0..1.0f64, omega in -1.0..1.0f64,
                                               left in -1.0..1.0f64, right in -1.0..1.0f64, inert: bool) {
            let contacts = four_wheels(left, right);
            let inertia = inert.then(|| InertiaStep {
                mass_per_step: Matrix3::new(5e3, 0.0, 3e2, 0.0, 5e3, -2e2, 3e2, -2e2, 4e3),
                before: Vector3::new(0.1, -0.2, 0.3),
            });
            let balance = Balance { contacts: &contacts, friction: &ROUGH,
                drive: Vector3::new(150.0, -240.0, 30.0), inertia };
            let at = Vector3::new(v_x, v_y, omega);
            let here = balance.expand(&at);
            let step = 1e-6;
            for axis in 0..3 {
                let mut offset = Vector3::zeros();
                offset[axis] = step;
                let (up, down) = (balance.expand(&(at + offset)), balance.expand(&(at - offset)));
                let gradient = (up.value - down.value) / (2.0 * step);
                prop_assert!((gradient - here.gradient[axis]).abs() < 2e-3 * (1.0 + here.gradient.norm() * 1e-3));
                let column = (up.gradient - down.gradient) / (2.0 * step);
                prop_assert!((column - here.hessian.column(axis)).norm() < 1e-5 * here.hessian.norm());
            }
        }

        #[test]
        fn the_majorant_lies_above_the_potential(v_x in -1.0..1.0f64, v_y in -1.0..1.0f64, omega in -1.0..1.0f64,
                d_x in -1.0..1.0f64, d_y in -1.0..1.0f64, d_omega in -1.0..1.0f64) {
            let contacts = four_wheels(0.3, 0.7);
            let balance = Balance { contacts: &contacts, friction: &ROUGH,
                drive: Vector3::new(150.0, -240.0, 30.0), inertia: None };
            let (at, step) = (Vector3::new(v_x, v_y, omega), Vector3::new(d_x, d_y, d_omega));
            let (here, there) = (balance.expand(&at), balance.expand(&(at + step)));
            let above = here.value + here.gradient.dot(&step) + 0.5 * step.dot(&(here.majorant * step));
            prop_assert!(there.value <= above + 1e-9, "{} {}", there.value, above);
        }

        #[test]
        fn the_solution_does_not_depend_on_the_start(left in -1.0..1.0f64, right in -1.0..1.0f64,
                v_x in -3.0..3.0f64, v_y in -3.0..3.0f64, omega in -3.0..3.0f64) {
            let contacts = four_wheels(left, right);
            let balance = Balance { contacts: &contacts, friction: &ROUGH,
                drive: Vector3::new(150.0, -240.0, 30.0), inertia: None };
            let a = balance.solve(Vector3::zeros()).unwrap();
            let b = balance.solve(Vector3::new(v_x, v_y, omega)).unwrap();
            prop_assert!((a - b).norm() < 1e-8, "{} {}", a, b);
        }
    }
}
