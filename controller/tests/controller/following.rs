//! A reference waits for the vehicle, and paths are driven to their ends and one after another.

use crate::rig::{CIRCLE, KINDS, STOPPING_CYCLES, Setup, course, driving};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::Status;
use sidehill_controller::reference::{Reference, Tracking};
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};

#[test]
fn a_timed_reference_waits_for_a_vehicle_that_stands_and_goes_on_with_it() {
    let trajectory = course("{shape: circle, radius_m: 4, speed_m_s: 0.4}");
    let mut reference = Reference::new(trajectory, Tracking::Time);
    let start = reference.ahead(0.0);
    let standing = start.pose();
    for _ in 0..200 {
        reference.advance(0.05, &standing);
    }
    // 0.6 m ahead at 0.4 m/s.
    assert!(
        (reference.time_s() - 1.5).abs() < 0.1,
        "{}",
        reference.time_s()
    );
    let point = reference.ahead(0.0);
    let there = point.pose();
    let before_s = reference.time_s();
    reference.advance(0.05, &there);
    assert!((reference.time_s() - before_s - 0.05).abs() < 1e-12);
}

#[test]
fn at_a_cusp_only_the_geometric_laws_reference_waits_for_the_vehicle() {
    let cusp = "{shape: cusp, radius_m: 3, angle_deg: 90, speed_m_s: 0.5}";
    for (tracking, passes) in [
        (Tracking::Path { lead_max_m: 0.3 }, true),
        (Tracking::PathByCusps { lead_max_m: 0.3 }, false),
    ] {
        let mut reference = Reference::new(course(cusp), tracking);
        let path = reference.path().unwrap().clone();
        let cusp_m = path.cusps_m().next().unwrap();
        // The vehicle drives on the path and stops 0.2 m short of the cusp.
        let mut driven_m: f64 = 0.0;
        for _ in 0..400 {
            driven_m = (driven_m + 0.025).min(cusp_m - 0.2);
            let at = path.at(driven_m);
            let pose = PlanarPose {
                x_m: at.position.x_m,
                y_m: at.position.y_m,
                yaw_rad: at.heading_rad,
            };
            reference.advance(0.05, &pose);
        }
        let reached_m = reference.ahead(0.0).arc_length_m;
        assert_eq!(reached_m > cusp_m, passes, "{tracking:?} {reached_m}");
        assert!(reached_m > cusp_m - 0.05, "{tracking:?} {reached_m}");
    }
}

#[test]
fn pure_pursuit_drives_into_a_cusp_back_out_of_it_and_to_its_end() {
    for (course_text, slope_right_m) in [
        (
            "{shape: cusp, radius_m: 3, angle_deg: 90, speed_m_s: 0.5}",
            0.0,
        ),
        ("{shape: straight, length_m: 6, speed_m_s: 0.5}", 0.3),
    ] {
        let mut setup = Setup::new(course(course_text));
        setup.kind = ControllerKind::PurePursuit;
        setup.start.x_m += slope_right_m;
        let end = setup.trajectory.at(1e6);
        let mut rig = setup.build();
        let mut finished = None;
        for cycle in 0..1200 {
            let decision = rig.cycle();
            let progress = decision.progress.unwrap();
            assert!(progress.cross_track_m.abs() < 0.35, "{progress:?}");
            if decision.status == Status::Finished {
                finished = Some(cycle);
                break;
            }
            assert_eq!(decision.status, Status::Tracking, "{course_text} {cycle}");
        }
        assert!(finished.is_some(), "{course_text}");
        let pose = rig.simulation.state().pose;
        let miss_m = (pose.x_m - end.position.x_m).hypot(pose.y_m - end.position.y_m);
        assert!(miss_m < 0.15, "{course_text}: {miss_m} m from the end");
    }
}

#[test]
fn a_start_that_the_limits_cannot_follow_is_caught_up_with() {
    // The reference drives at 0.4 m/s from its first instant, the vehicle stands and needs 2 s.
    let mut setup = Setup::new(course(CIRCLE));
    for motor in [
        &mut setup.config.limits.traction,
        &mut setup.config.limits.steer,
    ] {
        motor.acceleration_m_s2 = 0.2;
        motor.deceleration_m_s2 = 0.2;
    }
    setup.config.limits.tread_speed_m_s = 0.9;
    let mut rig = setup.build();
    for cycle in 0..400 {
        let decision = rig.cycle();
        match decision.status {
            Status::Tracking => (),
            status => panic!("cycle {cycle}: {status:?}"),
        }
    }
    let decision = rig.cycle();
    let (pose, progress) = (decision.estimate.unwrap().pose, decision.progress.unwrap());
    let reference = progress.point.position;
    let lag_m = (pose.x_m - reference.x_m).hypot(pose.y_m - reference.y_m);
    assert!(lag_m < 0.02, "{lag_m} m");
}

#[test]
fn a_straight_drive_ends_standing_at_its_end() {
    for kind in ControllerKind::ALL {
        let mut rig = Setup {
            kind,
            ..Setup::new(course("{shape: straight, length_m: 3, speed_m_s: 0.5}"))
        }
        .build();
        let finished = (0..600).find(|_| rig.cycle().status == Status::Finished);
        assert!(finished.is_some(), "{kind:?}");
        rig.until_standing(STOPPING_CYCLES);
        for _ in 0..100 {
            let decision = rig.cycle();
            assert_eq!(decision.status, Status::Finished);
            assert_eq!(decision.command_effective, MotorSpeeds::STOP);
        }
        let end = rig.controller.reference().unwrap().ahead(0.0).position;
        let pose = rig.simulation.state().pose;
        let distance_m = (end.x_m - pose.x_m).hypot(end.y_m - pose.y_m);
        assert!(distance_m < 0.1, "{kind:?}: {distance_m} m");
    }
}

#[test]
fn another_path_is_taken_up_while_driving() {
    for kind in KINDS {
        let mut rig = driving(kind);
        let before = rig.cycle();
        let pose = before.estimate.unwrap().pose;
        // A straight path that begins under the vehicle, given in a frame of its own.
        let ahead = course("{shape: straight, length_m: 4, heading_deg: 0}").seen_from(&pose);
        rig.follow(7, ahead, 0.0);
        let after = rig.cycle();
        assert_eq!((before.reference, after.reference), (0, 7));
        assert_eq!(after.status, Status::Tracking);
        // Neither the estimate nor the command begins anew.
        let drop_m_s = before.command_effective.traction_m_s - after.command_effective.traction_m_s;
        assert!(drop_m_s.abs() < 0.11, "{drop_m_s}");
        let until = (0..400).find(|_| rig.cycle().status == Status::Finished);
        assert!(until.is_some());
        let end = rig.simulation.state().pose;
        let (sin, cos) = pose.yaw_rad.sin_cos();
        let (x_m, y_m) = (pose.x_m - 4.0 * sin, pose.y_m + 4.0 * cos);
        let miss_m = (end.x_m - x_m).hypot(end.y_m - y_m);
        assert!(miss_m < 0.25, "{kind:?}: {miss_m} m");
        // One that has finished drives again, and begins where it is told to.
        let back = course("{shape: straight, length_m: 9, heading_deg: 0}").seen_from(&pose);
        rig.follow(8, back, 4.0);
        let decision = rig.cycle();
        assert_eq!(decision.status, Status::Tracking);
        let progress_m = decision.progress.unwrap().arc_length_m;
        assert!((progress_m - 4.0).abs() < 0.2, "{progress_m}");
    }
}

/// Turned away from the path, above it and with traction limited to 0.52 m/s^2, a plan that reverses first is a
/// local optimum, too.
#[test]
fn from_beside_the_path_the_vehicle_drives_on_towards_it() {
    let mut setup = Setup::new(course("{shape: straight, length_m: 8, speed_m_s: 0.6}"));
    setup.kind = ControllerKind::ContactMpc;
    setup.tracking = Tracking::Path { lead_max_m: 0.6 };
    let traction = &mut setup.config.limits.traction;
    (traction.acceleration_m_s2, traction.deceleration_m_s2) = (0.52, 0.52);
    setup.config.weights.steer_change_s3_per_m2 = 0.8;
    setup.config.weights.heading_per_rad2 = 0.4;
    setup.terrain = Terrain::Plane(PlaneTerrain::new(12.0, -75.0).unwrap());
    setup.start.x_m -= 0.38;
    setup.start.y_m += 0.11;
    setup.start.yaw_rad += 0.37;
    let mut rig = setup.build();
    for _ in 0..16 {
        rig.cycle();
        assert!(rig.command.traction_m_s > -0.01, "{:?}", rig.command);
    }
    assert!(rig.command.traction_m_s > 0.3, "{:?}", rig.command);
}
