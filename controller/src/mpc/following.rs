//! The plan moved to a QP's solution, as far as the model itself confirms it.

use super::assembling::COST_SCALE;
use super::extra::row_size;
use super::stage::CostWeights;
use super::step_limit::{HALVINGS, StepCosts, StepLimit};
use super::{Horizon, Mpc, Plan, StageTarget};
use nalgebra::Vector3;
use sidehill_plant::contact::BodyState;
use sidehill_plant::speeds::MotorSpeeds;

impl Mpc {
    /// Moves the plan to the QP's solution, or as far as the model confirms it.
    pub(super) fn follow(&mut self, horizon: &Horizon) {
        if let Some(extra) = &mut self.extra {
            let (qp, multipliers) = (self.solver.qp(), &self.solver.point().multipliers);
            let mut largest = 0.0_f64;
            for k in 0..self.stages.len() {
                let own = &multipliers[qp.extra_rows(k)];
                for (row, multiplier) in extra.terms.rows(k).iter().zip(own) {
                    largest = largest.max(multiplier.abs() / row_size(row));
                }
            }
            // The QP's cost is half of the plan's, times the scale.
            extra.set_price(2.0 / COST_SCALE * largest);
        }
        let before = self.cost_of(&self.plan, horizon);
        let cost = self.apply_within(self.settings.step_limit, before, horizon);
        self.cost = cost;
    }

    /// Moves the plan's inputs by a share of the QP's solution, and its states to where the linearised dynamics take
    /// these inputs from the vehicle's place.
    fn apply(&mut self, share: f64) {
        let mut deviation = Vector3::zeros();
        let corrections = &self.solver.point().rollout.inputs;
        for ((k, stage), [traction_m_s, steer_m_s]) in
            self.stages.iter().enumerate().zip(corrections)
        {
            let step = &stage.step;
            deviation += step.by_yaw * deviation.z
                + share * (step.by_traction * *traction_m_s + step.by_steer * *steer_m_s);
            self.plan.states[k + 1] += deviation;
            self.plan.inputs[k] = MotorSpeeds {
                traction_m_s: stage.input.traction_m_s + share * traction_m_s,
                steer_m_s: stage.input.steer_m_s + share * steer_m_s,
            };
        }
    }

    /// Returns the largest correction of planned steer in the QP's solution, m/s.
    fn largest_steer_correction_m_s(&self) -> f64 {
        let corrections = self.solver.point().rollout.inputs.iter();
        corrections.fold(0.0, |m, [_, steer_m_s]| m.max(steer_m_s.abs()))
    }

    /// Moves the plan as far as the linearisation is accurate, see [`step_limit`](super::step_limit). The plan's states
    /// are then those of the model itself: a gap between states and inputs would be taken for a reduction of the cost
    /// in the cycles to come. `before` is what its inputs cost until now; returns what they cost then.
    ///
    /// A try that costs too much is not run to its end.
    fn apply_within(&mut self, limit: StepLimit, before: f64, horizon: &Horizon) -> f64 {
        let mut share = limit.first_share(self.largest_steer_correction_m_s());
        self.shifted.states.copy_from_slice(&self.plan.states);
        self.shifted.inputs.copy_from_slice(&self.plan.inputs);
        let mut halvings = 0;
        loop {
            self.apply(share);
            let mut costs = StepCosts {
                before,
                predicted: self.cost_of(&self.plan, horizon),
                actual: f64::INFINITY,
            };
            let largest = if halvings == HALVINGS {
                f64::INFINITY
            } else {
                costs.largest(limit.accepted_share)
            };
            costs.actual = self.roll_out(horizon, largest);
            if halvings == 0 {
                self.damping.learn(&costs, &limit);
            }
            if halvings == HALVINGS || costs.achieve(limit.accepted_share) {
                std::mem::swap(&mut self.plan.states, &mut self.rolled);
                return costs.actual;
            }
            halvings += 1;
            share *= 0.5;
            self.plan.states.copy_from_slice(&self.shifted.states);
        }
    }

    /// Returns the cost of a plan as its states have it.
    pub(super) fn cost_of(&self, plan: &Plan, horizon: &Horizon) -> f64 {
        let mut cost = 0.0;
        let mut before = self.settings.limits.within_bounds(horizon.previous);
        for (k, stage) in self.stages.iter().enumerate() {
            let (input, target) = (plan.inputs[k], &horizon.targets[k]);
            let way = (&plan.states[k], &plan.states[k + 1], self.times.step_s(k));
            cost += stage_cost(&stage.weights(), target, stage.along, way, input, before);
            cost += self.extra_cost(k, plan.states[0].z, way.1, input);
            before = input;
        }
        cost
    }

    /// Runs the plan's inputs through the model from the plan's first state into `rolled`, and returns the cost. Ends
    /// where it is above `largest`, with a cost of infinity.
    fn roll_out(&mut self, horizon: &Horizon, largest: f64) -> f64 {
        let mut cost = 0.0;
        let mut before = self.settings.limits.within_bounds(horizon.previous);
        let mut state = self.plan.states[0];
        let mut moving = horizon.moving;
        self.rolled[0] = state;
        for (k, stage) in self.stages.iter().enumerate() {
            let (input, target) = (self.plan.inputs[k], &horizon.targets[k]);
            let from = state;
            state += self.increment(k, target, state.z, input, &mut moving);
            self.rolled[k + 1] = state;
            let way = (&from, &state, self.times.step_s(k));
            cost += stage_cost(&stage.weights(), target, stage.along, way, input, before);
            cost += self.extra_cost(k, self.plan.states[0].z, way.1, input);
            if cost > largest {
                return f64::INFINITY;
            }
            before = input;
        }
        cost
    }

    /// Returns what the extra terms cost of a stage that ends in `state`, of a plan whose first heading is
    /// `first_yaw_rad`; 0 without such terms.
    pub(super) fn extra_cost(
        &self,
        stage: usize,
        first_yaw_rad: f64,
        state: &Vector3<f64>,
        input: MotorSpeeds,
    ) -> f64 {
        self.extra
            .as_ref()
            .map_or(0.0, |extra| extra.cost(stage, first_yaw_rad, state, input))
    }

    /// Returns the increment of the state over a stage by the model itself, of a vehicle that moved as `moving`,
    /// which becomes that at the stage's end.
    pub(super) fn increment(
        &self,
        stage: usize,
        target: &StageTarget,
        yaw_rad: f64,
        input: MotorSpeeds,
        moving: &mut BodyState,
    ) -> Vector3<f64> {
        let step_s = self.times.step_s(stage);
        self.model.increment_near(
            &self.starts[stage],
            &target.normal_in_world,
            yaw_rad,
            input,
            step_s,
            moving,
        ) + step_s * target.slip
    }
}

/// Returns the cost of a stage that goes from one state to another in a time, s.
pub(super) fn stage_cost(
    weights: &CostWeights,
    target: &StageTarget,
    (along_x, along_y): (f64, f64),
    (from, to, step_s): (&Vector3<f64>, &Vector3<f64>, f64),
    input: MotorSpeeds,
    before: MotorSpeeds,
) -> f64 {
    let error = target.error_of((along_x, along_y), to).state;
    let speed = target.speed_error((along_x, along_y), from, to, step_s);
    let along = along_x * error.x + along_y * error.y;
    let cross = along_x * error.y - along_y * error.x;
    let (errors, changes) = (&weights.errors, &weights.changes);
    errors.along_per_m2 * along * along
        + errors.cross_per_m2 * cross * cross
        + errors.heading_per_rad2 * error.z * error.z
        + errors.speed_s2_per_m2 * speed * speed
        + changes.traction * (input.traction_m_s - before.traction_m_s).powi(2)
        + changes.steer * (input.steer_m_s - before.steer_m_s).powi(2)
}
