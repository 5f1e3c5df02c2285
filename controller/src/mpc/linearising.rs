//! The plan of the cycle before, moved on, and the stages linearised about it.

use super::condensing::Stage;
use super::{ChangeWeights, Horizon, Mpc, vector};
use nalgebra::Vector3;
use sidehill_plant::frames::wrap_angle;
use sidehill_plant::speeds::MotorSpeeds;

impl Mpc {
    /// Returns the time for a change of the inputs to those of a stage, s.
    pub(super) fn change_time_s(&self, stage: usize) -> f64 {
        match stage {
            0 => self.settings.period_s,
            _ => self.times.step_s(stage - 1),
        }
    }

    /// Shifts the plan by `elapsed_s`, less than a stage: states are interpolated, inputs averaged
    /// over the new stages, the end follows from the model with the last input kept.
    pub(super) fn shift(&mut self, elapsed_s: f64, normal_at_end: &Vector3<f64>) {
        let elapsed_s = elapsed_s.clamp(0.0, self.times.step_s(0));
        let last = self.settings.stages - 1;
        for k in 0..=last {
            let ratio = elapsed_s / self.times.step_s(k);
            self.shifted.states[k] =
                (1.0 - ratio) * self.plan.states[k] + ratio * self.plan.states[k + 1];
            let (now, next) = (self.plan.inputs[k], self.plan.inputs[(k + 1).min(last)]);
            self.shifted.inputs[k] = MotorSpeeds {
                traction_m_s: (1.0 - ratio) * now.traction_m_s + ratio * next.traction_m_s,
                steer_m_s: (1.0 - ratio) * now.steer_m_s + ratio * next.steer_m_s,
            };
        }
        let end = &self.plan.states[last + 1];
        let step =
            self.model
                .step_on_plane(normal_at_end, end.z, self.plan.inputs[last], elapsed_s);
        self.shifted.states[last + 1] = end + step.increment;
        std::mem::swap(&mut self.plan, &mut self.shifted);
    }

    /// Dynamics, errors and limits of each stage about the plan, whose first state becomes the horizon's start. With a
    /// step limit its other states become those to which its inputs take the model from there. What the states
    /// were is left in `shifted`.
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
            if settings.step_limit.is_some() {
                self.plan.states[k + 1] = state + step.increment;
            }
            let next = &self.plan.states[k + 1];
            let time_s = self.change_time_s(k);
            let error = target.error_of(next);
            let mut weights = target.weights;
            weights.heading_per_rad2 += settings.heading_excess.weight(error.state.z);
            // The cost is that of even stages, each of them a sample of an integral.
            let mut factor = step_s / settings.step_s;
            if k + 1 == horizon.targets.len() {
                factor *= settings.terminal_factor;
            }
            self.stages.push(Stage {
                step,
                defect: state + step.increment - next,
                error: error.state,
                point_by_yaw_m: error.point_by_yaw_m,
                along: target.along(),
                weights: weights.scaled(factor),
                input,
                change_weights: ChangeWeights {
                    traction: horizon.change_weights.traction / step_s,
                    steer: horizon.change_weights.steer / step_s,
                },
                damping: self.damping.s2_per_m2 * step_s / settings.step_s,
                traction_change: settings.limits.traction.change(before.traction_m_s, time_s),
                steer_change: settings.limits.steer.change(before.steer_m_s, time_s),
            });
            before = input;
        }
    }
}
