//! How a vehicle with inertia, on tyres whose force builds up over a length, follows its balance.
//!
//! Near the balance u* the forces of settled tyres leave -H (u - u*) over. With the forces f that are in fact left over,
//! p = H^-1 f, and the mass matrix M of (v_x, v_y, omega), over the weight,
//!
//! ```text
//! T du/dt = p - d (u - u'),    T_f dp/dt + p = -(1 - d) (u - u'),    T = H^-1 M,    T_f = L / w
//! u' = u* + H^-1 omega (q_y, -q_x, 0),    q = m v_c + T_f G
//! ```
//!
//! L is the relaxation length, w the speed at which the ground passes the wheels, d the share of the force that follows at
//! once, see the [contact module](crate::contact). Momentum m v_c and the weight's pull along the ground G keep their
//! direction while the body's axes turn, and so pull the vehicle outward and ahead of its turn. Without relaxation
//! T du/dt = u' - u: where friction hardly yields, as on a straight, T is some milliseconds; where grip ends, H is flat and
//! T tenths of a second. With it the vehicle swings about its balance.
//!
//! What is left after a time t is exp(t A) of this linear system, here (1 - t A + t^2 A^2 / 2)^-1, which is bounded for
//! every T, T_f and t. All its blocks are polynomials of T.

use super::geometry::{Geometry, Ground};
use super::loads::LoadCase;
use super::search::BalanceSolution;
use crate::contact::GRAVITY_M_S2;
use crate::contact::Parameter;
use crate::contact::relaxation::DAMPING_SHARE;
use crate::contact::vehicle::box_gyration_squared_m2;
use crate::speeds::TreadSpeeds;
use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};

/// How a vehicle moves at an instant, or `C` derivatives of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyState<const C: usize = 1> {
    /// (v_x, v_y, omega), m/s and rad/s.
    pub velocity: SMatrix<f64, 3, C>,
    /// Forces of the tyres out of balance, as the accelerations (m/s^2 and rad/s^2) that they would give a vehicle with
    /// the inertia of a box on its wheels.
    pub force: SMatrix<f64, 3, C>,
}

/// Time constants with which a vehicle follows its balance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// T of a vehicle with the inertia of a box on its wheels, s.
    of_box_s: Matrix3<f64>,
    /// Inertia over that of the box.
    inertia: f64,
    /// Centre of mass to the right of the origin and ahead of it, m.
    centre_m: Vector2<f64>,
    relaxation_length_m: f64,
    /// Speed at which the ground passes the wheels, m/s.
    passing_m_s: f64,
    /// G over the mass, m/s^2.
    pull_m_s2: Vector2<f64>,
}

/// How a vehicle follows a balance over a certain time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Following {
    lag: Lag,
    time_s: f64,
    /// Inverse of the denominator of all shares below, 1/s^2.
    inverse: Matrix3<f64>,
    /// What the distance from the balance and the force at the beginning leave at the end.
    velocity_by_behind: Matrix3<f64>,
    velocity_by_force: Matrix3<f64>,
    force_by_behind: Matrix3<f64>,
    force_by_force: Matrix3<f64>,
}

/// How a vehicle has followed its balance, or `C` derivatives of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Followed<const C: usize = 1> {
    /// The mean velocity over the time.
    pub mean: SMatrix<f64, 3, C>,
    /// The state at the end of the time.
    pub end: BodyState<C>,
}

/// A polynomial a T^2 + b t T + c t^2.
#[derive(Clone, Copy)]
struct Polynomial(f64, f64, f64);

/// What multiplies the distance from the balance and H^-1 f in (1 - t A + t^2 A^2 / 2)^-1, over r^2 / 2 with
/// r = t / T_f, as functions of s = T_f / t.
struct Shares {
    denominator: Polynomial,
    velocity_by_behind: Polynomial,
    velocity_by_force: Polynomial,
    /// Over the inertia, times T.
    force_by_behind: Polynomial,
    force_by_force: Polynomial,
}

impl Shares {
    fn at(s: f64) -> Self {
        let d = DAMPING_SHARE;
        let square = 2.0 * s * s;
        Self {
            denominator: Polynomial(
                square + 2.0 * s + 1.0,
                d * (square + 2.0 * s) + 1.0,
                d * s * (d * s + 1.0) + 0.5,
            ),
            velocity_by_behind: Polynomial(square + 2.0 * s + 1.0, -(1.0 - d) * s, 0.0),
            velocity_by_force: Polynomial(0.0, square + s, 0.5 * d * square),
            force_by_behind: Polynomial(-(1.0 - d) * (2.0 * s + 1.0), -(1.0 - d) * d * s, 0.0),
            force_by_force: Polynomial(square, d * square - (1.0 - d) * s, 0.5 * d * d * square),
        }
    }

    /// Returns the derivatives by s.
    fn derivatives_at(s: f64) -> Self {
        let d = DAMPING_SHARE;
        let slope = 4.0 * s;
        Self {
            denominator: Polynomial(slope + 2.0, d * (slope + 2.0), d * (0.5 * d * slope + 1.0)),
            velocity_by_behind: Polynomial(slope + 2.0, -(1.0 - d), 0.0),
            velocity_by_force: Polynomial(0.0, slope + 1.0, 0.5 * d * slope),
            force_by_behind: Polynomial(-2.0 * (1.0 - d), -(1.0 - d) * d, 0.0),
            force_by_force: Polynomial(slope, d * slope - (1.0 - d), 0.5 * d * d * slope),
        }
    }
}

impl<const C: usize> Default for BodyState<C> {
    fn default() -> Self {
        Self::steady(SMatrix::zeros())
    }
}

impl<const C: usize> BodyState<C> {
    /// Returns the state of a vehicle whose tyres are in balance.
    pub fn steady(velocity: SMatrix<f64, 3, C>) -> Self {
        Self {
            velocity,
            force: SMatrix::zeros(),
        }
    }
}

impl Lag {
    /// Returns the lag at a balance that was found for the speeds of the treads.
    pub(super) fn new(
        geometry: &Geometry,
        ground: &Ground,
        treads: TreadSpeeds,
        stance: &LoadCase,
        balance: &BalanceSolution,
    ) -> Self {
        let centre_m = ground.centre.xy();
        let (x, y) = (centre_m.x, centre_m.y);
        let square_m2 = box_gyration_squared_m2(geometry.half_width_m, geometry.half_length_m);
        let mass = Matrix3::new(1.0, 0.0, -y, 0.0, 1.0, x, -y, x, square_m2 + x * x + y * y);
        Self {
            of_box_s: balance.inverse_hessian * mass / GRAVITY_M_S2,
            inertia: ground.inertia,
            centre_m,
            relaxation_length_m: ground.relaxation_length_m,
            passing_m_s: passing_m_s(geometry, ground, treads, &balance.velocity),
            pull_m_s2: GRAVITY_M_S2 * balance.pull_share * stance.weight.xy(),
        }
    }

    /// Returns how the vehicle follows its balance over `time_s`.
    pub fn over(&self, time_s: f64) -> Following {
        let constants_s = self.inertia * self.of_box_s;
        let square = constants_s * constants_s;
        let shares = Shares::at(self.force_s() / time_s);
        let whole = shares.denominator.of(&constants_s, &square, time_s);
        let Some(inverse) = whole.try_inverse().filter(|_| time_s > 0.0) else {
            return Following::IN_NO_TIME;
        };
        let by_square = inverse * square;
        let by_constants = inverse * constants_s;
        let share = |Polynomial(a, b, c): Polynomial| {
            a * by_square + b * time_s * by_constants + c * time_s * time_s * inverse
        };
        let Polynomial(a, b, _) = shares.force_by_behind;
        Following {
            lag: *self,
            time_s,
            inverse,
            velocity_by_behind: share(shares.velocity_by_behind),
            velocity_by_force: share(shares.velocity_by_force) * self.of_box_s,
            force_by_behind: self.inertia * (a * by_constants + b * time_s * inverse),
            force_by_force: share(shares.force_by_force),
        }
    }

    /// Returns T_f, s.
    fn force_s(&self) -> f64 {
        self.relaxation_length_m / self.passing_m_s
    }

    /// Returns how far the turn of the axes moves what is followed, for a vector (m/s) over the mass that keeps its
    /// direction, in the place of a momentum.
    fn by_turning(&self, yaw_rate_rad_s: f64, kept: &Vector2<f64>) -> Vector3<f64> {
        self.of_box_s * (yaw_rate_rad_s * Vector3::new(kept.y, -kept.x, 0.0))
    }

    /// Returns the velocity of the centre of mass.
    fn of_centre(&self, velocity: &Vector3<f64>) -> Vector2<f64> {
        velocity.xy() + velocity.z * Vector2::new(-self.centre_m.y, self.centre_m.x)
    }
}

/// Returns the root of the mean square, over the wheels, of tread speed and slip, m/s; at a standstill the slip scale: there
/// a tyre is a spring.
fn passing_m_s(
    geometry: &Geometry,
    ground: &Ground,
    treads: TreadSpeeds,
    velocity: &Vector3<f64>,
) -> f64 {
    let half_width_m = geometry.half_width_m;
    let side = |right_m: f64, tread_m_s: f64| {
        tread_m_s.powi(2) + (velocity.y + velocity.z * right_m - tread_m_s).powi(2)
    };
    let sides = side(-half_width_m, treads.left_m_s) + side(half_width_m, treads.right_m_s);
    let forward_m = &geometry.forward_m[..geometry.axles];
    let sideways: f64 = forward_m
        .iter()
        .map(|y| (velocity.x - velocity.z * y).powi(2))
        .sum();
    let square = ground.slip_squared + 0.5 * sides + sideways / geometry.axles as f64;
    square.sqrt()
}

impl Polynomial {
    /// Returns its value at T, whose square is given, and t.
    fn of(self, constants_s: &Matrix3<f64>, square: &Matrix3<f64>, time_s: f64) -> Matrix3<f64> {
        let Self(a, b, c) = self;
        let time = Matrix3::from_diagonal_element(c * time_s * time_s);
        a * square + b * time_s * constants_s + time
    }

    /// Returns its derivative by T, to be multiplied by that of T.
    fn by_constants(self, constants_s: &Matrix3<f64>, time_s: f64) -> Matrix3<f64> {
        let Self(a, b, _) = self;
        2.0 * a * constants_s + Matrix3::from_diagonal_element(b * time_s)
    }
}

impl Following {
    /// Without any lag.
    pub const AT_ONCE: Self = Self::alike(0.0);
    const IN_NO_TIME: Self = Self::alike(1.0);

    /// Leaves so much of the distance and of the force.
    const fn alike(left: f64) -> Self {
        const NONE: Matrix3<f64> = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let left = Matrix3::new(left, 0.0, 0.0, 0.0, left, 0.0, 0.0, 0.0, left);
        Self {
            lag: Lag {
                of_box_s: NONE,
                inertia: 0.0,
                centre_m: Vector2::new(0.0, 0.0),
                relaxation_length_m: 0.0,
                passing_m_s: 1.0,
                pull_m_s2: Vector2::new(0.0, 0.0),
            },
            time_s: 0.0,
            inverse: NONE,
            velocity_by_behind: left,
            velocity_by_force: NONE,
            force_by_behind: NONE,
            force_by_force: left,
        }
    }

    /// Returns the motion of a vehicle that moved as `before`, where the balance is `settled`.
    pub fn from(&self, before: &BodyState, settled: &Vector3<f64>) -> Followed {
        self.along(before, &self.followed(&before.velocity, settled))
    }

    /// Returns u', where the balance is `settled`.
    fn followed(&self, velocity: &Vector3<f64>, settled: &Vector3<f64>) -> Vector3<f64> {
        let lag = &self.lag;
        let kept = lag.inertia * lag.of_centre(velocity) + lag.force_s() * lag.pull_m_s2;
        settled + lag.by_turning(velocity.z, &kept)
    }

    /// Returns the derivatives of [`Self::from`] along directions in which state and balance change; the turn of the axes is
    /// left out.
    pub fn along<const C: usize>(
        &self,
        before: &BodyState<C>,
        settled: &SMatrix<f64, 3, C>,
    ) -> Followed<C> {
        let behind = before.velocity - settled;
        let end = BodyState {
            velocity: settled
                + self.velocity_by_behind * behind
                + self.velocity_by_force * before.force,
            force: self.force_by_behind * behind + self.force_by_force * before.force,
        };
        // The sum of the two equations of motion, over the time.
        let gained = self.lag.inertia * (end.velocity - before.velocity)
            + self.lag.force_s() * (end.force - before.force);
        Followed {
            mean: if self.time_s > 0.0 {
                settled - self.lag.of_box_s * (gained / self.time_s)
            } else {
                end.velocity
            },
            end,
        }
    }

    /// Returns the derivatives of [`Self::from`], which led to the state `end`, by the inertia and by the entry of the
    /// relaxation length in a [`ParameterVector`](crate::contact::ParameterVector).
    pub fn by_lag(
        &self,
        before: &BodyState,
        settled: &Vector3<f64>,
        end: &BodyState,
    ) -> [Followed; 2] {
        let Lag {
            of_box_s,
            inertia,
            relaxation_length_m,
            passing_m_s,
            pull_m_s2,
            ..
        } = self.lag;
        let (time_s, force_s) = (self.time_s, self.lag.force_s());
        if time_s <= 0.0 {
            let end = BodyState::default();
            let mean = end.velocity;
            return [Followed { mean, end }; 2];
        }
        let yaw_rate_rad_s = before.velocity.z;
        let followed = self.followed(&before.velocity, settled);
        let behind = before.velocity - followed;
        let left = end.velocity - followed;
        let force = of_box_s * before.force;
        let constants_s = inertia * of_box_s;
        let square = constants_s * constants_s;
        // With u' alone, then with T or T_f at given u'.
        let derivative = |followed: Vector3<f64>, velocity_by, force_by, gained: Vector3<f64>| {
            let velocity: Vector3<f64> =
                followed - self.velocity_by_behind * followed + self.inverse * velocity_by;
            let force: Vector3<f64> = self.inverse * force_by - self.force_by_behind * followed;
            Followed {
                mean: followed
                    - of_box_s * ((gained + inertia * velocity + force_s * force) / time_s),
                end: BodyState { velocity, force },
            }
        };
        let shares = Shares::at(force_s / time_s);
        let by_constants = |share: Polynomial| share.by_constants(&constants_s, time_s);
        let whole = by_constants(shares.denominator) * of_box_s;
        let Polynomial(a, b, _) = shares.force_by_behind;
        let by_inertia = derivative(
            self.lag
                .by_turning(yaw_rate_rad_s, &self.lag.of_centre(&before.velocity)),
            of_box_s
                * (by_constants(shares.velocity_by_behind) * behind
                    + by_constants(shares.velocity_by_force) * force)
                - whole * left,
            2.0 * a * (constants_s * behind)
                + b * time_s * behind
                + by_constants(shares.force_by_force) * force
                - whole * end.force,
            end.velocity - before.velocity,
        );
        let shares = Shares::derivatives_at(force_s / time_s);
        let of = |share: Polynomial| share.of(&constants_s, &square, time_s) / time_s;
        let whole = of(shares.denominator);
        let Polynomial(a, b, _) = shares.force_by_behind;
        let by_force_s = derivative(
            self.lag.by_turning(yaw_rate_rad_s, &pull_m_s2),
            of(shares.velocity_by_behind) * behind + of(shares.velocity_by_force) * force
                - whole * left,
            inertia * (a / time_s * (constants_s * behind) + b * behind)
                + of(shares.force_by_force) * before.force
                - whole * end.force,
            end.force - before.force,
        );
        let by_entry_m = Parameter::length_by_entry_m(relaxation_length_m);
        let by_entry = |of_force_s| of_force_s * (by_entry_m / passing_m_s);
        [
            by_inertia,
            Followed {
                mean: by_entry(by_force_s.mean),
                end: BodyState {
                    velocity: by_entry(by_force_s.end.velocity),
                    force: by_entry(by_force_s.end.force),
                },
            },
        ]
    }
}
