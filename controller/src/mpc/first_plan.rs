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

/// Share of its cost below which the plan is given up for a drive towards the path.
const BETTER_SHARE: f64 = 0.8;
/// Error across the path all along the horizon, m, whose cost leaves too little to gain for a drive to be tried.
const GOOD_ERROR_M: f64 = 0.02;

impl Mpc {
    /// Returns whether there is no plan, or one so costly that a drive towards the path may be better: noise and
    /// inertia can lead the cycles to a local optimum, such as one that waits while the vehicle slides.
    pub fn wants_first_plan(&self) -> bool {
        let good = GOOD_ERROR_M.powi(2) * self.settings.cross_per_m2 * self.settings.stages as f64;
        !self.planned || self.cost > good
    }

    /// Puts a drive of the model towards the path and along it, within the limits, in the place of the plan where there
    /// is none or that is far better. `target` returns what is asked of a stage that ends at a time in the horizon, at a state.
    ///
    /// The cycles converge to the local optimum nearest to their first plan. With the targets as the plan's
    /// states, where a vehicle beside the path cannot be, that may be an optimum that reverses or waits first.
    pub fn try_first_plan(
        &mut self,
        horizon: &Horizon,
        mut target: impl FnMut(f64, &Vector3<f64>, MotorSpeeds) -> StageTarget,
    ) {
        let too_much = if self.planned {
            BETTER_SHARE * self.cost
        } else {
            self.starts.fill(StepStart::default());
            f64::INFINITY
        };
        let limits = self.settings.limits;
        let mut cost = 0.0;
        let mut state = vector(&horizon.start);
        let mut moving = horizon.moving;
        let mut before = limits.within_bounds(horizon.previous);
        let mut asked = target(0.0, &state, before);
        self.shifted.states[0] = state;
        for k in 0..self.settings.stages {
            let wanted = towards(&asked, &state, horizon.half_track_m);
            // A horizon that is no number ends in the QP's failure.
            let input = if wanted.is_finite() {
                limits.project(wanted, before, self.change_time_s(k))
            } else {
                before
            };
            let from = state;
            state += self.increment(k, &asked, state.z, input, &mut moving);
            self.shifted.states[k + 1] = state;
            self.shifted.inputs[k] = input;
            asked = target(self.times.end_s(k), &state, input);
            let along = asked.along();
            let error = asked.error_of(along, &state).state;
            let weights = self.weights_of(k, &asked, error.z, horizon);
            let way = (&from, &state, self.times.step_s(k));
            cost += stage_cost(&weights, &asked, along, way, input, before);
            cost += self.extra_cost(k, self.shifted.states[0].z, way.1, input);
            if cost >= too_much {
                return;
            }
            before = input;
        }
        std::mem::swap(&mut self.plan, &mut self.shifted);
        self.planned = true;
        self.damping = Damping::default();
    }
}

/// Returns motor speeds that turn a vehicle towards the path of `target`, the more the farther it is beside it.
fn towards(target: &StageTarget, state: &Vector3<f64>, half_track_m: f64) -> MotorSpeeds {
    let feedforward = target.feedforward;
    let along = target.along();
    let error = target.error_of(along, state).state;
    let left_m = along.0 * error.y - along.1 * error.x;
    let mut turn_rad = -error.z;
    if feedforward.traction_m_s != 0.0 {
        turn_rad -= feedforward.traction_m_s.signum() * (RETURN_PER_M * left_m).atan();
    }
    let turn_rad = wrap_angle(turn_rad);
    MotorSpeeds {
        traction_m_s: feedforward.traction_m_s,
        steer_m_s: feedforward.steer_m_s + half_track_m * TURN_PER_S * turn_rad,
    }
}
