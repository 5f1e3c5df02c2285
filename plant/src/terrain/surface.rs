//! Height and slope of the ground at one place.

use nalgebra::Vector3;

/// The ground at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Height Z_g, m.
    pub height_m: f64,
    /// Upward unit normal, (-dh/dX_g, -dh/dY_g, 1) normalised.
    pub normal_in_world: Vector3<f64>,
}

impl Surface {
    /// Returns the surface of this height and this gradient (dh/dX_g, dh/dY_g).
    pub fn from_gradient(height_m: f64, gradient_in_world: [f64; 2]) -> Self {
        let [along_x, along_y] = gradient_in_world;
        Self {
            height_m,
            normal_in_world: Vector3::new(-along_x, -along_y, 1.0).normalize(),
        }
    }

    /// Returns (dh/dX_g, dh/dY_g).
    pub fn gradient_in_world(&self) -> [f64; 2] {
        let n = &self.normal_in_world;
        [-n.x / n.z, -n.y / n.z]
    }
}
