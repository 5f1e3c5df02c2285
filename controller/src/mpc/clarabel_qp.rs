//! The only file that uses clarabel: its interior-point method for a whole QP, and its KKT system for
//! a QP with equalities alone.

use crate::clock::Instant;
pub use clarabel::algebra::CscMatrix;

use super::failure::QpFailure;
use super::problem::{Point, QpData};
use super::settings::{ITERATIONS_MAX, QpMode, QpSettings};
use clarabel::solver::traits::KKTSystem;
use clarabel::solver::{
    DefaultInfo, DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

/// Static regularisation of a [`LinearSystem`]. Clarabel's 1e-8 suits the ill-conditioned systems at
/// the end of an interior-point solve; here it would cost a refinement step in each cycle.
const REGULARISATION: f64 = 1e-11;

/// Deadline and iteration limit of a solve.
#[derive(Debug)]
pub struct SolveLimits {
    epoch: Instant,
    /// Nanoseconds after `epoch`.
    deadline_ns: AtomicU64,
    iterations: AtomicU32,
    /// Looks at the deadline since [`SolveLimits::begin_cycle`].
    looks: AtomicU32,
    /// The look that ends the solves, instead of the clock; `NEVER` for none.
    cut_at: AtomicU32,
    /// The first look that ended a solve; `NEVER` for none.
    was_cut_at: AtomicU32,
}

/// No look at the deadline.
const NEVER: u32 = u32::MAX;

impl Clone for SolveLimits {
    fn clone(&self) -> Self {
        let copy = |count: &AtomicU32| AtomicU32::new(count.load(Ordering::Relaxed));
        Self {
            epoch: self.epoch,
            deadline_ns: AtomicU64::new(self.deadline_ns.load(Ordering::Relaxed)),
            iterations: copy(&self.iterations),
            looks: copy(&self.looks),
            cut_at: copy(&self.cut_at),
            was_cut_at: copy(&self.was_cut_at),
        }
    }
}

impl SolveLimits {
    /// Returns limits without a deadline.
    pub fn new(iterations: u32) -> Self {
        Self {
            epoch: Instant::now(),
            deadline_ns: AtomicU64::new(u64::MAX),
            iterations: AtomicU32::new(iterations),
            looks: AtomicU32::new(0),
            cut_at: AtomicU32::new(NEVER),
            was_cut_at: AtomicU32::new(NEVER),
        }
    }

    /// Begins a cycle, whose solves look at the deadline in turn. With `cut_at` the look of that number
    /// ends them and no clock does, so that a recorded cycle is solved again exactly.
    pub fn begin_cycle(&self, cut_at: Option<u32>) {
        self.looks.store(0, Ordering::Relaxed);
        self.cut_at
            .store(cut_at.unwrap_or(NEVER), Ordering::Relaxed);
        self.was_cut_at.store(NEVER, Ordering::Relaxed);
    }

    /// Returns the look at the deadline that ended a solve of this cycle, counted from 0; none where
    /// none did.
    pub fn was_cut_at(&self) -> Option<u32> {
        Some(self.was_cut_at.load(Ordering::Relaxed)).filter(|look| *look != NEVER)
    }

    /// Sets when the solves to come end.
    pub fn set_deadline(&self, deadline: Option<Instant>) {
        let after = |instant: Instant| instant.saturating_duration_since(self.epoch).as_nanos();
        let limit = deadline.map_or(u64::MAX, |instant| {
            u64::try_from(after(instant)).unwrap_or(u64::MAX)
        });
        self.deadline_ns.store(limit, Ordering::Relaxed);
    }

    /// Sets the largest number of interior-point iterations of the solves to come.
    #[cfg(test)]
    pub fn set_iterations(&self, iterations: u32) {
        self.iterations.store(iterations, Ordering::Relaxed);
    }

    /// Returns the largest number of interior-point iterations.
    pub fn iterations(&self) -> u32 {
        self.iterations.load(Ordering::Relaxed)
    }

    /// Returns whether the deadline is over.
    pub fn passed(&self) -> bool {
        let look = self.looks.fetch_add(1, Ordering::Relaxed);
        let cut_at = self.cut_at.load(Ordering::Relaxed);
        let passed = if cut_at == NEVER {
            let deadline = Duration::from_nanos(self.deadline_ns.load(Ordering::Relaxed));
            self.epoch.elapsed() >= deadline
        } else {
            look >= cut_at
        };
        if passed {
            self.was_cut_at.fetch_min(look, Ordering::Relaxed);
        }
        passed
    }
}

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

    /// Solves the QP of the last update from nothing, copies the point it ends in to `point`, and returns how and
    /// after how many iterations it ended.
    pub fn solve(&mut self, point: &mut Point) -> (SolveEnding, u32) {
        let Some(solver) = &mut self.solver else {
            return (SolveEnding::Broken, 0);
        };
        solver.solve();
        let iterations = solver.info.iterations;
        let found = &solver.solution;
        point.primal.copy_from_slice(&found.x);
        point.dual.copy_from_slice(&found.z);
        point.slack.copy_from_slice(&found.s);
        let ending = match found.status {
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
}

/// The linear system of a QP that has equalities alone,
///
/// ```text
/// [ P  E' ] [ x ]   [ -q ]
/// [ E  0  ] [ y ] = [  e ]
/// ```
///
/// factorised once for any number of right-hand sides.
///
/// Clarabel regularises the diagonal: a solution is to be refined by its residuals.
pub struct LinearSystem {
    /// None in a copy until it is needed.
    solver: Option<DefaultSolver<f64>>,
    settings: DefaultSettings<f64>,
    /// A problem of the system's pattern.
    pattern: QpData,
}

impl Clone for LinearSystem {
    /// Returns a system that finds the same once it is factorised again.
    fn clone(&self) -> Self {
        Self {
            solver: None,
            settings: self.settings.clone(),
            pattern: self.pattern.clone(),
        }
    }
}

impl LinearSystem {
    /// Returns the system of problems with the pattern of `data`, which has no inequalities.
    ///
    /// # Errors
    /// [`QpFailure::Rejected`] when clarabel does not take the data.
    pub fn new(data: &QpData) -> Result<Self, QpFailure> {
        let mut settings = clarabel_settings(&QpSettings::default());
        settings.static_regularization_constant = REGULARISATION;
        Ok(Self {
            solver: Some(build(data, settings.clone())?),
            settings,
            pattern: data.clone(),
        })
    }

    /// Factorises the system of the values of P and of the equalities' rows of A; returns whether that
    /// went well.
    ///
    /// # Errors
    /// [`QpFailure::Rejected`] for values of another number.
    pub fn factorise(&mut self, p: &Vec<f64>, equalities: &Vec<f64>) -> Result<bool, QpFailure> {
        let solver = match &mut self.solver {
            Some(solver) => solver,
            None => self
                .solver
                .insert(build(&self.pattern, self.settings.clone())?),
        };
        solver
            .update_P(p)
            .and_then(|()| solver.update_A(equalities))
            .map_err(|_| QpFailure::Rejected)?;
        let data = &solver.data;
        Ok(solver.kktsystem.update(data, &solver.cones, &self.settings))
    }

    /// Solves the system for q and e; returns whether the solution is finite.
    pub fn solve(&mut self, q: &[f64], e: &[f64]) -> bool {
        let Some(solver) = &mut self.solver else {
            return false;
        };
        solver.data.q.copy_from_slice(q);
        solver.data.b.copy_from_slice(e);
        let (x, data) = (&mut solver.variables, &solver.data);
        solver
            .kktsystem
            .solve_initial_point(x, data, &self.settings)
    }

    /// Returns x of the last solution.
    pub fn primal(&self) -> &[f64] {
        self.solver
            .as_ref()
            .map_or(&[], |solver| &solver.variables.x)
    }

    /// Returns y of the last solution.
    pub fn multipliers(&self) -> &[f64] {
        self.solver
            .as_ref()
            .map_or(&[], |solver| &solver.variables.z)
    }
}

fn clarabel_settings(settings: &QpSettings) -> DefaultSettings<f64> {
    let mut clarabel = DefaultSettings::<f64>::default();
    if settings.mode != QpMode::FreshDefaults {
        // Updates in place need the data as given; the QP is already scaled, so neither
        // equilibration nor iterative refinement is worth its time.
        clarabel.presolve_enable = false;
        clarabel.equilibrate_enable = false;
        clarabel.iterative_refinement_enable = false;
        clarabel.direct_solve_method = "qdldl".into();
        clarabel.max_iter = ITERATIONS_MAX;
        clarabel.tol_gap_abs = settings.tolerance;
        clarabel.tol_gap_rel = settings.tolerance;
        clarabel.tol_feas = settings.tolerance;
    }
    clarabel.verbose = false;
    clarabel
}

fn build(data: &QpData, settings: DefaultSettings<f64>) -> Result<DefaultSolver<f64>, QpFailure> {
    let cones = [
        SupportedConeT::ZeroConeT(data.equalities),
        SupportedConeT::NonnegativeConeT(data.b.len() - data.equalities),
    ];
    DefaultSolver::new(&data.p, &data.q, &data.a, &data.b, &cones, settings)
        .map_err(|_| QpFailure::Rejected)
}
