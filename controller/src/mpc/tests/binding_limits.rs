//! The MPC where limits bind.

use super::closed_loop::*;
use super::stages::any_stage;
use super::*;
use crate::mpc::assembling::make_feasible;

/// The 8 with limits that bind: little speed to spare, and a vehicle that is pushed.
struct Pushed {
    course: Course,
    mpc: Mpc,
    cut_short: u32,
}

impl Pushed {
    fn new(mode: QpMode) -> Self {
        let settings = MpcSettings {
            limits: input_limits(1.1),
            qp: QpSettings {
                mode,
                max_iterations: 100,
                ..settings(40).qp
            },
            ..settings(40)
        };
        Self {
            course: Course::new(),
            mpc: mpc(settings),
            cut_short: 0,
        }
    }

    /// Pushes the vehicle, solves and drives on; what a solve cut short ended with is checked.
    fn cycle(&mut self, cycle: u32) -> Result<SolveReport, QpFailure> {
        let Self { course, mpc, .. } = self;
        course.pose.x_m += 0.1 * (f64::from(cycle) * 1.3).sin();
        course.pose.yaw_rad += 0.2 * (f64::from(cycle) * 0.7).cos();
        let solved = course.solve(mpc);
        if let Ok(report) = &solved
            && report.path == SolvePath::CutShort
        {
            self.cut_short += 1;
            assert!(report.residuals.primal < 1e-12, "{:?}", report.residuals);
            let (qp, mut unchanged) = (mpc.solver.qp(), mpc.solver.qp().zeros().rollout);
            let limits = &mpc.settings.limits;
            let previous = limits.within_bounds(course.command);
            make_feasible(&mut unchanged.inputs, &mpc.stages, previous, limits);
            qp.roll(&mut unchanged);
            let (mut work, found) = (qp.work(), &mpc.solver.point().rollout);
            assert!(qp.cost(found, &mut work) < qp.cost(&unchanged, &mut work));
            assert_keeps_limits(mpc, course.command);
        }
        if mpc.plan().is_some() {
            course.drive(mpc);
        }
        solved
    }
}

/// All inputs of the solver's point are within bounds, and their changes within rates.
fn assert_keeps_limits(mpc: &Mpc, mut before: MotorSpeeds) {
    let corrections = &mpc.solver.point().rollout.inputs;
    for (k, [traction_m_s, steer_m_s]) in corrections.iter().enumerate() {
        let about = mpc.stages[k].input;
        let input = motors(
            about.traction_m_s + traction_m_s,
            about.steer_m_s + steer_m_s,
        );
        let bounded = mpc.settings.limits.within_bounds(input);
        assert!(
            (bounded.traction_m_s - input.traction_m_s).abs() < 1e-9,
            "stage {k}"
        );
        assert!(
            (bounded.steer_m_s - input.steer_m_s).abs() < 1e-9,
            "stage {k}"
        );
        let (traction, steer) = (&mpc.stages[k].traction_change, &mpc.stages[k].steer_change);
        for (now, then, change) in [
            (input.traction_m_s, before.traction_m_s, traction),
            (input.steer_m_s, before.steer_m_s, steer),
        ] {
            assert!(now - then <= change.rise + 1e-9, "stage {k}");
            assert!(then - now <= change.fall + 1e-9, "stage {k}");
        }
        before = input;
    }
}

#[test]
fn a_solve_cut_short_keeps_the_limits_and_is_better_than_no_change() {
    let mut pushed = Pushed::new(QpMode::InteriorPoint);
    for cycle in 0..60 {
        if cycle == 10 {
            pushed.mpc.solver.set_max_iterations(4);
        }
        // The plan shifted may be better than what four iterations found.
        let solved = pushed.cycle(cycle);
        assert!(matches!(
            solved,
            Ok(_) | Err(QpFailure::MaxIterations { iterations: 4 })
        ));
    }
    assert!(pushed.cut_short >= 20, "{}", pushed.cut_short);
}

#[test]
fn a_solve_with_extra_rows_that_is_cut_short_fails_and_one_with_extra_costs_does_not() {
    for rows in [false, true] {
        let mut pushed = Pushed::new(QpMode::InteriorPoint);
        let wide = ExtraRow {
            by: [1.0, 0.0, 0.0, 0.0, 0.0],
            low: -100.0,
            high: 100.0,
        };
        let rows_of_all = if rows { vec![wide; 40] } else { Vec::new() };
        let terms = ExtraTerms::new(vec![ExtraCost::default(); 40], rows_of_all).unwrap();
        pushed.mpc.set_extra_terms(Some(terms)).unwrap();
        let mut failed = 0;
        for cycle in 0..40 {
            if cycle == 10 {
                pushed.mpc.solver.set_max_iterations(4);
            }
            failed += u32::from(pushed.cycle(cycle).is_err());
        }
        assert_eq!(pushed.cut_short > 0, !rows, "{}", pushed.cut_short);
        assert!(!rows || failed > 5, "{failed}");
    }
}

#[test]
fn a_deadline_anywhere_in_a_solve_leaves_a_point_that_keeps_the_limits() {
    for mode in [QpMode::ActiveSet, QpMode::InteriorPoint] {
        let mut pushed = Pushed::new(mode);
        let mut late = 0;
        for cycle in 0..400 {
            // From the first look at the deadline to one after most solves have ended.
            let checks = cycle % 20;
            pushed.mpc.begin_cycle(Some(checks));
            match pushed.cycle(cycle) {
                Ok(_) => {}
                Err(QpFailure::Deadline { iterations }) => {
                    assert!(checks > 0 || iterations == 0, "{iterations}");
                    late += 1;
                }
                Err(failure) => panic!("cycle {cycle}: {failure}"),
            }
        }
        let cut_short = pushed.cut_short;
        assert!(cut_short >= 20, "{mode:?}: {cut_short}");
        assert!((20..200).contains(&late), "{mode:?}: {late}");
    }
}

#[test]
fn a_previous_input_out_of_bounds_does_not_make_the_qp_infeasible() {
    for previous in [motors(3.0, -3.0), motors(-1.0, 0.8), motors(1.0, 0.2)] {
        let course = Course::new();
        let mut settings = settings(20);
        settings.limits = input_limits(1.2);
        let horizon = Horizon {
            previous,
            ..course.horizon(&settings)
        };
        let mut mpc = mpc(settings);
        solve(&mut mpc, &horizon, None).unwrap();
        let bounded = mpc.settings.limits.within_bounds(previous);
        let reached = mpc
            .settings
            .limits
            .project(mpc.plan().unwrap().inputs[0], bounded, 0.05);
        let first = mpc.plan().unwrap().inputs[0];
        assert!((reached.traction_m_s - first.traction_m_s).abs() < 1e-3);
        assert!((reached.steer_m_s - first.steer_m_s).abs() < 1e-3);
    }
}

#[test]
fn what_is_too_fast_for_the_treads_is_followed_as_far_as_they_can() {
    let wide = Change {
        fall: 2.0,
        rise: 2.0,
    };
    let stage = Stage {
        input: motors(0.1, 0.1),
        traction_change: wide,
        steer_change: wide,
        ..any_stage()
    };
    // The treads' speed of these is 0.5 m/s before and 1.6 m/s wanted; they can do 8/11 of the way.
    for (before, wanted, reached) in [
        ((0.3, 0.2), (0.9, 0.7), (0.3 + 4.8 / 11.0, 0.2 + 4.0 / 11.0)),
        (
            (-0.3, 0.2),
            (-0.9, 0.7),
            (-0.3 - 4.8 / 11.0, 0.2 + 4.0 / 11.0),
        ),
        ((0.3, 0.2), (0.7, 0.5), (0.7, 0.5)),
    ] {
        let mut corrections = [[wanted.0 - 0.1, wanted.1 - 0.1]];
        let before = motors(before.0, before.1);
        make_feasible(&mut corrections, &[stage], before, &input_limits(1.3));
        let [traction, steer] = corrections[0].map(|own| own + 0.1);
        assert!(
            (traction - reached.0).abs() < 1e-12,
            "{traction} {reached:?}"
        );
        assert!((steer - reached.1).abs() < 1e-12, "{steer} {reached:?}");
    }
}
