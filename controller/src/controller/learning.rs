//! What a controller has learned, and where it begins with what was learned before.

use super::Controller;
use crate::estimator::Estimate;
use crate::memory::{Learned, RecallError};
use crate::path::Point2;
use crate::reference::PROJECTION_WINDOW;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::sample::Sample;

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
    /// [`RecallError`] if it belongs to another one or is not plausible; nothing is then taken over.
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

    /// Measures the vehicle's distance from its path at the time of its newest pose.
    pub(super) fn learn_error(&mut self, estimate: &Estimate, sample: &Sample) {
        let point = self.tracked_point();
        let (Some(memory), Some(reference), Some(pose)) =
            (&mut self.memory, &self.reference, &sample.pose)
        else {
            return;
        };
        let moving = estimate.treads.left_m_s != 0.0 || estimate.treads.right_m_s != 0.0;
        let (Some(path), true) = (reference.path(), moving && estimate.poses_gated == 0) else {
            return;
        };
        let pose = point.of(&pose.value.planar(), &estimate.normal_in_world);
        let seen = Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        };
        if seen.x_m.is_finite() && seen.y_m.is_finite() {
            let around_m = reference.ahead(0.0).arc_length_m;
            let nearest = path
                .nearest_within(&seen, around_m, &PROJECTION_WINDOW)
                .point;
            let place = PlanarPose {
                x_m: nearest.position.x_m,
                y_m: nearest.position.y_m,
                yaw_rad: nearest.heading_rad,
            };
            memory.observe(sample.time_s, &seen, &place);
        }
    }
}
