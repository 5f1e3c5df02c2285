//! Wheel-ground contact: a skid-steer vehicle that moves by friction, not by an ICR model.
//!
//! Each tread imposes its speed V on all its wheels. A wheel at (x, y) of the body slips by
//! `s = (v_x - omega y, v_y + omega x - V)` and gets the regularised Coulomb force
//!
//! ```text
//! F = -mu N (a^2 s_x, s_y) / q,    q = sqrt(a^2 s_x^2 + s_y^2 + r^2 omega^2 + eps^2 + k^2 V^2)
//! ```
//!
//! and the moment `-mu N r^2 omega / q` about its middle, with N its normal load, mu the friction where
//! it stands, `a` the share of mu that acts sideways, r the radius of gyration of its contact patch
//! (whose mean squared slip is that of its middle and r^2 omega^2), eps the slip scale and k the share of
//! the speed by which a rolling tyre's slip scale grows (H. B. Pacejka, "Tire and Vehicle Dynamics": its
//! force follows from slip over speed). Without
//! inertia, wheel forces and the weight's pull along the ground balance in both directions and in
//! moment: three equations for v_x, v_y and omega. They are the stationarity of the dissipation
//! potential
//!
//! ```text
//! P(v_x, v_y, omega) = sum mu N q + sum c N sqrt(u^2 + eps^2) - G . v_c
//! ```
//!
//! (c the soft ground's rolling resistance against a wheel's speed u, G the weight along the ground,
//! v_c the velocity of the centre of mass). P is strictly convex, so the balance has at most one
//! solution and a Newton method, which falls back on a majorising parabola where its step does not
//! lower P, reaches it from anywhere; it has none where the ground is steeper than friction holds,
//! which is reported. With a yaw inertia given, the kinetic term of an implicit Euler step is added to
//! P, which keeps it convex and the step stable at any length; a turn at speed then pushes the vehicle
//! outward.
//!
//! A vehicle with inertia may have tyres whose force F builds up over the relaxation length L:
//!
//! ```text
//! L dF/dt = w (F_s - F),    w = sqrt(V^2 + s_x^2 + s_y^2)
//! ```
//!
//! with F_s the force above (Pacejka, chapter 7, at constant load). The ground passes at the speed V of a wheel
//! that rolls; one that stands and is dragged has the slip instead, as J. E. Bernard and C. L. Clover let it in
//! "Tire modeling for low-speed and high-speed calculations" (SAE 950311). So at standstill a tyre is a spring
//! of the stiffness mu N / L that gives way at mu N, which is P. R. Dahl's model of friction (1968). A fiftieth
//! of F_s acts at once and damps it.
//!
//! What this leaves out: inertial load transfer, suspension travel, and the drive train, which imposes the
//! tread speeds regardless of the forces.
//!
//! Friction forces of sliding wheels in skid-steer turns follow O. Chuy et al., "Power modeling of a
//! skid steered wheeled robotic ground vehicle", ICRA 2009, and J. L. Martinez et al., "Approximating
//! kinematics for tracked mobile robots", IJRR 2005; the potential is the usual one of quasi-static
//! pushing under friction (S. Goyal, A. Ruina, J. Papadopoulos, "Planar sliding with dry friction",
//! Wear 1991), smoothed by eps.

mod balance;
mod friction;
mod known;
mod loads;
mod model;
mod parameters;
mod prediction;
mod relaxation;
mod vehicle;

pub use friction::{Friction, FrictionField};
pub(crate) use known::KnownContact;
pub use loads::GRAVITY_M_S2;
pub use model::ContactModel;
pub use parameters::{PARAMETERS, Parameter, ParameterVector};
pub use prediction::{
    BodyState, ContactPrediction, Followed, Following, FoundBalance, Lag, Predicted,
};
pub use vehicle::{Axle, CentreOfMass, ContactVehicle};

#[cfg(test)]
mod tests;
