//! The model-predictive controller: a model linearised about the previous plan, one QP a cycle.
//!
//! ```text
//! mpc.linearise(&horizon).condense().solve(deadline)
//!     Horizon -> Linearised -> CondensedQp -> Solution
//! ```

mod clarabel_qp;
mod condensing;
mod dual_active_set;
mod failure;
pub mod limits;
mod model;
mod problem;
mod qp;
mod rows;
mod settings;
mod stage_times;
mod step_limit;
mod structure;
mod working_set;

pub use condensing::StageWeights;
pub use failure::QpFailure;
pub use model::Model;
pub use problem::{CscMatrix, Point, QpData, Residuals};
pub use qp::{QpSolver, SolvePath};
pub use settings::{ChangeWeights, Corridor, HeadingExcess, MpcSettings, QpMode, QpSettings};
pub use stage_times::StageTimes;
pub use step_limit::StepLimit;

use crate::tracked_point::TrackedPoint;
use condensing::{Condenser, Stage};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::speeds::MotorSpeeds;
use std::time::Instant;
use step_limit::{HALVINGS, TrustRegion};

/// Factor on all costs: brings the QP's numbers near 1, where the solver's tolerances are meant.
const COST_SCALE: f64 = 10.0;

/// Correction of planned steer, m/s, from which a plan without a step limit is run through the model
/// before it is taken.
const CHECKED_STEER_M_S: f64 = 0.3;

/// What the horizon asks for at the end of one stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageTarget {
    /// Where the tracked point is to be and the vehicle's heading there, world frame.
    pub pose: PlanarPose,
    /// Point of the vehicle that is to be there.
    pub tracked_point: TrackedPoint,
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

/// The optimisation problem of one cycle: where the vehicle will be when its command acts, and where
/// it should go from there.
#[derive(Debug, Clone, PartialEq)]
pub struct Horizon {
    /// Time since the horizon of the cycle before, s, less than a stage.
    pub elapsed_s: f64,
    /// Pose when a command given now begins to act.
    pub start: PlanarPose,
    /// Effective command in force. Of it only what is within the bounds counts: from there the QP
    /// always has a feasible point, that of no change.
    pub previous: MotorSpeeds,
    /// Weights of changes of the inputs.
    pub change_weights: ChangeWeights,
    /// One target for each stage.
    pub targets: Vec<StageTarget>,
}

/// A horizon linearised about the plan: dynamics, errors and limits of each stage.
pub struct Linearised<'a> {
    mpc: &'a mut Mpc,
    horizon: &'a Horizon,
    /// First state of the plan before it was put to where the vehicle is.
    first: Vector3<f64>,
}

/// A linearised horizon condensed into the data of its QP.
pub struct CondensedQp<'a> {
    mpc: &'a mut Mpc,
    horizon: &'a Horizon,
    /// First state of the plan before it was put to where the vehicle is.
    first: Vector3<f64>,
}

/// What the law wants of a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// Effective command: the plan's first input.
    pub command: MotorSpeeds,
    /// The solver's account; none of a law without a solver.
    pub report: Option<SolveReport>,
}

/// What a solved cycle reports besides its plan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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
    model: Model,
    plan: Plan,
    /// Whether the plan is the solution of an earlier cycle.
    planned: bool,
    /// Workspace of the plan's size: the shifted plan, the plan before a step.
    shifted: Plan,
    times: StageTimes,
    region: Option<TrustRegion>,
    stages: Vec<Stage>,
    condenser: Condenser,
    solver: QpSolver,
}

impl Mpc {
    /// Returns a controller that predicts with `model`.
    ///
    /// # Errors
    /// [`QpFailure`] where the solver does not take the problem.
    pub fn new(settings: MpcSettings, model: impl Into<Model>) -> Result<Self, QpFailure> {
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
            planned: false,
            times: settings.stage_times(),
            region: settings.step_limit.map(TrustRegion::new),
            stages: Vec::new(),
            condenser,
            solver,
            model: model.into(),
            settings,
        };
        mpc.stages.reserve_exact(mpc.settings.stages);
        Ok(mpc)
    }

    /// Returns the plan in force; none before the first solution, and after
    /// [`Mpc::discard_plan`].
    pub fn plan(&self) -> Option<&Plan> {
        self.planned.then_some(&self.plan)
    }

    /// Makes the next plan from nothing, as after a change of the path.
    pub fn discard_plan(&mut self) {
        self.planned = false;
    }

    /// Returns the QP of the last cycle and the point that its solver ended with.
    pub fn qp(&self) -> (&QpData, &Point) {
        (self.solver.data(), self.solver.point())
    }

    /// Returns the prediction model, to be adapted.
    pub fn model_mut(&mut self) -> &mut Model {
        &mut self.model
    }

    /// Returns the times of the stages.
    pub fn stage_times(&self) -> &StageTimes {
        &self.times
    }

    /// Linearises `horizon` about the shifted plan or, where there is none, about a guess: the targets
    /// as states, with their feed-forward as inputs. The plan then converges over the cycles to come,
    /// with one QP each. Allocates nothing.
    pub fn linearise<'a>(&'a mut self, horizon: &'a Horizon) -> Linearised<'a> {
        let guessed = !self.planned;
        if guessed {
            self.guess(horizon);
        } else {
            let normal_at_end = horizon
                .targets
                .last()
                .map_or(Vector3::z(), |target| target.normal_in_world);
            self.shift(horizon.elapsed_s, &normal_at_end);
        }
        let first = self.linearise_about_plan(horizon, guessed);
        Linearised {
            mpc: self,
            horizon,
            first,
        }
    }

    /// Puts the targets as states and their feed-forward as inputs into the plan.
    fn guess(&mut self, horizon: &Horizon) {
        let state = &horizon.start;
        self.plan.states[0] = vector(state);
        for (k, target) in horizon.targets.iter().enumerate() {
            let mut next = vector(
                &target
                    .tracked_point
                    .origin_of(&target.pose, &target.normal_in_world),
            );
            next.z = state.yaw_rad + wrap_angle(next.z - state.yaw_rad);
            self.plan.states[k + 1] = next;
            self.plan.inputs[k] = target.feedforward;
        }
        // Unwrap, so that the plan's heading runs on where the targets' does.
        for k in 1..=horizon.targets.len() {
            let before = self.plan.states[k - 1].z;
            let yaw = &mut self.plan.states[k].z;
            *yaw = before + wrap_angle(*yaw - before);
        }
    }

    /// Shifts the plan by `elapsed_s`, less than a stage: states are interpolated, inputs averaged
    /// over the new stages, the end follows from the model with the last input kept.
    fn shift(&mut self, elapsed_s: f64, normal_at_end: &Vector3<f64>) {
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

    /// Dynamics, errors and limits of each stage about the plan, whose first state becomes the
    /// horizon's start; returns the one it had.
    fn linearise_about_plan(&mut self, horizon: &Horizon, guessed: bool) -> Vector3<f64> {
        let mut start = vector(&horizon.start);
        // The plan's heading is not wrapped; the state's turn count is taken from it.
        start.z = self.plan.states[0].z + wrap_angle(start.z - self.plan.states[0].z);
        let first = std::mem::replace(&mut self.plan.states[0], start);
        let settings = &self.settings;
        let mut before = settings.limits.within_bounds(horizon.previous);
        self.stages.clear();
        for (k, target) in horizon.targets.iter().enumerate() {
            let (state, next, input) = (
                &self.plan.states[k],
                &self.plan.states[k + 1],
                self.plan.inputs[k],
            );
            let step_s = self.times.step_s(k);
            let step = self
                .model
                .step_on_plane(&target.normal_in_world, state.z, input, step_s);
            let (sin, cos) = target.along_heading_rad.sin_cos();
            let time_s = if k == 0 {
                settings.period_s
            } else {
                self.times.step_s(k - 1)
            };
            let lever = target.tracked_point.lever(&target.normal_in_world, next.z);
            let error = Vector3::new(
                next.x + lever.offset_m.0 - target.pose.x_m,
                next.y + lever.offset_m.1 - target.pose.y_m,
                wrap_angle(next.z - target.pose.yaw_rad),
            );
            let mut weights = target.weights;
            if !guessed {
                weights.heading_per_rad2 += settings.heading_excess.weight(error.z);
            }
            // The cost is that of even stages, each of them a sample of an integral.
            let mut factor = step_s / settings.step_s;
            if k + 1 == horizon.targets.len() {
                factor *= settings.terminal_factor;
            }
            weights.along_per_m2 *= factor;
            weights.cross_per_m2 *= factor;
            weights.heading_per_rad2 *= factor;
            self.stages.push(Stage {
                step,
                defect: state + step.increment - next,
                error,
                point_by_yaw_m: lever.by_yaw_m,
                along: (-sin, cos),
                weights,
                input,
                change_weights: ChangeWeights {
                    traction: horizon.change_weights.traction / step_s,
                    steer: horizon.change_weights.steer / step_s,
                },
                traction_change: settings.limits.traction.change(before.traction_m_s, time_s),
                steer_change: settings.limits.steer.change(before.steer_m_s, time_s),
            });
            before = input;
        }
        first
    }

    fn condense(&mut self, horizon: &Horizon) {
        let previous = self.settings.limits.within_bounds(horizon.previous);
        self.condenser
            .assemble(&self.stages, previous, self.solver.data_mut());
    }

    /// Solves the condensed QP and moves the plan to its solution; a failure leaves the plan as it
    /// was before it was linearised about. A solve that is cut short ends with a point that meets all
    /// limits, where one is found that is better than to change nothing.
    fn solve(
        &mut self,
        horizon: &Horizon,
        first: Vector3<f64>,
        deadline: Option<Instant>,
    ) -> Result<SolveReport, QpFailure> {
        let begin = Instant::now();
        let residuals = self
            .solver
            .solve(deadline)
            .or_else(|failure| {
                let (condenser, stages) = (&self.condenser, &self.stages);
                self.solver.salvage(failure, |data, primal| {
                    condenser.make_feasible(stages, data, primal);
                })
            })
            .inspect_err(|_| self.plan.states[0] = first)?;
        let report = SolveReport {
            iterations: self.solver.iterations(),
            path: self.solver.path(),
            residuals,
            solve_time_s: begin.elapsed().as_secs_f64(),
        };
        match self.region {
            Some(region) => self.region = Some(self.apply_within(region, horizon)),
            // At the end of grip two plans can lead to one another for ever, each good about the other only.
            // The guess for a first plan does not keep the limits: part of a step from it would not either.
            None if self.planned && self.largest_steer_correction_m_s() > CHECKED_STEER_M_S => {
                self.apply_within(TrustRegion::new(StepLimit::WHOLE_STEP), horizon);
            }
            None => self.apply(1.0),
        }
        Ok(report)
    }

    /// Begins a cycle. With `cut_at` the look of that number at the deadline, counted from 0, ends its
    /// solves and the clock does not: so a recorded cycle is solved again exactly.
    pub(crate) fn begin_cycle(&mut self, cut_at: Option<u32>) {
        self.solver.begin_cycle(cut_at);
    }

    /// Returns the look at the deadline that ended a solve of this cycle; none where none did.
    pub(crate) fn was_cut_at(&self) -> Option<u32> {
        self.solver.was_cut_at()
    }

    /// Moves the plan by a share of the QP's solution, states along the linearised dynamics.
    fn apply(&mut self, share: f64) {
        let mut deviation = Vector3::zeros();
        let corrections = self.condenser.input_corrections(self.solver.primal());
        for ((k, stage), correction) in self.stages.iter().enumerate().zip(corrections) {
            let step = &stage.step;
            deviation += step.by_yaw * deviation.z
                + step.by_traction * correction.traction_m_s
                + step.by_steer * correction.steer_m_s
                + stage.defect;
            self.plan.states[k + 1] += share * deviation;
            self.plan.inputs[k] = MotorSpeeds {
                traction_m_s: stage.input.traction_m_s + share * correction.traction_m_s,
                steer_m_s: stage.input.steer_m_s + share * correction.steer_m_s,
            };
        }
    }

    /// Returns the largest correction of planned steer that the QP's solution asks for, m/s.
    fn largest_steer_correction_m_s(&self) -> f64 {
        self.condenser
            .input_corrections(self.solver.primal())
            .map(|correction| correction.steer_m_s.abs())
            .fold(0.0, f64::max)
    }

    /// Moves the plan as far as the linearisation tells the truth, see [`step_limit`]; returns the region
    /// of the next cycle.
    fn apply_within(&mut self, mut region: TrustRegion, horizon: &Horizon) -> TrustRegion {
        let largest_m_s = self.largest_steer_correction_m_s();
        let mut share = region.first_share(largest_m_s);
        self.shifted.states.copy_from_slice(&self.plan.states);
        self.shifted.inputs.copy_from_slice(&self.plan.inputs);
        let before = self.rolled_out_cost(horizon);
        for halvings in 0..=HALVINGS {
            self.apply(share);
            let promised = self.planned_cost(horizon);
            let actual = self.rolled_out_cost(horizon);
            if halvings == HALVINGS || region.takes(before, promised, actual) {
                region.learn(before, promised, actual, share * largest_m_s, halvings == 0);
                break;
            }
            share *= 0.5;
            self.plan.states.copy_from_slice(&self.shifted.states);
        }
        region
    }

    /// Returns the cost of the plan as its states have it.
    fn planned_cost(&self, horizon: &Horizon) -> f64 {
        let mut cost = 0.0;
        let mut before = self.settings.limits.within_bounds(horizon.previous);
        for (k, stage) in self.stages.iter().enumerate() {
            let input = self.plan.inputs[k];
            cost += stage_cost(
                stage,
                &horizon.targets[k],
                &self.plan.states[k + 1],
                input,
                before,
            );
            before = input;
        }
        cost
    }

    /// Returns the cost of the plan's inputs, run through the model from the plan's first state.
    fn rolled_out_cost(&mut self, horizon: &Horizon) -> f64 {
        let mut cost = 0.0;
        let mut before = self.settings.limits.within_bounds(horizon.previous);
        let mut state = self.plan.states[0];
        for (k, stage) in self.stages.iter().enumerate() {
            let (input, target) = (self.plan.inputs[k], &horizon.targets[k]);
            let step_s = self.times.step_s(k);
            let step = self
                .model
                .step_on_plane(&target.normal_in_world, state.z, input, step_s);
            state += step.increment;
            cost += stage_cost(stage, target, &state, input, before);
            before = input;
        }
        cost
    }
}

/// Returns what a stage costs that ends at `state`.
fn stage_cost(
    stage: &Stage,
    target: &StageTarget,
    state: &Vector3<f64>,
    input: MotorSpeeds,
    before: MotorSpeeds,
) -> f64 {
    let lever = target.tracked_point.lever(&target.normal_in_world, state.z);
    let dx = state.x + lever.offset_m.0 - target.pose.x_m;
    let dy = state.y + lever.offset_m.1 - target.pose.y_m;
    let heading = wrap_angle(state.z - target.pose.yaw_rad);
    let along = stage.along.0 * dx + stage.along.1 * dy;
    let cross = stage.along.0 * dy - stage.along.1 * dx;
    stage.weights.along_per_m2 * along * along
        + stage.weights.cross_per_m2 * cross * cross
        + stage.weights.heading_per_rad2 * heading * heading
        + stage.change_weights.traction * (input.traction_m_s - before.traction_m_s).powi(2)
        + stage.change_weights.steer * (input.steer_m_s - before.steer_m_s).powi(2)
}

impl<'a> Linearised<'a> {
    /// Condenses the stages into the QP's data. Allocates nothing.
    pub fn condense(self) -> CondensedQp<'a> {
        self.mpc.condense(self.horizon);
        CondensedQp {
            mpc: self.mpc,
            horizon: self.horizon,
            first: self.first,
        }
    }
}

impl CondensedQp<'_> {
    /// Solves the QP, moves the plan to its solution and returns its first input; `deadline` ends the
    /// solve. Allocates nothing but what the solver does.
    ///
    /// # Errors
    /// Every [`QpFailure`]; the plan is then the shifted one.
    pub fn solve(self, deadline: Option<Instant>) -> Result<Solution, QpFailure> {
        let Self {
            mpc,
            horizon,
            first,
        } = self;
        let report = mpc.solve(horizon, first, deadline)?;
        mpc.planned = true;
        Ok(Solution {
            command: mpc.plan.inputs[0],
            report: Some(report),
        })
    }
}

fn vector(pose: &PlanarPose) -> Vector3<f64> {
    Vector3::new(pose.x_m, pose.y_m, pose.yaw_rad)
}

#[cfg(test)]
mod tests;
