//! A drive towards the path: the plan that a first QP is linearised about, and a later one that got stuck.

use super::following::stage_cost;
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

/// Share of its cost below which the plan is given up for a drive towards the path.
const BETTER_SHARE: f64 = 0.8;
/// Error across the path all along the horizon, m, whose cost leaves too little to gain for a drive to be tried.
const GOOD_ERROR_M: f64 = 0.02;

impl Mpc {
    /// Begins the plan with a drive towards the path.
    ///
    /// The cycles converge to the local optimum nearest to their first plan. With the targets as the plan's
    /// states, where a vehicle beside the path cannot be, that may be an optimum that reverses or waits first.
    pub(super) fn begin_plan(&mut self, horizon: &Horizon) {
        self.starts.fill(StepStart::default());
        self.damping = Damping::default();
        self.shifted.states[0] = vector(&horizon.start);
        self.stages.clear();
        self.drive_towards_path(horizon, f64::INFINITY);
        std::mem::swap(&mut self.plan, &mut self.shifted);
    }

    /// Puts a drive towards the path in the place of the plan, whose cost is `cost`, where it is far better: noise and
    /// inertia can lead the cycles to a local optimum, such as one that waits while the vehicle slides.
    pub(super) fn begin_anew_where_better(&mut self, horizon: &Horizon, cost: f64) {
        let weights = self.stages.iter().map(|stage| stage.weights.cross_per_m2);
        if cost <= GOOD_ERROR_M.powi(2) * weights.sum::<f64>() {
            return;
        }
        self.shifted.states[0] = self.plan.states[0];
        if self.drive_towards_path(horizon, BETTER_SHARE * cost) {
            std::mem::swap(&mut self.plan, &mut self.shifted);
            self.damping = Damping::default();
        }
    }

    /// Puts a drive of the model into `shifted`, from its first state to the path and along it, within the limits.
    /// Ends where it costs `too_much` and returns whether it did not. Without stages it costs nothing.
    fn drive_towards_path(&mut self, horizon: &Horizon, too_much: f64) -> bool {
        let limits = self.settings.limits;
        let mut cost = 0.0;
        let mut state = self.shifted.states[0];
        let mut moving = horizon.moving;
        let mut before = limits.within_bounds(horizon.previous);
        for (k, target) in horizon.targets.iter().enumerate() {
            let wanted = towards(target, &state, horizon.half_track_m);
            // A horizon that is no number ends in the QP's failure.
            let input = if wanted.is_finite() {
                limits.project(wanted, before, self.change_time_s(k))
            } else {
                before
            };
            state += self.increment(k, target, state.z, input, &mut moving);
            self.shifted.states[k + 1] = state;
            self.shifted.inputs[k] = input;
            if let Some(stage) = self.stages.get(k) {
                cost += stage_cost(stage, target, &state, input, before);
                if cost >= too_much {
                    return false;
                }
            }
            before = input;
        }
        true
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
