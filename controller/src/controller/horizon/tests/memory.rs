//! Horizons where memory knows the places, and where the vehicle is when a command acts.

use super::*;
use crate::controller::drives::Drives;
use crate::memory::{Cell, Evidence, Key, MemoryConfig};

/// Aim, m, and slip per metre, to the right of the path, ahead, rad/m.
const AIM_M: f64 = 0.08;
const SLIP_PER_M: [f64; 3] = [0.2, 0.03, -0.1];

/// Returns a controller on a slalom that knows the same of all places of it.
fn knowing(kind: ControllerKind, cycles: usize) -> Controller {
    let course = Course::Slalom(Slalom::default());
    let mut controller = following(kind, &course, 3.0, 0, start);
    let mut memory = Memory::new(MemoryConfig::default());
    // Ways so long that what little is known does not count.
    let way_m = 1e6;
    let evidence = Evidence {
        way_m,
        slip: SLIP_PER_M.map(|slip| slip * way_m),
        error_way_m: way_m,
        aim_m2: AIM_M * way_m,
        ..Evidence::default()
    };
    for place in 0..4 * 24 * 40 {
        let key = Key {
            sector: [6, 7, 0, 1][place % 4],
            x: (place / 4 % 24) as i32 - 12,
            y: (place / 96) as i32 + 10,
        };
        memory.recall(&[Cell {
            key,
            evidence,
            visits: 1,
        }]);
    }
    controller.memory = Some(memory);
    let pose = start(controller.reference.as_ref().unwrap());
    see(&mut controller, &pose, 0..cycles);
    controller
}

/// Returns a motion per metre at a heading in the world.
fn in_world(yaw_rad: f64) -> Vector3<f64> {
    let [right, ahead, turn] = SLIP_PER_M;
    let (sin, cos) = yaw_rad.sin_cos();
    Vector3::new(cos * right - sin * ahead, sin * right + cos * ahead, turn)
}

#[test]
fn targets_aim_beside_the_path_and_slip_as_memory_knows_the_place() {
    let mut controller = knowing(ControllerKind::ContactMpc, 20);
    let before = controller.mpc().unwrap().plan().unwrap().clone();
    let pose = start(controller.reference.as_ref().unwrap());
    see(&mut controller, &pose, 20..21);
    let path = controller.reference.as_ref().unwrap().path().unwrap();
    let (mut at_m, mut turned) = (3.0, 0.0_f64);
    for (target, input) in controller.horizon.targets.iter().zip(&before.inputs) {
        let place = Point2 {
            x_m: target.pose.x_m,
            y_m: target.pose.y_m,
        };
        let window = Window {
            behind_m: 0.1,
            ahead_m: 1.0,
        };
        let nearest = path.nearest_within(&place, at_m, &window);
        at_m = nearest.point.arc_length_m;
        assert!(
            (nearest.cross_track_m + AIM_M).abs() < 1e-3,
            "{at_m}: {nearest:?}"
        );
        let yaw_rad = target.along_heading_rad;
        turned = turned.max(yaw_rad.abs());
        // The plan has moved on by a cycle.
        let expected = input.traction_m_s * in_world(yaw_rad);
        let off = (target.slip - expected).norm();
        assert!(off < 0.05 * in_world(0.0).norm(), "{at_m}: {off}");
    }
    assert!(at_m > 4.5 && turned > 0.2, "{at_m} {turned}");
}

#[test]
fn the_horizon_begins_where_the_commands_in_flight_take_the_vehicle() {
    let mut controller = knowing(ControllerKind::IcrikMpc, 20);
    let pose = start(controller.reference.as_ref().unwrap());
    let period_s = controller.config.period_s;
    let decision = controller.step(&sample(20.0 * period_s, &pose), None);
    let (mut estimate, mut progress) = (decision.estimate.unwrap(), decision.progress.unwrap());
    progress.cross_track_m = 0.0;
    estimate.time_s = 10.0;
    estimate.pose = PlanarPose {
        x_m: 1.0,
        y_m: 4.0,
        yaw_rad: 0.5,
    };
    let delay_s = 0.3;
    let mut config = controller.config.clone();
    (config.command_delay_s, config.motor_lag_s) = (0.25, 0.05);
    controller.drives = Drives::new(&config);
    let commands =
        [(-0.3, 0.1), (0.6, 0.4), (0.4, -0.3)].map(|(traction_m_s, steer_m_s)| MotorSpeeds {
            traction_m_s,
            steer_m_s,
        });
    for (command, ago) in commands.iter().zip([2.0, 0.7, 0.2]) {
        controller.issued.push(10.0 - ago * delay_s, *command);
    }
    let (start, _) = controller.roll_forward(&estimate, &progress);
    let path = controller.reference.as_ref().unwrap().path().unwrap();
    let slip_per_m = in_world(path.at(progress.arc_length_m).pose().yaw_rad);
    let Law::Mpc(mpc) = &mut controller.law else {
        unreachable!()
    };
    let mut expected = Vector3::new(1.0, 4.0, 0.5);
    for (command, share) in commands.into_iter().zip([0.3, 0.5, 0.2]) {
        let (normal, time_s) = (&estimate.normal_in_world, share * delay_s);
        let step = mpc
            .model_mut()
            .step_on_plane(normal, expected.z, command, time_s);
        expected += step.increment + time_s * command.traction_m_s.abs() * slip_per_m;
    }
    let found = Vector3::new(start.x_m, start.y_m, start.yaw_rad);
    assert!((found - expected).norm() < 1e-9, "{found} {expected}");
}

#[test]
fn a_vehicle_beside_its_path_is_aimed_to_the_other_side_the_next_time() {
    for right_m in [0.3, -0.3] {
        let mut controller = following(ControllerKind::IcrikMpc, &circle(2.0), 0.0, 0, start);
        controller.memory = Some(Memory::new(MemoryConfig::default()));
        let path = controller
            .reference
            .as_ref()
            .unwrap()
            .path()
            .unwrap()
            .clone();
        for cycle in 0..400 {
            let time_s = 0.05 * f64::from(cycle);
            let mut pose = path.at(0.4 * time_s).pose();
            pose.x_m += right_m * pose.yaw_rad.cos();
            pose.y_m += right_m * pose.yaw_rad.sin();
            let mut sample = sample(time_s, &pose);
            let reading = sample.tread_speeds.as_mut().unwrap();
            // A quarter turn of the vehicle's own circle takes as long as that of the path.
            let own_m_s = 0.4 * (2.0 + right_m) / 2.0;
            let turning_m_s = 0.2 * controller.horizon.half_track_m;
            (reading.value.left_m_s, reading.value.right_m_s) =
                (own_m_s - turning_m_s, own_m_s + turning_m_s);
            // It goes its way whatever is commanded.
            controller.drives = Drives::new(&controller.config);
            controller.step(&sample, None);
        }
        for at_m in [1.0, 2.0, 3.2, 4.0, 5.0] {
            let known = controller
                .memory
                .as_ref()
                .unwrap()
                .known(&path.at(at_m).pose(), 100.0);
            let aim_m = known.aim_right_m * right_m.signum();
            assert!(
                (-0.101..-0.05).contains(&aim_m),
                "{right_m} {at_m}: {aim_m}"
            );
        }
    }
}
