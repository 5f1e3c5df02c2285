//! Stages of no vehicle in particular, and their QP.

use super::stagewise::optimal_corrections;
use super::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

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
    stage()
        .new_tree(&mut TestRunner::deterministic())
        .unwrap()
        .current()
}

/// Returns the QP of stages about their inputs.
pub fn qp_of(stages: &[Stage], previous: MotorSpeeds, limits: &InputLimits) -> StageQp {
    let states = vec![Vector3::zeros(); stages.len() + 1];
    let mut qp = StageQp::new(stages.len(), !limits.treads_follow_from_motors(), 0);
    assemble(&mut qp, stages, &states, previous, limits, None);
    qp
}

/// Asserts that the QP of stages has the optimum of the problem that was written down once more.
pub fn assert_same_optimum(
    stages: &[Stage],
    previous: MotorSpeeds,
    limits: &InputLimits,
    mode: QpMode,
) {
    let qp = qp_of(stages, previous, limits);
    let mut solver = QpSolver::new(qp, QpSettings { mode, ..exact() }).unwrap();
    solver.solve(None).unwrap();
    let expected = optimal_corrections(stages, previous, limits);
    let found = &solver.point().rollout.inputs;
    assert_eq!(found.len(), expected.len());
    for (k, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let difference = (found[0] - expected[0])
            .abs()
            .max((found[1] - expected[1]).abs());
        assert!(
            difference < 1e-5,
            "stage {k} of {}: {found:?}, expected {expected:?}",
            stages.len()
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn the_qp_has_the_optimum_of_its_stages(
        stages in prop::collection::vec(stage(), 2..22),
        previous in (-0.6..0.6_f64, -0.5..0.5_f64),
        tread_speed_m_s in prop_oneof![Just(2.0), 1.1..1.7_f64],
        mode in prop_oneof![Just(QpMode::ActiveSet), Just(QpMode::InteriorPoint)],
    ) {
        let limits = input_limits(tread_speed_m_s);
        assert_same_optimum(&stages, motors(previous.0, previous.1), &limits, mode);
    }
}
