//! Whatever goes wrong ends as `Status` and `StopReason` say, with the vehicle standing.

use crate::rig::{CIRCLE, KINDS, Rig, STOPPING_CYCLES, Setup, course, driving};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{Controller, ControllerError, Decision, Status, StopReason};
use sidehill_controller::estimator::Refused;
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::{EncoderScale, MeasuredTreadSpeeds, MotorSpeeds, TreadSpeeds};
use sidehill_plant::vehicle::Vehicle;
use std::f64::consts::PI;

/// Asserts that a stopping vehicle comes to stand and stays so with all in order again, until it is
/// re-armed; then it drives.
pub fn assert_stays_stopped(rig: &mut Rig, reason: impl Fn(&StopReason) -> bool) {
    let is_expected =
        |decision: &Decision| matches!(decision.status, Status::Stopping(found) if reason(&found));
    let (_, decision) = rig.until_standing(STOPPING_CYCLES);
    assert!(is_expected(&decision), "{:?}", decision.status);
    let stands_at = rig.simulation.state().pose;
    for _ in 0..100 {
        let decision = rig.cycle();
        assert!(is_expected(&decision), "{:?}", decision.status);
        assert_eq!(decision.command_effective, MotorSpeeds::STOP);
    }
    assert_eq!(rig.simulation.state().pose, stands_at);
    rig.controller.rearm();
    for _ in 0..20 {
        assert_eq!(rig.cycle().status, Status::Tracking);
    }
    assert!(rig.command.traction_m_s > 0.1);
}

#[test]
fn nothing_moves_before_an_attitude_and_a_pose() {
    let losses: [fn(&mut Sample); 2] =
        [|sample| sample.pose = None, |sample| sample.attitude = None];
    for kind in ControllerKind::ALL {
        for lose in losses {
            let mut rig = Setup {
                kind,
                ..Setup::new(course(CIRCLE))
            }
            .build();
            for _ in 0..20 {
                let decision = rig.cycle_with(None, lose);
                assert_eq!(decision.status, Status::Waiting);
                assert_eq!(decision.command_effective, MotorSpeeds::STOP);
                assert_eq!(decision.estimate, None);
            }
            let decision = rig.cycle();
            assert_eq!(decision.status, Status::Tracking, "{kind:?}");
            assert!(decision.estimate.is_some() && decision.progress.is_some());
        }
    }
}

#[test]
fn readings_lost_for_a_moment_are_driven_over() {
    for kind in KINDS {
        let mut rig = driving(kind);
        for lose in [
            (|sample: &mut Sample| sample.pose = None) as fn(&mut Sample),
            |sample| sample.attitude = None,
            |sample| sample.tread_speeds = None,
        ] {
            for _ in 0..5 {
                assert_eq!(rig.cycle_with(None, lose).status, Status::Tracking);
            }
            assert_eq!(rig.cycle().status, Status::Tracking);
        }
    }
}

/// Disturbs every cycle until one does not track; returns how many did, and the decision.
pub fn until_stopping(rig: &mut Rig, disturb: impl Fn(&mut Sample)) -> (u32, Decision) {
    for count in 0..300 {
        let decision = rig.cycle_with(None, &disturb);
        if decision.status != Status::Tracking {
            return (count, decision);
        }
    }
    panic!("still tracking");
}

#[test]
fn stale_readings_stop_for_good() {
    for kind in KINDS {
        let mut rig = driving(kind);
        let (cycles, decision) = until_stopping(&mut rig, |sample| sample.pose = None);
        // It drives on as long as it knows where it is, and no longer than 12 s.
        assert!((60..=241).contains(&cycles), "{cycles}");
        let expected = |reason: &StopReason| match reason {
            StopReason::PoseStale {
                age_s,
                gated: 0,
                late: 0,
            } => *age_s > 11.9,
            StopReason::PoseUncertain { bound_m, .. } => *bound_m > 0.25,
            _ => false,
        };
        assert!(matches!(decision.status, Status::Stopping(r) if expected(&r)));
        assert_stays_stopped(&mut rig, expected);

        let mut rig = driving(kind);
        let (cycles, _) = until_stopping(&mut rig, |sample| sample.attitude = None);
        assert!((5..=6).contains(&cycles), "{cycles}");
        assert_stays_stopped(
            &mut rig,
            |reason| matches!(reason, StopReason::AttitudeStale { age_s } if *age_s > 0.29),
        );

        let mut rig = driving(kind);
        let (cycles, _) = until_stopping(&mut rig, |sample| sample.tread_speeds = None);
        assert!((5..=6).contains(&cycles), "{cycles}");
        assert_stays_stopped(
            &mut rig,
            |reason| matches!(reason, StopReason::SpeedsStale { age_s } if *age_s > 0.29),
        );
    }
}

#[test]
fn a_stop_says_that_poses_come_too_late() {
    for kind in KINDS {
        let mut rig = driving(kind);
        let late_by_2_s = |sample: &mut Sample| {
            if let Some(pose) = &mut sample.pose {
                pose.time_s -= 2.0;
            }
        };
        let (_, decision) = until_stopping(&mut rig, late_by_2_s);
        let Status::Stopping(reason) = decision.status else {
            panic!("{:?}", decision.status);
        };
        let late = match reason {
            StopReason::PoseStale { late, .. } | StopReason::PoseUncertain { late, .. } => late,
            other => panic!("{other}"),
        };
        assert!(late > 10, "{reason}");
        let said = format!("{late} more than 1.5 s late");
        assert!(reason.to_string().contains(&said), "{reason}");
    }
}

#[test]
fn nan_readings_are_named_driven_over_and_in_the_end_stop() {
    for kind in KINDS {
        let mut rig = driving(kind);
        let nan = |sample: &mut Sample| {
            if let Some(pose) = &mut sample.pose {
                pose.value.yaw_rad = f64::NAN;
            }
            if let Some(attitude) = &mut sample.attitude {
                attitude.value.pitch_rad = f64::NAN;
            }
            if let Some(speeds) = &mut sample.tread_speeds {
                speeds.value.left_m_s = f64::NAN;
            }
            sample.yaw_rate = Some(Stamped {
                time_s: sample.time_s,
                value: f64::NAN,
            });
        };
        let decision = rig.cycle_with(None, nan);
        assert_eq!(decision.status, Status::Tracking);
        let all = Refused {
            tread_speeds: true,
            attitude: true,
            yaw_rate: true,
            pose: true,
        };
        assert_eq!(decision.refused, all);
        assert_eq!(rig.cycle().refused, Refused::default());
        let (cycles, _) = until_stopping(&mut rig, nan);
        assert!((5..=6).contains(&cycles), "{cycles}");
        assert_stays_stopped(&mut rig, |r| matches!(r, StopReason::AttitudeStale { .. }));
    }
}

#[test]
fn a_clock_that_does_not_run_on_stops() {
    type Disturb = fn(&mut Sample);
    let jumps: [Disturb; 5] = [
        |sample| sample.time_s -= 1.0,
        |sample| sample.time_s -= 0.05,
        |sample| sample.time_s += 2.0,
        |sample| sample.time_s = f64::NAN,
        |sample| sample.time_s = f64::INFINITY,
    ];
    for kind in KINDS {
        for jump in jumps {
            let mut rig = driving(kind);
            let expected_now = {
                let mut sample = Sample {
                    time_s: rig.simulation.state().time_s,
                    tread_speeds: None,
                    attitude: None,
                    yaw_rate: None,
                    pose: None,
                };
                jump(&mut sample);
                sample.time_s
            };
            let decision = rig.cycle_with(None, jump);
            let expected = |reason: &StopReason| {
                matches!(
                    reason,
                    StopReason::ClockJump { before_s, now_s }
                        if (before_s - 1.95).abs() < 1e-9
                            && now_s.to_bits() == expected_now.to_bits()
                )
            };
            assert!(
                matches!(decision.status, Status::Stopping(r) if expected(&r)),
                "{:?}",
                decision.status
            );
            assert_stays_stopped(&mut rig, expected);
        }
    }
}

#[test]
fn poses_after_a_clock_that_was_put_back_are_believed_and_those_while_it_stands_are_not() {
    for (back_s, believed) in [(1.0, true), (0.0, false)] {
        let mut rig = driving(ControllerKind::IcrikMpc);
        let before = rig.cycle().estimate.unwrap();
        let decision = rig.cycle_with(None, |sample| {
            let time_s = before.time_s - back_s;
            sample.time_s = time_s;
            if let (Some(pose), Some(attitude)) = (&mut sample.pose, &mut sample.attitude) {
                (pose.time_s, attitude.time_s) = (time_s, time_s);
                pose.value.x_m += 5.0;
            }
        });
        let moved_m = decision.estimate.unwrap().pose.x_m - before.pose.x_m;
        assert_eq!(moved_m > 4.5, believed, "{moved_m}");
    }
}

#[test]
fn the_drives_are_commanded_in_what_their_own_encoders_count() {
    let mut rig = driving(ControllerKind::IcrikMpc);
    let decision = rig.cycle();
    let mut vehicle = Vehicle::j8();
    vehicle.encoder_scale = EncoderScale {
        left: 0.8,
        right: 1.25,
    };
    let sent = MeasuredTreadSpeeds::from(decision.command_for_drives(&vehicle));
    let wanted = TreadSpeeds::from(decision.command_effective);
    assert!(wanted.left_m_s > 0.1);
    assert!((0.8 * sent.left_m_s - wanted.left_m_s).abs() < 1e-12);
    assert!((1.25 * sent.right_m_s - wanted.right_m_s).abs() < 1e-12);
}

#[test]
fn a_path_behind_the_vehicle_is_not_turned_to() {
    for kind in ControllerKind::ALL {
        let mut setup = Setup {
            kind,
            ..Setup::new(course(CIRCLE))
        };
        setup.start.yaw_rad += PI - 0.2;
        let mut rig = setup.build();
        for _ in 0..50 {
            let decision = rig.cycle();
            let Status::Stopping(StopReason::HeadingOff { error_rad }) = decision.status else {
                panic!("{:?}", decision.status);
            };
            assert!((error_rad - (PI - 0.2)).abs() < 1e-6);
            assert_eq!(decision.command_effective, MotorSpeeds::STOP);
        }
    }
}

#[test]
fn a_vehicle_off_the_path_stays_where_it_is() {
    for kind in ControllerKind::ALL {
        let mut setup = Setup {
            kind,
            ..Setup::new(course(CIRCLE))
        };
        setup.start.x_m += 2.5;
        let mut rig = setup.build();
        for _ in 0..50 {
            let decision = rig.cycle();
            let Status::Stopping(StopReason::OffPath { cross_track_m }) = decision.status else {
                panic!("{:?}", decision.status);
            };
            assert!((cross_track_m + 2.5).abs() < 0.01, "{cross_track_m}");
            assert_eq!(decision.command_effective, MotorSpeeds::STOP);
        }
    }
}

#[test]
fn settings_out_of_range_make_no_controller() {
    let mut setup = Setup::new(course(CIRCLE));
    setup.config.supervisor.pose_timeout_s = f64::NAN;
    let failure = Controller::new(setup.kind, setup.config, &Vehicle::j8());
    let Err(ControllerError::Range(error)) = failure.map(|_| ()) else {
        panic!("accepted");
    };
    assert_eq!(error.key, "supervisor.pose_timeout_s");
}
