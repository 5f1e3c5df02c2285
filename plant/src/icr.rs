//! The exact tread-ICR models: ICRHK (4) on level ground and ICRIK (5)-(10) with its limits.

use crate::frames::{Attitude, BodyVelocity};
use crate::speeds::TreadSpeeds;
use crate::vehicle::Vehicle;

/// Positions of the two treads' instantaneous centres of rotation, in the body frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TreadIcrs {
    /// x_ICR^l, m to the right of the origin (negative: on the left).
    pub left_m: f64,
    /// x_ICR^r, m to the right of the origin.
    pub right_m: f64,
    /// y_ICR of both, m ahead of the origin.
    pub forward_m: f64,
}

impl TreadIcrs {
    /// Returns the body velocity for these ICRs and tread speeds: equation (4).
    ///
    /// Total for ICRs of a validated [`Vehicle`], whose distance is at least the base's width.
    pub fn body_velocity(&self, treads: TreadSpeeds) -> BodyVelocity {
        let (x_l, x_r, y) = (self.left_m, self.right_m, self.forward_m);
        let (v_l, v_r) = (treads.left_m_s, treads.right_m_s);
        let distance = x_r - x_l;
        BodyVelocity {
            right_m_s: y * (v_r - v_l) / distance,
            forward_m_s: (x_r * v_l - x_l * v_r) / distance,
            yaw_rate_rad_s: (v_r - v_l) / distance,
        }
    }
}

impl Vehicle {
    /// Returns the tread ICRs on level ground (ICRHK).
    pub fn icrhk(&self) -> TreadIcrs {
        TreadIcrs {
            left_m: self.icrs.left_m,
            right_m: self.icrs.right_m,
            forward_m: self.icrs.forward_m,
        }
    }

    /// Returns the tread ICRs at an attitude (ICRIK): equations (5)-(10), then the limits.
    ///
    /// Symbols: alpha, phi roll and pitch (rad), V_l, V_r the corrected tread speeds (m/s). The gain
    /// g = v_y^m - |V_r + V_l|/2 is meant for speeds up to v_y^m; beyond it is held at 0, which is
    /// this project's extension: a vehicle faster than identified does not slide uphill.
    pub fn icrik(&self, attitude: Attitude, treads: TreadSpeeds) -> TreadIcrs {
        let (alpha, phi) = (attitude.roll_rad, attitude.pitch_rad);
        let (v_l, v_r) = (treads.left_m_s, treads.right_m_s);
        let (lambda_1, lambda_2) = (self.slide.shift_s_per_rad, self.slide.aggravated_s_per_rad);
        let sign = if v_r > v_l {
            1.0
        } else if v_r < v_l {
            -1.0
        } else {
            0.0
        }; // (8)
        let g = (self.speed_max_m_s - 0.5 * (v_r + v_l).abs()).max(0.0);
        let mut x_l = self.icrs.left_m + sign * g * lambda_1 * phi; // (5)
        let mut x_r = self.icrs.right_m + sign * g * lambda_1 * phi; // (6)
        let mut y = self.icrs.forward_m + sign * g * lambda_1 * alpha; // (7)
        if sign != 0.0 && phi.abs() > alpha.abs() {
            let shift = (1.0 - (alpha / phi).abs()) * sign * g * lambda_2 * phi;
            if sign * phi < 0.0 {
                x_l += shift; // (9)
            } else {
                x_r += shift; // (10)
            }
        }
        x_l = x_l.min(-self.base_half_width_m);
        x_r = x_r.max(self.base_half_width_m);
        y = y.clamp(-self.base_half_length_m, self.base_half_length_m);
        TreadIcrs {
            left_m: x_l,
            right_m: x_r,
            forward_m: y,
        }
    }

    /// Returns the body velocity of ICRIK: equations (5)-(10), the limits and (4).
    pub fn body_velocity(&self, attitude: Attitude, treads: TreadSpeeds) -> BodyVelocity {
        self.icrik(attitude, treads).body_velocity(treads)
    }
}
