//! A convex QP of fixed sparsity that is solved once per cycle.
//!
//! The active rows are mostly those of the cycle before, so the solver starts from them ([`WorkingSet`]). Only
//! where that fails does it call the interior-point method, which cannot be warm-started.

use super::clarabel_qp::{InteriorPoint, SolveEnding, SolveLimits};
use super::failure::QpFailure;
use super::problem::{Point, QpData, Residuals};
use super::settings::{QpMode, QpSettings};
use super::working_set::WorkingSet;
use crate::clock::Instant;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How a solution was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SolvePath {
    /// No inequality is active.
    Relaxed,
    /// By an active-set method.
    WorkingSet,
    /// By the interior-point method.
    InteriorPoint,
    /// Cut short by the deadline or the iteration limit: a feasible point that costs less than no
    /// change, but not the optimum.
    CutShort,
}

/// A solver and the data of its problem.
pub struct QpSolver {
    data: QpData,
    settings: QpSettings,
    working_set: WorkingSet,
    interior_point: InteriorPoint,
    limits: Arc<SolveLimits>,
    point: Point,
    work: Point,
    path: SolvePath,
    iterations: u32,
    rebuilds: u32,
}

impl Clone for QpSolver {
    fn clone(&self) -> Self {
        let limits = Arc::new(SolveLimits::clone(&self.limits));
        Self {
            data: self.data.clone(),
            settings: self.settings,
            working_set: self.working_set.clone(),
            interior_point: self.interior_point.copy_within(&limits),
            limits,
            point: self.point.clone(),
            work: self.work.clone(),
            path: self.path,
            iterations: self.iterations,
            rebuilds: self.rebuilds,
        }
    }
}

impl QpSolver {
    /// Returns a solver for problems with the pattern of `data`.
    ///
    /// # Errors
    /// [`QpFailure::Rejected`] when clarabel does not accept the data.
    pub fn new(data: QpData, settings: QpSettings) -> Result<Self, QpFailure> {
        let limits = Arc::new(SolveLimits::new(settings.max_iterations));
        Ok(Self {
            working_set: WorkingSet::new(&data)?,
            interior_point: InteriorPoint::new(&data, &settings, &limits)?,
            point: Point::zeros(&data),
            work: Point::zeros(&data),
            data,
            settings,
            limits,
            path: SolvePath::Relaxed,
            iterations: 0,
            rebuilds: 0,
        })
    }

    /// Returns the data for the next solve, to be overwritten in place.
    pub fn data_mut(&mut self) -> &mut QpData {
        &mut self.data
    }

    /// Returns the data of the last solve.
    pub fn data(&self) -> &QpData {
        &self.data
    }

    /// Returns the iterations of the last solve: linear systems factorised to find the active rows,
    /// plus interior-point iterations.
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

    /// Returns the primal point of the last solve.
    pub fn primal(&self) -> &[f64] {
        &self.point.primal
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
        if !self.data.is_finite() {
            return Err(QpFailure::NotFinite);
        }
        self.limits.set_deadline(deadline);
        if self.settings.mode == QpMode::WorkingSet {
            let found = self.working_set.solve(
                &self.data,
                &mut self.point,
                &mut self.work,
                self.settings.tolerance,
                &self.limits,
            );
            self.iterations = self.working_set.factorisations();
            if let Some(residuals) = found? {
                self.path = if self.working_set.binds() {
                    SolvePath::WorkingSet
                } else {
                    SolvePath::Relaxed
                };
                return Ok(residuals);
            }
        }
        self.path = SolvePath::InteriorPoint;
        let solved = self.solve_whole();
        if solved.is_ok() {
            self.working_set.begin_with(&self.point, &self.data);
        }
        solved
    }

    fn solve_whole(&mut self) -> Result<Residuals, QpFailure> {
        let before = self.iterations;
        match self.settings.mode {
            QpMode::WorkingSet | QpMode::InPlace => self.interior_point.update(&self.data)?,
            QpMode::FreshDefaults => self.rebuild()?,
        }
        let (ending, iterations) = self.interior_point.solve(&mut self.point);
        self.iterations = before + iterations;
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

    fn rebuild(&mut self) -> Result<(), QpFailure> {
        self.interior_point = InteriorPoint::new(&self.data, &self.settings, &self.limits)?;
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
    /// projects the origin and the iterate on the constraints; the cheapest point between the two
    /// projections is taken.
    ///
    /// # Errors
    /// `failure` itself if there is no iterate, or if no such point is cheaper than the projected origin.
    pub fn salvage(
        &mut self,
        failure: QpFailure,
        make_feasible: impl Fn(&QpData, &mut [f64]),
    ) -> Result<Residuals, QpFailure> {
        let (QpFailure::Deadline { .. } | QpFailure::MaxIterations { .. }) = failure else {
            return Err(failure);
        };
        if self.iterations == 0 {
            return Err(failure);
        }
        let (from, to) = (&mut self.work.primal, &mut self.point.primal);
        from.fill(0.0);
        make_feasible(&self.data, from);
        make_feasible(&self.data, to);
        // The cost along the line is a parabola: three values give its minimum.
        let (begin, end) = (self.data.cost(from), self.data.cost(to));
        for (to, from) in to.iter_mut().zip(&*from) {
            *to = 0.5 * (*to + from);
        }
        let middle = self.data.cost(to);
        let curvature = 2.0 * (begin + end - 2.0 * middle);
        let slope = end - begin - curvature;
        let share = (-slope / (2.0 * curvature)).clamp(0.0, 1.0);
        // Comparisons with NaN are false, so NaN fails too.
        if !(slope < 0.0 && share > 0.0) {
            return Err(failure);
        }
        for (to, from) in to.iter_mut().zip(&*from) {
            *to = from + 2.0 * share * (*to - from);
        }
        self.data.slacken(&mut self.point);
        self.point.dual.fill(0.0);
        self.path = SolvePath::CutShort;
        Ok(self.residuals())
    }

    /// Returns the KKT residuals of the last solution.
    pub fn residuals(&mut self) -> Residuals {
        self.data.residuals(&self.point, &mut self.work)
    }
}
