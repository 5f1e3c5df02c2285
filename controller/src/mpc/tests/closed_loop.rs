//! The MPC on a slope, driving the exact model.

use super::stages::assert_same_optimum;
use super::*;
use crate::course::FigureEight;
use crate::tracked_point::TrackedPoint;
use crate::trajectory::Trajectory;
use sidehill_plant::frames::{Attitude, pose_rate};

/// The 8 on a plane of 10 deg, with the MPC at its start.
pub struct Course {
    trajectory: Trajectory,
    normal_in_world: Vector3<f64>,
    pub pose: PlanarPose,
    pub command: MotorSpeeds,
    cycle: u32,
}

impl Course {
    pub fn new() -> Self {
        let trajectory = FigureEight::default().trajectory().unwrap();
        let start = trajectory.at(0.0);
        let slope = 10.0_f64.to_radians();
        Self {
            normal_in_world: Vector3::new(0.0, -slope.sin(), slope.cos()),
            pose: start.pose(),
            command: MotorSpeeds::STOP,
            trajectory,
            cycle: 0,
        }
    }

    /// The horizon of the next cycle, a control period after the one before.
    pub fn horizon(&self, settings: &MpcSettings) -> Horizon {
        let targets = (1..=settings.stages)
            .map(|k| {
                let time_s = 0.05 * f64::from(self.cycle) + settings.step_s * k as f64;
                let point = self.trajectory.at(time_s);
                StageTarget {
                    tracked_point: TrackedPoint::ORIGIN,
                    pose: point.pose(),
                    along_heading_rad: point.heading_rad,
                    curvature_per_m: 0.0,
                    normal_in_world: self.normal_in_world,
                    feedforward: motors(point.speed_m_s, point.yaw_rate_rad_s),
                    speed_m_s: point.speed_m_s,
                    slip: Vector3::zeros(),
                    weights: StageWeights {
                        along_per_m2: 50.0,
                        cross_per_m2: 50.0,
                        heading_per_rad2: 0.02,
                        speed_s2_per_m2: 2.0,
                    },
                    errors_share: 1.0,
                }
            })
            .collect();
        Horizon {
            start: self.pose,
            moving: BodyState::default(),
            previous: self.command,
            change_weights: ChangeWeights {
                traction: 0.05,
                steer: 0.05,
            },
            half_track_m: 1.0,
            targets,
        }
    }

    /// Solves a cycle: the first about a first plan, later ones about the plan moved on.
    pub fn solve(&self, mpc: &mut Mpc) -> Result<SolveReport, QpFailure> {
        mpc.move_on(0.05, 1.0, &self.normal_in_world);
        solve(mpc, &self.horizon(&mpc.settings), None)
    }

    /// Drives for a control period with the plan's first input.
    pub fn drive(&mut self, mpc: &Mpc) {
        self.command = mpc.plan().unwrap().inputs[0];
        let vehicle = Vehicle::j8();
        for _ in 0..10 {
            let attitude = Attitude::on_plane(&self.normal_in_world, self.pose.yaw_rad);
            let velocity = vehicle.body_velocity(attitude, self.command.into());
            let rate = pose_rate(&velocity, &attitude, self.pose.yaw_rad);
            self.pose.x_m += 0.005 * rate.x_m_s;
            self.pose.y_m += 0.005 * rate.y_m_s;
            self.pose.yaw_rad += 0.005 * rate.yaw_rad_s;
        }
        self.cycle += 1;
    }
}

/// Puts a drive towards the horizon's targets in the place of the plan where that is none or far worse.
pub fn begin(mpc: &mut Mpc, horizon: &Horizon) {
    let mut calls = 0;
    mpc.try_first_plan(horizon, |_, _, _| {
        // The first call is that of the horizon's begin.
        calls += 1;
        horizon.targets[if calls > 1 { calls - 2 } else { 0 }]
    });
}

/// Solves for a horizon about the plan as it is, or about a first plan.
pub fn solve(
    mpc: &mut Mpc,
    horizon: &Horizon,
    deadline: Option<Instant>,
) -> Result<SolveReport, QpFailure> {
    if mpc.wants_first_plan() {
        begin(mpc, horizon);
    }
    let solution = mpc.linearise(horizon).assemble().solve(deadline)?;
    Ok(solution.report.unwrap())
}

pub fn settings(stages: usize) -> MpcSettings {
    MpcSettings {
        stages,
        step_s: 0.15,
        last_step_s: 0.15,
        step_limit: StepLimit::default(),
        period_s: 0.05,
        heading_excess: HeadingExcess {
            free_rad: 0.5,
            per_rad2: 0.0,
        },
        cross_per_m2: 50.0,
        limits: input_limits(2.0),
        qp: QpSettings {
            tolerance: 1e-6,
            max_iterations: 60,
            accepted_residual: 1e-3,
            accepted_gap: 0.2,
            mode: QpMode::ActiveSet,
        },
    }
}

pub fn mpc(settings: MpcSettings) -> Mpc {
    Mpc::new(settings, PredictionModel::new(Vehicle::j8(), 0.02)).unwrap()
}

#[test]
fn every_qp_of_a_run_meets_its_optimality_conditions() {
    let mut course = Course::new();
    let mut mpc = mpc(settings(40));
    for _ in 0..400 {
        let report = course.solve(&mut mpc).unwrap();
        let Residuals { primal, dual, gap } = report.residuals;
        let at = format!("cycle {}: {:?}", course.cycle, report.residuals);
        assert!(primal < 1e-5 && dual < 1e-5 && gap < 1e-3, "{at}");
        // What the report says is what the solver's data say.
        assert_eq!(mpc.solver.residuals(), report.residuals);
        let mut before = course.command;
        for (k, input) in mpc.plan().unwrap().inputs.iter().enumerate() {
            let bounded = mpc.settings.limits.within_bounds(*input);
            assert!(
                (bounded.traction_m_s - input.traction_m_s).abs() < 1e-4,
                "{at}"
            );
            assert!((bounded.steer_m_s - input.steer_m_s).abs() < 1e-4, "{at}");
            let time_s = if k == 0 { 0.05 } else { 0.15 };
            let reached = mpc.settings.limits.project(*input, before, time_s);
            assert!(
                (reached.traction_m_s - input.traction_m_s).abs() < 0.02,
                "{at} {k}"
            );
            assert!(
                (reached.steer_m_s - input.steer_m_s).abs() < 0.02,
                "{at} {k}"
            );
            before = *input;
        }
        course.drive(&mpc);
    }
    assert_eq!(mpc.solver.rebuilds(), 0);
}

#[test]
fn the_qps_of_a_run_have_the_optimum_of_their_stages() {
    let mut course = Course::new();
    let mut mpc = mpc(settings(40));
    for _ in 0..8 {
        for _ in 0..5 {
            course.solve(&mut mpc).unwrap();
            course.drive(&mpc);
        }
        // The stages of the last QP, before its solution moved the plan.
        for tread_speed_m_s in [2.0, 1.2] {
            let limits = input_limits(tread_speed_m_s);
            assert_same_optimum(&mpc.stages, course.command, &limits, QpMode::ActiveSet);
        }
    }
}

#[test]
fn both_ways_to_solve_give_one_plan() {
    let plan = |mode| {
        let mut settings = settings(30);
        settings.qp = QpSettings { mode, ..exact() };
        let mut course = Course::new();
        let mut mpc = mpc(settings);
        for _ in 0..20 {
            course.solve(&mut mpc).unwrap();
            course.drive(&mpc);
        }
        mpc.plan().unwrap().clone()
    };
    let (reference, other) = (plan(QpMode::InteriorPoint), plan(QpMode::ActiveSet));
    for (a, b) in reference.inputs.iter().zip(&other.inputs) {
        let difference = (a.traction_m_s - b.traction_m_s)
            .abs()
            .max((a.steer_m_s - b.steer_m_s).abs());
        assert!(difference < 1e-5, "{difference}");
    }
    for (a, b) in reference.states.iter().zip(&other.states) {
        assert!((a - b).norm() < 1e-5);
    }
}

#[test]
fn a_failed_cycle_leaves_the_plan_and_the_next_one_is_right() {
    let mut course = Course::new();
    let settings = settings(40);
    let (mut spoiled, mut twin) = (mpc(settings.clone()), mpc(settings));
    for _ in 0..10 {
        course.solve(&mut spoiled).unwrap();
        course.solve(&mut twin).unwrap();
        course.drive(&twin);
    }
    let horizon = course.horizon(&twin.settings);
    let plan = spoiled.plan().unwrap().clone();

    let mut nan = horizon.clone();
    nan.targets[7].pose.x_m = f64::NAN;
    let failure = solve(&mut spoiled, &nan, None);
    assert_eq!(failure, Err(QpFailure::NotFinite));
    assert_eq!(spoiled.plan().unwrap(), &plan);

    let mut lost = horizon.clone();
    lost.start.yaw_rad = f64::NAN;
    let failure = solve(&mut spoiled, &lost, None);
    assert_eq!(failure, Err(QpFailure::NotFinite));
    assert_eq!(spoiled.plan().unwrap(), &plan);

    let failure = solve(&mut spoiled, &horizon, Some(Instant::now()));
    assert_eq!(failure, Err(QpFailure::Deadline { iterations: 0 }));
    assert_eq!(spoiled.plan().unwrap(), &plan);

    solve(&mut spoiled, &horizon, None).unwrap();
    solve(&mut twin, &horizon, None).unwrap();
    assert_eq!(spoiled.plan().unwrap(), twin.plan().unwrap());
}

#[test]
fn shifting_interpolates_and_runs_on_with_the_last_input() {
    let mut course = Course::new();
    let mut mpc = mpc(settings(12));
    for _ in 0..10 {
        course.solve(&mut mpc).unwrap();
        course.drive(&mpc);
    }
    let plan = mpc.plan().unwrap().clone();
    let normal = course.normal_in_world;
    mpc.shift(0.0, 1.0, &normal);
    for k in 0..12 {
        let same = mpc.plan().unwrap();
        assert!((same.states[k + 1] - plan.states[k + 1]).norm() < 1e-12);
        let steer = same.inputs[k].steer_m_s - plan.inputs[k].steer_m_s;
        assert!(steer.abs() < 1e-12);
    }
    mpc.plan = plan.clone();

    mpc.shift(0.05, 1.0, &normal);
    for k in 0..12 {
        let expected = plan.states[k] * (2.0 / 3.0) + plan.states[k + 1] / 3.0;
        assert!((mpc.plan().unwrap().states[k] - expected).norm() < 1e-12);
        let next = plan.inputs[(k + 1).min(11)];
        let steer = plan.inputs[k].steer_m_s * (2.0 / 3.0) + next.steer_m_s / 3.0;
        assert!((mpc.plan().unwrap().inputs[k].steer_m_s - steer).abs() < 1e-12);
    }
    let run_on = |from: &Vector3<f64>, time_s| {
        let model = PredictionModel::new(Vehicle::j8(), 0.02);
        from + model
            .step_on_plane(&normal, from.z, plan.inputs[11], time_s)
            .increment
    };
    assert!((mpc.plan().unwrap().states[12] - run_on(&plan.states[12], 0.05)).norm() < 1e-12);

    mpc.plan = plan.clone();
    mpc.shift(0.15, 1.0, &normal);
    for k in 0..12 {
        assert!((mpc.plan().unwrap().states[k] - plan.states[k + 1]).norm() < 1e-12);
        let (found, expected) = (mpc.plan().unwrap().inputs[k], plan.inputs[(k + 1).min(11)]);
        assert!((found.traction_m_s - expected.traction_m_s).abs() < 1e-12);
        assert!((found.steer_m_s - expected.steer_m_s).abs() < 1e-12);
    }
}

/// Returns the integral of a plan's inputs over the time from one instant to another, m.
fn integral(plan: &Plan, times: &StageTimes, from_s: f64, to_s: f64) -> [f64; 2] {
    let mut sum = [0.0; 2];
    for (k, input) in plan.inputs.iter().enumerate() {
        let begin_s = times.end_s(k) - times.step_s(k);
        let last = k + 1 == plan.inputs.len();
        let end_s = if last { f64::INFINITY } else { times.end_s(k) };
        let within_s = (end_s.min(to_s) - begin_s.max(from_s)).max(0.0);
        sum[0] += within_s * input.traction_m_s;
        sum[1] += within_s * input.steer_m_s;
    }
    sum
}

proptest! {
    #[test]
    fn a_plan_moved_on_to_other_stages_keeps_the_integral_of_its_inputs(
        speeds in prop::collection::vec((-1.0..1.0_f64, -0.8..0.8_f64), 12),
        elapsed_s in 0.0..0.3_f64,
        last_step_s in 0.15..0.4_f64,
        before in 1.0..4.0_f64,
        after in 1.0..4.0_f64,
    ) {
        let mut mpc = mpc(MpcSettings {
            last_step_s,
            ..settings(12)
        });
        let normal = Vector3::z();
        mpc.move_on(0.0, before, &normal);
        for (k, (traction_m_s, steer_m_s)) in speeds.into_iter().enumerate() {
            mpc.plan.inputs[k] = motors(traction_m_s, steer_m_s);
            let state = mpc.plan.states[k];
            let (input, step_s) = (mpc.plan.inputs[k], mpc.times.step_s(k));
            let step = mpc.model.step_on_plane(&normal, state.z, input, step_s);
            mpc.plan.states[k + 1] = state + step.increment;
        }
        mpc.planned = true;
        let (plan, times) = (mpc.plan.clone(), mpc.times.clone());
        mpc.move_on(elapsed_s, after, &normal);
        prop_assert_eq!(mpc.times.stretch(), after);
        for k in 0..12 {
            let (to_s, from_s) = (mpc.times.end_s(k), mpc.times.end_s(k) - mpc.times.step_s(k));
            let own = integral(&mpc.plan, &mpc.times, from_s, to_s);
            let old = integral(&plan, &times, elapsed_s + from_s, elapsed_s + to_s);
            prop_assert!((own[0] - old[0]).abs() < 1e-9, "{} {:?} {:?}", k, own, old);
            prop_assert!((own[1] - old[1]).abs() < 1e-9, "{} {:?} {:?}", k, own, old);
        }
        // The states lie on the old plan's, at their new times.
        for k in 0..12 {
            let time_s = elapsed_s + mpc.times.end_s(k);
            let Some(stage) = (0..12).find(|stage| times.end_s(*stage) >= time_s) else {
                continue;
            };
            let share = (time_s - times.end_s(stage)) / times.step_s(stage) + 1.0;
            let expected = plan.states[stage].lerp(&plan.states[stage + 1], share);
            prop_assert!((mpc.plan.states[k + 1] - expected).norm() < 1e-9, "{}", k);
        }
    }
}
