//! Motion of a simulated vehicle by its ICR models.

use super::Vehicle;
use crate::frames::BodyVelocity;
use crate::motion::{GroundState, MotionError, MotionModel};
use crate::speeds::TreadSpeeds;

/// Motion by the exact ICR models: what the vehicle does if the model is the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct IcrMotion {
    /// The vehicle whose ICRs move it.
    pub vehicle: Vehicle,
    /// Whether the ICRs move with the attitude (ICRIK), with the terms of the vehicle's extension where
    /// it has one, or stay as on level ground (ICRHK).
    pub inclined: bool,
}

impl MotionModel for IcrMotion {
    fn body_velocity(
        &mut self,
        ground: &GroundState,
        treads: TreadSpeeds,
        _dt_s: f64,
    ) -> Result<BodyVelocity, MotionError> {
        Ok(if self.inclined {
            self.vehicle.extended_velocity(ground.attitude, treads)
        } else {
            self.vehicle.icrhk().body_velocity(treads)
        })
    }
}
