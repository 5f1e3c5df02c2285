//! The QP of a horizon, stage by stage.
//!
//! Direct multiple shooting about a plan (x_k, u_k), k = 0..N, with deviations xi of the states and du of the inputs. With
//! v_k = (xi_{k+1}, du_k):
//!
//! ```text
//! xi_{k+1} = A xi_k + B du_k,   A = I + a e_3',   xi_0 = 0,   du_{-1} = 0
//! cost = sum_k  1/2 v_k' Q v_k + f' v_k
//!        + 1/2 sum_m r_m (du_k - du_{k-1} + o)_m^2
//!        + 1/2 w (s' (e_3' xi_k, du_k) + t)^2
//! low <= g' v_k + h' du_{k-1} <= high   for each row of stage k
//! ```

use super::residuals::{Residuals, nan_max};
use std::ops::Range;

/// Inputs of a stage: traction and steer.
pub const MOTORS: usize = 2;
/// Entries of a state: x, y and yaw.
pub const STATES: usize = 3;
/// Variables of a stage: the state at its end and its inputs.
pub const VARIABLES: usize = STATES + MOTORS;

/// Dynamics and cost of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StageTerms {
    /// a: change of the state by the yaw before.
    pub(super) by_yaw: [f64; STATES],
    /// Columns of B, 1/(m/s).
    pub(super) by_input: [[f64; STATES]; MOTORS],
    /// Q.
    pub(super) weight: [[f64; VARIABLES]; VARIABLES],
    /// f.
    pub(super) force: [f64; VARIABLES],
    /// r, 1/(m/s)^2.
    pub(super) change_weight: [f64; MOTORS],
    /// o: planned change from the stage before, m/s.
    pub(super) change: [f64; MOTORS],
    /// s: derivatives of a speed by the yaw before and the inputs.
    pub(super) speed_row: [f64; 1 + MOTORS],
    /// w, 1/(m/s)^2.
    pub(super) speed_weight: f64,
    /// t, m/s.
    pub(super) speed_error: f64,
}

impl StageTerms {
    /// Returns A' of a vector.
    pub(super) fn back(&self, mut vector: [f64; STATES]) -> [f64; STATES] {
        vector[2] += dot(&self.by_yaw, &vector);
        vector
    }

    /// Returns A xi + B u.
    pub(super) fn forward(&self, xi: &[f64; STATES], inputs: &[f64; MOTORS]) -> [f64; STATES] {
        std::array::from_fn(|i| {
            xi[i]
                + self.by_yaw[i] * xi[2]
                + self.by_input[0][i] * inputs[0]
                + self.by_input[1][i] * inputs[1]
        })
    }

    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let motion = self
            .by_yaw
            .iter_mut()
            .chain(self.by_input.as_flattened_mut());
        let weight = self.weight.as_flattened_mut().iter_mut();
        motion
            .chain(weight)
            .chain(&mut self.force)
            .chain(&mut self.change_weight)
            .chain(&mut self.change)
            .chain(&mut self.speed_row)
            .chain([&mut self.speed_weight, &mut self.speed_error])
    }
}

/// A row low <= g' v_k + h' u_{k-1} <= high of a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageRow {
    /// g.
    pub(super) by: [f64; VARIABLES],
    /// h.
    pub(super) by_before: [f64; MOTORS],
    /// -infinity for none.
    pub(super) low: f64,
    /// Infinity for none.
    pub(super) high: f64,
}

impl StageRow {
    /// Constrains nothing.
    const FREE: Self = Self {
        by: [0.0; VARIABLES],
        by_before: [0.0; MOTORS],
        low: f64::NEG_INFINITY,
        high: f64::INFINITY,
    };

    /// Returns the side on which a value exceeds the row, and how far.
    pub(super) fn excess(&self, value: f64) -> (f64, f64) {
        let high = value - self.high;
        if high > 0.0 {
            (1.0, high)
        } else {
            (-1.0, self.low - value)
        }
    }

    /// Returns how far a value exceeds the end of a side.
    pub(super) fn excess_on(&self, side: f64, value: f64) -> f64 {
        if side > 0.0 {
            value - self.high
        } else {
            self.low - value
        }
    }

    fn of_inputs(by: [f64; MOTORS], by_before: [f64; MOTORS]) -> Self {
        Self {
            by: [0.0, 0.0, 0.0, by[0], by[1]],
            by_before,
            ..Self::FREE
        }
    }

    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let ends = [&mut self.low, &mut self.high];
        self.by.iter_mut().chain(&mut self.by_before).chain(ends)
    }
}

/// Inputs, and the states at the stages' ends that follow from them.
#[derive(Debug, Clone)]
pub struct Rollout {
    /// du.
    pub inputs: Vec<[f64; MOTORS]>,
    /// xi.
    pub states: Vec<[f64; STATES]>,
}

impl Rollout {
    /// Returns a rollout of zeros.
    pub fn zeros(stages: usize) -> Self {
        Self {
            inputs: vec![[0.0; MOTORS]; stages],
            states: vec![[0.0; STATES]; stages],
        }
    }

    /// Takes the values of a rollout of the same length.
    pub fn copy_from(&mut self, other: &Self) {
        self.inputs.copy_from_slice(&other.inputs);
        self.states.copy_from_slice(&other.states);
    }
}

/// A point of a QP.
#[derive(Debug, Clone)]
pub struct Point {
    /// Inputs and states.
    pub rollout: Rollout,
    /// Multipliers of the rows: positive where the high end presses, negative where the low one does.
    pub multipliers: Vec<f64>,
}

/// A QP; its terms and rows may be overwritten between solves.
#[derive(Debug, Clone, PartialEq)]
pub struct StageQp {
    /// Terms of the stages.
    pub(super) stages: Vec<StageTerms>,
    /// Rows of the first stage, then those of the next.
    rows: Vec<StageRow>,
    /// Rows of a stage that limit inputs and their changes; those of extra terms follow.
    input_rows: usize,
}

/// Workspace of [`StageQp::residuals`].
#[derive(Debug, Clone)]
pub struct Work {
    forces: Vec<[f64; VARIABLES]>,
    slopes: Vec<[f64; MOTORS]>,
}

impl StageQp {
    /// Returns a QP without dynamics and cost. Its rows are, of each stage: bounds and changes of traction and steer, the
    /// treads' speeds with `tread_rows`, and `extra_rows` others; none has an end yet.
    pub fn new(stages: usize, tread_rows: bool, extra_rows: usize) -> Self {
        let mut of_stage = Vec::new();
        for motor in [[1.0, 0.0], [0.0, 1.0]] {
            of_stage.push(StageRow::of_inputs(motor, [0.0; MOTORS]));
            of_stage.push(StageRow::of_inputs(motor, motor.map(|by| -by)));
        }
        if tread_rows {
            of_stage.push(StageRow::of_inputs([1.0, -1.0], [0.0; MOTORS]));
            of_stage.push(StageRow::of_inputs([1.0, 1.0], [0.0; MOTORS]));
        }
        let input_rows = of_stage.len();
        of_stage.resize(input_rows + extra_rows, StageRow::FREE);
        let mut rows = of_stage.repeat(stages);
        // No input comes before those of the first stage.
        for row in rows.iter_mut().take(of_stage.len()) {
            row.by_before = [0.0; MOTORS];
        }
        Self {
            stages: vec![StageTerms::default(); stages],
            rows,
            input_rows,
        }
    }

    /// Returns a QP of the same stages and rows of inputs with other extra rows.
    pub fn with_extra_rows(&self, extra_rows: usize) -> Self {
        Self::new(self.stages.len(), self.input_rows > 2 * MOTORS, extra_rows)
    }

    /// Returns the number of rows of each stage that limit inputs and their changes.
    pub fn input_rows(&self) -> usize {
        self.input_rows
    }

    /// Returns the rows.
    pub fn rows(&self) -> &[StageRow] {
        &self.rows
    }

    /// Returns the number of rows of each stage.
    fn rows_per_stage(&self) -> usize {
        self.rows.len() / self.stages.len()
    }

    /// Returns where the extra rows of a stage stand.
    pub fn extra_rows(&self, stage: usize) -> Range<usize> {
        let count = self.rows_per_stage();
        stage * count + self.input_rows..(stage + 1) * count
    }

    /// Returns the rows of a stage that limit its inputs, and its extra rows.
    pub(super) fn rows_mut(&mut self, stage: usize) -> (&mut [StageRow], &mut [StageRow]) {
        let count = self.rows_per_stage();
        self.rows[stage * count..(stage + 1) * count].split_at_mut(self.input_rows)
    }

    /// Returns the stage of a row.
    pub fn stage_of(&self, row: usize) -> usize {
        row / self.rows_per_stage()
    }

    /// Returns whether all values are finite, but for ends that are none.
    pub fn is_finite(&self) -> bool {
        let mut stages = self.stages.iter().copied();
        stages.all(|mut terms| terms.numbers().all(|value| value.is_finite()))
            && self.rows.iter().all(|row| {
                let mut coefficients = row.by.iter().chain(&row.by_before);
                // No comparison with a NaN is true.
                coefficients.all(|by| by.is_finite())
                    && row.low < f64::INFINITY
                    && row.high > f64::NEG_INFINITY
            })
    }

    /// Returns a point of zeros.
    pub fn zeros(&self) -> Point {
        Point {
            rollout: Rollout::zeros(self.stages.len()),
            multipliers: vec![0.0; self.rows.len()],
        }
    }

    /// Returns workspace for residuals.
    pub fn work(&self) -> Work {
        Work {
            forces: vec![[0.0; VARIABLES]; self.stages.len()],
            slopes: vec![[0.0; MOTORS]; self.stages.len()],
        }
    }

    /// Sets the states that follow from a rollout's inputs.
    pub fn roll(&self, rollout: &mut Rollout) {
        let mut xi = [0.0; STATES];
        let inputs = rollout.inputs.iter().zip(&mut rollout.states);
        for (terms, (inputs, state)) in self.stages.iter().zip(inputs) {
            xi = terms.forward(&xi, inputs);
            *state = xi;
        }
    }

    /// Returns the value of a row.
    pub fn value(&self, row: usize, rollout: &Rollout) -> f64 {
        let (own, k) = (&self.rows[row], self.stage_of(row));
        let (by_state, by_inputs) = own.by.split_at(STATES);
        let value = dot(by_state, &rollout.states[k]) + dot(by_inputs, &rollout.inputs[k]);
        match k.checked_sub(1) {
            Some(before) => value + dot(&own.by_before, &rollout.inputs[before]),
            None => value,
        }
    }

    /// Adds a multiple of a row's coefficients to `forces`, the linear cost by the v of each stage.
    pub fn press(&self, row: usize, multiplier: f64, forces: &mut [[f64; VARIABLES]]) {
        let (own, k) = (&self.rows[row], self.stage_of(row));
        for (force, by) in forces[k].iter_mut().zip(&own.by) {
            *force += multiplier * by;
        }
        if k > 0 {
            for (force, by) in forces[k - 1][STATES..].iter_mut().zip(&own.by_before) {
                *force += multiplier * by;
            }
        }
    }

    /// Sets `forces` to the derivatives of the cost by the v of each stage, where all v are 0.
    pub fn linear(&self, forces: &mut [[f64; VARIABLES]]) {
        for (force, terms) in forces.iter_mut().zip(&self.stages) {
            *force = terms.force;
        }
        for (k, terms) in self.stages.iter().enumerate() {
            let pull = terms.speed_weight * terms.speed_error;
            for m in 0..MOTORS {
                let push = terms.change_weight[m] * terms.change[m];
                forces[k][STATES + m] += push + pull * terms.speed_row[1 + m];
                if k > 0 {
                    forces[k - 1][STATES + m] -= push;
                }
            }
            if k > 0 {
                forces[k - 1][2] += pull * terms.speed_row[0];
            }
        }
    }

    /// Returns the cost of a rollout, and hands the derivatives of the cost plus `forces` to `take`, stage by stage, the last
    /// first: by the inputs and by the state at the stage's end, where the states that follow do so.
    fn differentiate(
        &self,
        rollout: &Rollout,
        forces: &[[f64; VARIABLES]],
        mut take: impl FnMut(usize, [f64; MOTORS], [f64; STATES]),
    ) -> f64 {
        let mut cost = 0.0;
        let mut ahead = [0.0; STATES];
        let mut change_after = [0.0; MOTORS];
        for (k, terms) in self.stages.iter().enumerate().rev() {
            let (xi, own) = (&rollout.states[k], &rollout.inputs[k]);
            let v = [xi[0], xi[1], xi[2], own[0], own[1]];
            let (yaw, before) = match k.checked_sub(1) {
                Some(last) => (rollout.states[last][2], rollout.inputs[last]),
                None => (0.0, [0.0; MOTORS]),
            };
            let mut slope = [0.0; VARIABLES];
            for (i, slope) in slope.iter_mut().enumerate() {
                let turned = dot(&terms.weight[i], &v);
                cost += v[i] * (0.5 * turned + terms.force[i]);
                *slope = turned + terms.force[i] + forces[k][i];
            }
            for (ahead, slope) in ahead.iter_mut().zip(&slope) {
                *ahead += slope;
            }
            let costate = ahead;
            let [by_yaw, by_inputs @ ..] = &terms.speed_row;
            let speed = by_yaw * yaw + dot(by_inputs, own) + terms.speed_error;
            let pull = terms.speed_weight * speed;
            cost += 0.5 * pull * speed;
            let mut by_own = [0.0; MOTORS];
            for m in 0..MOTORS {
                let change = own[m] - before[m] + terms.change[m];
                let force = terms.change_weight[m] * change;
                cost += 0.5 * force * change;
                by_own[m] = dot(&terms.by_input[m], &ahead) + slope[STATES + m] + force
                    - change_after[m]
                    + pull * by_inputs[m];
                change_after[m] = force;
            }
            ahead = terms.back(ahead);
            ahead[2] += pull * by_yaw;
            take(k, by_own, costate);
        }
        cost
    }

    /// Returns the cost of a rollout.
    pub fn cost(&self, rollout: &Rollout, work: &mut Work) -> f64 {
        work.forces.fill([0.0; VARIABLES]);
        self.differentiate(rollout, &work.forces, |_, _, _| {})
    }

    /// Returns the KKT residuals of a point whose states follow from its inputs.
    pub fn residuals(&self, point: &Point, work: &mut Work) -> Residuals {
        self.linear(&mut work.forces);
        let largest_force = largest(work.forces.as_flattened());
        work.forces.fill([0.0; VARIABLES]);
        let (mut excess, mut size, mut gap) = (0.0, 0.0, 0.0);
        for (row, (own, multiplier)) in self.rows.iter().zip(&point.multipliers).enumerate() {
            let value = self.value(row, &point.rollout);
            excess = nan_max(excess, nan_max(value - own.high, own.low - value));
            size = nan_max(size, value.abs());
            if *multiplier != 0.0 {
                let end = if *multiplier > 0.0 { own.high } else { own.low };
                gap += multiplier * (value - end);
                self.press(row, *multiplier, &mut work.forces);
            }
        }
        let slopes = &mut work.slopes;
        let cost = self.differentiate(&point.rollout, &work.forces, |k, by_inputs, _| {
            slopes[k] = by_inputs;
        });
        Residuals {
            primal: excess / (1.0 + size),
            dual: largest(work.slopes.as_flattened()) / (1.0 + largest_force),
            gap: gap.abs() / (1.0 + cost.abs()),
        }
    }

    /// Returns the derivatives of the Lagrangian by the states at the stages' ends, where the states that follow do so.
    pub fn costates(&self, point: &Point) -> Vec<[f64; STATES]> {
        let mut forces = vec![[0.0; VARIABLES]; self.stages.len()];
        for (row, multiplier) in point.multipliers.iter().enumerate() {
            self.press(row, *multiplier, &mut forces);
        }
        let mut costates = vec![[0.0; STATES]; self.stages.len()];
        self.differentiate(&point.rollout, &forces, |k, _, costate| {
            costates[k] = costate
        });
        costates
    }

    /// Returns the numbers of the terms and of the rows, stage by stage.
    pub fn to_numbers(&self) -> [Vec<f64>; 2] {
        let (mut stages, mut rows) = (self.stages.clone(), self.rows.clone());
        let terms = stages.iter_mut().flat_map(StageTerms::numbers);
        let of_rows = rows.iter_mut().flat_map(StageRow::numbers);
        [
            terms.map(|own| *own).collect(),
            of_rows.map(|own| *own).collect(),
        ]
    }

    /// Returns the QP of [`Self::to_numbers`]'s numbers, of which the first `input_rows` rows of each stage are those of
    /// the inputs; none where their count does not fit.
    pub fn from_numbers(terms: &[f64], rows: &[f64], input_rows: usize) -> Option<Self> {
        let size = StageTerms::default().numbers().count();
        let mut row = StageRow::FREE;
        let row_size = row.numbers().count();
        let (stages, count) = (terms.len() / size, rows.len() / row_size);
        let fits = stages > 0
            && terms.len() == stages * size
            && rows.len() == count * row_size
            && count.is_multiple_of(stages)
            && count >= stages * input_rows;
        if !fits {
            return None;
        }
        let mut qp = Self {
            stages: vec![StageTerms::default(); stages],
            rows: vec![StageRow::FREE; count],
            input_rows,
        };
        let own = qp.stages.iter_mut().flat_map(StageTerms::numbers);
        let of_rows = qp.rows.iter_mut().flat_map(StageRow::numbers);
        for (own, value) in own.zip(terms).chain(of_rows.zip(rows)) {
            *own = *value;
        }
        Some(qp)
    }
}

/// Returns the largest absolute value, NaN where one is.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, value| nan_max(m, value.abs()))
}

/// Returns the product of two vectors.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
