//! Costs and constraints beside those of path tracking, stage by stage.
//!
//! ```text
//! z_k   = (x, y, yaw at the end of stage k; traction, steer during it)
//! cost += sum_k (z_k - r_k)' W_k (z_k - r_k)
//! l_k  <= G_k z_k <= h_k
//! ```
//!
//! The constraints hold in the QP, for the model linearised about the plan. Where a step towards the QP's solution is
//! judged, what is left of a violation costs a price above the multipliers of all rows: so a step that mends a violation
//! is one that lowers the cost (the exact penalty function of Han, "A globally convergent method for nonlinear programming",
//! 1977).

use super::failure::QpFailure;
use super::stage_qp::dot;
use nalgebra::{SMatrix, Vector3};
use sidehill_plant::frames::wrap_angle;
use sidehill_plant::speeds::MotorSpeeds;

/// Numbers of z: x and y, m, yaw, rad, effective traction and steer, m/s.
pub const EXTRA_SIZE: usize = 5;
/// Largest number of rows of a stage.
pub const EXTRA_ROWS_MAX: usize = 8;

/// Asymmetry and negative curvature that rounding explains, relative to the largest weight.
const ROUNDING: f64 = 1e-9;
/// Price of violations over the largest multiplier.
const PRICE_FACTOR: f64 = 2.0;

/// The cost (z - r)' W (z - r) of a stage, in the unit of the tracking weights: W of diag(0, w, 0, 0, 0) weighs y - r_y
/// as a weight w of 1/m^2 weighs an error of position. The stage's duration does not scale it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExtraCost {
    /// W, symmetric and positive semidefinite.
    pub weight: [[f64; EXTRA_SIZE]; EXTRA_SIZE],
    /// r. The difference of yaws is taken within (-pi, pi].
    pub target: [f64; EXTRA_SIZE],
}

/// The constraint low <= g' z <= high of a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtraRow {
    /// g. Zeros constrain nothing.
    pub by: [f64; EXTRA_SIZE],
    /// Least value, -infinity for none.
    pub low: f64,
    /// Largest value, infinity for none.
    pub high: f64,
}

/// Why extra terms are refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ExtraError {
    /// The law predicts nothing.
    #[error("the controller makes no plan: extra terms need an MPC")]
    NoPlan,
    /// The terms are of another number of stages.
    #[error("the terms are of {found} stages, the horizon has {needed}")]
    Stages {
        /// Stages of the terms.
        found: usize,
        /// Stages of the horizon.
        needed: usize,
    },
    /// The rows are too many or not as many in each stage.
    #[error(
        "rows: {rows} for {stages} stages; each stage must have as many, and at most {EXTRA_ROWS_MAX}"
    )]
    Rows {
        /// Rows of all stages.
        rows: usize,
        /// Stages of the terms.
        stages: usize,
    },
    /// The solver does not take the problem.
    #[error("the MPC cannot be set up: {0}")]
    Solver(#[from] QpFailure),
    /// A number is NaN or infinite.
    #[error("{name}: stage {stage} has a value that is not finite")]
    NotFinite {
        /// What has it.
        name: &'static str,
        /// Stage, the first is 0.
        stage: usize,
    },
    /// A weight is not symmetric.
    #[error("weight: stage {stage} is not symmetric")]
    Asymmetric {
        /// Stage, the first is 0.
        stage: usize,
    },
    /// A weight is not positive semidefinite, so that the QP would not be convex.
    #[error("weight: stage {stage} has the eigenvalue {eigenvalue}, and none may be negative")]
    NotConvex {
        /// Stage, the first is 0.
        stage: usize,
        /// Least eigenvalue.
        eigenvalue: f64,
    },
    /// A row's ends are in the wrong order, or one is NaN.
    #[error("low, high: stage {stage}, row {row}: {low} to {high} has no value")]
    Empty {
        /// Stage, the first is 0.
        stage: usize,
        /// Row in the stage, the first is 0.
        row: usize,
        /// Least value.
        low: f64,
        /// Largest value.
        high: f64,
    },
}

/// Costs and constraints of a horizon's stages.
#[derive(Debug, Clone, PartialEq)]
pub struct ExtraTerms {
    costs: Vec<ExtraCost>,
    rows: Vec<ExtraRow>,
}

impl ExtraTerms {
    /// Returns terms of as many stages as there are `costs`; `rows` has those of the first stage first, as many in each.
    ///
    /// # Errors
    /// [`ExtraError`] with the stage of the first value that is wrong.
    pub fn new(costs: Vec<ExtraCost>, rows: Vec<ExtraRow>) -> Result<Self, ExtraError> {
        let stages = costs.len();
        if stages == 0 || !rows.len().is_multiple_of(stages) || rows.len() > EXTRA_ROWS_MAX * stages
        {
            let rows = rows.len();
            return Err(ExtraError::Rows { rows, stages });
        }
        for (stage, cost) in costs.iter().enumerate() {
            cost.check(stage)?;
        }
        let terms = Self { costs, rows };
        for stage in 0..stages {
            for (row, ExtraRow { by, low, high }) in terms.rows(stage).iter().enumerate() {
                finite("rows", stage, by)?;
                // No comparison with a NaN is true.
                let holds = low <= high && *low < f64::INFINITY && *high > f64::NEG_INFINITY;
                if !holds {
                    let (low, high) = (*low, *high);
                    return Err(ExtraError::Empty {
                        stage,
                        row,
                        low,
                        high,
                    });
                }
            }
        }
        Ok(terms)
    }

    /// Returns the number of stages.
    pub fn stages(&self) -> usize {
        self.costs.len()
    }

    /// Returns the costs of the stages.
    pub fn costs(&self) -> &[ExtraCost] {
        &self.costs
    }

    /// Returns the number of rows of each stage.
    pub fn rows_per_stage(&self) -> usize {
        self.rows.len() / self.costs.len()
    }

    /// Returns the rows of a stage.
    pub fn rows(&self, stage: usize) -> &[ExtraRow] {
        let count = self.rows_per_stage();
        &self.rows[stage * count..(stage + 1) * count]
    }

    /// Returns W of a stage.
    pub(super) fn weight(&self, stage: usize) -> &[[f64; EXTRA_SIZE]; EXTRA_SIZE] {
        &self.costs[stage].weight
    }

    /// Returns z - r of a stage.
    pub(super) fn error(&self, stage: usize, z: &[f64; EXTRA_SIZE]) -> [f64; EXTRA_SIZE] {
        let target = &self.costs[stage].target;
        let mut error: [f64; EXTRA_SIZE] = std::array::from_fn(|i| z[i] - target[i]);
        error[2] = wrap_angle(error[2]);
        error
    }

    /// Returns the cost of a stage, with `price` for each unit by which a row is violated.
    fn cost(&self, stage: usize, z: &[f64; EXTRA_SIZE], price: f64) -> f64 {
        let error = self.error(stage, z);
        let pull = product(self.weight(stage), &error);
        let violation: f64 = self
            .rows(stage)
            .iter()
            .map(|row| {
                let value = dot(&row.by, z);
                (value - row.high).max(row.low - value).max(0.0)
            })
            .sum();
        dot(&error, &pull).max(0.0) + price * violation
    }
}

impl ExtraCost {
    fn check(&self, stage: usize) -> Result<(), ExtraError> {
        finite("weight", stage, self.weight.as_flattened())?;
        finite("target", stage, &self.target)?;
        let weight = SMatrix::<f64, EXTRA_SIZE, EXTRA_SIZE>::from(self.weight);
        let rounding = ROUNDING * weight.amax();
        if (weight - weight.transpose()).amax() > rounding {
            return Err(ExtraError::Asymmetric { stage });
        }
        let eigenvalue = weight.symmetric_eigenvalues().min();
        if eigenvalue < -rounding {
            return Err(ExtraError::NotConvex { stage, eigenvalue });
        }
        Ok(())
    }
}

fn finite(name: &'static str, stage: usize, values: &[f64]) -> Result<(), ExtraError> {
    if values.iter().all(|value| value.is_finite()) {
        Ok(())
    } else {
        Err(ExtraError::NotFinite { name, stage })
    }
}

/// Returns z of a stage of a plan whose first heading is `first_yaw_rad`: there yaw is within (-pi, pi], and from there it
/// goes on without jumps.
pub(super) fn values(
    state: &Vector3<f64>,
    input: MotorSpeeds,
    first_yaw_rad: f64,
) -> [f64; EXTRA_SIZE] {
    let turns_rad = first_yaw_rad - wrap_angle(first_yaw_rad);
    let (traction, steer) = (input.traction_m_s, input.steer_m_s);
    [state.x, state.y, state.z - turns_rad, traction, steer]
}

/// Returns the size of a row: its largest coefficient.
pub(super) fn row_size(row: &ExtraRow) -> f64 {
    row.by
        .iter()
        .fold(f64::MIN_POSITIVE, |m, by| m.max(by.abs()))
}

/// Returns the product of a matrix and a vector.
pub(super) fn product(
    matrix: &[[f64; EXTRA_SIZE]; EXTRA_SIZE],
    vector: &[f64; EXTRA_SIZE],
) -> [f64; EXTRA_SIZE] {
    std::array::from_fn(|i| dot(&matrix[i], vector))
}

/// The terms in force.
#[derive(Clone)]
pub(super) struct Extra {
    pub(super) terms: ExtraTerms,
    /// Price of a violated row for each of its units.
    price: f64,
}

impl Extra {
    pub(super) fn new(terms: ExtraTerms) -> Self {
        Self { terms, price: 0.0 }
    }

    /// Sets the price of violations by the largest multiplier of a row, in units of the cost.
    pub(super) fn set_price(&mut self, largest_multiplier: f64) {
        self.price = PRICE_FACTOR * largest_multiplier;
    }

    /// Returns the cost of a stage that ends in `state`, of a plan whose first heading is `first_yaw_rad`.
    pub(super) fn cost(
        &self,
        stage: usize,
        first_yaw_rad: f64,
        state: &Vector3<f64>,
        input: MotorSpeeds,
    ) -> f64 {
        let z = values(state, input, first_yaw_rad);
        self.terms.cost(stage, &z, self.price)
    }
}
