//! Tyres whose force builds up over a length.

use super::balance::{Balance, Contact, Velocity};
use super::friction::Friction;
use nalgebra::Vector3;

/// The forces of all wheels, which follow those of their slip over the relaxation length.
///
/// Over a step `dt`, `F = k F_before + (1 - k) F_s` with `k = exp(-w dt / L)`. What is kept acts as a given
/// force, the rest as friction of a smaller coefficient, so the balance stays convex.
#[derive(Debug, Clone)]
pub(super) struct Relaxation {
    length_m: f64,
    tyres: Vec<Tyre>,
}

#[derive(Debug, Clone, Copy)]
struct Tyre {
    /// F: N to the right and forward and, about the wheel's own middle, N m.
    force: Vector3<f64>,
    /// k of the step.
    kept: f64,
}

/// Share of friction that follows slip at once: it damps the tyre, which otherwise swings as a spring under the
/// vehicle's mass. Its damping ratio is then about 0.1 at walking speed.
pub(super) const DAMPING_SHARE: f64 = 0.02;

impl Relaxation {
    /// Returns the tyres before their first step; none where the force follows the slip at once.
    pub(super) fn of(friction: &Friction) -> Option<Self> {
        (friction.relaxation_length_m > 0.0).then(|| Self {
            length_m: friction.relaxation_length_m,
            tyres: Vec::new(),
        })
    }

    /// Leaves the contacts the share of friction that acts within a step of `dt_s`, and returns what the tyres keep:
    /// newtons to the right and forward, and the moment about the origin, N m.
    ///
    /// Before the first step the tyres hold the vehicle as in the balance without inertia under `drive`.
    pub(super) fn begin(
        &mut self,
        friction: &Friction,
        contacts: &mut [Contact],
        velocity: &Velocity,
        drive: Vector3<f64>,
        dt_s: f64,
    ) -> Vector3<f64> {
        if self.tyres.len() != contacts.len() {
            self.tyres = tyres_at_rest(friction, contacts, velocity, drive);
        }
        let mut total = Vector3::zeros();
        for (contact, tyre) in contacts.iter_mut().zip(&mut self.tyres) {
            if contact.load_n <= 0.0 {
                tyre.force = Vector3::zeros();
            }
            let slip = contact.slip(friction, velocity);
            let passing_m_s = contact.tread_m_s.hypot(slip.x).hypot(slip.y);
            tyre.kept = (-passing_m_s * dt_s / self.length_m).exp();
            contact.friction *= tyre.share_at_once();
            let force = (1.0 - DAMPING_SHARE) * tyre.kept * tyre.force;
            let (x, y) = (contact.position.x, contact.position.y);
            total += Vector3::new(force.x, force.y, x * force.y - y * force.x + force.z);
        }
        total
    }

    /// Takes over what friction gave at the end of the step that [`Relaxation::begin`] began.
    pub(super) fn end(&mut self, friction: &Friction, contacts: &[Contact], velocity: &Velocity) {
        for (contact, tyre) in contacts.iter().zip(&mut self.tyres) {
            let settled = contact.friction_force(friction, velocity) / tyre.share_at_once();
            tyre.force = tyre.kept * tyre.force + (1.0 - tyre.kept) * settled;
        }
    }
}

impl Tyre {
    fn share_at_once(&self) -> f64 {
        DAMPING_SHARE + (1.0 - DAMPING_SHARE) * (1.0 - self.kept)
    }
}

/// Returns tyres with the forces of the balance without inertia; without any where friction does not hold the
/// vehicle.
fn tyres_at_rest(
    friction: &Friction,
    contacts: &[Contact],
    velocity: &Velocity,
    drive: Vector3<f64>,
) -> Vec<Tyre> {
    let balance = Balance {
        contacts,
        friction,
        drive,
        inertia: None,
    };
    let held = balance.solve(*velocity).ok();
    let force = |contact: &Contact| {
        held.map_or_else(Vector3::zeros, |at| contact.friction_force(friction, &at))
    };
    contacts
        .iter()
        .map(|contact| Tyre {
            force: force(contact),
            kept: 1.0,
        })
        .collect()
}
