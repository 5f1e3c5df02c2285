//! The one file that names clarabel: a convex QP of fixed sparsity, solved again and again.
//!
//! ```text
//! minimise 1/2 z' P z + q' z   subject to   A z + s = b,  s = 0 (equalities), s >= 0 (the rest)
//! ```

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultInfo, DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Largest number of iterations of any solve.
pub const ITERATIONS_MAX: u32 = 100;

/// Share of the way to the cone's boundary that a step may take. On a well-scaled QP few of whose
/// rows bind, each step reduces the gap by about 1 less this: clarabel's 0.99 costs an iteration more.
const STEP_FRACTION: f64 = 0.999;

/// How the QP is handed to the solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QpMode {
    /// One solver made at start, updated in place, set up for small well-scaled QPs.
    InPlace,
    /// A solver with clarabel's defaults made new in each cycle: what benches compare with.
    FreshDefaults,
}

/// Why there is no solution to use.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
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

/// Optimality of a point, computed from the data and not from the solver's own account.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residuals {
    /// Largest entry of |A z + s - b|, and how far s or the multipliers leave their cone.
    pub primal: f64,
    /// Largest entry of |P z + q + A' y|.
    pub dual: f64,
    /// |z' P z + q' z + b' y|.
    pub gap: f64,
}

/// A QP's data with the pattern it was made with; values may be overwritten between solves.
#[derive(Debug, Clone)]
pub struct QpData {
    /// Upper triangle of P.
    pub p: CscMatrix<f64>,
    /// Linear cost.
    pub q: Vec<f64>,
    /// Constraint matrix, equalities first.
    pub a: CscMatrix<f64>,
    /// Right-hand side.
    pub b: Vec<f64>,
    /// Number of equality rows.
    pub equalities: usize,
}

/// Limits and tolerances of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QpSettings {
    /// How the solver is used.
    pub mode: QpMode,
    /// Largest number of interior-point iterations.
    pub max_iterations: u32,
    /// Feasibility and gap tolerance of the solver.
    pub tolerance: f64,
    /// Largest primal and dual residual accepted by our own check, relative to the size of the terms
    /// they sum.
    pub accepted_residual: f64,
    /// Largest duality gap accepted, relative to the cost: a feasible point so far from the optimum
    /// is still a plan.
    pub accepted_gap: f64,
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
    fn reached(&self, iterations: u32) -> bool {
        let deadline = Duration::from_nanos(self.deadline_ns.load(Ordering::Relaxed));
        iterations >= self.iterations.load(Ordering::Relaxed) || self.epoch.elapsed() >= deadline
    }
}

/// A solver with the problem it solves.
pub struct QpSolver {
    data: QpData,
    settings: QpSettings,
    solver: DefaultSolver<f64>,
    limits: Arc<SolveLimits>,
    dual_residual: Vec<f64>,
    primal_residual: Vec<f64>,
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
        let solver = build(&data, &settings, &limits)?;
        Ok(Self {
            dual_residual: vec![0.0; data.q.len()],
            primal_residual: vec![0.0; data.b.len()],
            data,
            settings,
            solver,
            limits,
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

    /// Returns the iterations of the last solve.
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
        &self.solver.solution.x
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
        if !self.data_is_finite() {
            return Err(QpFailure::NotFinite);
        }
        let limit = deadline.map_or(u64::MAX, |instant| {
            u64::try_from(
                instant
                    .saturating_duration_since(self.limits.epoch)
                    .as_nanos(),
            )
            .unwrap_or(u64::MAX)
        });
        self.limits.deadline_ns.store(limit, Ordering::Relaxed);
        match self.settings.mode {
            QpMode::InPlace => self.update()?,
            QpMode::FreshDefaults => {
                self.solver = build(&self.data, &self.settings, &self.limits)?;
            }
        }
        self.solver.solve();
        let iterations = self.solver.info.iterations;
        self.iterations = iterations;
        match self.solver.solution.status {
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
                self.rebuild()?;
                Err(QpFailure::Numerical { iterations })
            }
        }
    }

    fn update(&mut self) -> Result<(), QpFailure> {
        let (solver, data) = (&mut self.solver, &self.data);
        let updated = solver
            .update_P(&data.p.nzval)
            .and_then(|()| solver.update_q(&data.q))
            .and_then(|()| solver.update_A(&data.a.nzval))
            .and_then(|()| solver.update_b(&data.b));
        updated.map_err(|_| QpFailure::Rejected)
    }

    /// Makes the solver new: a NaN inside it would stay there for good.
    fn rebuild(&mut self) -> Result<(), QpFailure> {
        self.solver = build(&self.data, &self.settings, &self.limits)?;
        self.rebuilds += 1;
        Ok(())
    }

    fn data_is_finite(&self) -> bool {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        finite(&self.data.p.nzval)
            && finite(&self.data.q)
            && finite(&self.data.a.nzval)
            && finite(&self.data.b)
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

    /// Returns the KKT residuals of the last solution, relative to the largest term of each.
    pub fn residuals(&mut self) -> Residuals {
        let (data, solution) = (&self.data, &self.solver.solution);
        let (z, y, s) = (&solution.x, &solution.z, &solution.s);
        self.dual_residual.copy_from_slice(&data.q);
        let mut quadratic = 0.0;
        for column in 0..data.p.n {
            for k in data.p.colptr[column]..data.p.colptr[column + 1] {
                let (row, value) = (data.p.rowval[k], data.p.nzval[k]);
                self.dual_residual[row] += value * z[column];
                quadratic += value * z[row] * z[column];
                if row != column {
                    self.dual_residual[column] += value * z[row];
                    quadratic += value * z[row] * z[column];
                }
            }
        }
        for ((residual, s), b) in self.primal_residual.iter_mut().zip(s).zip(&data.b) {
            *residual = s - b;
        }
        for (column, (z, residual)) in z.iter().zip(&mut self.dual_residual).enumerate() {
            for k in data.a.colptr[column]..data.a.colptr[column + 1] {
                let (row, value) = (data.a.rowval[k], data.a.nzval[k]);
                self.primal_residual[row] += value * z;
                *residual += value * y[row];
            }
        }
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| nan_max(m, v.abs()));
        let outside = s[data.equalities..]
            .iter()
            .chain(&y[data.equalities..])
            .fold(0.0_f64, |m, v| nan_max(m, -v));
        let linear = dot(&data.q, z);
        let gap = quadratic + linear + dot(&data.b, y);
        Residuals {
            primal: nan_max(largest(&self.primal_residual), outside)
                / (1.0 + largest(&data.b).max(largest(z))),
            dual: largest(&self.dual_residual) / (1.0 + largest(&data.q)),
            gap: gap.abs() / (1.0 + (0.5 * quadratic + linear).abs()),
        }
    }
}

/// Returns the larger of two values, or NaN where one is: a NaN must not hide behind a maximum.
fn nan_max(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() {
        f64::NAN
    } else {
        a.max(b)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
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
    if settings.mode == QpMode::InPlace {
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
    let mut solver = DefaultSolver::new(&data.p, &data.q, &data.a, &data.b, &cones, clarabel)
        .map_err(|_| QpFailure::Rejected)?;
    let limits = Arc::clone(limits);
    solver.set_termination_callback(move |info: &DefaultInfo<f64>| limits.reached(info.iterations));
    Ok(solver)
}

/// Returns a matrix in compressed columns with the given entries, all 1, and where each entry's value
/// stands in it.
///
/// Entries must be distinct; their order is free.
pub fn pattern(
    rows: usize,
    columns: usize,
    entries: &[(usize, usize)],
) -> (CscMatrix<f64>, Vec<usize>) {
    let mut order: Vec<usize> = (0..entries.len()).collect();
    order.sort_by_key(|&i| (entries[i].1, entries[i].0));
    let mut column_starts = vec![0; columns + 1];
    for &(_, column) in entries {
        column_starts[column + 1] += 1;
    }
    for column in 0..columns {
        column_starts[column + 1] += column_starts[column];
    }
    let mut positions = vec![0; entries.len()];
    for (position, &entry) in order.iter().enumerate() {
        positions[entry] = position;
    }
    let row_indices = order.iter().map(|&i| entries[i].0).collect();
    let values = vec![1.0; entries.len()];
    (
        CscMatrix::new(rows, columns, column_starts, row_indices, values),
        positions,
    )
}
