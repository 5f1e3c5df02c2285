//! The QP in compressed columns, and its solution there.

use super::stages::{any_stage, qp_of, stage};
use super::*;
use crate::mpc::sparse::{QpData, SolvedQp};

/// Returns P x, A x and A' y.
fn products(data: &QpData, x: &[f64], y: &[f64]) -> [Vec<f64>; 3] {
    let mut products = [vec![0.0; x.len()], vec![0.0; y.len()], vec![0.0; x.len()]];
    let [p_x, a_x, a_y] = &mut products;
    for column in 0..x.len() {
        for place in data.p.colptr[column]..data.p.colptr[column + 1] {
            let (row, value) = (data.p.rowval[place], data.p.nzval[place]);
            p_x[row] += value * x[column];
            if row != column {
                p_x[column] += value * x[row];
            }
        }
        for place in data.a.colptr[column]..data.a.colptr[column + 1] {
            let (row, value) = (data.a.rowval[place], data.a.nzval[place]);
            a_x[row] += value * x[column];
            a_y[column] += value * y[row];
        }
    }
    products
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

proptest! {
    #[test]
    fn a_solution_is_one_of_the_sparse_qp(
        stages in prop::collection::vec(stage(), 1..22),
        tread_speed_m_s in prop_oneof![Just(2.0), 1.1..1.7_f64],
    ) {
        let qp = qp_of(&stages, motors(0.3, -0.2), &input_limits(tread_speed_m_s));
        let mut solver = QpSolver::new(qp, QpSettings::default()).unwrap();
        prop_assume!(solver.solve(None).is_ok() && solver.path() != SolvePath::InteriorPoint);
        let SolvedQp { data, primal, dual } = solver.solved();
        let [p_x, a_x, a_y] = products(&data, &primal, &dual);
        let size = 1.0 + data.q.iter().fold(0.0_f64, |m, q| m.max(q.abs()));
        for ((p_x, q), a_y) in p_x.iter().zip(&data.q).zip(&a_y) {
            prop_assert!((p_x + q + a_y).abs() < 1e-7 * size);
        }
        for (row, ((a_x, b), y)) in a_x.iter().zip(&data.b).zip(&dual).enumerate() {
            if row < data.equalities {
                prop_assert!((a_x - b).abs() < 1e-9, "row {}", row);
            } else {
                prop_assert!(a_x - b < 1e-7 && *y >= 0.0 && (y * (a_x - b)).abs() < 1e-7 * size, "row {}", row);
            }
        }
        let mut work = solver.qp().work();
        let nothing = solver.qp().cost(&solver.qp().zeros().rollout, &mut work);
        let cost = solver.qp().cost(&solver.point().rollout, &mut work) - nothing;
        let expected = 0.5 * dot(&primal, &p_x) + dot(&data.q, &primal);
        prop_assert!((cost - expected).abs() < 1e-9 * (1.0 + cost.abs()), "{} {}", cost, expected);
    }
}

#[test]
fn a_qp_is_read_back_from_its_numbers() {
    let stages = vec![any_stage(); 3];
    let qp = qp_of(&stages, motors(0.3, -0.2), &input_limits(1.3));
    let [terms, rows] = qp.to_numbers();
    assert_eq!(StageQp::from_numbers(&terms, &rows, 6), Some(qp));
    for (terms, rows, input_rows) in [
        (&terms[1..], &rows[..], 6),
        (&terms[..], &rows[1..], 6),
        (&terms[..], &rows[..2 * 9], 0),
        (&terms[..], &rows[..], 7),
        (&[], &[], 0),
    ] {
        assert_eq!(StageQp::from_numbers(terms, rows, input_rows), None);
    }
}
