//! How sessions begin, and what becomes of their path.

use super::*;
use std::time::Duration;

const AT_START: PivotSettings = PivotSettings {
    at_start: true,
    at_goal: false,
};

#[test]
fn a_path_that_begins_behind_is_preceded_by_one_pivot() {
    let mut world = World::with(AT_START);
    world.yaw_rad = ALONG_X + 2.5;
    let client = world.follow();
    world.cycles(10);
    let pivot = world.reference;
    assert_eq!((world.armed, world.state), (pivot, SafetyState::Driving));
    // A pivot makes no progress, and its end is not that of the path.
    world.cycles(250);
    assert_eq!(world.state, SafetyState::Driving);
    world.end_pivot();
    assert!(wrap_angle(world.yaw_rad - ALONG_X).abs() < 1e-6);
    assert!(world.finished.is_empty(), "{:?}", world.finished);
    // Were the path still behind, one pivot has to do.
    world.yaw_rad = ALONG_X + 2.5;
    world.build();
    world.cycles(10);
    assert_eq!(world.state, SafetyState::Driving);
    assert!(world.armed > pivot);
    (world.x_m, world.yaw_rad) = (10.0, ALONG_X);
    world.cycle();
    world.finish();
    world.assert_finished(client, GoalEnd::Succeeded, code::NONE);
}

#[test]
fn a_vehicle_under_way_stops_before_it_pivots() {
    let mut world = World::with(AT_START);
    let first = world.driving();
    world.yaw_rad = ALONG_X + 3.0;
    let second = world.follow();
    world.assert_finished(first, GoalEnd::Aborted, code::UNKNOWN);
    let (armed, path) = (world.armed, world.reference);
    world.cycle();
    assert_eq!((world.state, world.armed), (SafetyState::Stopping, armed));
    assert_eq!(world.reference, path, "not while it drives");
    world.cycles(10);
    assert_eq!(world.state, SafetyState::Driving);
    assert!(world.armed > armed);
    let end_rad = world.trajectory.as_ref().unwrap().at(1e3).heading_rad;
    assert!(wrap_angle(end_rad - ALONG_X).abs() < 1e-6);
    // A cancel during the pivot ends the session.
    world.cancel(second);
    world.cycles(5);
    world.assert_finished(second, GoalEnd::Canceled, code::NONE);
    assert_eq!(world.handler.goal(), None);
}

#[test]
fn a_path_that_begins_behind_is_driven_as_it_is_without_pivots() {
    let mut world = World::new();
    world.yaw_rad = ALONG_X + 3.0;
    world.driving();
    assert!(world.trajectory.unwrap().length_m() > 9.0);
}

#[test]
fn a_path_within_the_goal_tolerance_only_checks_the_goal() {
    for (yaw_rad, pivots) in [(0.1, false), (2.0, true)] {
        for count in [1, 3] {
            let mut world = World::with(PivotSettings {
                at_start: false,
                at_goal: true,
            });
            // It takes the place of a path that is driven, as from a planner that plans again.
            world.driving();
            let pose = PlanarPose {
                yaw_rad: ALONG_X + yaw_rad,
                ..PlanarPose::default()
            };
            let client = world.begin(RequestedPath {
                frame: "map".to_owned(),
                poses: vec![pose; count],
                ..RequestedPath::default()
            });
            world.look();
            world.cycle();
            assert_eq!(world.state, SafetyState::Stopping);
            world.cycles(10);
            if pivots {
                assert_eq!(world.state, SafetyState::Driving);
                world.end_pivot();
                world.cycles(3);
            }
            world.assert_finished(client, GoalEnd::Succeeded, code::NONE);
        }
    }
}

fn place(x_m: f64, yaw_rad: f64) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad);
    Isometry3::from_parts(Translation3::new(x_m, 0.0, 0.0), rotation)
}

#[test]
fn a_path_moves_with_its_frame() {
    let mut world = World::new();
    world.transforms = Transforms::default();
    let (now_s, frame) = (world.now_s, place(3.0, 0.5));
    world
        .transforms
        .take("odom", "map", (now_s, now_s), frame, false);
    world.x_m = 3.0;
    world.follow();
    world.cycles(5);
    let end = world.trajectory.as_ref().unwrap().at(1e3);
    let (sin, cos) = 0.5_f64.sin_cos();
    assert!(
        (end.position.x_m - (3.0 + 10.0 * cos)).abs() < 1e-3,
        "{end:?}"
    );
    assert!((end.position.y_m - 10.0 * sin).abs() < 1e-3, "{end:?}");
    assert!(wrap_angle(end.heading_rad - ALONG_X - 0.5).abs() < 1e-3);
    // The frame moves while the controller has no progress yet: the move is kept until it has.
    let before = world.reference;
    let (now_s, frame) = (world.now_s, place(3.2, 0.5));
    world
        .transforms
        .take("odom", "map", (now_s, now_s), frame, false);
    world.cycles(5);
    assert_eq!(world.reference, before);
    world.has_progress = true;
    world.cycle();
    assert!(world.reference > before);
    let moved = world.trajectory.as_ref().unwrap().at(1e3);
    assert!((moved.position.x_m - end.position.x_m - 0.2).abs() < 1e-9);
    assert_eq!(world.state, SafetyState::Driving);
    let after = world.reference;
    world.cycles(3);
    assert_eq!(world.reference, after, "it has not moved since");
}

#[test]
fn a_missing_frame_is_waited_for_and_then_refused() {
    let mut world = World::new();
    world.transforms = Transforms::default();
    let client = world.begin(path());
    world.cycles(15);
    assert!(world.finished.is_empty());
    world.cycles(10);
    world.assert_finished(client, GoalEnd::Aborted, code::TF_ERROR);
    assert_eq!(world.armed, 0);
}

#[test]
fn a_path_waits_for_an_unknown_emergency_stop() {
    let mut world = World::new();
    world.estop_unknown = true;
    world.begin(path());
    world.cycles(100);
    assert_eq!((world.reference, world.armed), (0, 0));
    world.estop_unknown = false;
    world.build();
    world.cycles(5);
    assert_eq!(world.state, SafetyState::Driving);
}

#[test]
fn a_refused_path_ends_the_one_before_too() {
    let mut world = World::new();
    let first = world.driving();
    let refusal = Err(Outcome::invalid_path("the path has no poses"));
    world.handler.begin(PathSource::None, refusal, world.now_s);
    world.look();
    world.cycles(5);
    world.assert_finished(first, GoalEnd::Aborted, code::UNKNOWN);
    world.assert_finished(PathSource::None, GoalEnd::Aborted, code::INVALID_PATH);
    assert_eq!(world.state, SafetyState::Latched);
}

#[test]
fn a_path_that_leaves_the_geofence_is_refused_with_the_place() {
    let mut world = World::new();
    let corners = vec![[-1.0, -1.0], [5.0, -1.0], [5.0, 1.0], [-1.0, 1.0]];
    let geofence = sidehill_bridge::safety::Geofence::try_from(corners).unwrap();
    world.handler.settings.geofence = Some(geofence);
    let client = world.begin(path());
    // The route is built in real time, within 20 s of the simulated.
    for _ in 0..400 {
        if world.finished.is_empty() {
            world.cycle();
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    world.assert_finished(client, GoalEnd::Aborted, code::INVALID_PATH);
    let (_, _, outcome) = &world.finished[0];
    assert!(
        outcome.message.contains("leaves the geofence at x = 5.0"),
        "{}",
        outcome.message
    );
    assert_eq!(world.state, SafetyState::Disarmed);
}

fn limit(percentage: bool, speed_limit: f64) -> SpeedLimit {
    SpeedLimit {
        percentage,
        speed_limit,
        ..SpeedLimit::default()
    }
}

fn fastest_m_s(world: &World) -> f64 {
    let trajectory = world.trajectory.as_ref().unwrap();
    let times = (0..1000).map(|i| 0.1 * f64::from(i));
    times.fold(0.0_f64, |max, s| max.max(trajectory.at(s).speed_m_s))
}

#[test]
fn a_speed_limit_holds_for_the_path_in_hand_and_those_after_it() {
    let mut world = World::new();
    world.handler.limit_speed(limit(true, 50.0));
    world.driving();
    world.has_progress = true;
    assert!((fastest_m_s(&world) - 0.25).abs() < 1e-6);
    for (new, expected_m_s) in [
        (limit(false, 0.1), 0.1),
        (limit(false, f64::NAN), 0.1),
        (limit(false, -1.0), 0.1),
        (limit(false, 9.0), 0.5),
        (limit(true, 40.0), 0.2),
        (limit(false, 0.0), 0.5),
    ] {
        world.handler.limit_speed(new);
        world.cycle();
        assert!((fastest_m_s(&world) - expected_m_s).abs() < 1e-6);
    }
    world.handler.set_desired_speed(0.3);
    world.cycle();
    assert!((fastest_m_s(&world) - 0.3).abs() < 1e-6);
    assert_eq!(world.state, SafetyState::Driving, "it is armed once");
}

#[test]
fn a_speed_limit_that_arrives_while_the_route_is_built_holds() {
    let mut world = World::new();
    world.begin(path());
    world.look();
    world.handler.limit_speed(limit(false, 0.2));
    world.build();
    assert!((fastest_m_s(&world) - 0.2).abs() < 1e-6);
}

#[test]
fn a_speed_limit_while_arming_does_not_arm_twice() {
    let mut world = World::new();
    world.has_progress = true;
    world.follow();
    world.handler.limit_speed(limit(false, 0.2));
    world.cycles(20);
    // Armed under the number that was requested, driven under a newer one.
    assert_eq!(world.state, SafetyState::Driving);
    assert!(world.reference > world.armed);
    world.cycles(150);
    assert_eq!(world.state, SafetyState::Driving);
}

#[test]
fn feedback_is_that_of_the_own_route() {
    let mut world = World::new();
    world.driving();
    let mut own = decision(1.0, 0.0, ALONG_X);
    own.command_effective.traction_m_s = 0.4;
    own.progress = Some(Progress {
        point: world.trajectory.as_ref().unwrap().at(0.0),
        arc_length_m: 4.0,
        cross_track_m: 0.0,
        ended: false,
    });
    assert_eq!(world.handler.feedback(&own), None, "of another reference");
    own.reference = world.reference;
    let (distance_m, speed_m_s) = world.handler.feedback(&own).unwrap();
    assert!((distance_m - 6.0).abs() < 1e-3, "{distance_m}");
    assert_eq!(speed_m_s, 0.4);
}
