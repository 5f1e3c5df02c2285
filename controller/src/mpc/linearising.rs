//! The plan of the cycle before, moved on, and the stages linearised about it.

use super::stage::{CostWeights, Stage};
use super::{ChangeWeights, Horizon, Mpc, StageTarget, vector};
use nalgebra::{Vector2, Vector3};
use sidehill_plant::frames::wrap_angle;
use sidehill_plant::speeds::MotorSpeeds;

impl Mpc {
    /// Returns the weights of a stage that ends with a heading error.
    pub(super) fn weights_of(
        &self,
        stage: usize,
        target: &StageTarget,
        heading_error_rad: f64,
        horizon: &Horizon,
    ) -> CostWeights {
        let (settings, step_s) = (&self.settings, self.times.step_s(stage));
        let mut errors = target.weights;
        errors.heading_per_rad2 += settings.heading_excess.weight(heading_error_rad);
        errors.heading_per_rad2 *= target.errors_share;
        errors.cross_per_m2 *= target.errors_share;
        // The cost is that of even stages, each of them a sample of an integral.
        let even_s = self.times.stretch() * settings.step_s;
        CostWeights {
            errors: errors.scaled(step_s / even_s),
            changes: ChangeWeights {
                traction: horizon.change_weights.traction / step_s,
                steer: horizon.change_weights.steer / step_s,
            },
        }
    }

    /// Returns the time for a change of the inputs to those of a stage, s.
    pub(super) fn change_time_s(&self, stage: usize) -> f64 {
        match stage {
            0 => self.settings.period_s,
            _ => self.times.step_s(stage - 1),
        }
    }

    /// Moves the plan on by `elapsed_s` to stages stretched by `stretch`: states are interpolated, inputs averaged over
    /// the new stages, what lies beyond the old end follows from the model with the last input kept.
    pub(super) fn shift(&mut self, elapsed_s: f64, stretch: f64, normal_at_end: &Vector3<f64>) {
        let last = self.settings.stages - 1;
        let elapsed_s = elapsed_s.clamp(0.0, self.times.duration_s());
        let old_end_s = self.times.end_s(last);
        let ratio = stretch / self.times.stretch();
        let (mut old, mut until) = (0, Vector2::zeros());
        let (mut before_s, mut before) = (elapsed_s, Vector2::zeros());
        for k in 0..=last + 1 {
            let new_s = match k.checked_sub(1) {
                Some(stage) => elapsed_s + ratio * self.times.end_s(stage),
                None => elapsed_s,
            };
            while old < last && self.times.end_s(old) < new_s {
                until += self.times.step_s(old) * both(self.plan.inputs[old]);
                old += 1;
            }
            let (step_s, input) = (self.times.step_s(old), self.plan.inputs[old]);
            let within_s = new_s - (self.times.end_s(old) - step_s);
            let (from, to) = (&self.plan.states[old], &self.plan.states[old + 1]);
            self.shifted.states[k] = if new_s <= old_end_s {
                from + within_s / step_s * (to - from)
            } else {
                let beyond_s = new_s - old_end_s;
                to + self
                    .model
                    .step_on_plane(normal_at_end, to.z, input, beyond_s)
                    .increment
            };
            // The integral of the inputs until here.
            let sum = until + within_s * both(input);
            if let Some(stage) = k.checked_sub(1) {
                let mean = (sum - before) / (new_s - before_s);
                self.shifted.inputs[stage] = MotorSpeeds {
                    traction_m_s: mean.x,
                    steer_m_s: mean.y,
                };
            }
            (before_s, before) = (new_s, sum);
        }
        self.times.set_stretch(stretch);
        std::mem::swap(&mut self.plan, &mut self.shifted);
    }

    /// Dynamics, errors and limits of each stage about the plan, whose first state becomes the horizon's start; its
    /// other states become those to which its inputs take the model from there. What the states were is left in
    /// `shifted`.
    pub(super) fn linearise_about_plan(&mut self, horizon: &Horizon) {
        self.shifted.states.copy_from_slice(&self.plan.states);
        let mut start = vector(&horizon.start);
        // The plan's heading is not wrapped; the state's turn count is taken from it.
        start.z = self.plan.states[0].z + wrap_angle(start.z - self.plan.states[0].z);
        self.plan.states[0] = start;
        let settings = &self.settings;
        let mut before = settings.limits.within_bounds(horizon.previous);
        let mut moving = horizon.moving;
        self.stages.clear();
        for (k, target) in horizon.targets.iter().enumerate() {
            let (state, input) = (self.plan.states[k], self.plan.inputs[k]);
            let step_s = self.times.step_s(k);
            let mut step = self.model.step_near(
                &mut self.starts[k],
                &target.normal_in_world,
                state.z,
                input,
                step_s,
                &mut moving,
            );
            step.increment += step_s * target.slip;
            self.plan.states[k + 1] = state + step.increment;
            let next = &self.plan.states[k + 1];
            let time_s = self.change_time_s(k);
            let along = target.along();
            let error = target.error_of(along, next);
            let weights = self.weights_of(k, target, error.state.z, horizon);
            self.stages.push(Stage {
                step,
                error: error.state,
                point_by_yaw_m: error.point_by_yaw_m,
                along,
                curvature_per_m: target.curvature_per_m,
                weights: weights.errors,
                speed_row: target.speed_row(along, &state, next, &step, step_s),
                speed_error: target.speed_error(along, &state, next, step_s),
                input,
                change_weights: weights.changes,
                damping: self.damping.s2_per_m2 * step_s / settings.step_s * self.times.stretch(),
                traction_change: settings.limits.traction.change(before.traction_m_s, time_s),
                steer_change: settings.limits.steer.change(before.steer_m_s, time_s),
            });
            before = input;
        }
    }
}

fn both(speeds: MotorSpeeds) -> Vector2<f64> {
    Vector2::new(speeds.traction_m_s, speeds.steer_m_s)
}
