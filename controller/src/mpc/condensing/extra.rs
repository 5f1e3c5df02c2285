//! Extra terms in the condensed QP.

use crate::mpc::extra::{EXTRA_SIZE, ExtraTerms, dot, product, values};
use crate::mpc::problem::QpData;
use nalgebra::Vector3;
use sidehill_plant::speeds::MotorSpeeds;

/// How the deviations of a stage's z follow from the variables of its block.
pub struct StageLines<'a> {
    /// Rows of d(x, y, yaw)/d(variables).
    pub states: [&'a [f64]; 3],
    /// The stage's traction among the variables, before its steer.
    pub input: usize,
}

impl StageLines<'_> {
    /// Returns the number of variables that count: those to come do not.
    fn used(&self) -> usize {
        self.input + 2
    }

    /// Returns dz/d(variable).
    fn by(&self, variable: usize) -> [f64; EXTRA_SIZE] {
        let [x, y, yaw] = self.states.map(|line| line[variable]);
        let unit = |input| f64::from(u8::from(variable == input));
        [x, y, yaw, unit(self.input), unit(self.input + 1)]
    }
}

/// Extra terms about a plan.
#[derive(Clone, Copy)]
pub struct PlannedExtra<'a> {
    pub terms: &'a ExtraTerms,
    /// The plan's (x, y, yaw) at the stages' ends, the present first.
    pub states: &'a [Vector3<f64>],
    /// The plan's inputs.
    pub inputs: &'a [MotorSpeeds],
}

impl PlannedExtra<'_> {
    /// Returns z of a stage where all variables are 0.
    fn values(&self, stage: usize) -> [f64; EXTRA_SIZE] {
        let Self { states, inputs, .. } = self;
        values(&states[stage + 1], inputs[stage], states[0].z)
    }

    /// Adds the cost of a stage, times `scale`, to the gradient of its block and the upper triangle of the block's Hessian,
    /// whose columns are `stride` apart.
    pub fn add_cost(
        &self,
        stage: usize,
        lines: &StageLines<'_>,
        scale: f64,
        gradient: &mut [f64],
        (hessian, stride): (&mut [f64], usize),
    ) {
        let weight = self.terms.weight(stage);
        let pull = product(weight, &self.terms.error(stage, &self.values(stage)));
        for column in 0..lines.used() {
            let by = lines.by(column);
            gradient[column] += scale * dot(&by, &pull);
            let turned = product(weight, &by).map(|entry| scale * entry);
            let entries = &mut hessian[column * stride..column * stride + column + 1];
            for (row, entry) in entries.iter_mut().enumerate() {
                *entry += dot(&lines.by(row), &turned);
            }
        }
    }
}

/// Where the rows of extra constraints stand in the QP: those of a stage together, each from above and from below.
#[derive(Debug, Clone, Default)]
pub struct ExtraRows {
    /// First row.
    first: usize,
    /// Where the entries of each stage's rows stand among A's values, row by row.
    places: Vec<Vec<usize>>,
    /// Factor of each row.
    factors: Vec<f64>,
}

impl ExtraRows {
    /// Returns the rows from `first` on, `count` in all, whose entries stand at `places`.
    pub fn new(first: usize, count: usize, places: Vec<Vec<usize>>) -> Self {
        Self {
            first,
            places,
            factors: vec![0.0; count],
        }
    }

    /// Writes the rows of a stage. Each is divided by the largest of its coefficients and its right-hand side; one without
    /// an end is all zeros and never binds.
    pub fn write(
        &mut self,
        stage: usize,
        extra: PlannedExtra<'_>,
        lines: &StageLines<'_>,
        data: &mut QpData,
    ) {
        let z = extra.values(stage);
        let rows = extra.terms.rows(stage);
        let mut row = 2 * stage * rows.len();
        let mut places = self.places[stage].iter();
        for own in rows {
            let value = dot(&own.by, &z);
            let size = own
                .by
                .iter()
                .fold(f64::MIN_POSITIVE, |m, by| m.max(by.abs()));
            for (sign, room) in [(1.0, own.high - value), (-1.0, value - own.low)] {
                let bounded = room < f64::INFINITY;
                let factor = if bounded {
                    1.0 / size.max(room.abs())
                } else {
                    0.0
                };
                for (column, place) in (0..lines.used()).zip(places.by_ref()) {
                    data.a.nzval[*place] = sign * factor * dot(&own.by, &lines.by(column));
                }
                data.b[self.first + row] = if bounded { factor * room } else { 1.0 };
                self.factors[row] = factor;
                row += 1;
            }
        }
    }

    /// Returns the largest multiplier of a constraint, for each of its units, of the multipliers of a QP.
    pub fn largest_multiplier(&self, dual: &[f64]) -> f64 {
        let rows = dual[self.first..].iter().zip(&self.factors);
        rows.map(|(y, factor)| y * factor).fold(0.0, f64::max)
    }
}
