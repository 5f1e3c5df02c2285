//! The one file that names clarabel: a convex QP of fixed sparsity, solved again and again.
//!
//! Most of the time no inequality binds. Then the minimiser under the equalities alone is the QP's
//! solution, and one linear system finds it: [`QpMode::RelaxedFirst`] tries that before the whole QP.

pub use clarabel::algebra::CscMatrix;

use super::problem::{Point, QpData, Residuals};
use super::settings::{ITERATIONS_MAX, QpMode, QpSettings};
use clarabel::solver::{
    DefaultInfo, DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Share of the way to the cone's boundary that a step may take. On a well-scaled QP few of whose
/// rows bind, each step reduces the gap by about 1 less this: clarabel's 0.99 costs an iteration more.
const STEP_FRACTION: f64 = 0.999;

/// Why there is no solution to use.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QpFailure {
    /// The data holds a value that is not finite; the solver was not touched.
    #[error("the QP's data is not finite")]
    NotFinite,
    /// The solver did not accept the problem.
    #[error("the solver rejected the QP's data")]
    Rejected,
    /// The time for this cycle was used up.
    #[error("the deadline passed after {iterations} iterations")]
    Deadline {
        /// Iterations done.
        iterations: u32,
    },
    /// The iterations allowed did not suffice.
    #[error("no solution within {iterations} iterations")]
    MaxIterations {
        /// Iterations done.
        iterations: u32,
    },
    /// No point meets the constraints.
    #[error("the QP is infeasible")]
    Infeasible,
    /// The factorisation broke down; the solver is made new.
    #[error("numerical error after {iterations} iterations")]
    Numerical {
        /// Iterations done.
        iterations: u32,
    },
    /// The solver claims success, the residuals do not.
    #[error("residuals too large: primal {primal:e}, dual {dual:e}, gap {gap:e}")]
    Residual {
        /// Largest violation of a constraint.
        primal: f64,
        /// Largest entry of the Lagrangian's gradient.
        dual: f64,
        /// Duality gap.
        gap: f64,
    },
}

/// When the termination callback ends a solve.
#[derive(Debug)]
struct SolveLimits {
    epoch: Instant,
    /// Nanoseconds after `epoch`.
    deadline_ns: AtomicU64,
    iterations: AtomicU32,
}

impl SolveLimits {
    fn set_deadline(&self, deadline: Option<Instant>) {
        let after = |instant: Instant| instant.saturating_duration_since(self.epoch).as_nanos();
        let limit = deadline.map_or(u64::MAX, |instant| {
            u64::try_from(after(instant)).unwrap_or(u64::MAX)
        });
        self.deadline_ns.store(limit, Ordering::Relaxed);
    }

    fn reached(&self, iterations: u32) -> bool {
        let deadline = Duration::from_nanos(self.deadline_ns.load(Ordering::Relaxed));
        iterations >= self.iterations.load(Ordering::Relaxed) || self.epoch.elapsed() >= deadline
    }
}

/// The problem without its inequalities: clarabel needs one factorisation for it.
struct Relaxed {
    solver: DefaultSolver<f64>,
    /// A's values in the equalities' rows.
    a_values: Vec<f64>,
    b: Vec<f64>,
}

impl Relaxed {
    fn new(
        data: &QpData,
        settings: &QpSettings,
        limits: &Arc<SolveLimits>,
    ) -> Result<Self, QpFailure> {
        let mut relaxed = data.without_inequalities();
        let solver = build(&relaxed, settings, limits)?;
        Ok(Self {
            solver,
            a_values: std::mem::take(&mut relaxed.a.nzval),
            b: relaxed.b,
        })
    }

    fn solve(&mut self, data: &QpData) -> Result<SolverStatus, QpFailure> {
        self.a_values.clear();
        self.a_values.extend(data.equality_values());
        self.b.copy_from_slice(&data.b[..data.equalities]);
        update(
            &mut self.solver,
            &data.p.nzval,
            &data.q,
            &self.a_values,
            &self.b,
        )?;
        self.solver.solve();
        Ok(self.solver.solution.status)
    }
}

/// A solver with the problem it solves.
pub struct QpSolver {
    data: QpData,
    settings: QpSettings,
    whole: DefaultSolver<f64>,
    relaxed: Relaxed,
    limits: Arc<SolveLimits>,
    point: Point,
    work: Point,
    /// Whether an inequality bound in the last solve.
    binding: bool,
    iterations: u32,
    rebuilds: u32,
}

impl QpSolver {
    /// Returns a solver for problems with the pattern of `data`.
    ///
    /// # Errors
    /// [`QpFailure::Rejected`] when clarabel does not take the data.
    pub fn new(data: QpData, settings: QpSettings) -> Result<Self, QpFailure> {
        let limits = Arc::new(SolveLimits {
            epoch: Instant::now(),
            deadline_ns: AtomicU64::new(u64::MAX),
            iterations: AtomicU32::new(settings.max_iterations),
        });
        Ok(Self {
            whole: build(&data, &settings, &limits)?,
            relaxed: Relaxed::new(&data, &settings, &limits)?,
            point: Point::zeros(&data),
            work: Point::zeros(&data),
            data,
            settings,
            limits,
            binding: false,
            iterations: 0,
            rebuilds: 0,
        })
    }

    /// Returns the data for the next solve, to be overwritten in place.
    pub fn data_mut(&mut self) -> &mut QpData {
        &mut self.data
    }

    /// Returns the data of the last solve.
    #[cfg(test)]
    pub fn data(&self) -> &QpData {
        &self.data
    }

    /// Returns the iterations of the last solve; the relaxed problem's linear system counts as one.
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// Returns how often the solver was made new after a numerical error.
    #[cfg(test)]
    pub fn rebuilds(&self) -> u32 {
        self.rebuilds
    }

    /// Returns the primal point of the last solve.
    pub fn primal(&self) -> &[f64] {
        &self.point.primal
    }

    /// Sets the largest number of iterations of the solves to come, at most [`ITERATIONS_MAX`].
    pub fn set_max_iterations(&mut self, iterations: u32) {
        self.limits.iterations.store(iterations, Ordering::Relaxed);
    }

    /// Solves the problem as its data stands, until `deadline` at the latest.
    ///
    /// # Errors
    /// Every [`QpFailure`]; the last solution is then not to be used.
    pub fn solve(&mut self, deadline: Option<Instant>) -> Result<Residuals, QpFailure> {
        self.iterations = 0;
        if !self.data.is_finite() {
            return Err(QpFailure::NotFinite);
        }
        self.limits.set_deadline(deadline);
        if self.settings.mode == QpMode::RelaxedFirst
            && !self.binding
            && !self.limits.reached(0)
            && let Some(residuals) = self.solve_relaxed()?
        {
            return Ok(residuals);
        }
        self.solve_whole()
    }

    /// Returns the residuals of the solution, where no inequality is in its way.
    fn solve_relaxed(&mut self) -> Result<Option<Residuals>, QpFailure> {
        let status = self.relaxed.solve(&self.data)?;
        self.iterations += 1;
        if !matches!(status, SolverStatus::Solved | SolverStatus::AlmostSolved) {
            self.relaxed = Relaxed::new(&self.data, &self.settings, &self.limits)?;
            return Ok(None);
        }
        let found = &self.relaxed.solver.solution;
        self.point.primal.copy_from_slice(&found.x);
        self.point.dual[..self.data.equalities].copy_from_slice(&found.z);
        self.point.dual[self.data.equalities..].fill(0.0);
        if self.data.slacken(&mut self.point) >= 0.0 {
            return Ok(self.check().ok());
        }
        Ok(None)
    }

    fn solve_whole(&mut self) -> Result<Residuals, QpFailure> {
        let before = self.iterations;
        match self.settings.mode {
            QpMode::RelaxedFirst | QpMode::InPlace => {
                let data = &self.data;
                update(
                    &mut self.whole,
                    &data.p.nzval,
                    &data.q,
                    &data.a.nzval,
                    &data.b,
                )?;
            }
            QpMode::FreshDefaults => {
                self.whole = build(&self.data, &self.settings, &self.limits)?;
            }
        }
        self.whole.solve();
        let iterations = self.whole.info.iterations;
        self.iterations = before + iterations;
        let found = &self.whole.solution;
        self.point.primal.copy_from_slice(&found.x);
        self.point.dual.copy_from_slice(&found.z);
        self.point.slack.copy_from_slice(&found.s);
        self.binding = self.point.binds(self.data.equalities);
        match found.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => self.check(),
            SolverStatus::MaxIterations | SolverStatus::InsufficientProgress => {
                // The last iterate may well do; the residuals tell.
                self.check()
                    .map_err(|_| QpFailure::MaxIterations { iterations })
            }
            SolverStatus::CallbackTerminated
                if iterations >= self.limits.iterations.load(Ordering::Relaxed) =>
            {
                self.check()
                    .map_err(|_| QpFailure::MaxIterations { iterations })
            }
            SolverStatus::CallbackTerminated | SolverStatus::MaxTime => {
                Err(QpFailure::Deadline { iterations })
            }
            SolverStatus::PrimalInfeasible
            | SolverStatus::DualInfeasible
            | SolverStatus::AlmostPrimalInfeasible
            | SolverStatus::AlmostDualInfeasible => Err(QpFailure::Infeasible),
            SolverStatus::NumericalError | SolverStatus::Unsolved => {
                // A NaN inside it would stay there for good.
                self.whole = build(&self.data, &self.settings, &self.limits)?;
                self.rebuilds += 1;
                Err(QpFailure::Numerical { iterations })
            }
        }
    }

    fn check(&mut self) -> Result<Residuals, QpFailure> {
        let residuals = self.residuals();
        let limit = self.settings.accepted_residual;
        let Residuals { primal, dual, gap } = residuals;
        if primal <= limit && dual <= limit && gap <= self.settings.accepted_gap {
            Ok(residuals)
        } else {
            // A comparison with NaN is false, so a NaN ends here too.
            Err(QpFailure::Residual { primal, dual, gap })
        }
    }

    /// Returns the KKT residuals of the last solution.
    pub fn residuals(&mut self) -> Residuals {
        self.data.residuals(&self.point, &mut self.work)
    }
}

fn update(
    solver: &mut DefaultSolver<f64>,
    p: &Vec<f64>,
    q: &Vec<f64>,
    a: &Vec<f64>,
    b: &Vec<f64>,
) -> Result<(), QpFailure> {
    solver
        .update_P(p)
        .and_then(|()| solver.update_q(q))
        .and_then(|()| solver.update_A(a))
        .and_then(|()| solver.update_b(b))
        .map_err(|_| QpFailure::Rejected)
}

fn build(
    data: &QpData,
    settings: &QpSettings,
    limits: &Arc<SolveLimits>,
) -> Result<DefaultSolver<f64>, QpFailure> {
    let mut clarabel = DefaultSettings::<f64> {
        verbose: false,
        ..DefaultSettings::default()
    };
    if settings.mode != QpMode::FreshDefaults {
        // Updates in place need the data as given; the QP is scaled by its maker, so neither
        // equilibration nor iterative refinement earns its time.
        clarabel.presolve_enable = false;
        clarabel.equilibrate_enable = false;
        clarabel.iterative_refinement_enable = false;
        clarabel.direct_solve_method = "qdldl".into();
        clarabel.max_iter = ITERATIONS_MAX;
        clarabel.max_step_fraction = STEP_FRACTION;
        clarabel.tol_gap_abs = settings.tolerance;
        clarabel.tol_gap_rel = settings.tolerance;
        clarabel.tol_feas = settings.tolerance;
    }
    let cones = [
        SupportedConeT::ZeroConeT(data.equalities),
        SupportedConeT::NonnegativeConeT(data.b.len() - data.equalities),
    ];
    let cones = &cones[..if data.b.len() > data.equalities { 2 } else { 1 }];
    let mut solver = DefaultSolver::new(&data.p, &data.q, &data.a, &data.b, cones, clarabel)
        .map_err(|_| QpFailure::Rejected)?;
    let limits = Arc::clone(limits);
    solver.set_termination_callback(move |info: &DefaultInfo<f64>| limits.reached(info.iterations));
    Ok(solver)
}
