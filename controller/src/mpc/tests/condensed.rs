//! The condensed QP has the optimum of the problem it was condensed from.

use super::stagewise::optimal_corrections;
use super::*;

/// A stage of no vehicle in particular.
pub fn stage() -> impl Strategy<Value = Stage> {
    prop::collection::vec(0.0..1.0_f64, 33).prop_map(|u| {
        let mut next = u.into_iter();
        let mut within = |low: f64, high: f64| low + (high - low) * next.next().unwrap();
        let mut vector = |size: f64| {
            Vector3::new(
                within(-size, size),
                within(-size, size),
                within(-size, size),
            )
        };
        let step = LinearisedStep {
            increment: Vector3::zeros(),
            by_yaw: Vector3::new(1.0, 1.0, 0.0).component_mul(&vector(0.2)),
            by_traction: vector(0.2),
            by_steer: vector(0.2),
        };
        let error = vector(0.3);
        let heading = within(-4.0, 4.0);
        Stage {
            point_by_yaw_m: (within(-0.6, 0.6), within(-0.6, 0.6)),
            step,
            error,
            along: (-heading.sin(), heading.cos()),
            curvature_per_m: within(-1.0, 1.0),
            weights: StageWeights {
                along_per_m2: within(0.0, 60.0),
                cross_per_m2: within(0.0, 60.0),
                heading_per_rad2: within(0.0, 5.0),
                speed_s2_per_m2: within(0.0, 20.0),
            },
            speed_row: [within(-0.7, 0.7), within(-1.2, 1.2), within(-0.7, 0.7)],
            speed_error: within(-0.5, 0.5),
            input: motors(within(-1.0, 1.0), within(-0.8, 0.8)),
            change_weights: ChangeWeights {
                traction: within(0.5, 4.0),
                steer: within(0.5, 4.0),
            },
            damping: within(0.0, 4.0),
            traction_change: Change {
                fall: within(0.05, 0.5),
                rise: within(0.05, 0.5),
            },
            steer_change: Change {
                fall: within(0.05, 0.5),
                rise: within(0.05, 0.5),
            },
        }
    })
}

/// One of these stages.
pub fn any_stage() -> Stage {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    proptest::strategy::ValueTree::current(&stage().new_tree(&mut runner).unwrap())
}

/// Asserts that condensed and stage-wise problem have the same optimum.
pub fn assert_same_optimum(
    stages: &[Stage],
    previous: MotorSpeeds,
    limits: &InputLimits,
    block_stages: usize,
    reference: QpMode,
) {
    let (mut condenser, data) =
        Condenser::new(stages.len(), block_stages, *limits, None, COST_SCALE);
    let mut solver = QpSolver::new(data, exact()).unwrap();
    condenser.assemble(stages, previous, None, solver.data_mut());
    solver.solve(None).unwrap();
    let expected = optimal_corrections(stages, previous, limits, reference);
    let found: Vec<_> = condenser.input_corrections(solver.primal()).collect();
    assert_eq!(found.len(), expected.len());
    for (k, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let difference = (found.traction_m_s - expected.traction_m_s)
            .abs()
            .max((found.steer_m_s - expected.steer_m_s).abs());
        assert!(
            difference < 1e-5,
            "stage {k} of {} in blocks of {block_stages}: {found:?}, expected {expected:?}",
            stages.len()
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn condensing_keeps_the_optimum(
        stages in prop::collection::vec(stage(), 2..22),
        previous in (-0.6..0.6_f64, -0.5..0.5_f64),
        block_stages in 1..=8_usize,
        tread_speed_m_s in prop_oneof![Just(2.0), 1.1..1.7_f64],
    ) {
        assert_same_optimum(
            &stages,
            motors(previous.0, previous.1),
            &input_limits(tread_speed_m_s),
            block_stages,
            // Clarabel's own tolerance leaves up to 1e-4 where a limit almost binds.
            QpMode::InPlace,
        );
    }
}
