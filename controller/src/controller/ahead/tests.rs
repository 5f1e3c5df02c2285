#![allow(clippy::unwrap_used)]

use super::super::horizon::tests::sample;
use super::*;
use crate::config::{ControllerConfig, ControllerKind};
use crate::controller::Decision;
use crate::course::{Circle, Course};
use crate::mpc::StageTarget;
use crate::reference::Reference;
use crate::speed_profile::SpeedConfig;
use sidehill_plant::frames::{Attitude, PlanarPose, pose_rate};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::Vehicle;
use std::collections::VecDeque;

const RADIUS_M: f64 = 2.5;
const PERIOD_S: f64 = 0.05;

/// A point of the J8 that drives round a circle to the left of the origin on 10 degrees, with commands under way for 0.2 s.
struct Drive {
    controller: Controller,
    normal_in_world: Vector3<f64>,
    pose: PlanarPose,
    under_way: VecDeque<MotorSpeeds>,
    time_s: f64,
}

impl Drive {
    fn new() -> Self {
        let config = ControllerConfig {
            command_delay_s: 0.2,
            tracked_point: TrackedPoint {
                right_m: 0.2,
                forward_m: 0.3,
            },
            ..ControllerConfig::default()
        };
        let vehicle = Vehicle::j8();
        let limits = SpeedConfig::default().limits(&config.limits, &vehicle);
        let course = Course::Circle(Circle {
            radius_m: RADIUS_M,
            speed_m_s: 0.7,
            ..Circle::default()
        });
        let mut controller = Controller::new(ControllerKind::IcrikMpc, config, &vehicle).unwrap();
        controller.follow(Reference::new(course.trajectory(&limits).unwrap()));
        let slope = 10.0_f64.to_radians();
        Self {
            controller,
            normal_in_world: Vector3::new(slope.sin(), 0.0, slope.cos()),
            pose: PlanarPose::default(),
            under_way: VecDeque::from([MotorSpeeds::STOP; 4]),
            time_s: 0.0,
        }
    }

    fn cycle(&mut self) -> Decision {
        let vehicle = Vehicle::j8();
        let moving = self.under_way[0];
        let pose = &mut self.pose;
        let attitude = Attitude::on_plane(&self.normal_in_world, pose.yaw_rad);
        let (time_s, value) = (self.time_s, attitude);
        let moving_and_tilted = Sample {
            tread_speeds: Some(Stamped {
                time_s,
                value: vehicle.encoder_scale.invert(moving.into()),
            }),
            attitude: Some(Stamped { time_s, value }),
            ..sample(time_s, pose)
        };
        let decision = self.controller.step(&moving_and_tilted, None);
        self.under_way.push_back(decision.command_effective);
        let moving = self.under_way.pop_front().unwrap();
        for _ in 0..10 {
            let attitude = Attitude::on_plane(&self.normal_in_world, pose.yaw_rad);
            let velocity = vehicle.body_velocity(attitude, moving.into());
            let rate = pose_rate(&velocity, &attitude, pose.yaw_rad);
            pose.x_m += 0.1 * PERIOD_S * rate.x_m_s;
            pose.y_m += 0.1 * PERIOD_S * rate.y_m_s;
            pose.yaw_rad += 0.1 * PERIOD_S * rate.yaw_rad_s;
        }
        self.time_s += PERIOD_S;
        decision
    }

    fn place(&self, target: &StageTarget, state: &Vector3<f64>) -> PlanarPose {
        let origin = PlanarPose {
            x_m: state.x,
            y_m: state.y,
            yaw_rad: state.z,
        };
        self.controller
            .tracked_point()
            .of(&origin, &target.normal_in_world)
    }

    /// Returns by how much the distance from the path where a target is changes with a jump of the state, by a difference.
    fn change(&self, target: &StageTarget, state: &Vector3<f64>, jump: &Vector3<f64>) -> f64 {
        let (sin, cos) = target.along_heading_rad.sin_cos();
        let left_m = |by: f64| {
            let place = self.place(target, &(state + by * jump));
            -cos * place.x_m - sin * place.y_m
        };
        (left_m(1e-4) - left_m(-1e-4)) / 2e-4
    }

    /// Returns the distance from the path in [`AHEAD_S`] and its variance with s = 1, as the file's head has it.
    fn expected(&self, estimate: &Estimate) -> (f64, f64) {
        let controller = &self.controller;
        let Law::Mpc(mpc) = &controller.law else {
            panic!("no MPC");
        };
        let (targets, plan) = (&controller.horizon.targets, mpc.plan().unwrap());
        let start = plan_start(&controller.horizon.start);
        let (sin, cos) = targets[0].along_heading_rad.sin_cos();
        let left = Vector3::new(-cos, -sin, 0.0);
        // A heading that is corrected turns what is driven until the plan begins about the vehicle.
        let way = start - plan_start(&estimate.pose);
        let turned = Vector3::new(-way.y, way.x, 1.0);
        let change = |k: usize, state: &Vector3<f64>, jumps: [Vector3<f64>; 2]| {
            jumps.map(|jump| self.change(&targets[k], state, &jump))
        };

        let delay_s = controller.drives.response().delay_s;
        let mut points = vec![
            (0.0, change(0, &start, [left, Vector3::z()])),
            (delay_s, change(0, &start, [left, turned])),
        ];
        let answers: Vec<Vec<_>> = [left, turned]
            .iter()
            .map(|jump| [*jump].into_iter().chain(mpc.answer(*jump)).collect())
            .collect();
        let (mut time_s, mut squares, mut k) = (delay_s, 0.0, 0);
        let (state, at) = loop {
            let step_s = mpc.stage_times().step_s(k);
            let within_s = step_s.min(AHEAD_S - time_s);
            let share = within_s / step_s;
            let state = plan.states[k].lerp(&plan.states[k + 1], share);
            let jumps = [0, 1].map(|i: usize| answers[i][k].lerp(&answers[i][k + 1], share));
            time_s += within_s;
            squares += within_s * plan.inputs[k].steer_m_s.powi(2);
            points.push((time_s, change(k, &state, jumps)));
            if share < 1.0 {
                break (state, k);
            }
            k += 1;
        };
        let growth = controller.estimator.growth();
        let columns = Matrix3x2::from_columns(&[left, Vector3::z()]);
        let rate = columns.transpose() * growth * columns;
        let rate_of = |f: [f64; 2]| {
            f[0] * f[0] * rate[(0, 0)]
                + 2.0 * f[0] * f[1] * rate[(0, 1)]
                + f[1] * f[1] * rate[(1, 1)]
        };
        let integral: f64 = points
            .windows(2)
            .map(|pair| 0.5 * (pair[1].0 - pair[0].0) * (rate_of(pair[0].1) + rate_of(pair[1].1)))
            .sum();
        let across = [Vector3::x(), Vector3::y(), Vector3::z()]
            .map(|axis| self.change(&targets[at], &state, &axis));
        let now_m2: f64 = (0..9)
            .map(|i| across[i / 3] * estimate.covariance[(i / 3, i % 3)] * across[i % 3])
            .sum();
        let turning = squares / (AHEAD_S - delay_s) / (STEER_M_S * STEER_M_S);

        let place = self.place(&targets[at], &state);
        let cross_track_m = RADIUS_M - (place.x_m + RADIUS_M).hypot(place.y_m);
        (cross_track_m, now_m2 + (1.0 + turning) * integral)
    }
}

fn plan_start(pose: &PlanarPose) -> Vector3<f64> {
    Vector3::new(pose.x_m, pose.y_m, pose.yaw_rad)
}

#[test]
fn the_bound_ahead_is_that_of_what_a_pose_will_correct_and_the_plan_answers() {
    let mut drive = Drive::new();
    let mut first_s = None;
    let unlearned = drive.controller.predictions.share();
    for cycle in 0..120 {
        let time_s = drive.time_s;
        let decision = drive.cycle();
        let estimate = decision.estimate.unwrap();
        let Some(ahead) = decision.ahead else {
            assert_eq!(estimate.treads, TreadSpeeds::default(), "{cycle}");
            continue;
        };
        assert_ne!(estimate.treads, TreadSpeeds::default(), "{cycle}");
        // Nothing is learned before the first prediction is due.
        let due_s = *first_s.get_or_insert(time_s) + AHEAD_S;
        let share = drive.controller.predictions.share();
        assert_eq!(share == unlearned, time_s < due_s - 1e-3, "{cycle}");
        let (cross_track_m, variance_m2) = drive.expected(&estimate);
        let at = format!("cycle {cycle}: {ahead:?}, expected {cross_track_m}, {variance_m2}");
        assert!((ahead.cross_track_m - cross_track_m).abs() < 1e-4, "{at}");
        let heading_rad = decision.progress.unwrap().point.heading_rad;
        let now_m = estimate.bound_across_m(heading_rad);
        let bound_m = (1.96 * (share * variance_m2).sqrt()).max(now_m);
        assert!(
            (ahead.bound_m / bound_m - 1.0).abs() < 1e-4,
            "{at}, {bound_m}"
        );
        assert!(share < unlearned || ahead.bound_m > 1.1 * now_m, "{at}");
    }
    assert!(first_s.is_some_and(|first_s| first_s < 1.0));
}
