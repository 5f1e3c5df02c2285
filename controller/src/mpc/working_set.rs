//! The QP for a set of active rows, which starts from that of the last solve.
//!
//! [`LimitSearch`] mostly finds the set and the solution. Where it does not apply or fails, the QP of the active
//! rows W is one linear system. Where its solution has wrong signs, rows with negative multipliers leave W and
//! violated ones join it (Hintermueller, Ito and Kunisch, SIAM J. Optim. 13, 2002). That can cycle: it ends where
//! the number of wrong signs does not fall, and the interior-point method solves the QP.
//!
//! W enters as a penalty rho/2 (a' x - b)^2 on each of its rows a, so that all systems have one
//! sparsity pattern: P's, with room for the products of each row. The multiplier of a row is
//! rho (a' x - b). Iterative refinement on the KKT residuals of the QP itself removes the penalty's
//! error:
//!
//! ```text
//! (P + rho A_W' A_W) dx + E' dy_E = -(P x + q + A' y) - rho A_W' (A_W x - b_W)
//! E dx                            = e - E x
//! dy_W = rho (A_W (x + dx) - b_W)
//! ```

use super::clarabel_qp::{LinearSystem, SolveLimits};
use super::failure::QpFailure;
use super::limit_search::LimitSearch;
use super::penalised::{Places, penalised};
use super::problem::{Point, QpData, Residuals};
use super::rows::Rows;

/// A penalty's curvature along its row, relative to P's own.
const STIFFNESS: f64 = 1e6;
/// Largest number of these systems.
const CORRECTIONS: u32 = 6;
/// Factor by which the number of wrong signs must fall from one system to the next.
const PROGRESS: f64 = 0.7;
/// Largest number of steps of iterative refinement.
const REFINEMENTS: u32 = 3;
/// Tolerance of signs and refined residuals, relative to the solver's.
const SHARPER: f64 = 0.1;

/// Finds the active rows, starting from those of the last solve.
#[derive(Clone)]
pub struct WorkingSet {
    rows: Rows,
    system: LinearSystem,
    search: Option<LimitSearch>,
    places: Places,
    /// Values of P with the penalties.
    p: Vec<f64>,
    /// Values of A in the equalities' rows.
    equalities: Vec<f64>,
    /// P's own diagonal.
    diagonal: Vec<f64>,
    q: Vec<f64>,
    e: Vec<f64>,
    /// Whether each row is in W: now, and next according to the signs.
    members: Vec<bool>,
    next: Vec<bool>,
    /// rho of the rows in W.
    stiffness: Vec<f64>,
    factorisations: u32,
}

impl WorkingSet {
    /// Returns a solver for problems with the pattern of `data`, with an empty working set.
    ///
    /// # Errors
    /// [`QpFailure::Rejected`] when clarabel does not accept the data.
    pub fn new(data: &QpData) -> Result<Self, QpFailure> {
        let rows = Rows::new(data);
        let (penalised, places) = penalised(data, &rows);
        let count = rows.count();
        Ok(Self {
            system: LinearSystem::new(&penalised)?,
            search: LimitSearch::new(data),
            p: penalised.p.nzval,
            equalities: penalised.a.nzval,
            diagonal: vec![0.0; data.q.len()],
            q: vec![0.0; data.q.len()],
            e: vec![0.0; data.equalities],
            members: vec![false; count],
            next: vec![false; count],
            stiffness: vec![0.0; count],
            factorisations: 0,
            places,
            rows,
        })
    }

    /// Returns the linear systems factorised in the last solve.
    pub fn factorisations(&self) -> u32 {
        self.factorisations
    }

    /// Returns whether an inequality is active in the last solution.
    pub fn binds(&self) -> bool {
        self.members.contains(&true)
    }

    /// Starts the next solve from the rows that are active at `point`.
    pub fn begin_with(&mut self, point: &Point, data: &QpData) {
        let first = data.equalities;
        let rows = point.dual[first..].iter().zip(&point.slack[first..]);
        for (member, (dual, slack)) in self.members.iter_mut().zip(rows) {
            *member = dual > slack;
        }
    }

    /// Sets `point` to the QP's solution and returns its residuals, at most `tolerance`; none where
    /// the method fails. `work` is workspace of the same lengths as `point`.
    ///
    /// # Errors
    /// [`QpFailure::Deadline`], with the last iterate in `point` where there was one, and
    /// [`QpFailure::Rejected`] for data of another size.
    pub fn solve(
        &mut self,
        data: &QpData,
        point: &mut Point,
        work: &mut Point,
        tolerance: f64,
        limits: &SolveLimits,
    ) -> Result<Option<Residuals>, QpFailure> {
        self.factorisations = 0;
        if !self.rows.fit(data) || data.p.nzval.len() != self.places.p.len() {
            return Err(QpFailure::Rejected);
        }
        if self.search(data, point, limits)? {
            let residuals = data.residuals(point, work);
            if residuals.within(SHARPER * tolerance) {
                return Ok(Some(residuals));
            }
        }
        let solved = self.correct(data, point, work, tolerance, limits)?;
        if solved.is_none() {
            // The next solve must not begin with these rows.
            self.members.fill(false);
        }
        Ok(solved)
    }

    /// Searches the active rows stage by stage; returns whether they were found, and `point` is the optimum. Where not,
    /// the members stay as they are.
    fn search(
        &mut self,
        data: &QpData,
        point: &mut Point,
        limits: &SolveLimits,
    ) -> Result<bool, QpFailure> {
        let Some(search) = &mut self.search else {
            return Ok(false);
        };
        let found = search.find(data, &self.rows, &mut self.members, limits);
        self.factorisations += search.systems();
        if search.systems() > 0 {
            search.put_optimum(data, &self.rows, point);
        }
        found.map_err(|()| self.late())
    }

    /// Exchanges all rows of wrong sign at once, until none is left or their number does not fall.
    fn correct(
        &mut self,
        data: &QpData,
        point: &mut Point,
        work: &mut Point,
        tolerance: f64,
        limits: &SolveLimits,
    ) -> Result<Option<Residuals>, QpFailure> {
        for (value, place) in self.equalities.iter_mut().zip(&self.places.equalities) {
            *value = data.a.nzval[*place];
        }
        let mut before = usize::MAX;
        for _ in 0..CORRECTIONS {
            if !self.factorise(data, limits)? || !self.first_point(data, point) {
                return Ok(None);
            }
            let mut wrong = self.judge(data, point, tolerance);
            for _ in 0..=REFINEMENTS {
                if wrong > 0 {
                    break;
                }
                let residuals = data.residuals(point, work);
                if residuals.within(SHARPER * tolerance) {
                    return Ok(Some(residuals));
                }
                if !self.refine(data, point, work) {
                    return Ok(None);
                }
                wrong = self.judge(data, point, tolerance);
            }
            if wrong == 0 || wrong as f64 > PROGRESS * before as f64 {
                return Ok(None);
            }
            before = wrong;
            std::mem::swap(&mut self.members, &mut self.next);
        }
        Ok(None)
    }

    /// Factorises the system of the rows in W; returns whether that went well.
    fn factorise(&mut self, data: &QpData, limits: &SolveLimits) -> Result<bool, QpFailure> {
        if limits.passed() {
            return Err(self.late());
        }
        self.factorisations += 1;
        self.p.fill(0.0);
        for (place, value) in self.places.p.iter().zip(&data.p.nzval) {
            self.p[*place] = *value;
        }
        for (own, place) in self.diagonal.iter_mut().zip(&self.places.diagonal) {
            *own = self.p[*place];
        }
        self.q.copy_from_slice(&data.q);
        for row in (0..self.members.len()).filter(|row| self.members[*row]) {
            let entries = self.rows.entries(data, row);
            let (mut size, mut curvature) = (0.0, 0.0);
            for (column, value) in entries.clone() {
                size += value * value;
                curvature += value * value * self.diagonal[column];
            }
            // A row of zeros constrains nothing.
            let size = size.max(f64::MIN_POSITIVE);
            let rho = STIFFNESS * (curvature / size).max(1.0) / size;
            self.stiffness[row] = rho;
            let mut products = self.places.products[self.places.product_starts[row]..].iter();
            for (i, (column, value)) in entries.clone().enumerate() {
                self.q[column] -= rho * value * data.b[data.equalities + row];
                let upper = entries.clone().take(i + 1);
                for ((_, other), place) in upper.zip(products.by_ref()) {
                    self.p[*place] += rho * value * other;
                }
            }
        }
        self.system.factorise(&self.p, &self.equalities)
    }

    /// Sets `point` to the solution of the penalised problem; returns whether there is one.
    fn first_point(&mut self, data: &QpData, point: &mut Point) -> bool {
        let first = data.equalities;
        if !self.system.solve(&self.q, &data.b[..first]) {
            return false;
        }
        point.primal.copy_from_slice(self.system.primal());
        point.dual[..first].copy_from_slice(self.system.multipliers());
        point.dual[first..].fill(0.0);
        self.multiply(data, point);
        true
    }

    /// Adds a step of iterative refinement; `work` holds the residuals of `point`.
    fn refine(&mut self, data: &QpData, point: &mut Point, work: &Point) -> bool {
        let first = data.equalities;
        self.q.copy_from_slice(&work.primal);
        for row in (0..self.members.len()).filter(|row| self.members[*row]) {
            let force = self.stiffness[row] * work.slack[first + row];
            for (column, value) in self.rows.entries(data, row) {
                self.q[column] += force * value;
            }
        }
        for (e, residual) in self.e.iter_mut().zip(&work.slack) {
            *e = -residual;
        }
        if !self.system.solve(&self.q, &self.e) {
            return false;
        }
        for (x, step) in point.primal.iter_mut().zip(self.system.primal()) {
            *x += step;
        }
        for (y, step) in point.dual.iter_mut().zip(self.system.multipliers()) {
            *y += step;
        }
        self.multiply(data, point);
        true
    }

    /// Adds rho (a' x - b) to the multipliers of the rows in W and sets all slacks.
    fn multiply(&self, data: &QpData, point: &mut Point) {
        data.slacken(point);
        let first = data.equalities;
        for row in (0..self.members.len()).filter(|row| self.members[*row]) {
            point.dual[first + row] -= self.stiffness[row] * point.slack[first + row];
            point.slack[first + row] = 0.0;
        }
    }

    /// Marks the rows that should be in W by their signs; returns how many change.
    fn judge(&mut self, data: &QpData, point: &Point, tolerance: f64) -> usize {
        let first = data.equalities;
        let least = |values: &[f64]| {
            let largest = values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            -SHARPER * tolerance * (1.0 + largest)
        };
        let (least_slack, least_dual) = (least(&data.b), least(&data.q));
        let rows = point.dual[first..].iter().zip(&point.slack[first..]);
        let mut wrong = 0;
        for ((member, next), (dual, slack)) in self.members.iter().zip(&mut self.next).zip(rows) {
            *next = if *member {
                *dual >= least_dual
            } else {
                *slack < least_slack
            };
            wrong += usize::from(next != member);
        }
        wrong
    }

    fn late(&self) -> QpFailure {
        QpFailure::Deadline {
            iterations: self.factorisations,
        }
    }
}
