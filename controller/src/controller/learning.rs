//! What a controller has learned, and where it begins with what was learned before.

use super::Controller;
use super::parts::Law;
use crate::estimator::Estimate;
use crate::memory::{Learned, RecallError};

impl Controller {
    /// Returns everything that was learned, to be kept; none where memory is off.
    pub fn learned(&self) -> Option<Learned> {
        let memory = self.memory.as_ref()?;
        Some(Learned {
            owner: self.owner.clone(),
            gains: self.estimator.learned().filter(|_| self.adapts),
            cell_m: memory.config.cell_m,
            cells: memory.cells(),
        })
    }

    /// Begins with what was learned before, by this vehicle under this controller.
    ///
    /// # Errors
    /// [`RecallError`] for what belongs to another one or makes no sense; nothing is then taken over.
    pub fn recall(&mut self, learned: &Learned) -> Result<(), RecallError> {
        let memory = self.memory.as_mut().ok_or(RecallError::Off)?;
        if learned.owner != self.owner {
            return Err(RecallError::Foreign {
                found: learned.owner.clone(),
                expected: self.owner.clone(),
            });
        }
        if learned.cell_m != memory.config.cell_m {
            return Err(RecallError::Wrong("cells have another size"));
        }
        if let Some(gains) = &learned.gains {
            self.estimator.recall(gains).map_err(RecallError::Wrong)?;
        }
        memory.recall(&learned.cells);
        Ok(())
    }

    /// Measures the residual slip of the cycle that is over.
    pub(super) fn learn_place(&mut self, estimate: &Estimate, elapsed_s: f64) {
        let (Some(memory), Law::Mpc(mpc)) = (&mut self.memory, &mut self.law) else {
            return;
        };
        if estimate.poses_gated > 0 {
            return memory.reset();
        }
        let step = mpc.model_mut().step_on_plane(
            &estimate.normal_in_world,
            estimate.pose.yaw_rad,
            estimate.treads.into(),
            elapsed_s,
        );
        memory.observe(estimate.time_s, &estimate.pose, &step.increment);
    }
}
