//! What turns tread speeds into a body velocity; the simulation integrates the result.

use crate::frames::{Attitude, BodyVelocity, PlanarPose};
use crate::speeds::TreadSpeeds;

/// Where the vehicle is when its motion is computed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GroundState {
    /// Position and heading in the world.
    pub position: PlanarPose,
    /// Roll and pitch of the ground there, at that heading.
    pub attitude: Attitude,
}

/// Why a model could not give a body velocity.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// The model's equations were not solved to their tolerance.
    #[error(
        "motion not solved at x {x_m} m, y {y_m} m: residual {residual} after {iterations} iterations"
    )]
    NotConverged {
        /// Norm of what the equations leave over, in the model's own scaling.
        residual: f64,
        /// Iterations spent.
        iterations: usize,
        /// X_g of the vehicle, m.
        x_m: f64,
        /// Y_g of the vehicle, m.
        y_m: f64,
    },
    /// The weight acts outside the wheels' support.
    #[error("the vehicle overturns at x {x_m} m, y {y_m} m")]
    Overturned {
        /// X_g of the vehicle, m.
        x_m: f64,
        /// Y_g of the vehicle, m.
        y_m: f64,
    },
    /// The model was given, or gave, a number that is not finite.
    #[error("{quantity} is not finite at x {x_m} m, y {y_m} m")]
    NotFinite {
        /// What is not finite.
        quantity: &'static str,
        /// X_g of the vehicle, m.
        x_m: f64,
        /// Y_g of the vehicle, m.
        y_m: f64,
    },
}

/// What moves the vehicle: body velocity for tread speeds at a place and attitude.
pub trait MotionModel {
    /// Returns the body velocity at `ground` for the effective tread speeds `treads`.
    ///
    /// `dt_s` is the step that follows, s (0 for a purely kinematic query); models with memory
    /// advance by it.
    ///
    /// # Errors
    /// Returns why the model has no answer at this place, see [`MotionError`].
    fn body_velocity(
        &mut self,
        ground: &GroundState,
        treads: TreadSpeeds,
        dt_s: f64,
    ) -> Result<BodyVelocity, MotionError>;

    /// Returns the body velocity at `ground` while brakes hold both treads; as [`Self::body_velocity`] otherwise.
    ///
    /// # Errors
    /// As [`Self::body_velocity`].
    fn braked_velocity(
        &mut self,
        ground: &GroundState,
        dt_s: f64,
    ) -> Result<BodyVelocity, MotionError> {
        self.body_velocity(ground, TreadSpeeds::default(), dt_s)
    }
}

/// A motion model that a simulation takes along when it is copied: every one that can be.
pub trait Motion: MotionModel + Send {
    /// Returns a copy with the same memory.
    fn copied(&self) -> Box<dyn Motion>;
}

impl<M: MotionModel + Clone + Send + 'static> Motion for M {
    fn copied(&self) -> Box<dyn Motion> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn Motion> {
    fn clone(&self) -> Self {
        (**self).copied()
    }
}
