//! Clarabel's interior-point method. No other file calls the solver.

use super::failure::QpFailure;
use super::settings::{ITERATIONS_MAX, QpSettings};
use super::solve_limits::SolveLimits;
use super::sparse::QpData;
use clarabel::solver::{
    DefaultInfo, DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};
use std::sync::Arc;

/// How an interior-point solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolveEnding {
    /// At the solution, as far as the solver can tell.
    Solved,
    /// With the iterations allowed, or with no more progress.
    Iterations,
    /// At the deadline.
    Deadline,
    /// With the certificate that no point meets the constraints.
    Infeasible,
    /// With a factorisation that broke down: the solver holds values that are not finite.
    Broken,
}

/// A solver of whole QPs of one pattern.
pub struct InteriorPoint {
    /// None in a copy until it is needed.
    solver: Option<DefaultSolver<f64>>,
    settings: QpSettings,
    limits: Arc<SolveLimits>,
}

impl InteriorPoint {
    /// Returns a solver for problems with the pattern of `data`.
    ///
    /// # Errors
    /// [`QpFailure::Rejected`] when clarabel does not take the data.
    pub fn new(
        data: &QpData,
        settings: &QpSettings,
        limits: &Arc<SolveLimits>,
    ) -> Result<Self, QpFailure> {
        let mut interior_point = Self {
            solver: None,
            settings: *settings,
            limits: Arc::clone(limits),
        };
        interior_point.build(data)?;
        Ok(interior_point)
    }

    /// Returns a solver under other limits that finds the same: it starts each solve from nothing.
    pub fn copy_within(&self, limits: &Arc<SolveLimits>) -> Self {
        Self {
            solver: None,
            settings: self.settings,
            limits: Arc::clone(limits),
        }
    }

    fn build(&mut self, data: &QpData) -> Result<(), QpFailure> {
        let limits = Arc::clone(&self.limits);
        let solver = self
            .solver
            .insert(build(data, clarabel_settings(&self.settings))?);
        solver.set_termination_callback(move |info: &DefaultInfo<f64>| {
            info.iterations >= limits.iterations() || limits.passed()
        });
        Ok(())
    }

    /// Puts the values of `data` in place of those before.
    ///
    /// # Errors
    /// [`QpFailure::Rejected`] for data of another size.
    pub fn update(&mut self, data: &QpData) -> Result<(), QpFailure> {
        let Some(solver) = &mut self.solver else {
            return self.build(data);
        };
        solver
            .update_P(&data.p.nzval)
            .and_then(|()| solver.update_q(&data.q))
            .and_then(|()| solver.update_A(&data.a.nzval))
            .and_then(|()| solver.update_b(&data.b))
            .map_err(|_| QpFailure::Rejected)
    }

    /// Solves the QP of the last update from nothing; returns how and after how many iterations it ended.
    pub fn solve(&mut self) -> (SolveEnding, u32) {
        let Some(solver) = &mut self.solver else {
            return (SolveEnding::Broken, 0);
        };
        solver.solve();
        let iterations = solver.info.iterations;
        let ending = match solver.solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => SolveEnding::Solved,
            SolverStatus::MaxIterations | SolverStatus::InsufficientProgress => {
                SolveEnding::Iterations
            }
            SolverStatus::CallbackTerminated if iterations >= self.limits.iterations() => {
                SolveEnding::Iterations
            }
            SolverStatus::CallbackTerminated | SolverStatus::MaxTime => SolveEnding::Deadline,
            SolverStatus::PrimalInfeasible
            | SolverStatus::DualInfeasible
            | SolverStatus::AlmostPrimalInfeasible
            | SolverStatus::AlmostDualInfeasible => SolveEnding::Infeasible,
            SolverStatus::NumericalError | SolverStatus::Unsolved => SolveEnding::Broken,
        };
        (ending, iterations)
    }

    /// Returns variables and multipliers of the point in which the last solve ended.
    pub fn point(&self) -> (&[f64], &[f64]) {
        self.solver.as_ref().map_or((&[], &[]), |solver| {
            (&solver.solution.x, &solver.solution.z)
        })
    }
}

fn clarabel_settings(settings: &QpSettings) -> DefaultSettings<f64> {
    DefaultSettings {
        // Updates in place need the data as given; the QP is already scaled, so neither
        // equilibration nor iterative refinement is worth its time.
        presolve_enable: false,
        equilibrate_enable: false,
        iterative_refinement_enable: false,
        direct_solve_method: "qdldl".into(),
        max_iter: ITERATIONS_MAX,
        tol_gap_abs: settings.tolerance,
        tol_gap_rel: settings.tolerance,
        tol_feas: settings.tolerance,
        verbose: false,
        ..DefaultSettings::default()
    }
}

fn build(data: &QpData, settings: DefaultSettings<f64>) -> Result<DefaultSolver<f64>, QpFailure> {
    let cones = [
        SupportedConeT::ZeroConeT(data.equalities),
        SupportedConeT::NonnegativeConeT(data.b.len() - data.equalities),
    ];
    DefaultSolver::new(&data.p, &data.q, &data.a, &data.b, &cones, settings)
        .map_err(|_| QpFailure::Rejected)
}
