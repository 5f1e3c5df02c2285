//! How sessions end.

use super::*;

#[test]
fn a_path_succeeds_within_the_tolerances() {
    for (x_m, end, code) in [
        (9.9, GoalEnd::Succeeded, code::NONE),
        (9.0, GoalEnd::Aborted, code::NO_VALID_CONTROL),
    ] {
        let mut world = World::new();
        let client = world.driving();
        world.x_m = x_m;
        world.cycle();
        world.finish();
        world.assert_finished(client, end, code);
        // Nothing is requested any more.
        world.cycles(3);
        assert_eq!((world.arm, world.stop, world.reference), (0, None, 0));
        assert_eq!(world.handler.goal(), None);
    }
}

#[test]
fn a_newer_path_takes_over_without_a_stop() {
    let mut world = World::new();
    let first = world.driving();
    let armed = world.armed;
    let second = world.follow();
    world.assert_finished(first, GoalEnd::Aborted, code::UNKNOWN);
    world.cycles(20);
    let expected = (SafetyState::Driving, armed, None);
    assert_eq!((world.state, world.armed, world.stop), expected);
    world.x_m = 10.0;
    world.cycle();
    world.finish();
    world.assert_finished(second, GoalEnd::Succeeded, code::NONE);
}

#[test]
fn a_path_that_arrives_as_the_one_before_ends_is_armed_for_again() {
    let mut world = World::new();
    world.driving();
    let first = world.reference;
    world
        .handler
        .begin(PathSource::None, Ok(path()), world.now_s);
    world.build();
    let second = std::mem::replace(&mut world.reference, first);
    // The controller finishes the old path before it has the new one.
    world.end_by(Reason::Finished);
    world.cycle();
    world.reference = second;
    world.cycles(5);
    assert_eq!(world.state, SafetyState::Driving);
    assert_eq!(world.armed, second);
}

#[test]
fn a_cancelled_goal_ends_when_the_vehicle_has_stopped() {
    let mut world = World::new();
    let client = world.driving();
    world.cancel(client);
    world.look();
    assert_eq!(world.stop, Some(StopCause::Cancelled));
    assert!(world.finished.is_empty());
    world.cycle();
    assert_eq!(world.state, SafetyState::Stopping);
    assert!(world.finished.is_empty());
    world.cycles(2);
    world.assert_finished(client, GoalEnd::Canceled, code::NONE);
    assert_eq!(world.stop, None);
    let cause = StopCause::Cancelled;
    assert_eq!(world.stopped_by, Some(Reason::Requested(cause)));
    // A path after it drives.
    world.driving();
}

#[test]
fn a_cancel_before_the_drives_are_armed_does_not_arm_them() {
    let mut world = World::new();
    let client = world.follow();
    world.cancel(client);
    world.look();
    // Only a cycle after the end can have seen the stop: the loop may have armed meanwhile.
    assert!(world.stop.is_some() && world.finished.is_empty());
    world.cycles(20);
    assert_eq!((world.armed, world.state), (0, SafetyState::Disarmed));
    world.assert_finished(client, GoalEnd::Canceled, code::NONE);
}

#[test]
fn newer_paths_do_not_hide_that_there_is_no_progress() {
    for (step_m, drives) in [(0.0, false), (0.6, true)] {
        let mut world = World::new();
        let mut client = world.driving();
        // A planner that plans every 4 s.
        for _ in 0..3 {
            world.x_m += step_m;
            client = world.follow();
            world.cycles(80);
        }
        assert_eq!(world.state == SafetyState::Driving, drives);
        if !drives {
            world.assert_finished(client, GoalEnd::Aborted, code::FAILED_TO_MAKE_PROGRESS);
            // A path after it has its own time.
            world.driving();
            world.cycles(80);
            assert_eq!(world.state, SafetyState::Driving);
        }
    }
}

#[test]
fn every_fault_ends_with_its_code() {
    type Disturb = fn(&mut World);
    const WHY: StopReason = StopReason::OffPath { cross_track_m: 3.0 };
    let requested = Reason::Requested;
    let faults: [(Disturb, u16, Reason); 12] = [
        (
            |world| world.estop_incompatible = Some("/emergency_stop: published as Int32"),
            code::UNKNOWN,
            requested(StopCause::EmergencyStopIncompatible),
        ),
        (
            |world| world.estop_unknown = true,
            code::UNKNOWN,
            requested(StopCause::EmergencyStopUnheard),
        ),
        (
            |world| world.emergency_stop = Some(StopCause::EmergencyStop),
            code::UNKNOWN,
            requested(StopCause::EmergencyStop),
        ),
        (
            |world| world.emergency_stop = Some(StopCause::EmergencyStopSilent),
            code::UNKNOWN,
            requested(StopCause::EmergencyStopSilent),
        ),
        (
            |world| world.clock_jumped = true,
            code::TF_ERROR,
            requested(StopCause::ClockJumped),
        ),
        (
            |world| world.handler.clients_left(|client| *client == CLIENT),
            code::UNKNOWN,
            requested(StopCause::ClientLeft),
        ),
        (
            |world| world.transforms = Transforms::default(),
            code::TF_ERROR,
            requested(StopCause::FrameLost),
        ),
        (
            |world| {
                world.status = Status::Fallback {
                    reason: QpFailure::Infeasible,
                    cycles: 1,
                };
            },
            code::PATIENCE_EXCEEDED,
            requested(StopCause::NoPlan),
        ),
        (
            |_| {},
            code::FAILED_TO_MAKE_PROGRESS,
            requested(StopCause::NoProgress),
        ),
        (
            |world| world.end_by(Reason::CommandTimeout { age_s: 0.2 }),
            code::CONTROLLER_TIMED_OUT,
            Reason::CommandTimeout { age_s: 0.2 },
        ),
        (
            |world| world.end_by(Reason::FeedbackTimeout { age_s: 0.3 }),
            code::TF_ERROR,
            Reason::FeedbackTimeout { age_s: 0.3 },
        ),
        (
            |world| {
                world.end_by(Reason::ControllerStopped { why: WHY });
                world.status = Status::Stopping(WHY);
            },
            code::NO_VALID_CONTROL,
            Reason::ControllerStopped { why: WHY },
        ),
    ];
    for (disturb, code, reason) in faults {
        let mut world = World::new();
        let client = world.driving();
        disturb(&mut world);
        world.cycles(220);
        assert_eq!(world.state, SafetyState::Latched, "{reason}");
        assert_eq!(world.stopped_by, Some(reason));
        world.assert_finished(client, GoalEnd::Aborted, code);
        assert_eq!(world.arm, 0, "{reason}: arms nothing");
    }
}

#[test]
fn another_client_that_leaves_ends_nothing() {
    let mut world = World::new();
    world.driving();
    world.handler.clients_left(|client| *client != CLIENT);
    world.cycles(3);
    assert_eq!(world.state, SafetyState::Driving);
}

#[test]
fn nothing_is_armed_under_an_emergency_stop() {
    let mut world = World::new();
    world.emergency_stop = Some(StopCause::EmergencyStop);
    let client = world.begin(path());
    world.cycles(20);
    assert_eq!((world.armed, world.state), (0, SafetyState::Disarmed));
    world.assert_finished(client, GoalEnd::Aborted, code::UNKNOWN);
}

#[test]
fn a_drive_without_a_session_is_stopped() {
    let mut world = World::new();
    world.state = SafetyState::Driving;
    world.cycles(3);
    assert_eq!(world.state, SafetyState::Latched);
    let cause = StopCause::NobodyAsked;
    assert_eq!(world.stopped_by, Some(Reason::Requested(cause)));
    world.cycles(2);
    assert_eq!(world.stop, None);
}

const AT_GOAL: PivotSettings = PivotSettings {
    at_start: false,
    at_goal: true,
};

#[test]
fn a_goal_with_another_heading_ends_with_a_pivot_where_that_is_enabled() {
    for pivots in [AT_GOAL, PivotSettings::default()] {
        let mut world = World::with(pivots);
        let client = world.begin(path_to(ALONG_X + 2.0));
        world.build();
        world.cycles(10);
        let armed = world.armed;
        world.x_m = 9.9;
        world.cycle();
        world.finish();
        if !pivots.at_goal {
            world.assert_finished(client, GoalEnd::Aborted, code::NO_VALID_CONTROL);
            continue;
        }
        assert!(world.finished.is_empty(), "it is armed for the pivot");
        world.cycles(5);
        assert_eq!(world.state, SafetyState::Driving);
        assert!(world.armed > armed);
        // A pivot takes its time and makes no progress.
        world.cycles(250);
        assert_eq!(world.state, SafetyState::Driving);
        world.end_pivot();
        world.cycles(3);
        world.assert_finished(client, GoalEnd::Succeeded, code::NONE);
        assert!(wrap_angle(world.yaw_rad - ALONG_X - 2.0).abs() < 1e-6);
    }
}

#[test]
fn a_goal_that_a_pivot_misses_is_aborted() {
    let mut world = World::with(AT_GOAL);
    let client = world.begin(path_to(ALONG_X + 2.0));
    world.build();
    world.cycles(10);
    world.x_m = 9.9;
    world.cycle();
    world.finish();
    world.cycles(5);
    world.finish();
    world.assert_finished(client, GoalEnd::Aborted, code::NO_VALID_CONTROL);
}

#[test]
fn a_pivot_that_slides_off_the_goal_is_not_begun() {
    for (slope_deg, angle_rad, pivots) in [(3.0, 3.0, true), (12.0, 3.0, false), (12.0, 1.0, true)]
    {
        let mut world = World::with(AT_GOAL);
        world.attitude = Attitude::from_slope(f64::to_radians(slope_deg), 0.0);
        let client = world.begin(path_to(ALONG_X + angle_rad));
        world.build();
        world.cycles(10);
        world.x_m = 10.0;
        world.cycle();
        world.finish();
        world.cycles(5);
        assert_eq!(world.state == SafetyState::Driving, pivots, "{slope_deg}");
        if !pivots {
            world.assert_finished(client, GoalEnd::Aborted, code::NO_VALID_CONTROL);
            let message = &world.finished[0].2.message;
            assert!(message.contains("a pivot would slide 0.40 m"), "{message}");
        }
    }
}
