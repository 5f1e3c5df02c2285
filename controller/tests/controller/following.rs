//! Progress along a reference, and paths driven to their ends and one after another.

use crate::rig::{CIRCLE, KINDS, LIMITS, STOPPING_CYCLES, Setup, course, driving};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::Status;
use sidehill_controller::path::{Path, Point2, RawPoint, Smoothing, smooth};
use sidehill_controller::reference::{PROJECTION_WINDOW, Reference};
use sidehill_controller::speed_profile::speed_profile;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};

fn pose_at(path: &Path, arc_length_m: f64) -> PlanarPose {
    path.at(arc_length_m).pose()
}

#[test]
fn progress_is_where_the_vehicle_is_and_not_how_long_it_took() {
    for text in [CIRCLE, "{shape: slalom}", "{shape: figure_eight}"] {
        let reached = |elapsed_s: f64, waits: bool| {
            let mut reference = Reference::new(course(text));
            let path = reference.path().unwrap().clone();
            let mut seen = Vec::new();
            for i in 0..100 {
                let pose = pose_at(&path, 0.1 * f64::from(i));
                let cycles = if waits && i == 40 { 300 } else { 1 };
                let progress = (0..cycles).map(|_| reference.advance(elapsed_s, &pose, waits));
                seen.push(progress.last().unwrap());
            }
            seen
        };
        let first = reached(0.05, false);
        for (i, progress) in first.iter().enumerate() {
            let off_m = progress.arc_length_m - 0.1 * i as f64;
            assert!(off_m.abs() < 1e-3, "{text} {i}: {off_m}");
            assert!(progress.cross_track_m.abs() < 1e-3 && !progress.ended);
        }
        assert_eq!(first, reached(0.5, false));
        assert_eq!(first, reached(0.05, true));
    }
}

#[test]
fn a_drive_ends_at_its_cusp_when_the_vehicle_stands_there() {
    let mut reference = Reference::new(course(
        "{shape: cusp, radius_m: 3, angle_deg: 90, speed_m_s: 0.5}",
    ));
    let path = reference.path().unwrap().clone();
    let cusp_m = path.cusps_m().next().unwrap();
    // A vehicle that stands short of the cusp is on its way there, however long it stands.
    for driven_m in [0.0, 0.5 * cusp_m, cusp_m - 0.2] {
        for _ in 0..400 {
            reference.advance(0.05, &pose_at(&path, driven_m), true);
        }
        assert_eq!(reference.stop_at_m(), cusp_m);
        assert!((reference.arc_length_m() - driven_m).abs() < 0.02);
    }
    // One that passes it by is still on the drive to it.
    let mut past = pose_at(&path, cusp_m.next_down());
    past.x_m -= 0.1 * past.yaw_rad.sin();
    past.y_m += 0.1 * past.yaw_rad.cos();
    let progress = reference.advance(0.05, &past, false);
    assert!(progress.arc_length_m <= cusp_m && reference.stop_at_m() == cusp_m);
    let progress = reference.advance(0.05, &pose_at(&path, cusp_m.next_down()), true);
    assert!(
        !progress.ended && progress.point.speed_m_s < 0.0,
        "{progress:?}"
    );
    assert_eq!(reference.stop_at_m(), path.length_m());
    // The way back lies on the way there: the vehicle is on the second drive.
    let back = reference.advance(0.05, &pose_at(&path, cusp_m + 0.3), false);
    assert!((back.arc_length_m - cusp_m - 0.3).abs() < 1e-3, "{back:?}");
    let mut end = back;
    while !end.ended {
        let next_m = (end.arc_length_m + 0.1).min(path.length_m().next_down());
        end = reference.advance(0.05, &pose_at(&path, next_m), false);
        assert!((end.arc_length_m - next_m).abs() < 1e-3, "{end:?}");
    }
    assert!(end.arc_length_m > path.length_m() - 0.2);
    assert_eq!(end.point.speed_m_s, 0.0);
}

#[test]
fn a_path_is_begun_at_the_point_that_the_vehicle_fits() {
    let trajectory = || course("{shape: straight, length_m: 20, speed_m_s: 0.5}");
    let path = trajectory().path().unwrap().clone();
    let begun_m = |pose: &PlanarPose| {
        Reference::new(trajectory())
            .advance(0.05, pose, true)
            .arc_length_m
    };
    let beside = |arc_length_m: f64, left_m: f64, turned_rad: f64| {
        let mut pose = pose_at(&path, arc_length_m);
        pose.x_m -= left_m * pose.yaw_rad.cos();
        pose.y_m -= left_m * pose.yaw_rad.sin();
        pose.yaw_rad += turned_rad;
        pose
    };
    for arc_length_m in [0.0, 0.7, 3.0, 8.0] {
        for (left_m, turned_rad) in [(0.0, 0.0), (0.5, 0.2), (-0.8, -0.3)] {
            let found_m = begun_m(&beside(arc_length_m, left_m, turned_rad));
            assert!(
                (found_m - arc_length_m).abs() < 0.1,
                "{arc_length_m}: {found_m}"
            );
        }
    }
    // Most of the path is to come where it is begun.
    assert!(begun_m(&beside(19.5, 0.0, 0.0)) < 11.1);
}

#[test]
fn a_loop_is_begun_at_its_start_and_driven_round() {
    // A square loop whose end is where it begins.
    let points: Vec<RawPoint> = [(0.0, 0.0), (0.0, 8.0), (-8.0, 8.0), (-8.0, 0.0), (0.0, 0.0)]
        .into_iter()
        .map(|(x_m, y_m)| RawPoint {
            position: Point2 { x_m, y_m },
            ..RawPoint::default()
        })
        .collect();
    let path = smooth(&points, &Smoothing::default()).unwrap().path;
    let trajectory = speed_profile(&path, &LIMITS, |_| f64::INFINITY).unwrap();
    let mut reference = Reference::new(trajectory);
    let mut driven_m = 0.0;
    while driven_m < path.length_m() {
        let progress = reference.advance(0.05, &pose_at(&path, driven_m), false);
        let off_m = progress.arc_length_m - driven_m;
        assert!(off_m.abs() < 0.01, "{driven_m}: {off_m}");
        assert_eq!(
            progress.ended,
            driven_m >= path.length_m() - 0.05,
            "{driven_m}"
        );
        driven_m += 0.02;
    }
}

#[test]
fn a_turn_on_the_spot_is_a_drive_in_heading_counted_over_whole_turns() {
    for turn_deg in [150.0, -150.0, 500.0, -500.0] {
        let text = format!("{{shape: pivot, angle_deg: {turn_deg}, yaw_rate_rad_s: 0.35}}");
        let mut reference = Reference::new(course(&text));
        let from = reference.ahead(0.0).pose();
        let turned = |share: f64| {
            let yaw_rad = from.yaw_rad + share * f64::to_radians(turn_deg);
            PlanarPose {
                yaw_rad: yaw_rad.sin().atan2(yaw_rad.cos()),
                ..from
            }
        };
        let mut before_s = -1.0;
        for i in 0..100 {
            let progress = reference.advance(0.05, &turned(f64::from(i) / 100.0), false);
            assert!(!progress.ended, "{turn_deg} {i}");
            assert!(reference.time_s() > before_s);
            before_s = reference.time_s();
            // A vehicle that waits has not turned on.
            reference.advance(10.0, &turned(f64::from(i) / 100.0), true);
            assert!((reference.time_s() - before_s).abs() < 1e-9);
        }
        assert!(reference.advance(0.05, &turned(1.0), false).ended);
        // A vehicle that has gone too far has to come back; off the place shows.
        let too_far = turned(1.0 + 0.05 / f64::to_radians(turn_deg).abs());
        assert!(!reference.advance(0.05, &too_far, false).ended);
        let mut off = turned(1.0);
        off.x_m += 0.3;
        let progress = reference.advance(0.05, &off, false);
        assert!(progress.ended && (progress.cross_track_m - 0.3).abs() < 1e-9);
    }
}

#[test]
fn a_drive_is_over_where_the_vehicle_reaches_its_end_and_leaves_it_again() {
    for (back_to_m, is_over) in [(0.03, false), (0.045, true)] {
        let trajectory = course("{shape: cusp, radius_m: 3, angle_deg: 80, speed_m_s: 0.5}");
        let path = trajectory.path().unwrap().clone();
        let mut reference = Reference::new(trajectory);
        let cusp_m = path.cusps_m().next().unwrap();
        let mut at =
            |to_go_m: f64| reference.advance(0.05, &pose_at(&path, cusp_m - to_go_m), false);
        let mut to_go_m = cusp_m;
        while to_go_m > 0.025 {
            to_go_m = (to_go_m - 0.02).max(0.025);
            assert!(at(to_go_m).point.speed_m_s > 0.0);
        }
        let backwards = at(back_to_m).point.speed_m_s < 0.0;
        assert_eq!(backwards, is_over, "{back_to_m}");
    }
}

#[test]
fn a_slow_turn_on_the_spot_beside_its_place_does_not_stand() {
    let turn_rad = std::f64::consts::FRAC_PI_2;
    let mut setup = Setup::new(course(
        "{shape: pivot, angle_deg: 90, yaw_rate_rad_s: 0.02}",
    ));
    setup.terrain = crate::rig::plane(14.0);
    setup.start.x_m += 0.2;
    let from_rad = setup.start.yaw_rad;
    let mut rig = setup.build();
    for _ in 0..1200 {
        rig.cycle();
    }
    let turned_rad = rig.simulation.state().pose.yaw_rad - from_rad;
    // Sixty seconds at 0.02 rad/s; it slides back to its place by turning, and so may be done sooner.
    assert!((0.8..turn_rad + 0.05).contains(&turned_rad), "{turned_rad}");
}

#[test]
fn a_circle_on_a_slope_is_driven_at_the_speed_asked_for() {
    // The heading that keeps the path is off its tangent, and has a price: it buys no other speed, as the tangent ahead
    // turns with the vehicle.
    for kind in [ControllerKind::IcrikMpc, ControllerKind::ContactMpc] {
        let mut setup = Setup::new(course("{shape: circle, radius_m: 2.5, speed_m_s: 0.5}"));
        setup.kind = kind;
        setup.config.weights.heading_per_rad2 = 0.4;
        let mut rig = setup.build();
        let mut come_m = |cycles: u32| {
            let decisions = (0..cycles).map(|_| rig.cycle());
            decisions.last().unwrap().progress.unwrap().arc_length_m
        };
        let from_m = come_m(60);
        let speed_m_s = (come_m(400) - from_m) / 20.0;
        assert!((speed_m_s - 0.5).abs() < 0.01, "{kind:?}: {speed_m_s}");
    }
}

#[test]
fn a_turn_on_the_spot_is_planned_to_end_at_its_place() {
    // The J8 turns about a point ahead of its origin, and slides. Across its last heading nothing can be corrected.
    for yaw_rate_rad_s in [0.1, 0.2, 0.4] {
        let mut setup = Setup::new(course(&format!(
            "{{shape: pivot, angle_deg: 90, yaw_rate_rad_s: {yaw_rate_rad_s}}}"
        )));
        setup.terrain = crate::rig::plane(12.0);
        let start = setup.start;
        let mut rig = setup.build();
        let finished = (0..900).any(|_| rig.cycle().status == Status::Finished);
        let end = rig.simulation.state().pose;
        let off_m = (end.x_m - start.x_m).hypot(end.y_m - start.y_m);
        assert!(finished && off_m < 0.12, "{yaw_rate_rad_s} {off_m}");
    }
}

#[test]
fn a_turn_that_has_gone_too_far_comes_back_before_it_is_over() {
    let setup = Setup::new(course("{shape: pivot, angle_deg: 90}"));
    let to_rad = setup.start.yaw_rad + std::f64::consts::FRAC_PI_2;
    let mut rig = setup.build();
    let almost = (0..400).any(|_| {
        rig.cycle();
        rig.simulation.state().pose.yaw_rad > to_rad - 0.1
    });
    assert!(almost);
    let mut pose = rig.simulation.state().pose;
    pose.yaw_rad = to_rad + 0.14;
    rig.simulation.put(pose.planar()).unwrap();
    let finished = (0..100).any(|_| rig.cycle().status == Status::Finished);
    let off_rad = rig.simulation.state().pose.yaw_rad - to_rad;
    assert!(finished && off_rad.abs() < 0.1, "{finished} {off_rad}");
}

#[test]
fn a_turn_that_comes_no_nearer_is_over_close_to_its_end_only() {
    for (short_rad, is_over) in [(0.06, true), (0.2, false)] {
        let mut reference = Reference::new(course("{shape: pivot, angle_deg: 90}"));
        let mut pose = reference.ahead(0.0).pose();
        pose.yaw_rad += std::f64::consts::FRAC_PI_2 - short_rad;
        let ended_s = (0..400)
            .find(|_| reference.advance(0.05, &pose, false).ended)
            .map(|cycle| 0.05 * f64::from(cycle));
        assert_eq!(ended_s.is_some(), is_over, "{short_rad}");
        assert!(ended_s.is_none_or(|ended_s| (2.5..3.5).contains(&ended_s)));
    }
}

#[test]
fn the_last_drive_is_over_near_its_end_sooner_for_a_vehicle_that_goes_away_again() {
    // It waits 9 cm before the end, where it may still come nearer, or goes back from there.
    for (back_m_s, most_to_go_m, longest_s) in [(0.0, 0.1, 3.3), (0.06, 0.16, 1.3)] {
        let trajectory = course("{shape: straight, length_m: 4, speed_m_s: 0.5}");
        let path = trajectory.path().unwrap().clone();
        let mut reference = Reference::new(trajectory);
        let mut at = |to_go_m: f64| {
            reference
                .advance(0.05, &pose_at(&path, 4.0 - to_go_m), false)
                .ended
        };
        assert!((0..100).all(|i| !at(4.0 - 0.0391 * f64::from(i))));
        let (mut to_go_m, mut waited_s) = (0.09, 0.0);
        while !at(to_go_m) {
            (to_go_m, waited_s) = (to_go_m + 0.05 * back_m_s, waited_s + 0.05);
            assert!(waited_s < 10.0);
        }
        assert!(
            to_go_m < most_to_go_m && waited_s < longest_s,
            "{to_go_m} {waited_s}"
        );
    }
}

#[test]
fn a_drive_to_a_cusp_is_over_for_a_vehicle_that_comes_no_nearer_within_a_tenth_of_a_metre() {
    for (short_m, is_over) in [(0.08, true), (0.12, false)] {
        let trajectory = course("{shape: cusp, radius_m: 3, angle_deg: 80, speed_m_s: 0.5}");
        let path = trajectory.path().unwrap().clone();
        let mut reference = Reference::new(trajectory);
        let cusp_m = path.cusps_m().next().unwrap();
        for i in 0..=100 {
            let driven_m = (cusp_m - short_m) * f64::from(i) / 100.0;
            reference.advance(0.05, &pose_at(&path, driven_m), false);
        }
        let short = pose_at(&path, cusp_m - short_m);
        let mut backwards = || reference.advance(0.05, &short, false).point.speed_m_s < 0.0;
        let over_s = (1..200).find(|_| backwards()).map(|i| 0.05 * f64::from(i));
        assert_eq!(over_s.is_some(), is_over, "{short_m}");
        assert!(over_s.is_none_or(|over_s| (2.5..3.5).contains(&over_s)));
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
fn a_drive_is_finished_in_the_cycle_in_which_the_vehicle_stands_at_its_end() {
    for text in [
        "{shape: straight, length_m: 1.5, speed_m_s: 0.5}",
        "{shape: pivot, angle_deg: 60, yaw_rate_rad_s: 0.3}",
    ] {
        let mut rig = Setup::new(course(text)).build();
        let mut ended = 0;
        let finished = (0..400).any(|_| {
            let before = rig.command;
            let decision = rig.cycle();
            ended += u32::from(decision.progress.unwrap().ended);
            let stands = before.traction_m_s.abs() < 0.01 && before.steer_m_s.abs() < 0.01;
            let finished = decision.status == Status::Finished;
            // Or where it has come no nearer for a second.
            let stayed = finished && ended >= 20;
            assert_eq!(
                finished,
                ended > 0 && (stands || stayed),
                "{text} {before:?} {ended}"
            );
            finished
        });
        assert!(finished, "{text}");
    }
}

#[test]
fn the_last_lap_of_a_circle_is_finished_where_it_ends_at_speed() {
    let mut rig = Setup::new(course("{shape: circle, radius_m: 1.2, speed_m_s: 0.5}")).build();
    let finished = (0..500).any(|_| {
        let decision = rig.cycle();
        let finished = decision.status == Status::Finished;
        assert_eq!(finished, decision.progress.unwrap().ended);
        finished
    });
    assert!(
        finished && rig.command.traction_m_s > 0.2,
        "{:?}",
        rig.command
    );
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

/// A plan that leads elsewhere is a bad point to linearise about.
#[test]
fn the_plan_is_kept_for_a_path_that_leads_close_to_where_the_horizon_ends() {
    let straight = course("{shape: straight, length_m: 12, heading_deg: 0}");
    let mut rig = Setup::new(straight.clone()).build();
    for _ in 0..5 {
        rig.cycle();
    }
    // Beside the path before, and turned away from it about its start.
    for (x_m, yaw_rad, kept) in [
        (0.4, 0.0, true),
        (0.6, 0.0, false),
        (0.0, 0.02, true),
        (0.0, 0.5, false),
    ] {
        let mut rig = rig.clone();
        let frame = PlanarPose {
            x_m,
            y_m: 0.0,
            yaw_rad,
        };
        rig.follow(1, straight.clone().seen_from(&frame), 0.0);
        let found = rig.controller.plan().is_some();
        assert_eq!(found, kept, "{x_m} m, {yaw_rad} rad");
        assert_eq!(rig.cycle().status, Status::Tracking);
    }
}

#[test]
fn a_program_sees_where_on_the_path_each_stage_is_to_end() {
    let mut rig = driving(ControllerKind::IcrikMpc);
    let reference = rig.controller.reference().unwrap();
    let path = reference.path().unwrap();
    let targets = rig.controller.targets();
    assert_eq!(targets.len(), rig.controller.config().stages);
    assert_eq!(rig.controller.mpc().unwrap().stages(), targets.len());
    let mut along_m = reference.arc_length_m();
    for target in targets {
        let place = Point2 {
            x_m: target.pose.x_m,
            y_m: target.pose.y_m,
        };
        let nearest = path.nearest_within(&place, along_m, &PROJECTION_WINDOW);
        assert!(nearest.cross_track_m.abs() < 1e-3, "{nearest:?}");
        let farther_m = nearest.point.arc_length_m - along_m;
        assert!((0.0..0.3).contains(&farther_m), "{farther_m}");
        along_m = nearest.point.arc_length_m;
    }
    assert!(along_m > reference.arc_length_m() + 2.0, "{along_m}");
    rig.controller.forget_path();
    assert!(rig.controller.targets().is_empty());
    let pursuing = driving(ControllerKind::PurePursuit);
    assert!(pursuing.controller.targets().is_empty());
}

/// Turned away from the path, above it and with traction limited to 0.52 m/s^2, a plan that reverses first is a
/// local optimum, too.
#[test]
fn from_beside_the_path_the_vehicle_drives_on_towards_it() {
    let mut setup = Setup::new(course("{shape: straight, length_m: 8, speed_m_s: 0.6}"));
    setup.kind = ControllerKind::ContactMpc;
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

#[test]
fn on_the_way_back_to_its_path_a_vehicle_is_at_most_a_quarter_faster_than_allowed() {
    for kind in [ControllerKind::IcrikMpc, ControllerKind::ContactMpc] {
        let mut setup = Setup::new(course("{shape: straight, length_m: 8, speed_m_s: 0.4}"));
        setup.kind = kind;
        setup.start.x_m += 0.8;
        let mut rig = setup.build();
        let fastest_m_s = (0..240)
            .map(|_| rig.cycle().command_effective.traction_m_s.abs())
            .fold(0.0, f64::max);
        assert!(
            (0.45..0.5 + 1e-6).contains(&fastest_m_s),
            "{kind:?} {fastest_m_s}"
        );
    }
}

#[test]
fn a_vehicle_whose_commands_are_scaled_down_drives_at_that_share_of_its_speed() {
    for (ratio, speed_m_s) in [(0.8, 0.4), (0.4, 0.4), (0.4, 0.8), (0.25, 0.8)] {
        for kind in [ControllerKind::ContactMpc, ControllerKind::IcrikMpc] {
            let straight = format!("{{shape: straight, length_m: 8, speed_m_s: {speed_m_s}}}");
            let mut setup = Setup::new(course(&straight));
            setup.kind = kind;
            setup.drive_train = serde_yaml::from_str(&format!(
                "{{traction: {{time_constant_s: 0.1}}, steer: {{time_constant_s: 0.1}},
                  collision_monitor: [{{from_s: 0, to_s: 1000, slowdown_ratio: {ratio}}}]}}"
            ))
            .unwrap();
            let mut rig = setup.build();
            let period_s = rig.controller.config().period_s;
            let (mut time_s, what) = (0.0, format!("{kind:?}, {ratio} of {speed_m_s} m/s"));
            while rig.cycle().status != Status::Finished {
                time_s += period_s;
                assert!(time_s < 200.0, "{what}");
            }
            // It needs up to 8 s to know, and brakes.
            let at_best_s = 8.0 / (ratio * speed_m_s);
            assert!(time_s < 1.2 * at_best_s + 8.0, "{what}: {time_s} s");
        }
    }
}
