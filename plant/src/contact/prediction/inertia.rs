//! How a vehicle with inertia follows its balance.
//!
//! Near the balance u* the forces left over are -H (u - u*), so that with the mass matrix M of (v_x, v_y, omega),
//! over the weight,
//!
//! ```text
//! T du/dt = u* + T c - u,   T = H^-1 M,   c = omega (w_y, -w_x, 0)
//! ```
//!
//! with w the velocity of the centre of mass: it keeps its direction while the body's axes turn. Where friction hardly
//! yields, as on a straight, T is some milliseconds; where grip ends, H is flat and T tenths of a second. What is left of
//! u - u* after a time t is e^(-t T^-1), here (T^2 + t T + t^2/2)^-1 T^2, which is bounded for every T and t.

use crate::contact::GRAVITY_M_S2;
use crate::contact::vehicle::box_gyration_squared_m2;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Time constants with which a vehicle follows its balance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// T of a vehicle with the inertia of a box on its wheels, s.
    of_box_s: Matrix3<f64>,
    /// Inertia over that of the box.
    inertia: f64,
    /// Centre of mass to the right of the origin and ahead of it, m.
    centre_m: Vector2<f64>,
}

/// How a vehicle follows a balance over a certain time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Following {
    lag: Lag,
    time_s: f64,
    /// (T^2 + t T + t^2/2)^-1, 1/s^2.
    inverse: Matrix3<f64>,
    /// Shares of the distance from the balance that are left in the mean over the time, and at its end.
    of_mean: Matrix3<f64>,
    of_end: Matrix3<f64>,
}

/// A velocity (v_x, v_y, omega), m/s and rad/s, or its derivative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Followed {
    /// The mean over the time.
    pub mean: Vector3<f64>,
    /// At the end of the time.
    pub end: Vector3<f64>,
}

impl Lag {
    /// Returns the lag where the inverse of the Hessian is H^-1; half width and half length are those of the box.
    pub(super) fn new(
        inverse_hessian: &Matrix3<f64>,
        inertia: f64,
        centre_m: Vector2<f64>,
        half_width_m: f64,
        half_length_m: f64,
    ) -> Self {
        let (x, y) = (centre_m.x, centre_m.y);
        let square_m2 = box_gyration_squared_m2(half_width_m, half_length_m);
        let mass = Matrix3::new(1.0, 0.0, -y, 0.0, 1.0, x, -y, x, square_m2 + x * x + y * y);
        Self {
            of_box_s: inverse_hessian * mass / GRAVITY_M_S2,
            inertia,
            centre_m,
        }
    }

    /// Returns how the vehicle follows its balance over `time_s`.
    pub fn over(&self, time_s: f64) -> Following {
        let constants_s = self.inertia * self.of_box_s;
        let square = constants_s * constants_s;
        let time = Matrix3::from_diagonal_element(time_s);
        let whole = square + time_s * constants_s + 0.5 * time_s * time;
        let (inverse, of_mean, of_end) = match whole.try_inverse() {
            Some(inverse) => (
                inverse,
                inverse * constants_s * (constants_s + 0.5 * time),
                inverse * square,
            ),
            // Without any lag all is followed at once, but nothing in no time.
            None => {
                let left = Matrix3::from_diagonal_element(if time_s > 0.0 { 0.0 } else { 1.0 });
                (Matrix3::zeros(), left, left)
            }
        };
        Following {
            lag: *self,
            time_s,
            inverse,
            of_mean,
            of_end,
        }
    }

    /// Returns T c of a vehicle with the inertia of the box.
    fn by_turning(&self, velocity: &Vector3<f64>) -> Vector3<f64> {
        let omega = velocity.z;
        let right = velocity.x - omega * self.centre_m.y;
        let forward = velocity.y + omega * self.centre_m.x;
        self.of_box_s * Vector3::new(omega * forward, -omega * right, 0.0)
    }
}

impl Following {
    /// Without any lag.
    pub const AT_ONCE: Self = {
        const NONE: Matrix3<f64> = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        Self {
            lag: Lag {
                of_box_s: NONE,
                inertia: 0.0,
                centre_m: Vector2::new(0.0, 0.0),
            },
            time_s: 0.0,
            inverse: NONE,
            of_mean: NONE,
            of_end: NONE,
        }
    };

    /// Returns the velocity of a vehicle that moved as `before`, where the balance is `settled`.
    pub fn from(&self, before: &Vector3<f64>, settled: &Vector3<f64>) -> Followed {
        let settled = settled + self.lag.inertia * self.lag.by_turning(before);
        let behind = before - settled;
        Followed {
            mean: settled + self.of_mean * behind,
            end: settled + self.of_end * behind,
        }
    }

    /// Returns the derivatives of [`Self::from`] by `before`, of the mean and of the end; the turn of the axes is left
    /// out. Those by `settled` are what is missing to the identity.
    pub fn by_before(&self) -> (Matrix3<f64>, Matrix3<f64>) {
        (self.of_mean, self.of_end)
    }

    /// Returns the derivative of [`Self::from`] by the inertia.
    pub fn by_inertia(&self, before: &Vector3<f64>, settled: &Vector3<f64>) -> Followed {
        let Lag {
            of_box_s, inertia, ..
        } = self.lag;
        let turning = self.lag.by_turning(before);
        let behind = before - settled - inertia * turning;
        let twice_s = 2.0 * inertia * of_box_s;
        let time = Matrix3::from_diagonal_element(self.time_s);
        // All of these matrices are polynomials of T, so they commute.
        let by_whole = self.inverse * of_box_s;
        let of = |by_numerator: Matrix3<f64>, left: Matrix3<f64>| {
            by_whole * (by_numerator - (twice_s + time) * left) * behind + turning - left * turning
        };
        Followed {
            mean: of(twice_s + 0.5 * time, self.of_mean),
            end: of(twice_s, self.of_end),
        }
    }
}
