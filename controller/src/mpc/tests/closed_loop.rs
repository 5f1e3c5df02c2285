//! The MPC on a slope, driving the exact model.

use super::condensed::assert_same_optimum;
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
                    normal_in_world: self.normal_in_world,
                    feedforward: motors(point.speed_m_s, point.yaw_rate_rad_s),
                    slip: Vector3::zeros(),
                    weights: StageWeights {
                        along_per_m2: 50.0,
                        cross_per_m2: 50.0,
                        heading_per_rad2: 0.02,
                    },
                }
            })
            .collect();
        Horizon {
            elapsed_s: 0.05,
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

    /// Solves a cycle: the first about a first plan, later ones about the shifted plan.
    pub fn solve(&self, mpc: &mut Mpc) -> Result<SolveReport, QpFailure> {
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

pub fn solve(
    mpc: &mut Mpc,
    horizon: &Horizon,
    deadline: Option<Instant>,
) -> Result<SolveReport, QpFailure> {
    let solution = mpc.linearise(horizon).condense().solve(deadline)?;
    Ok(solution.report.unwrap())
}

pub fn settings(stages: usize, block_stages: usize) -> MpcSettings {
    MpcSettings {
        stages,
        step_s: 0.15,
        last_step_s: 0.15,
        step_limit: None,
        period_s: 0.05,
        block_stages,
        heading_excess: HeadingExcess {
            free_rad: 0.5,
            per_rad2: 0.0,
        },
        terminal_factor: 1.0,
        limits: input_limits(2.0),
        corridor: None,
        qp: QpSettings {
            tolerance: 1e-6,
            max_iterations: 10,
            accepted_residual: 1e-3,
            accepted_gap: 0.2,
            mode: QpMode::WorkingSet,
        },
    }
}

pub fn mpc(settings: MpcSettings) -> Mpc {
    Mpc::new(settings, PredictionModel::new(Vehicle::j8(), 0.02)).unwrap()
}

#[test]
fn every_qp_of_a_run_meets_its_optimality_conditions() {
    let mut course = Course::new();
    let mut mpc = mpc(settings(40, 5));
    for _ in 0..400 {
        let report = course.solve(&mut mpc).unwrap();
        let Residuals { primal, dual, gap } = report.residuals;
        let at = format!("cycle {}: {:?}", course.cycle, report.residuals);
        assert!(primal < 1e-5 && dual < 1e-5 && gap < 1e-3, "{at}");
        // What the report says is what the solver's data say.
        assert_eq!(mpc.solver.residuals(), report.residuals);
        assert!(mpc.solver.data().b.iter().all(|b| b.is_finite()));
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
fn the_qps_of_a_run_have_the_optimum_of_the_stagewise_problem() {
    let mut course = Course::new();
    let mut mpc = mpc(settings(40, 5));
    for block_stages in 1..=8 {
        for _ in 0..5 {
            course.solve(&mut mpc).unwrap();
            course.drive(&mpc);
        }
        // The stages of the last QP, before its solution moved the plan.
        for (corridor, tread_speed_m_s) in [
            (None, 2.0),
            (
                Some(Corridor {
                    half_width_m: 0.01,
                    weight_per_m2: 300.0,
                }),
                1.2,
            ),
        ] {
            assert_same_optimum(
                &mpc.stages,
                course.command,
                &input_limits(tread_speed_m_s),
                corridor,
                block_stages,
                QpMode::FreshDefaults,
            );
        }
    }
}

#[test]
fn block_sizes_and_solver_modes_give_one_plan() {
    let plan = |block_stages, mode| {
        let mut settings = settings(30, block_stages);
        settings.qp = QpSettings { mode, ..exact() };
        let mut course = Course::new();
        let mut mpc = mpc(settings);
        for _ in 0..20 {
            course.solve(&mut mpc).unwrap();
            course.drive(&mpc);
        }
        mpc.plan().unwrap().clone()
    };
    let reference = plan(5, QpMode::InPlace);
    for (block_stages, mode) in [
        (5, QpMode::WorkingSet),
        (1, QpMode::WorkingSet),
        (1, QpMode::InPlace),
        (7, QpMode::InPlace),
        (20, QpMode::InPlace),
        (1, QpMode::FreshDefaults),
        (5, QpMode::FreshDefaults),
    ] {
        let other = plan(block_stages, mode);
        for (a, b) in reference.inputs.iter().zip(&other.inputs) {
            let difference = (a.traction_m_s - b.traction_m_s)
                .abs()
                .max((a.steer_m_s - b.steer_m_s).abs());
            assert!(difference < 1e-5, "{block_stages} {mode:?}: {difference}");
        }
        for (a, b) in reference.states.iter().zip(&other.states) {
            assert!((a - b).norm() < 1e-5, "{block_stages} {mode:?}");
        }
    }
}

#[test]
fn a_failed_cycle_leaves_the_plan_and_the_next_one_is_right() {
    check_failed_cycle(None);
    check_failed_cycle(Some(StepLimit::default()));
}

fn check_failed_cycle(step_limit: Option<StepLimit>) {
    let mut course = Course::new();
    let settings = MpcSettings {
        step_limit,
        ..settings(40, 5)
    };
    let (mut spoiled, mut twin) = (mpc(settings.clone()), mpc(settings));
    for _ in 0..10 {
        course.solve(&mut spoiled).unwrap();
        course.solve(&mut twin).unwrap();
        course.drive(&twin);
    }
    // At the same instant as the cycle before: the plan is not shifted.
    let horizon = Horizon {
        elapsed_s: 0.0,
        ..course.horizon(&twin.settings)
    };
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
    let mut mpc = mpc(settings(12, 5));
    for _ in 0..10 {
        course.solve(&mut mpc).unwrap();
        course.drive(&mpc);
    }
    let plan = mpc.plan().unwrap().clone();
    let normal = course.normal_in_world;
    mpc.shift(0.0, &normal);
    assert_eq!(mpc.plan().unwrap(), &plan);

    mpc.shift(0.05, &normal);
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
    mpc.shift(0.15, &normal);
    assert_eq!(mpc.plan().unwrap().states[..12], plan.states[1..]);
    assert_eq!(mpc.plan().unwrap().inputs[..11], plan.inputs[1..]);
    assert_eq!(mpc.plan().unwrap().inputs[11], plan.inputs[11]);
}
