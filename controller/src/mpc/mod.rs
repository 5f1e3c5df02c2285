//! The model-predictive controller: ICRIK linearised about the previous plan, one QP a cycle.

mod clarabel_qp;
mod condensing;
mod dual_active_set;
pub mod limits;
mod problem;
mod qp;
mod rows;
mod settings;
mod structure;
mod working_set;

pub use condensing::StageWeights;
pub use problem::{CscMatrix, Point, QpData, Residuals};
pub use qp::{QpFailure, QpSolver, SolvePath};
pub use settings::{ChangeWeights, Corridor, MpcSettings, QpMode, QpSettings};

use condensing::{Condenser, Stage};
use nalgebra::Vector3;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::prediction::PredictionModel;
use sidehill_plant::speeds::MotorSpeeds;
use std::time::Instant;

/// Factor on all costs: brings the QP's numbers near 1, where the solver's tolerances are meant.
const COST_SCALE: f64 = 10.0;

/// Linearisations and QPs at most when a plan is made from nothing.
const START_ITERATIONS: usize = 10;
/// Largest correction of an input, m/s, at which such a plan is good enough.
const START_CORRECTION_M_S: f64 = 1e-3;

/// What the horizon asks for at the end of one stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageTarget {
    /// Where to be, world frame, heading included.
    pub pose: PlanarPose,
    /// Heading of travel, which separates errors along the path from errors across it, rad.
    pub along_heading_rad: f64,
    /// Upward unit normal of the ground during the stage, world frame.
    pub normal_in_world: Vector3<f64>,
    /// Input of the flat model that would follow the target; a plan made from nothing begins with it.
    pub feedforward: MotorSpeeds,
    /// Weights of this stage.
    pub weights: StageWeights,
}

/// States and inputs over the horizon.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// (x, y, yaw) at the stages' ends, the present first; N + 1 of them.
    pub states: Vec<Vector3<f64>>,
    /// Inputs of the stages; N of them.
    pub inputs: Vec<MotorSpeeds>,
}

/// What a solved cycle reports besides its plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveReport {
    /// Linear systems factorised and interior-point iterations.
    pub iterations: u32,
    /// How the solution was found.
    pub path: SolvePath,
    /// KKT residuals.
    pub residuals: Residuals,
    /// Time within the solver, s.
    pub solve_time_s: f64,
}

/// The controller's plan and the workspace to renew it.
pub struct Mpc {
    settings: MpcSettings,
    model: PredictionModel,
    plan: Plan,
    shifted: Plan,
    stages: Vec<Stage>,
    condenser: Condenser,
    solver: QpSolver,
    /// Largest correction of an input by the last QP, m/s.
    corrected_m_s: f64,
}

impl Mpc {
    /// Returns a controller that predicts with `model`.
    ///
    /// # Errors
    /// [`QpFailure`] where the solver does not take the problem.
    pub fn new(settings: MpcSettings, model: PredictionModel) -> Result<Self, QpFailure> {
        let (condenser, data) = Condenser::new(
            settings.stages,
            settings.block_stages,
            settings.limits,
            settings.corridor,
            COST_SCALE,
        );
        let solver = QpSolver::new(data, settings.qp)?;
        let plan = Plan {
            states: vec![Vector3::zeros(); settings.stages + 1],
            inputs: vec![MotorSpeeds::STOP; settings.stages],
        };
        let mut mpc = Self {
            shifted: plan.clone(),
            plan,
            stages: Vec::new(),
            condenser,
            solver,
            corrected_m_s: 0.0,
            model,
            settings,
        };
        mpc.stages.reserve_exact(mpc.settings.stages);
        Ok(mpc)
    }

    /// Returns the plan in force.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Returns the QP of the last cycle and the point that its solver ended with.
    pub fn qp(&self) -> (&QpData, &Point) {
        (self.solver.data(), self.solver.point())
    }

    /// Returns the prediction model, to be adapted.
    pub fn model_mut(&mut self) -> &mut PredictionModel {
        &mut self.model
    }

    /// Returns the prediction model.
    pub fn model(&self) -> &PredictionModel {
        &self.model
    }

    /// Sets the weight of a change of steer, s/(m/s)^2, which must be positive.
    pub fn set_steer_change_weight(&mut self, weight: f64) {
        self.settings.change_weights.steer = weight;
    }

    /// Makes a plan from nothing: the targets as states, their feed-forward as inputs, then QPs until
    /// they correct it little or `deadline` is over.
    ///
    /// # Errors
    /// The [`QpFailure`] of the first QP; a later one leaves the plan of those before it.
    pub fn start(
        &mut self,
        state: &PlanarPose,
        previous: MotorSpeeds,
        targets: &[StageTarget],
        deadline: Option<Instant>,
    ) -> Result<SolveReport, QpFailure> {
        self.plan.states[0] = vector(state);
        for (k, target) in targets.iter().enumerate() {
            let mut next = vector(&target.pose);
            next.z = state.yaw_rad + wrap_angle(next.z - state.yaw_rad);
            self.plan.states[k + 1] = next;
            self.plan.inputs[k] = target.feedforward;
        }
        // Unwrap, so that the plan's heading runs on where the targets' does.
        for k in 1..=targets.len() {
            let before = self.plan.states[k - 1].z;
            let yaw = &mut self.plan.states[k].z;
            *yaw = before + wrap_angle(*yaw - before);
        }
        // Far from a good plan the limits bind and a QP takes longer.
        self.solver.set_max_iterations(settings::ITERATIONS_MAX);
        let mut report = self.solve(state, previous, targets, deadline);
        for _ in 1..START_ITERATIONS {
            if report.is_err() || self.corrected_m_s < START_CORRECTION_M_S {
                break;
            }
            match self.solve(state, previous, targets, deadline) {
                Ok(better) => report = Ok(better),
                Err(_) => break,
            }
        }
        self.solver
            .set_max_iterations(self.settings.qp.max_iterations);
        report
    }

    /// Shifts the plan by `elapsed_s`, less than a stage: states are interpolated, inputs averaged
    /// over the new stages, the end follows from the model with the last input kept.
    pub fn shift(&mut self, elapsed_s: f64, normal_at_end: &Vector3<f64>) {
        let ratio = (elapsed_s / self.settings.step_s).clamp(0.0, 1.0);
        let last = self.settings.stages - 1;
        for k in 0..=last {
            self.shifted.states[k] =
                (1.0 - ratio) * self.plan.states[k] + ratio * self.plan.states[k + 1];
            let (now, next) = (self.plan.inputs[k], self.plan.inputs[(k + 1).min(last)]);
            self.shifted.inputs[k] = MotorSpeeds {
                traction_m_s: (1.0 - ratio) * now.traction_m_s + ratio * next.traction_m_s,
                steer_m_s: (1.0 - ratio) * now.steer_m_s + ratio * next.steer_m_s,
            };
        }
        let end = &self.plan.states[last + 1];
        let step = self.model.step_on_plane(
            normal_at_end,
            end.z,
            self.plan.inputs[last],
            ratio * self.settings.step_s,
        );
        self.shifted.states[last + 1] = end + step.increment;
        std::mem::swap(&mut self.plan, &mut self.shifted);
    }

    /// Linearises about the plan, solves one QP and moves the plan to its solution.
    ///
    /// `previous` is the input in force, `targets` one for each stage. Of `previous` only what is
    /// within the bounds counts: from there the QP always has a feasible point, that of no change.
    /// Allocates nothing but what the solver does.
    ///
    /// # Errors
    /// Every [`QpFailure`]; the plan is then as it was.
    pub fn solve(
        &mut self,
        state: &PlanarPose,
        previous: MotorSpeeds,
        targets: &[StageTarget],
        deadline: Option<Instant>,
    ) -> Result<SolveReport, QpFailure> {
        let now = {
            let mut now = vector(state);
            // The plan's heading is not wrapped; the state's turn count is taken from it.
            now.z = self.plan.states[0].z + wrap_angle(now.z - self.plan.states[0].z);
            now
        };
        let before = std::mem::replace(&mut self.plan.states[0], now);
        self.linearise(previous, targets);
        self.assemble(previous);
        let report = self
            .solve_assembled(deadline)
            .inspect_err(|_| self.plan.states[0] = before)?;
        self.apply();
        Ok(report)
    }

    /// First part of [`Mpc::solve`]: dynamics, errors and limits of each stage about the plan.
    pub fn linearise(&mut self, previous: MotorSpeeds, targets: &[StageTarget]) {
        let previous = self.settings.limits.within_bounds(previous);
        self.stages.clear();
        let settings = &self.settings;
        let mut before = previous;
        for (k, target) in targets.iter().enumerate() {
            let (state, next, input) = (
                &self.plan.states[k],
                &self.plan.states[k + 1],
                self.plan.inputs[k],
            );
            let step =
                self.model
                    .step_on_plane(&target.normal_in_world, state.z, input, settings.step_s);
            let (sin, cos) = target.along_heading_rad.sin_cos();
            let time_s = if k == 0 {
                settings.period_s
            } else {
                settings.step_s
            };
            let mut weights = target.weights;
            if k + 1 == targets.len() {
                weights.along_per_m2 *= settings.terminal_factor;
                weights.cross_per_m2 *= settings.terminal_factor;
                weights.heading_per_rad2 *= settings.terminal_factor;
            }
            self.stages.push(Stage {
                step,
                defect: state + step.increment - next,
                error: Vector3::new(
                    next.x - target.pose.x_m,
                    next.y - target.pose.y_m,
                    wrap_angle(next.z - target.pose.yaw_rad),
                ),
                along: (-sin, cos),
                weights,
                input,
                change_weights: ChangeWeights {
                    traction: settings.change_weights.traction / settings.step_s,
                    steer: settings.change_weights.steer / settings.step_s,
                },
                traction_change: settings.limits.traction.change(before.traction_m_s, time_s),
                steer_change: settings.limits.steer.change(before.steer_m_s, time_s),
            });
            before = input;
        }
    }

    /// Second part of [`Mpc::solve`]: condenses the linearised stages into the QP.
    pub fn assemble(&mut self, previous: MotorSpeeds) {
        let previous = self.settings.limits.within_bounds(previous);
        self.condenser
            .assemble(&self.stages, previous, self.solver.data_mut());
    }

    /// Third part of [`Mpc::solve`]: solves the QP as assembled; the plan stays as it is. A solve that
    /// is cut short ends with a point that meets all limits, where one is found that is better than to
    /// change nothing.
    ///
    /// # Errors
    /// Every [`QpFailure`].
    pub fn solve_assembled(&mut self, deadline: Option<Instant>) -> Result<SolveReport, QpFailure> {
        let begin = Instant::now();
        let residuals = self.solver.solve(deadline).or_else(|failure| {
            let (condenser, stages) = (&self.condenser, &self.stages);
            self.solver.salvage(failure, |data, primal| {
                condenser.make_feasible(stages, data, primal);
            })
        })?;
        Ok(SolveReport {
            iterations: self.solver.iterations(),
            path: self.solver.path(),
            residuals,
            solve_time_s: begin.elapsed().as_secs_f64(),
        })
    }

    /// Moves the plan by the QP's solution, states along the linearised dynamics.
    fn apply(&mut self) {
        let mut deviation = Vector3::zeros();
        self.corrected_m_s = 0.0;
        let corrections = self.condenser.input_corrections(self.solver.primal());
        for ((k, stage), correction) in self.stages.iter().enumerate().zip(corrections) {
            let step = &stage.step;
            deviation += step.by_yaw * deviation.z
                + step.by_traction * correction.traction_m_s
                + step.by_steer * correction.steer_m_s
                + stage.defect;
            self.corrected_m_s = self
                .corrected_m_s
                .max(correction.traction_m_s.abs())
                .max(correction.steer_m_s.abs());
            self.plan.states[k + 1] += deviation;
            self.plan.inputs[k] = MotorSpeeds {
                traction_m_s: stage.input.traction_m_s + correction.traction_m_s,
                steer_m_s: stage.input.steer_m_s + correction.steer_m_s,
            };
        }
    }
}

fn vector(pose: &PlanarPose) -> Vector3<f64> {
    Vector3::new(pose.x_m, pose.y_m, pose.yaw_rad)
}

#[cfg(test)]
mod tests;
