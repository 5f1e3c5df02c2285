//! The model-predictive controller: a model linearised about the previous plan, one QP a cycle.
//!
//! ```text
//! mpc.linearise(&horizon).assemble().solve(deadline)
//!     Horizon -> LinearisedHorizon -> AssembledQp -> Solution
//! ```

mod active_set;
mod assembling;
mod clarabel_qp;
mod extra;
mod failure;
mod first_plan;
mod following;
pub mod limits;
mod linearising;
mod model;
mod qp;
mod recursion;
mod residuals;
mod settings;
mod solve_limits;
mod sparse;
mod stage;
mod stage_qp;
mod stage_times;
mod step_limit;

pub use extra::{EXTRA_ROWS_MAX, EXTRA_SIZE, ExtraCost, ExtraError, ExtraRow, ExtraTerms};
pub use failure::QpFailure;
pub use model::Model;
pub(crate) use model::StepStart;
pub use qp::{QpSolver, SolvePath};
pub use residuals::Residuals;
pub use settings::{ChangeWeights, HeadingExcess, MpcSettings, QpMode, QpSettings};
pub use sparse::{CscMatrix, QpData, SolvedQp};
pub use stage::StageWeights;
pub use stage_qp::StageQp;
pub use stage_times::StageTimes;
pub use step_limit::StepLimit;

use crate::clock::Instant;
use crate::tracked_point::TrackedPoint;
use extra::Extra;
use limits::MotorLimits;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use sidehill_plant::contact::BodyState;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::prediction::LinearisedStep;
use sidehill_plant::speeds::MotorSpeeds;
use stage::Stage;
use step_limit::Damping;

/// What the horizon asks for at the end of one stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageTarget {
    /// Where the tracked point is to be and the vehicle's heading there, world frame.
    pub pose: PlanarPose,
    /// Point of the vehicle that is to be there.
    pub tracked_point: TrackedPoint,
    /// Heading of travel, which separates errors along the path from errors across it, rad.
    pub along_heading_rad: f64,
    /// How the asked heading turns for each metre that the tracked point is farther along, rad/m; 0 where the target
    /// does not move on.
    pub curvature_per_m: f64,
    /// Upward unit normal of the ground during the stage, world frame.
    pub normal_in_world: Vector3<f64>,
    /// Input of the flat model that would follow the target.
    pub feedforward: MotorSpeeds,
    /// Speed of the tracked point along the path, m/s, negative in reverse.
    pub speed_m_s: f64,
    /// Velocity that the model does not have, (x, y, yaw) in the world.
    pub slip: Vector3<f64>,
    /// Weights of this stage.
    pub weights: StageWeights,
    /// Factor on those across the path and of the heading: the share of the way that the plan drives here.
    pub errors_share: f64,
}

/// How far a state is from a target.
struct TargetError {
    /// (x, y) of the tracked point in the world less that of the target, m, and the heading less the one asked for
    /// there, rad.
    state: Vector3<f64>,
    /// Derivative of (x, y) of the tracked point by the heading, m/rad.
    point_by_yaw_m: (f64, f64),
}

impl StageTarget {
    /// Returns how far (x, y, yaw) of a vehicle is from the target. `along` is [`StageTarget::along`] here and below.
    fn error_of(&self, along: (f64, f64), state: &Vector3<f64>) -> TargetError {
        let lever = self.tracked_point.lever(&self.normal_in_world, state.z);
        let x_m = state.x + lever.offset_m.0 - self.pose.x_m;
        let y_m = state.y + lever.offset_m.1 - self.pose.y_m;
        let farther_m = along.0 * x_m + along.1 * y_m;
        let yaw_rad = wrap_angle(state.z - self.pose.yaw_rad) - self.curvature_per_m * farther_m;
        TargetError {
            state: Vector3::new(x_m, y_m, yaw_rad),
            point_by_yaw_m: lever.by_yaw_m,
        }
    }

    /// Returns the speed of the tracked point along the path less that of the target, m/s, between two states.
    fn speed_error(
        &self,
        (along_x, along_y): (f64, f64),
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        step_s: f64,
    ) -> f64 {
        let lever = |state: &Vector3<f64>| {
            self.tracked_point
                .lever(&self.normal_in_world, state.z)
                .offset_m
        };
        let (before, after) = (lever(from), lever(to));
        let moved_m = along_x * (to.x - from.x + after.0 - before.0)
            + along_y * (to.y - from.y + after.1 - before.1);
        moved_m / step_s - self.speed_m_s
    }

    /// Returns the derivatives of the speed along the path by the yaw before, traction and steer, where `step` leads
    /// from one state to the other.
    fn speed_row(
        &self,
        (along_x, along_y): (f64, f64),
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        step: &LinearisedStep,
        step_s: f64,
    ) -> [f64; 3] {
        let along_by_yaw = |state: &Vector3<f64>| {
            let lever = self.tracked_point.lever(&self.normal_in_world, state.z);
            along_x * lever.by_yaw_m.0 + along_y * lever.by_yaw_m.1
        };
        let (before, after) = (along_by_yaw(from), along_by_yaw(to));
        let [mut by_yaw, by_traction, by_steer] = [&step.by_yaw, &step.by_traction, &step.by_steer]
            .map(|by| along_x * by.x + along_y * by.y + after * by.z);
        by_yaw += after - before;
        [by_yaw, by_traction, by_steer].map(|moved_m| moved_m / step_s)
    }

    /// Returns the unit vector along the path, (x, y) in the world.
    fn along(&self) -> (f64, f64) {
        let (sin, cos) = self.along_heading_rad.sin_cos();
        (-sin, cos)
    }
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
    /// Pose when a command given now begins to act.
    pub start: PlanarPose,
    /// How the body moves there.
    pub moving: BodyState,
    /// Effective command in force. Of it only what is within the bounds counts: from there the QP
    /// always has a feasible point, that of no change.
    pub previous: MotorSpeeds,
    /// Weights of changes of the inputs.
    pub change_weights: ChangeWeights,
    /// Half of the distance of the treads' ICRs on level ground, m: steer over yaw rate of the flat model.
    pub half_track_m: f64,
    /// One target for each stage.
    pub targets: Vec<StageTarget>,
}

/// A horizon linearised about the plan: dynamics, errors and limits of each stage.
pub struct LinearisedHorizon<'a> {
    mpc: &'a mut Mpc,
    horizon: &'a Horizon,
}

/// A linearised horizon as a QP.
pub struct AssembledQp<'a> {
    mpc: &'a mut Mpc,
    horizon: &'a Horizon,
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
#[derive(Clone)]
pub struct Mpc {
    settings: MpcSettings,
    model: Model,
    plan: Plan,
    /// Whether the plan is the solution of an earlier cycle.
    planned: bool,
    /// Workspace of the plan's size: the shifted plan, the plan before it was linearised about or moved.
    shifted: Plan,
    /// Workspace: the states of the plan's inputs by the model itself.
    rolled: Vec<Vector3<f64>>,
    times: StageTimes,
    /// What the plan costs.
    cost: f64,
    /// Price on corrections of planned inputs.
    damping: Damping,
    stages: Vec<Stage>,
    /// Where the model's searches of the stages' steps begin.
    starts: Vec<StepStart>,
    solver: QpSolver,
    extra: Option<Box<Extra>>,
}

impl Mpc {
    /// Returns a controller that predicts with `model`.
    ///
    /// # Errors
    /// [`QpFailure`] where the solver does not take the problem.
    pub fn new(settings: MpcSettings, model: impl Into<Model>) -> Result<Self, QpFailure> {
        let tread_rows = !settings.limits.treads_follow_from_motors();
        let qp = StageQp::new(settings.stages, tread_rows, 0);
        let solver = QpSolver::new(qp, settings.qp)?;
        let plan = Plan {
            states: vec![Vector3::zeros(); settings.stages + 1],
            inputs: vec![MotorSpeeds::STOP; settings.stages],
        };
        let mut mpc = Self {
            shifted: plan.clone(),
            rolled: plan.states.clone(),
            plan,
            planned: false,
            times: settings.stage_times(),
            cost: 0.0,
            damping: Damping::default(),
            stages: Vec::new(),
            starts: vec![StepStart::default(); settings.stages],
            solver,
            extra: None,
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

    /// Moves the plan in force on to a horizon that begins `elapsed_s` later than its own and has stages stretched by
    /// `stretch`; `normal_at_end` is the ground's where it ends.
    pub fn move_on(&mut self, elapsed_s: f64, stretch: f64, normal_at_end: &Vector3<f64>) {
        if self.planned {
            self.shift(elapsed_s, stretch, normal_at_end);
        } else {
            self.times.set_stretch(stretch);
        }
    }

    /// Sets the limits of the motors as they are known now, at most those of the settings.
    pub fn set_motor_limits(&mut self, traction: MotorLimits, steer: MotorLimits) {
        let limits = &mut self.settings.limits;
        (limits.traction, limits.steer) = (traction, steer);
    }

    /// Adds terms to the QPs from the next cycle on, in place of those added before, or removes these. Allocates, so
    /// that the cycles do not.
    ///
    /// Where no plan meets the rows a cycle fails with [`QpFailure::Infeasible`]. One that its deadline ends fails, too:
    /// there is no projection on the rows to salvage it with.
    ///
    /// # Errors
    /// [`ExtraError`] for terms of another horizon, and where the solver does not take the problem.
    pub fn set_extra_terms(&mut self, terms: Option<ExtraTerms>) -> Result<(), ExtraError> {
        let needed = self.settings.stages;
        if let Some(found) = terms.as_ref().map(ExtraTerms::stages)
            && found != needed
        {
            return Err(ExtraError::Stages { found, needed });
        }
        let rows = |terms: Option<&ExtraTerms>| terms.map_or(0, ExtraTerms::rows_per_stage);
        let needed = rows(terms.as_ref());
        if needed != rows(self.extra.as_ref().map(|extra| &extra.terms)) {
            let qp = self.solver.qp().with_extra_rows(needed);
            self.solver = QpSolver::new(qp, self.settings.qp)?;
        }
        self.extra = terms.map(|terms| Box::new(Extra::new(terms)));
        // The plan's cost was that of other terms.
        self.cost = 0.0;
        Ok(())
    }

    /// Makes the next plan from nothing, as after a change of the path.
    pub fn discard_plan(&mut self) {
        self.planned = false;
    }

    /// Returns the solver, with the QP of the last cycle and the point that it ended with.
    pub fn qp_solver(&self) -> &QpSolver {
        &self.solver
    }

    /// Returns the number of stages N.
    pub fn stages(&self) -> usize {
        self.settings.stages
    }

    /// Returns the step of each stage about the plan of the last cycle as it was before its QP was solved.
    pub fn linearised_stages(&self) -> impl ExactSizeIterator<Item = &LinearisedStep> {
        self.stages.iter().map(|stage| &stage.step)
    }

    /// Returns the prediction model, to be adapted.
    pub fn model_mut(&mut self) -> &mut Model {
        &mut self.model
    }

    /// Returns the times of the stages.
    pub fn stage_times(&self) -> &StageTimes {
        &self.times
    }

    /// Linearises `horizon` about the plan, at first that of [`Mpc::try_first_plan`]. The plan converges over the
    /// cycles, with one QP each. Allocates nothing.
    pub fn linearise<'a>(&'a mut self, horizon: &'a Horizon) -> LinearisedHorizon<'a> {
        self.linearise_about_plan(horizon);
        LinearisedHorizon { mpc: self, horizon }
    }

    fn assemble(&mut self, horizon: &Horizon) {
        let limits = &self.settings.limits;
        assembling::assemble(
            self.solver.qp_mut(),
            &self.stages,
            &self.plan.states,
            limits.within_bounds(horizon.previous),
            limits,
            self.extra.as_ref().map(|extra| &extra.terms),
        );
    }

    /// Solves the QP and moves the plan to its solution; a failure leaves the plan as it
    /// was before it was linearised about. A solve that is cut short ends with a point that meets all
    /// limits, where one is found that is better than to change nothing.
    fn solve(
        &mut self,
        horizon: &Horizon,
        deadline: Option<Instant>,
    ) -> Result<SolveReport, QpFailure> {
        let begin = Instant::now();
        let residuals = self
            .solver
            .solve(deadline)
            .or_else(|failure| {
                let extra = self.extra.as_ref();
                if extra.is_some_and(|extra| extra.terms.rows_per_stage() > 0) {
                    return Err(failure);
                }
                let (stages, limits) = (&self.stages, &self.settings.limits);
                let previous = limits.within_bounds(horizon.previous);
                self.solver.salvage(failure, |corrections| {
                    assembling::make_feasible(corrections, stages, previous, limits);
                })
            })
            .inspect_err(|_| {
                self.plan.states.copy_from_slice(&self.shifted.states);
                // A first plan from nowhere is none.
                let known = |state: &Vector3<f64>| state.iter().all(|value| value.is_finite());
                self.planned &= self.plan.states.iter().all(known);
            })?;
        let report = SolveReport {
            iterations: self.solver.iterations(),
            path: self.solver.path(),
            residuals,
            solve_time_s: begin.elapsed().as_secs_f64(),
        };
        self.follow(horizon);
        Ok(report)
    }

    /// Finds how the plan of the last cycle answers a change of its start, for [`Mpc::answer`]; returns whether it does.
    pub(crate) fn find_feedback(&mut self) -> bool {
        self.solver.find_feedback()
    }

    /// Returns by how much (x, y, yaw) at the stages' ends changes where the plan's start changes by `start`, m and rad, and
    /// the plan is optimal from there, limits aside.
    pub(crate) fn answer(&self, start: Vector3<f64>) -> impl Iterator<Item = Vector3<f64>> {
        self.solver.answer(start.into()).map(Vector3::from)
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
}

impl<'a> LinearisedHorizon<'a> {
    /// Writes the QP of the stages. Allocates nothing.
    pub fn assemble(self) -> AssembledQp<'a> {
        self.mpc.assemble(self.horizon);
        AssembledQp {
            mpc: self.mpc,
            horizon: self.horizon,
        }
    }
}

impl AssembledQp<'_> {
    /// Solves the QP, moves the plan to its solution and returns its first input; `deadline` ends the
    /// solve. Allocates nothing but what the solver does.
    ///
    /// # Errors
    /// Every [`QpFailure`]; the plan is then the shifted one.
    pub fn solve(self, deadline: Option<Instant>) -> Result<Solution, QpFailure> {
        let Self { mpc, horizon } = self;
        let report = mpc.solve(horizon, deadline)?;
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
