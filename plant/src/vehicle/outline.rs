use super::Vehicle;
use serde::Serialize;

/// A vehicle from above, for maps, m.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outline {
    /// Length and width of the body.
    pub body: [f64; 2],
    /// Of each wheel: how far it is ahead and to the left of the origin, its diameter and its width.
    pub wheels: Vec<[f64; 4]>,
}

/// Largest radius of a wheel that is drawn, m: vehicle files have none.
const RADIUS_MAX_M: f64 = 0.3;

impl Vehicle {
    /// Returns body and wheels as they are drawn: the wheels stand where the contact vehicle has them, each side as one
    /// behind the other, and the body is between them.
    pub fn outline(&self) -> Outline {
        let (half_width_m, half_length_m) = (self.base_half_width_m, self.base_half_length_m);
        let contact = self.contact_vehicle();
        let radius_m = (half_length_m / contact.axles.len().max(2) as f64).min(RADIUS_MAX_M);
        let wheels = contact.axles.iter().flat_map(|axle| {
            [contact.half_width_m, -contact.half_width_m]
                .map(|left_m| [axle.forward_m, left_m, 2.0 * radius_m, 0.25 * half_width_m])
        });
        Outline {
            body: [2.0 * half_length_m, 1.5 * half_width_m],
            wheels: wheels.collect(),
        }
    }
}
