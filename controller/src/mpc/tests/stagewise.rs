//! The horizon's problem written down once more, term by term.

use super::*;
use crate::mpc::clarabel_qp::{InteriorPoint, SolveEnding};
use crate::mpc::solve_limits::SolveLimits;
use crate::mpc::sparse::pattern;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Returns the corrections of the inputs that are optimal for `stages`, by a solver made for this
/// problem alone.
pub fn optimal_corrections(
    stages: &[Stage],
    previous: MotorSpeeds,
    limits: &InputLimits,
) -> Vec<[f64; 2]> {
    let mut problem = Problem::default();
    let count = stages.len();
    let input = |k: usize, motor: usize| 2 * k + motor;
    // Deviation of the state at the end of stage k.
    let state = |k: usize, i: usize| 2 * count + 3 * k + i;

    for (k, stage) in stages.iter().enumerate() {
        let step = &stage.step;
        for i in 0..3 {
            let mut row = vec![
                (state(k, i), 1.0),
                (input(k, 0), -step.by_traction[i]),
                (input(k, 1), -step.by_steer[i]),
            ];
            if k > 0 {
                row.push((state(k - 1, i), -1.0));
                row.push((state(k - 1, 2), -step.by_yaw[i]));
            }
            problem.equal(row, 0.0);
        }
    }
    for (k, stage) in stages.iter().enumerate() {
        let (along_x, along_y) = stage.along;
        let (point_x, point_y) = stage.point_by_yaw_m;
        let (x, y, yaw) = (state(k, 0), state(k, 1), state(k, 2));
        let error = stage.error;
        let w = &stage.weights;
        let along = [along_x, along_y, along_x * point_x + along_y * point_y];
        let [turn_x, turn_y, turn_yaw] = along.map(|by| -stage.curvature_per_m * by);
        problem.square(
            w.along_per_m2,
            &[(x, along[0]), (y, along[1]), (yaw, along[2])],
            along_x * error.x + along_y * error.y,
        );
        let cross = [
            (y, along_x),
            (x, -along_y),
            (yaw, along_x * point_y - along_y * point_x),
        ];
        let cross_error = along_x * error.y - along_y * error.x;
        problem.square(w.cross_per_m2, &cross, cross_error);
        problem.square(
            w.heading_per_rad2,
            &[(x, turn_x), (y, turn_y), (yaw, 1.0 + turn_yaw)],
            error.z,
        );
        let [by_yaw, by_traction, by_steer] = stage.speed_row;
        let mut speed = vec![(input(k, 0), by_traction), (input(k, 1), by_steer)];
        if k > 0 {
            speed.push((state(k - 1, 2), by_yaw));
        }
        problem.square(w.speed_s2_per_m2, &speed, stage.speed_error);

        let own = [stage.input.traction_m_s, stage.input.steer_m_s];
        let before = if k == 0 {
            previous
        } else {
            stages[k - 1].input
        };
        let before = [before.traction_m_s, before.steer_m_s];
        let speed_max = [limits.traction.speed_m_s, limits.steer.speed_m_s];
        let weights = [stage.change_weights.traction, stage.change_weights.steer];
        let changes = [stage.traction_change, stage.steer_change];
        for motor in 0..2 {
            let planned = own[motor] - before[motor];
            let mut change = vec![(input(k, motor), 1.0)];
            if k > 0 {
                change.push((input(k - 1, motor), -1.0));
            }
            problem.square(weights[motor], &change, planned);
            problem.square(stage.damping, &[(input(k, motor), 1.0)], 0.0);
            problem.at_most(change.clone(), changes[motor].rise - planned);
            let fall = change.into_iter().map(|(c, v)| (c, -v)).collect();
            problem.at_most(fall, changes[motor].fall + planned);
            for sign in [1.0, -1.0] {
                let row = vec![(input(k, motor), sign)];
                problem.at_most(row, speed_max[motor] - sign * own[motor]);
            }
        }
        for side in [1.0, -1.0] {
            for sign in [1.0, -1.0] {
                let row = vec![(input(k, 0), sign), (input(k, 1), sign * side)];
                let planned = sign * (own[0] + side * own[1]);
                problem.at_most(row, limits.tread_speed_m_s - planned);
            }
        }
    }
    let optimum = problem.solve(5 * count);
    let both = |k| [optimum[input(k, 0)], optimum[input(k, 1)]];
    (0..count).map(both).collect()
}

/// A QP in the making.
#[derive(Default)]
struct Problem {
    hessian: BTreeMap<(usize, usize), f64>,
    gradient: BTreeMap<usize, f64>,
    equalities: Vec<(Vec<(usize, f64)>, f64)>,
    inequalities: Vec<(Vec<(usize, f64)>, f64)>,
}

impl Problem {
    /// Adds weight/2 (row z + constant)^2 to the cost.
    fn square(&mut self, weight: f64, row: &[(usize, f64)], constant: f64) {
        for &(i, a) in row {
            *self.gradient.entry(i).or_default() += weight * a * constant;
            for &(j, b) in row.iter().filter(|&&(j, _)| i <= j) {
                *self.hessian.entry((i, j)).or_default() += weight * a * b;
            }
        }
    }

    fn equal(&mut self, row: Vec<(usize, f64)>, value: f64) {
        self.equalities.push((sum_repeated(row), value));
    }

    fn at_most(&mut self, row: Vec<(usize, f64)>, value: f64) {
        self.inequalities.push((sum_repeated(row), value));
    }

    fn solve(&self, variables: usize) -> Vec<f64> {
        let entries: Vec<_> = self.hessian.keys().copied().collect();
        let (mut p, positions) = pattern(variables, variables, &entries);
        for (value, &position) in self.hessian.values().zip(&positions) {
            p.nzval[position] = *value;
        }
        let rows: Vec<_> = self.equalities.iter().chain(&self.inequalities).collect();
        let entries: Vec<_> = rows
            .iter()
            .enumerate()
            .flat_map(|(i, (row, _))| row.iter().map(move |&(column, _)| (i, column)))
            .collect();
        let (mut a, positions) = pattern(rows.len(), variables, &entries);
        let values = rows.iter().flat_map(|(row, _)| row.iter().map(|&(_, v)| v));
        for (value, &position) in values.zip(&positions) {
            a.nzval[position] = value;
        }
        let q = (0..variables)
            .map(|i| self.gradient.get(&i).copied().unwrap_or(0.0))
            .collect();
        let data = QpData {
            p,
            q,
            a,
            b: rows.iter().map(|(_, value)| *value).collect(),
            equalities: self.equalities.len(),
        };
        let limits = Arc::new(SolveLimits::new(100));
        let mut solver = InteriorPoint::new(&data, &exact(), &limits).unwrap();
        assert_eq!(solver.solve().0, SolveEnding::Solved);
        solver.point().0.to_vec()
    }
}

fn sum_repeated(row: Vec<(usize, f64)>) -> Vec<(usize, f64)> {
    let mut sums = BTreeMap::<usize, f64>::new();
    for (column, value) in row {
        *sums.entry(column).or_default() += value;
    }
    sums.into_iter().collect()
}
