//! The QP of a horizon, solved once per cycle.
//!
//! The active rows are mostly those of the cycle before, so the solver starts from them ([`ActiveSet`]). Only
//! where that fails does it call the interior-point method, which cannot be warm-started.

use super::active_set::ActiveSet;
use super::clarabel_qp::{InteriorPoint, SolveEnding};
use super::failure::QpFailure;
use super::residuals::Residuals;
use super::settings::{QpMode, QpSettings};
use super::solve_limits::SolveLimits;
use super::sparse::{SolvedQp, Sparse};
use super::stage_qp::{MOTORS, Point, Rollout, STATES, StageQp, VARIABLES, Work};
use crate::clock::Instant;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How a solution was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SolvePath {
    /// No inequality is active.
    Relaxed,
    /// With the active rows.
    #[serde(rename = "working_set")]
    ActiveSet,
    /// By the interior-point method.
    InteriorPoint,
    /// Cut short by the deadline or the iteration limit: a feasible point that costs less than no
    /// change, but not the optimum.
    CutShort,
}

/// Share of the solver's tolerance within which an active set's solution is accepted.
const SHARPER: f64 = 0.1;

/// A solver and its problem.
pub struct QpSolver {
    qp: StageQp,
    settings: QpSettings,
    active_set: ActiveSet,
    /// Whether the active set knows the feedback of the QP as it is.
    has_feedback: bool,
    sparse: Sparse,
    interior_point: InteriorPoint,
    limits: Arc<SolveLimits>,
    point: Point,
    /// Between which points a solve that was cut short looks for a better one.
    from: Rollout,
    to: Rollout,
    work: Work,
    path: SolvePath,
    iterations: u32,
    rebuilds: u32,
}

impl Clone for QpSolver {
    fn clone(&self) -> Self {
        let limits = Arc::new(SolveLimits::clone(&self.limits));
        Self {
            qp: self.qp.clone(),
            settings: self.settings,
            active_set: self.active_set.clone(),
            has_feedback: self.has_feedback,
            sparse: self.sparse.clone(),
            interior_point: self.interior_point.copy_within(&limits),
            limits,
            point: self.point.clone(),
            from: self.from.clone(),
            to: self.to.clone(),
            work: self.work.clone(),
            path: self.path,
            iterations: self.iterations,
            rebuilds: self.rebuilds,
        }
    }
}

impl QpSolver {
    /// Returns a solver for problems with the stages and rows of `qp`.
    ///
    /// # Errors
    /// [`QpFailure::Rejected`] when clarabel does not accept the data.
    pub fn new(qp: StageQp, settings: QpSettings) -> Result<Self, QpFailure> {
        let limits = Arc::new(SolveLimits::new(settings.max_iterations));
        let sparse = Sparse::new(&qp);
        let point = qp.zeros();
        Ok(Self {
            active_set: ActiveSet::new(&qp),
            has_feedback: false,
            interior_point: InteriorPoint::new(&sparse.data, &settings, &limits)?,
            sparse,
            from: point.rollout.clone(),
            to: point.rollout.clone(),
            point,
            work: qp.work(),
            qp,
            settings,
            limits,
            path: SolvePath::Relaxed,
            iterations: 0,
            rebuilds: 0,
        })
    }

    /// Returns the QP for the next solve, to be overwritten in place.
    pub fn qp_mut(&mut self) -> &mut StageQp {
        self.has_feedback = false;
        &mut self.qp
    }

    /// Returns the QP of the last solve.
    pub fn qp(&self) -> &StageQp {
        &self.qp
    }

    /// Returns the QP of the last solve in compressed columns with the point of the last solve. Allocates.
    pub fn solved(&self) -> SolvedQp {
        self.qp.solved(&self.point)
    }

    /// Returns the iterations of the last solve: sets of active rows whose optimum was found, plus interior-point
    /// iterations.
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// Returns how the last solution was found.
    pub fn path(&self) -> SolvePath {
        self.path
    }

    /// Returns how often the solver was rebuilt after a numerical error.
    #[cfg(test)]
    pub fn rebuilds(&self) -> u32 {
        self.rebuilds
    }

    /// Returns the point of the last solve; after a failure the last iterate, if there was one.
    pub fn point(&self) -> &Point {
        &self.point
    }

    /// Finds the feedback that the last QP's cost asks for, rows left out, for [`Self::answer`]; returns whether there is one.
    pub(super) fn find_feedback(&mut self) -> bool {
        self.has_feedback = self.has_feedback || self.active_set.find_feedback(&self.qp);
        self.has_feedback
    }

    /// Returns by how much the state at the stages' ends changes where that at the first one's begin changes by `start`.
    pub(super) fn answer(&self, start: [f64; STATES]) -> impl Iterator<Item = [f64; STATES]> {
        self.active_set.answer(&self.qp, start)
    }

    /// Sets the largest number of interior-point iterations of the solves to come, at most
    /// `ITERATIONS_MAX`.
    #[cfg(test)]
    pub fn set_max_iterations(&mut self, iterations: u32) {
        self.limits.set_iterations(iterations);
    }

    /// Begins a cycle, see [`Mpc::begin_cycle`](super::Mpc::begin_cycle).
    pub(super) fn begin_cycle(&self, cut_at: Option<u32>) {
        self.limits.begin_cycle(cut_at);
    }

    /// Returns the look at the deadline that ended a solve of this cycle.
    pub(super) fn was_cut_at(&self) -> Option<u32> {
        self.limits.was_cut_at()
    }

    /// Solves the problem as its data stands, until `deadline` at the latest.
    ///
    /// # Errors
    /// Every [`QpFailure`]; do not use the point then.
    pub fn solve(&mut self, deadline: Option<Instant>) -> Result<Residuals, QpFailure> {
        self.iterations = 0;
        if !self.qp.is_finite() {
            return Err(QpFailure::NotFinite);
        }
        self.limits.set_deadline(deadline);
        if self.settings.mode == QpMode::ActiveSet {
            let found = self
                .active_set
                .find(&self.qp, &mut self.point, &self.limits);
            self.iterations = self.active_set.points();
            self.has_feedback = self.iterations > 0;
            let found = found.map_err(|()| QpFailure::Deadline {
                iterations: self.iterations,
            })?;
            if found {
                let residuals = self.residuals();
                if residuals.within(SHARPER * self.settings.tolerance) {
                    self.path = if self.active_set.binds() {
                        SolvePath::ActiveSet
                    } else {
                        SolvePath::Relaxed
                    };
                    return Ok(residuals);
                }
            }
        }
        self.path = SolvePath::InteriorPoint;
        let solved = self.solve_whole();
        if solved.is_ok() {
            self.active_set.begin_with(&self.qp, &self.point);
        }
        solved
    }

    fn solve_whole(&mut self) -> Result<Residuals, QpFailure> {
        let before = self.iterations;
        self.sparse.write(&self.qp);
        self.interior_point.update(&self.sparse.data)?;
        let (ending, iterations) = self.interior_point.solve();
        self.iterations = before + iterations;
        self.take_point();
        match ending {
            SolveEnding::Solved => self.check(),
            // The last iterate may be good enough: check its residuals.
            SolveEnding::Iterations => self
                .check()
                .map_err(|_| QpFailure::MaxIterations { iterations }),
            SolveEnding::Deadline => Err(QpFailure::Deadline {
                iterations: self.iterations,
            }),
            SolveEnding::Infeasible => Err(QpFailure::Infeasible),
            SolveEnding::Broken => {
                // A NaN inside the solver would stay there.
                self.rebuild()?;
                self.rebuilds += 1;
                Err(QpFailure::Numerical { iterations })
            }
        }
    }

    /// Takes inputs and multipliers from the interior-point method, and the states that follow.
    fn take_point(&mut self) {
        let (variables, multipliers) = self.interior_point.point();
        let stages = variables.chunks_exact(VARIABLES);
        for (inputs, own) in self.point.rollout.inputs.iter_mut().zip(stages) {
            inputs.copy_from_slice(&own[STATES..]);
        }
        let sides = multipliers[self.sparse.data.equalities..].chunks_exact(2);
        let rows = self.qp.rows().iter().zip(&mut self.point.multipliers);
        for ((row, multiplier), sides) in rows.zip(sides) {
            // An end that is none leaves the method a small multiplier of nothing.
            let high = if row.high.is_finite() { sides[0] } else { 0.0 };
            let low = if row.low.is_finite() { sides[1] } else { 0.0 };
            *multiplier = high - low;
        }
        self.qp.roll(&mut self.point.rollout);
    }

    fn rebuild(&mut self) -> Result<(), QpFailure> {
        self.interior_point = InteriorPoint::new(&self.sparse.data, &self.settings, &self.limits)?;
        Ok(())
    }

    fn check(&mut self) -> Result<Residuals, QpFailure> {
        let residuals = self.residuals();
        let limit = self.settings.accepted_residual;
        let Residuals { primal, dual, gap } = residuals;
        if primal <= limit && dual <= limit && gap <= self.settings.accepted_gap {
            Ok(residuals)
        } else {
            // Comparisons with NaN are false, so NaN fails too.
            Err(QpFailure::Residual { primal, dual, gap })
        }
    }

    /// Returns a feasible point from the last iterate of a solve that was cut short. `make_feasible`
    /// moves inputs to some that keep the limits; of those that it makes of no correction and of the iterate, and of the
    /// inputs between them, the cheapest are taken.
    ///
    /// # Errors
    /// `failure` itself if there is no iterate, or if no such point is cheaper than the first.
    pub fn salvage(
        &mut self,
        failure: QpFailure,
        make_feasible: impl Fn(&mut [[f64; MOTORS]]),
    ) -> Result<Residuals, QpFailure> {
        let (QpFailure::Deadline { .. } | QpFailure::MaxIterations { .. }) = failure else {
            return Err(failure);
        };
        if self.iterations == 0 {
            return Err(failure);
        }
        let Self { qp, work, .. } = self;
        let (from, to, rollout) = (&mut self.from, &mut self.to, &mut self.point.rollout);
        from.inputs.fill([0.0; MOTORS]);
        to.inputs.copy_from_slice(&rollout.inputs);
        for end in [&mut *from, &mut *to] {
            make_feasible(&mut end.inputs);
        }
        let mut between = |share: f64| {
            let ends = from.inputs.as_flattened().iter();
            let ends = ends.zip(to.inputs.as_flattened());
            for (own, (from, to)) in rollout.inputs.as_flattened_mut().iter_mut().zip(ends) {
                *own = from + share * (to - from);
            }
            qp.roll(rollout);
            qp.cost(rollout, work)
        };
        // The cost along the line is a parabola: three values give its minimum.
        let (begin, end) = (between(0.0), between(1.0));
        let curvature = 2.0 * (begin + end - 2.0 * between(0.5));
        let slope = end - begin - curvature;
        let share = (-slope / (2.0 * curvature)).clamp(0.0, 1.0);
        // Comparisons with NaN are false, so NaN fails too.
        if !(slope < 0.0 && share > 0.0) {
            return Err(failure);
        }
        between(share);
        self.point.multipliers.fill(0.0);
        self.path = SolvePath::CutShort;
        Ok(self.residuals())
    }

    /// Returns the KKT residuals of the last solution.
    pub fn residuals(&mut self) -> Residuals {
        self.qp.residuals(&self.point, &mut self.work)
    }
}
