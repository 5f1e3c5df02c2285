//! The plan that a first QP is linearised about.

use super::model::StepStart;
use super::step_limit::Damping;
use super::{Horizon, Mpc, StageTarget, vector};
use nalgebra::Vector3;
use sidehill_plant::frames::wrap_angle;
use sidehill_plant::speeds::MotorSpeeds;

/// Slope of the way back to the path, for each metre beside it, 1/m.
const RETURN_PER_M: f64 = 2.0;
/// Rate at which the heading turns into that way, 1/s.
const TURN_PER_S: f64 = 1.5;
/// Rate at which the distance along the path is made good, 1/s.
const CATCH_UP_PER_S: f64 = 0.5;

impl Mpc {
    /// Puts a drive of the model into the plan that leads from where the vehicle is to the path and along it, within
    /// the limits.
    ///
    /// The cycles converge to the local optimum nearest to their first plan. With the targets as the plan's
    /// states, where a vehicle beside the path cannot be, that may be an optimum that reverses or waits first.
    pub(super) fn begin_plan(&mut self, horizon: &Horizon) {
        self.starts.fill(StepStart::default());
        self.damping = Damping::default();
        let limits = self.settings.limits;
        let mut state = vector(&horizon.start);
        let mut input = limits.within_bounds(horizon.previous);
        self.plan.states[0] = state;
        for (k, target) in horizon.targets.iter().enumerate() {
            let wanted = towards(target, &state, horizon.half_track_m);
            // A horizon that is no number ends in the QP's failure.
            if wanted.is_finite() {
                input = limits.project(wanted, input, self.change_time_s(k));
            }
            let step_s = self.times.step_s(k);
            let start = &mut self.starts[k];
            let step = self
                .model
                .step_near(start, &target.normal_in_world, state.z, input, step_s);
            state += step.increment + step_s * target.slip;
            self.plan.states[k + 1] = state;
            self.plan.inputs[k] = input;
        }
    }
}

/// Returns motor speeds that turn a vehicle towards the path of `target`, the more the farther it is beside it, and
/// that catch up with it.
fn towards(target: &StageTarget, state: &Vector3<f64>, half_track_m: f64) -> MotorSpeeds {
    let feedforward = target.feedforward;
    let error = target.error_of(state).state;
    let along = target.along();
    let ahead_m = along.0 * error.x + along.1 * error.y;
    let left_m = along.0 * error.y - along.1 * error.x;
    let mut turn_rad = -error.z;
    if feedforward.traction_m_s != 0.0 {
        turn_rad -= feedforward.traction_m_s.signum() * (RETURN_PER_M * left_m).atan();
    }
    let turn_rad = wrap_angle(turn_rad);
    MotorSpeeds {
        traction_m_s: feedforward.traction_m_s - CATCH_UP_PER_S * ahead_m,
        steer_m_s: feedforward.steer_m_s + half_track_m * TURN_PER_S * turn_rad,
    }
}
