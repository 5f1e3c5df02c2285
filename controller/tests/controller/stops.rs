//! Stops: missed deadlines, stops on request, re-arming, and no path.

use crate::rig::{CIRCLE, KINDS, Rig, STOPPING_CYCLES, Setup, course, driving};
use crate::supervision::{assert_stays_stopped, until_stopping};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{Status, StopReason};
use sidehill_controller::mpc::QpFailure;
use sidehill_controller::reference::Reference;
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;
use std::time::Instant;

#[test]
fn missed_deadlines_drive_on_the_shifted_plan_then_stop() {
    let mut rig = driving(ControllerKind::IcrikMpc);
    let deadline = QpFailure::Deadline { iterations: 0 };
    for cycles in 1..=10 {
        let plan = rig.controller.plan().unwrap().inputs.clone();
        let decision = rig.cycle_with(Some(Instant::now()), |_| ());
        let expected = Status::Fallback {
            reason: deadline,
            cycles,
        };
        assert_eq!(decision.status, expected);
        assert_eq!(decision.solve, None);
        // A third of a stage later on the plan.
        let blend = |now: f64, next: f64| (2.0 * now + next) / 3.0;
        let traction = blend(plan[0].traction_m_s, plan[1].traction_m_s);
        let steer = blend(plan[0].steer_m_s, plan[1].steer_m_s);
        assert!((decision.command_effective.traction_m_s - traction).abs() < 1e-9);
        assert!((decision.command_effective.steer_m_s - steer).abs() < 1e-9);
    }
    assert!(rig.command.traction_m_s > 0.3);
    let decision = rig.cycle_with(Some(Instant::now()), |_| ());
    let reason = StopReason::NoSolution {
        cycles: 11,
        reason: deadline,
    };
    assert_eq!(decision.status, Status::Stopping(reason));
    assert_stays_stopped(&mut rig, |found| *found == reason);
}

#[test]
fn a_solved_cycle_ends_a_row_of_fallbacks() {
    let mut rig = driving(ControllerKind::IcrikMpc);
    for _ in 0..5 {
        for cycles in 1..=9 {
            let decision = rig.cycle_with(Some(Instant::now()), |_| ());
            assert!(
                matches!(decision.status, Status::Fallback { cycles: found, .. } if found == cycles)
            );
        }
        for _ in 0..5 {
            assert_eq!(rig.cycle().status, Status::Tracking);
        }
    }
    let cross_track_m = rig.cycle().progress.unwrap().cross_track_m;
    assert!(cross_track_m.abs() < 0.02, "{cross_track_m}");
}

#[test]
fn a_stop_that_is_asked_for_holds_until_rearmed() {
    for kind in ControllerKind::ALL {
        let mut rig = driving(kind);
        rig.controller.request_stop();
        let before = rig.command;
        let decision = rig.cycle();
        assert_eq!(decision.status, Status::Stopping(StopReason::Requested));
        let slower = before.traction_m_s - 2.0 * 0.05;
        assert!((decision.command_effective.traction_m_s - slower).abs() < 1e-9);
        assert_stays_stopped(&mut rig, |reason| *reason == StopReason::Requested);
    }
}

#[test]
fn the_first_reason_to_stop_is_kept() {
    let mut rig = driving(ControllerKind::IcrikMpc);
    until_stopping(&mut rig, |sample| sample.attitude = None);
    rig.controller.request_stop();
    for _ in 0..20 {
        let decision = rig.cycle_with(None, |sample| sample.pose = None);
        assert!(matches!(
            decision.status,
            Status::Stopping(StopReason::AttitudeStale { .. })
        ));
    }
}

#[test]
fn another_path_does_not_move_a_stopped_vehicle() {
    let mut rig = driving(ControllerKind::IcrikMpc);
    rig.controller.request_stop();
    rig.until_standing(STOPPING_CYCLES);
    let pose = rig.cycle().estimate.unwrap().pose;
    let ahead = course("{shape: straight, length_m: 4, heading_deg: 0}").seen_from(&pose);
    rig.follow(1, ahead, 0.0);
    for _ in 0..20 {
        let decision = rig.cycle();
        assert_eq!(decision.status, Status::Stopping(StopReason::Requested));
        assert_eq!(decision.command_effective, MotorSpeeds::STOP);
    }
}

#[test]
fn a_vehicle_that_was_carried_while_it_stood_is_believed_where_it_is() {
    let mut rig = driving(ControllerKind::IcrikMpc);
    rig.controller.request_stop();
    rig.until_standing(STOPPING_CYCLES);
    let carried = |sample: &mut Sample| {
        if let Some(pose) = &mut sample.pose {
            pose.value.x_m += 5.0;
        }
    };
    let before = rig.cycle().estimate.unwrap().pose;
    for _ in 0..20 {
        rig.cycle_with(None, carried);
    }
    let estimate = rig.cycle_with(None, carried).estimate.unwrap();
    assert!((estimate.pose.x_m - before.x_m - 5.0).abs() < 0.1);
    assert!(estimate.pose_age_s < 0.2);
}

#[test]
fn without_a_path_there_is_an_estimate_and_no_progress_and_nothing_moves() {
    for kind in KINDS {
        let mut rig = Setup {
            kind,
            ..Setup::new(course(CIRCLE))
        }
        .build();
        rig.controller.forget_path();
        for _ in 0..20 {
            let decision = rig.cycle();
            assert!(decision.estimate.is_some() && decision.progress.is_none());
            assert_eq!(decision.status, Status::Stopping(StopReason::NoPath));
            assert_eq!(decision.command_effective, MotorSpeeds::STOP);
        }
        // One that comes is driven where the controller is let.
        let pose = rig.cycle().estimate.unwrap().pose;
        let ahead = course("{shape: straight, length_m: 4, heading_deg: 0}").seen_from(&pose);
        rig.follow(1, ahead, 0.0);
        assert!(matches!(rig.cycle().status, Status::Stopping(_)));
        rig.controller.rearm();
        let decision = (0..5).map(|_| rig.cycle()).last().unwrap();
        assert_eq!((decision.status, decision.reference), (Status::Tracking, 1));
        assert!(decision.progress.unwrap().cross_track_m.abs() < 0.02);
        // One that is taken away while it is driven stops the vehicle.
        for _ in 0..20 {
            rig.cycle();
        }
        assert!(rig.command.traction_m_s > 0.1);
        rig.controller.forget_path();
        let decision = rig.cycle();
        assert_eq!(decision.status, Status::Stopping(StopReason::NoPath));
        assert_eq!((decision.progress, decision.reference), (None, 0));
        rig.until_standing(STOPPING_CYCLES);
    }
}

/// A recording whose first files were deleted is replayed from an arming on.
#[test]
fn after_rearming_nothing_depends_on_what_was_driven_before() {
    for kind in ControllerKind::ALL {
        let mut rig = driving(kind);
        let mut other = Setup {
            kind,
            ..Setup::new(course(CIRCLE))
        }
        .build()
        .controller;
        let step = |rig: &mut Rig| {
            let mut sample = None;
            let decision = rig.cycle_with(None, |taken| sample = Some(*taken));
            (sample.unwrap(), decision)
        };
        rig.controller.request_stop();
        for _ in 0..15 {
            step(&mut rig);
        }
        other.request_stop();
        // Commands of the last second count.
        let mut pose = None;
        for _ in 0..25 {
            let (sample, decision) = step(&mut rig);
            other.step(&sample, None);
            pose = decision.estimate.map(|estimate| estimate.pose);
        }
        let ahead =
            course("{shape: circle, radius_m: 3, speed_m_s: 0.4}").seen_from(&pose.unwrap());
        rig.follow(1, ahead.clone(), 0.0);
        let reference = Reference::new(ahead);
        other.follow(reference.numbered(1));
        rig.controller.rearm();
        other.rearm();
        for cycle in 0..20 {
            let (sample, decision) = step(&mut rig);
            let same = other.step(&sample, None);
            assert_eq!(decision.status, Status::Tracking, "{kind:?} {cycle}");
            assert_eq!(
                (
                    decision.command_effective,
                    decision.estimate.map(|at| at.pose)
                ),
                (same.command_effective, same.estimate.map(|at| at.pose)),
                "{kind:?} {cycle}"
            );
        }
    }
}
