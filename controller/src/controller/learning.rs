//! What a controller has learned, and where it begins with what was learned before.

use super::{Controller, Law};
use crate::estimator::{Estimate, LearnedGains, SLIP_SMOOTHING_M_S};
use crate::memory::{CELLS, Learned, RecallError, Step};
use crate::path::Point2;
use crate::reference::PROJECTION_WINDOW;
use nalgebra::{DMatrix, Rotation3, Vector3};
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::sample::Sample;
use sidehill_plant::slip_gains::Terms;
use sidehill_plant::speeds::{MotorSpeeds, TreadSpeeds};

impl Controller {
    /// Returns everything that was learned, to be kept; none where memory is off.
    pub fn learned(&self) -> Option<Learned> {
        let mut learned = self.room_for_learned()?;
        if !self.learned_into(&mut learned) {
            learned.gains = None;
        }
        Some(learned)
    }

    /// Returns the covariance of what is learned while driving, as
    /// [`Estimator::learned_covariance`](crate::estimator::Estimator::learned_covariance) has it; none where nothing is
    /// learned.
    pub fn learned_covariance(&self) -> Option<DMatrix<f64>> {
        let covariance = self.estimator.learned_covariance()?;
        self.adapts.then_some(covariance)
    }

    /// Returns room for what will be learned; none where memory is off.
    pub fn room_for_learned(&self) -> Option<Learned> {
        let memory = self.memory.as_ref()?;
        Some(Learned {
            owner: self.owner.clone(),
            gains: self.adapts.then(LearnedGains::room),
            cell_m: memory.config.cell_m,
            cells: Vec::with_capacity(CELLS),
        })
    }

    /// Puts everything that was learned into room for it, without allocating; returns whether there are gains
    /// where there can be any.
    pub fn learned_into(&self, learned: &mut Learned) -> bool {
        if let Some(memory) = &self.memory {
            learned.cells.clear();
            learned.cells.extend(memory.cells());
        }
        match &mut learned.gains {
            Some(gains) => self.estimator.learned_into(gains),
            None => true,
        }
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

    /// Measures the vehicle's distance from its path at the time of its newest pose, and the motion that the
    /// model does not have.
    pub(super) fn learn_places(&mut self, estimate: &Estimate, sample: &Sample, elapsed_s: f64) {
        let point = self.tracked_point();
        let (Some(memory), Some(reference), Law::Mpc(mpc)) =
            (&mut self.memory, &self.reference, &mut self.law)
        else {
            return;
        };
        let (true, Some(path)) = (memory.config.by_place, reference.driven_path()) else {
            return;
        };
        let motors = MotorSpeeds::from(estimate.treads);
        let step = mpc.model_mut().step_on_plane(
            &estimate.normal_in_world,
            estimate.pose.yaw_rad,
            motors,
            elapsed_s,
        );
        // The speeds are those of the time since the cycle before, when the heading was another.
        let moved =
            Rotation3::from_axis_angle(&Vector3::z_axis(), -step.increment.z) * step.increment;
        memory.step(&Step {
            time_s: sample.time_s,
            moved,
            terms: Terms::at(estimate.attitude, motors.steer_m_s, SLIP_SMOOTHING_M_S).value,
            speed_m_s: motors.traction_m_s,
        });
        let Some(pose) = &sample.pose else { return };
        let planar = pose.value.planar();
        let stands = estimate.treads == TreadSpeeds::default();
        if stands || estimate.poses_gated > 0 {
            return;
        }
        if !(planar.x_m.is_finite() && planar.y_m.is_finite() && planar.yaw_rad.is_finite()) {
            return;
        }
        let around_m = reference.ahead(0.0).arc_length_m;
        let place = |at: &PlanarPose| {
            let at = point.of(at, &estimate.normal_in_world);
            let seen = Point2 {
                x_m: at.x_m,
                y_m: at.y_m,
            };
            let place = path
                .nearest_within(&seen, around_m, &PROJECTION_WINDOW)
                .point
                .pose();
            let (sin, cos) = place.yaw_rad.sin_cos();
            let right_m = cos * (seen.x_m - place.x_m) + sin * (seen.y_m - place.y_m);
            (place, right_m)
        };
        let excess = memory.pose(pose.time_s, planar);
        let (here, right_m) = place(&planar);
        let way_m = elapsed_s * motors.traction_m_s.abs();
        memory.learn_error(sample.time_s, &here, right_m, way_m);
        if let Some(excess) = excess {
            let (middle, right_m) = place(&excess.middle);
            memory.learn_slip(&excess, &middle, right_m, sample.time_s);
        }
    }
}
