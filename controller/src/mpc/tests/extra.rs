//! Extra costs and constraints: in the QP, and in the cost by which its solution is followed.

use super::closed_loop::{Course, mpc, settings, solve};
use super::stages::stage;
use super::*;
use crate::mpc::stage_qp::Rollout;
use std::f64::consts::TAU;

const X: [f64; EXTRA_SIZE] = [1.0, 0.0, 0.0, 0.0, 0.0];
const Y: [f64; EXTRA_SIZE] = [0.0, 1.0, 0.0, 0.0, 0.0];
const TRACTION: [f64; EXTRA_SIZE] = [0.0, 0.0, 0.0, 1.0, 0.0];
const STEER: [f64; EXTRA_SIZE] = [0.0, 0.0, 0.0, 0.0, 1.0];
const NO_COST: ExtraCost = ExtraCost {
    weight: [[0.0; EXTRA_SIZE]; EXTRA_SIZE],
    target: [0.0; EXTRA_SIZE],
};

/// The cost w (g' (z - r))^2.
fn along(w: f64, g: [f64; EXTRA_SIZE], target: [f64; EXTRA_SIZE]) -> ExtraCost {
    let weight = g.map(|a| g.map(|b| w * a * b));
    ExtraCost { weight, target }
}

fn row(by: [f64; EXTRA_SIZE], low: f64, high: f64) -> ExtraRow {
    ExtraRow { by, low, high }
}

/// The same terms for each of 40 stages.
fn alike(cost: ExtraCost, rows: &[ExtraRow]) -> Option<ExtraTerms> {
    Some(ExtraTerms::new(vec![cost; 40], rows.repeat(40)).unwrap())
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Full turns of the heading in which plans of these tests begin.
const TURNS_RAD: f64 = 3.0 * TAU;

/// Returns how the states at the stages' ends change where the planned inputs are corrected by `corrections`.
pub fn states_of(stages: &[Stage], corrections: &[[f64; 2]]) -> Vec<Vector3<f64>> {
    let mut xi = Vector3::zeros();
    let moved = stages.iter().zip(corrections).map(|(stage, own)| {
        let step = &stage.step;
        xi += step.by_yaw * xi.z + step.by_traction * own[0] + step.by_steer * own[1];
        xi
    });
    moved.collect()
}

/// Returns the point of the QP with these corrections.
fn path_of(stages: &[Stage], corrections: &[[f64; 2]]) -> Rollout {
    Rollout {
        inputs: corrections.to_vec(),
        states: states_of(stages, corrections)
            .into_iter()
            .map(Into::into)
            .collect(),
    }
}

/// Returns z of each stage of a plan with these corrections.
fn corrected(stages: &[Stage], plan: &Plan, corrections: &[[f64; 2]]) -> Vec<[f64; EXTRA_SIZE]> {
    let moved = states_of(stages, corrections).into_iter().enumerate();
    let all = moved.zip(corrections).map(|((k, xi), [traction, steer])| {
        let (state, input) = (plan.states[k + 1] + xi, plan.inputs[k]);
        [
            state.x,
            state.y,
            state.z - TURNS_RAD,
            input.traction_m_s + traction,
            input.steer_m_s + steer,
        ]
    });
    all.collect()
}

proptest! {
    #[test]
    fn the_qp_has_the_cost_and_the_rows_of_the_stages(
        stages in prop::collection::vec(stage(), 12),
        numbers in prop::collection::vec(prop::array::uniform5(-1.0..1.0_f64), 5 * 12),
        tread_speed_m_s in prop_oneof![Just(2.0), Just(1.3)],
    ) {
        let mut plan = Plan { states: vec![Vector3::new(0.0, 0.0, TURNS_RAD + 0.3)], inputs: Vec::new() };
        let mut corrections = [Vec::new(), Vec::new()];
        for (k, stage) in stages.iter().enumerate() {
            let [x, y, yaw, traction, steer] = numbers[5 * k];
            plan.states.push(Vector3::new(x, y, TURNS_RAD + yaw));
            plan.inputs.push(stage.input);
            corrections[0].push([traction, steer]);
            let [.., traction, steer] = numbers[5 * k + 1];
            corrections[1].push([traction, steer]);
        }
        let points = corrections.map(|own| {
            (path_of(&stages, &own), corrected(&stages, &plan, &own))
        });
        let (mut costs, mut rows) = (Vec::new(), Vec::new());
        for k in 0..stages.len() {
            let mut cost = along(3.0, numbers[5 * k + 2], numbers[5 * k + 3]);
            // The same heading.
            cost.target[2] += 2.0 * TAU;
            costs.push(cost);
            let by = numbers[5 * k + 4];
            let value = dot(&by, &points[0].1[k]);
            rows.push(row(by, value, value));
            rows.push(row(by, f64::NEG_INFINITY, value + 0.1));
        }
        let expected = |all: &[[f64; EXTRA_SIZE]]| -> f64 {
            let squares = all.iter().zip(&costs).enumerate().map(|(k, (z, cost))| {
                let mut error: [f64; EXTRA_SIZE] = std::array::from_fn(|i| z[i] - cost.target[i]);
                error[2] = wrap_angle(error[2]);
                3.0 * dot(&error, &numbers[5 * k + 2]).powi(2)
            });
            squares.sum()
        };
        let expected = points.each_ref().map(|(_, all)| 0.5 * COST_SCALE * expected(all));
        let terms = ExtraTerms::new(costs.clone(), rows).unwrap();
        let (count, previous) = (stages.len(), motors(0.1, -0.2));
        let limits = input_limits(tread_speed_m_s);
        let tread_rows = !limits.treads_follow_from_motors();
        let assembled = |rows: usize, extra: Option<&ExtraTerms>| {
            let mut qp = StageQp::new(count, tread_rows, rows);
            assemble(&mut qp, &stages, &plan.states, previous, &limits, extra);
            qp
        };
        let (without, qp) = (assembled(0, None), assembled(2, Some(&terms)));
        let mut work = qp.work();

        let added = points.each_ref().map(|(path, _)| qp.cost(path, &mut work) - without.cost(path, &mut work));
        let (found, expected) = (added[1] - added[0], expected[1] - expected[0]);
        // Where half a turn is between, the QP's parabola is another than that beyond.
        let near = points.iter().flat_map(|(_, all)| all).zip(costs.iter().cycle())
            .zip(plan.states[1..].iter().cycle())
            .all(|((z, cost), state)| {
                let planned = wrap_angle(state.z - TURNS_RAD - cost.target[2]);
                (planned + z[2] - (state.z - TURNS_RAD)).abs() < 3.1
            });
        prop_assert!(!near || (found - expected).abs() < 1e-8 * (1.0 + expected.abs()), "{} {}", found, expected);

        let size = |k: usize| numbers[5 * k + 4].iter().fold(0.0_f64, |m, by| m.max(by.abs()));
        for k in 0..count {
            let own = qp.extra_rows(k);
            prop_assert_eq!(own.len(), 2);
            let [both, high] = [own.start, own.start + 1].map(|row| {
                let value = qp.value(row, &points[0].0);
                let (low, high) = (qp.rows()[row].low, qp.rows()[row].high);
                [low - value, high - value]
            });
            prop_assert!(both[0].abs() < 1e-9 && both[1].abs() < 1e-9, "stage {}: {:?}", k, both);
            prop_assert_eq!(high[0], f64::NEG_INFINITY);
            prop_assert!((high[1] - 0.1 / size(k)).abs() < 1e-9, "stage {}: {:?}", k, high);
        }
    }
}

/// An MPC at a place of the figure of eight that has solved twelve QPs with these terms.
fn settled(terms: Option<ExtraTerms>, step_limit: StepLimit) -> (Mpc, Horizon) {
    let mut settings = settings(40);
    settings.step_limit = step_limit;
    settings.qp = exact();
    let mut course = Course::new();
    let mut mpc = mpc(settings);
    for _ in 0..10 {
        course.solve(&mut mpc).unwrap();
        course.drive(&mpc);
    }
    mpc.set_extra_terms(terms).unwrap();
    let horizon = course.horizon(&mpc.settings);
    for _ in 0..12 {
        mpc.linearise(&horizon).assemble().solve(None).unwrap();
    }
    (mpc, horizon)
}

/// The cost of a plan's inputs with a correction of one of them, as steps are judged by it.
fn cost_of(mpc: &Mpc, horizon: &Horizon, stage: usize, correction: MotorSpeeds) -> f64 {
    let mut plan = mpc.plan.clone();
    plan.inputs[stage].traction_m_s += correction.traction_m_s;
    plan.inputs[stage].steer_m_s += correction.steer_m_s;
    let mut moving = horizon.moving;
    for (k, target) in horizon.targets.iter().enumerate() {
        let (state, input) = (plan.states[k], plan.inputs[k]);
        plan.states[k + 1] = state + mpc.increment(k, target, state.z, input, &mut moving);
    }
    mpc.cost_of(&plan, horizon)
}

#[test]
fn the_gradient_of_the_qp_is_that_of_the_cost_by_which_steps_are_judged() {
    let mut settings = settings(40);
    settings.qp = exact();
    let mut course = Course::new();
    let mut mpc = mpc(settings);
    let costs = (0..40).map(|k| {
        let share = f64::from(k) / 40.0;
        along(
            20.0,
            [1.0, 0.5, 0.3, share, 0.4],
            [share, 1.0, 0.1, 0.3, -0.1],
        )
    });
    mpc.set_extra_terms(Some(ExtraTerms::new(costs.collect(), Vec::new()).unwrap()))
        .unwrap();
    for cycle in 0..60 {
        course.solve(&mut mpc).unwrap();
        course.drive(&mpc);
        if cycle % 10 < 9 {
            continue;
        }
        let horizon = course.horizon(&mpc.settings);
        mpc.move_on(0.05, 1.0, &horizon.targets[0].normal_in_world);
        let _ = mpc.linearise(&horizon).assemble();
        let slope = |variable: usize| {
            let (qp, mut work) = (mpc.solver.qp(), mpc.solver.qp().work());
            let mut cost = |step: f64| {
                let mut path = qp.zeros().rollout;
                path.inputs.as_flattened_mut()[variable] = step;
                qp.roll(&mut path);
                qp.cost(&path, &mut work)
            };
            // The difference of a parabola is exact.
            cost(0.5) - cost(-0.5)
        };
        for variable in 0..80 {
            let slope = slope(variable);
            let by = |step: f64| match variable % 2 {
                0 => cost_of(&mpc, &horizon, variable / 2, motors(step, 0.0)),
                _ => cost_of(&mpc, &horizon, variable / 2, motors(0.0, step)),
            };
            let expected = 0.5 * COST_SCALE * (by(1e-6) - by(-1e-6)) / 2e-6;
            assert!(
                (slope - expected).abs() < 1e-3,
                "cycle {cycle}, variable {variable}: {slope}, expected {expected}"
            );
        }
    }
}

#[test]
fn an_extra_cost_moves_a_plan_to_where_the_algebra_says() {
    // A stage of T on level ground, ahead from y: minimise c/T (u - u_0)^2 + w (y + T u - r)^2 + v (u - s)^2.
    let (step_s, change, before) = (0.15, 0.05, 0.4);
    let mut settings = settings(1);
    settings.qp = exact();
    let mut horizon = Course::new().horizon(&settings);
    horizon.previous = motors(before, 0.0);
    let target = &mut horizon.targets[0];
    target.normal_in_world = Vector3::z();
    target.weights = target.weights.scaled(0.0);
    for (w, v, turns) in [
        (0.0, 0.0, 0.0),
        (3.0, 0.0, 0.0),
        (0.0, 0.7, 2.0),
        (4.0, 0.3, -1.0),
    ] {
        horizon.start = PlanarPose {
            x_m: 1.0,
            y_m: -2.0,
            yaw_rad: turns * TAU,
        };
        let (r, s) = (-1.97, 0.42);
        let mut cost = along(w, Y, [0.0, r, 0.0, s, 0.0]);
        cost.weight[3][3] = v;
        let mut mpc = mpc(settings.clone());
        // Steer would move the origin, beside which the vehicle turns.
        let straight = vec![row(STEER, 0.0, 0.0)];
        mpc.set_extra_terms(Some(ExtraTerms::new(vec![cost], straight).unwrap()))
            .unwrap();
        for _ in 0..20 {
            solve(&mut mpc, &horizon, None).unwrap();
        }
        let expected = (change / step_s * before + w * step_s * (r + 2.0) + v * s)
            / (change / step_s + w * step_s * step_s + v);
        let input = mpc.plan().unwrap().inputs[0];
        assert!(
            (input.traction_m_s - expected).abs() < 1e-6,
            "{input:?}, expected {expected}"
        );
        assert!(input.steer_m_s.abs() < 1e-6, "{input:?}");
    }
}

#[test]
fn a_row_that_binds_is_held_and_its_steps_are_taken() {
    let free = settled(None, StepLimit::default()).0.plan;
    let most = |of: &dyn Fn(usize) -> f64| (0..40).map(of).fold(f64::NEG_INFINITY, f64::max);
    let x = |plan: &Plan| most(&|k| plan.states[k + 1].x);
    let steer = |plan: &Plan| most(&|k| plan.inputs[k].steer_m_s);
    let high = x(&free) - 0.2;
    for limit in [
        StepLimit::default(),
        StepLimit {
            steer_m_s: 0.1,
            ..StepLimit::default()
        },
    ] {
        let (mpc, _) = settled(alike(NO_COST, &[row(X, f64::NEG_INFINITY, high)]), limit);
        assert!(
            (x(&mpc.plan) - high).abs() < 1e-4,
            "{} {high}",
            x(&mpc.plan)
        );
        // Steps that are refused make it grow to hundreds.
        assert!(mpc.damping.s2_per_m2 < 10.0, "{:?}", mpc.damping);
    }
    let high = 0.5 * steer(&free);
    let (mpc, _) = settled(
        alike(NO_COST, &[row(STEER, -9.0, high)]),
        StepLimit::default(),
    );
    assert!(
        (steer(&mpc.plan) - high).abs() < 1e-6,
        "{} {high}",
        steer(&mpc.plan)
    );
    // An equality.
    let (mpc, _) = settled(
        alike(NO_COST, &[row(STEER, 0.1, 0.1)]),
        StepLimit::default(),
    );
    assert!(
        mpc.plan
            .inputs
            .iter()
            .all(|input| (input.steer_m_s - 0.1).abs() < 1e-6)
    );
}

#[test]
fn a_violation_costs_twice_what_room_for_the_row_that_presses_most_is_worth() {
    let (free, _) = settled(None, StepLimit::default());
    let wide = row(X, f64::NEG_INFINITY, f64::INFINITY);
    let high = free.plan.states[31].x - 0.2;
    let held = |high: f64| {
        let mut rows = vec![wide; 40];
        // In other units than m.
        rows[30] = row(X.map(|by| 4.0 * by), f64::NEG_INFINITY, 4.0 * high);
        let (mpc, horizon) = settled(
            Some(ExtraTerms::new(vec![NO_COST; 40], rows).unwrap()),
            StepLimit::default(),
        );
        let cost = mpc.cost_of(&mpc.plan, &horizon);
        // Of a state that is a metre too far.
        let far = Vector3::new(high + 1.0, 0.0, 0.0);
        let price = mpc.extra.unwrap().cost(30, 0.0, &far, MotorSpeeds::STOP);
        (cost, price)
    };
    let (_, price) = held(high);
    let worth = (held(high - 1e-3).0 - held(high + 1e-3).0) / 2e-3;
    assert!((price / worth - 2.0).abs() < 0.02, "{price} {worth}");
}

#[test]
fn rows_that_no_plan_meets_end_in_a_failure_that_leaves_the_plan() {
    let mut course = Course::new();
    let mut mpc = mpc(settings(40));
    for _ in 0..10 {
        course.solve(&mut mpc).unwrap();
        course.drive(&mpc);
    }
    let plan = mpc.plan().unwrap().clone();
    let horizon = course.horizon(&mpc.settings);
    for rows in [
        vec![row(X, 100.0, 101.0)],
        vec![row(TRACTION, 1.5, 2.0)],
        vec![row(X, 0.0, 0.0), row(X, 1.0, 1.0)],
    ] {
        mpc.set_extra_terms(alike(NO_COST, &rows)).unwrap();
        let failure = solve(&mut mpc, &horizon, None);
        assert_eq!(failure, Err(QpFailure::Infeasible), "{rows:?}");
        assert_eq!(mpc.plan(), Some(&plan));
    }
    mpc.set_extra_terms(None).unwrap();
    solve(&mut mpc, &horizon, None).unwrap();
}

#[test]
fn an_mpc_whose_terms_were_removed_plans_as_one_that_had_none() {
    let mut course = Course::new();
    let mut settings = settings(40);
    settings.limits = input_limits(0.95);
    let (mut mpc, mut twin) = (mpc(settings.clone()), mpc(settings));
    for mpc in [&mut mpc, &mut twin] {
        // Drives of a weak battery.
        let (mut traction, mut steer) = (mpc.settings.limits.traction, mpc.settings.limits.steer);
        (traction.speed_m_s, traction.acceleration_m_s2) = (0.5, 0.3);
        (steer.speed_m_s, steer.acceleration_m_s2) = (0.4, 0.7);
        mpc.set_motor_limits(traction, steer);
    }
    mpc.set_extra_terms(alike(
        along(1.0, X, [0.0; EXTRA_SIZE]),
        &[row(X, -9.0, 9.0)],
    ))
    .unwrap();
    mpc.set_extra_terms(None).unwrap();
    // Once the motors are as strong as told, they would be too fast for the treads.
    for mpc in [&mut mpc, &mut twin] {
        let told = input_limits(0.95);
        mpc.set_motor_limits(told.traction, told.steer);
    }
    for _ in 0..40 {
        course.solve(&mut mpc).unwrap();
        course.solve(&mut twin).unwrap();
        assert_eq!(mpc.plan, twin.plan);
        course.drive(&mpc);
    }
}

#[test]
fn terms_that_are_wrong_are_refused_with_their_stage() {
    let cost = |stage: usize, entry: &dyn Fn(&mut ExtraCost)| {
        let mut costs = vec![NO_COST; 3];
        entry(&mut costs[stage]);
        ExtraTerms::new(costs, Vec::new()).unwrap_err().to_string()
    };
    assert_eq!(
        cost(2, &|cost| cost.weight[1][0] = 1.0),
        "weight: stage 2 is not symmetric"
    );
    assert_eq!(
        cost(1, &|cost| cost.weight[1][1] = -2.0),
        "weight: stage 1 has the eigenvalue -2, and none may be negative"
    );
    assert_eq!(
        cost(0, &|cost| cost.weight[4][4] = f64::NAN),
        "weight: stage 0 has a value that is not finite"
    );
    assert_eq!(
        cost(1, &|cost| cost.target[0] = f64::INFINITY),
        "target: stage 1 has a value that is not finite"
    );
    let rows = |rows: &[ExtraRow]| {
        ExtraTerms::new(vec![NO_COST; 2], rows.to_vec())
            .unwrap_err()
            .to_string()
    };
    let good = row(X, 0.0, 1.0);
    assert_eq!(
        rows(&[good, good, good, row(X, 2.0, 1.0)]),
        "low, high: stage 1, row 1: 2 to 1 has no value"
    );
    assert_eq!(
        rows(&[row(X, f64::NAN, 1.0), good]),
        "low, high: stage 0, row 0: NaN to 1 has no value"
    );
    assert_eq!(
        rows(&[good, row([f64::NAN; 5], 0.0, 1.0)]),
        "rows: stage 1 has a value that is not finite"
    );
    assert!(rows(&[good; 3]).starts_with("rows: 3 for 2 stages"));
    assert!(rows(&[good; 18]).starts_with("rows: 18 for 2 stages"));
    // What rounding explains is taken, and that depends on the size of the weights.
    for size in [1e-6, 1.0, 1e6] {
        let terms = |asymmetry: f64| {
            let mut cost = along(size, Y, [0.0; EXTRA_SIZE]);
            (cost.weight[0][0], cost.weight[0][1]) = (size, asymmetry * size);
            ExtraTerms::new(vec![cost; 3], Vec::new()).map(|terms| terms.costs() == [cost; 3])
        };
        assert_eq!(terms(1e-10), Ok(true));
        assert_eq!(terms(1e-8), Err(ExtraError::Asymmetric { stage: 0 }));
    }
    let mut mpc = mpc(settings(40));
    let of_three = ExtraTerms::new(vec![NO_COST; 3], Vec::new()).unwrap();
    assert_eq!(
        mpc.set_extra_terms(Some(of_three)),
        Err(ExtraError::Stages {
            found: 3,
            needed: 40
        })
    );
}
