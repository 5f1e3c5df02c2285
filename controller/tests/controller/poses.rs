//! Poses that do not fit the prediction: which are believed, when, and what the vehicle does meanwhile; and
//! a vehicle that does not move.

use crate::rig::{KINDS, Rig, driving};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{Stall, Status, StopReason};
use sidehill_plant::sample::Sample;

/// Cycles a second of the rig.
const CYCLES_PER_S: u32 = 20;

fn rig() -> Rig {
    driving(ControllerKind::IcrikMpc)
}

fn shift(sample: &mut Sample, x_m: f64) {
    if let Some(pose) = &mut sample.pose {
        pose.value.x_m += x_m;
    }
}

/// Returns the reason for which the vehicle is stopped, and after how many cycles, with samples that are
/// disturbed by `disturb`, which knows the cycle.
fn stop_within(
    rig: &mut Rig,
    cycles: u32,
    mut disturb: impl FnMut(u32, &mut Sample),
) -> Option<(u32, StopReason)> {
    (0..cycles).find_map(|cycle| {
        let decision = rig.cycle_with(None, |sample| disturb(cycle, sample));
        match decision.status {
            Status::Stopping(reason) => Some((cycle, reason)),
            _ => None,
        }
    })
}

fn cross_track_m(rig: &mut Rig) -> f64 {
    rig.cycle().progress.unwrap().cross_track_m.abs()
}

#[test]
fn single_outliers_are_driven_over_without_slowing_down() {
    let mut rig = rig();
    let before = rig.command.traction_m_s;
    for cycle in 0..20 * CYCLES_PER_S {
        let decision = rig.cycle_with(None, |sample| {
            if cycle % 7 == 0 {
                shift(sample, if cycle % 2 == 0 { 1.0 } else { -2.0 });
            }
        });
        assert_eq!(decision.status, Status::Tracking);
        assert!(rig.command.traction_m_s > 0.9 * before, "{cycle}");
    }
    assert!(cross_track_m(&mut rig) < 0.05);
}

#[test]
fn poses_that_jump_for_half_a_second_slow_the_vehicle_down_and_are_not_followed() {
    let mut rig = rig();
    let before = rig.command.traction_m_s;
    let half_a_second = CYCLES_PER_S / 2;
    assert_eq!(
        stop_within(&mut rig, half_a_second, |_, sample| shift(sample, 1.0)),
        None
    );
    assert!(
        rig.command.traction_m_s < 0.7 * before,
        "{}",
        rig.command.traction_m_s
    );
    assert!(cross_track_m(&mut rig) < 0.05);
    assert_eq!(stop_within(&mut rig, 5 * CYCLES_PER_S, |_, _| ()), None);
    assert!(rig.command.traction_m_s > 0.8 * before);
    assert!(cross_track_m(&mut rig) < 0.05);
}

#[test]
fn poses_that_stay_elsewhere_are_believed_after_a_second() {
    let mut rig = rig();
    let mut far_after = None;
    for cycle in 0..3 * CYCLES_PER_S {
        let decision = rig.cycle_with(None, |sample| shift(sample, 0.8));
        assert_eq!(decision.status, Status::Tracking);
        let off_m = decision.estimate.unwrap().pose.x_m - rig.simulation.state().pose.x_m;
        if off_m > 0.4 && far_after.is_none() {
            far_after = Some(cycle);
        }
    }
    // A second after the first of them, and a cycle for rounding.
    let believed = far_after.unwrap();
    assert!(
        (CYCLES_PER_S - 1..=CYCLES_PER_S + 1).contains(&believed),
        "{believed}"
    );
}

#[test]
fn a_vehicle_carried_away_from_its_path_is_stopped_there() {
    let mut rig = rig();
    let stopped = stop_within(&mut rig, 2 * CYCLES_PER_S, |_, sample| shift(sample, 6.0));
    let Some((_, StopReason::OffPath { cross_track_m })) = stopped else {
        panic!("{stopped:?}");
    };
    assert!(cross_track_m.abs() > 2.0);
}

#[test]
fn poses_that_contradict_each_other_stop_the_vehicle() {
    let mut rig = rig();
    let stopped = stop_within(&mut rig, CYCLES_PER_S, |cycle, sample| {
        shift(sample, if cycle % 2 == 0 { 1.0 } else { -1.0 });
    });
    let Some((cycle, StopReason::PoseStale { gated, .. })) = stopped else {
        panic!("{stopped:?}");
    };
    assert!((9..=11).contains(&cycle), "{cycle}");
    assert_eq!(gated, cycle + 1);
}

#[test]
fn treads_that_slip_by_a_third_do_not_end_the_drive() {
    for kind in ControllerKind::ALL {
        let mut rig = driving(kind);
        let stopped = stop_within(&mut rig, 30 * CYCLES_PER_S, |_, sample| {
            if let Some(speeds) = &mut sample.tread_speeds {
                speeds.value.left_m_s /= 0.7;
                speeds.value.right_m_s /= 0.7;
            }
        });
        assert_eq!(stopped, None, "{kind:?}");
    }
}

/// Returns why a vehicle is stopped within 2 s whose pose stays where it is while its treads turn, but for noise.
fn stopped_where_it_stands(kind: ControllerKind, noise_m: f64) -> StopReason {
    let mut rig = driving(kind);
    let mut held = None;
    let stopped = stop_within(&mut rig, 2 * CYCLES_PER_S, |cycle, sample| {
        if let Some(pose) = &mut sample.pose {
            pose.value = *held.get_or_insert(pose.value);
        }
        shift(sample, noise_m * f64::from(cycle % 3));
    });
    stopped.unwrap().1
}

#[test]
fn treads_that_turn_while_the_pose_stands_are_stopped_within_two_seconds() {
    for kind in ControllerKind::ALL {
        let reason = stopped_where_it_stands(kind, 1e-3);
        let StopReason::Stalled { stall, .. } = reason else {
            panic!("{kind:?} {reason:?}");
        };
        assert_eq!(stall, Stall::Treads);
    }
}

#[test]
fn a_pose_that_is_frozen_to_the_bit_is_not_taken_for_digging() {
    for kind in ControllerKind::ALL {
        let reason = stopped_where_it_stands(kind, 0.0);
        let frozen = matches!(reason, StopReason::PoseFrozen { .. });
        assert!(frozen, "{kind:?} {reason:?}");
    }
}

#[test]
fn a_vehicle_whose_motors_do_not_turn_is_stopped_after_the_time_of_a_stall() {
    for kind in KINDS {
        let mut rig = driving(kind);
        let time_s = rig.controller.config().supervisor.stall_time_s;
        let mut held = None;
        let stopped = stop_within(&mut rig, 10 * CYCLES_PER_S, |_, sample| {
            if let (Some(pose), Some(speeds)) = (&mut sample.pose, &mut sample.tread_speeds) {
                pose.value = *held.get_or_insert(pose.value);
                (speeds.value.left_m_s, speeds.value.right_m_s) = (0.0, 0.0);
            }
        });
        let Some((
            cycle,
            StopReason::Stalled {
                stall,
                time_s: of_s,
            },
        )) = stopped
        else {
            panic!("{kind:?} {stopped:?}");
        };
        assert!(
            stall != Stall::Treads && of_s == time_s,
            "{kind:?} {stall:?}"
        );
        // A tenth of the way asked for does not count: the vehicle may have driven so far before.
        let after_s = f64::from(cycle) / f64::from(CYCLES_PER_S);
        assert!(
            (time_s - 0.6..time_s + 1.0).contains(&after_s),
            "{kind:?} {after_s}"
        );
    }
}

/// What shows is where the vehicle goes, so when it is stopped differs from start to start: after 2 to 35 s here.
#[test]
fn a_heading_that_stands_still_while_the_vehicle_turns_ends_in_a_stop() {
    for cycles_before in [0, 5, 10, 20] {
        let mut rig = rig();
        for _ in 0..cycles_before {
            rig.cycle();
        }
        let mut yaw_rad = None;
        let stopped = stop_within(&mut rig, 60 * CYCLES_PER_S, |_, sample| {
            if let Some(pose) = &mut sample.pose {
                pose.value.yaw_rad = *yaw_rad.get_or_insert(pose.value.yaw_rad);
            }
        });
        assert!(
            matches!(
                stopped,
                Some((_, StopReason::Stalled { .. } | StopReason::OffPath { .. }))
            ),
            "{cycles_before}: {stopped:?}"
        );
    }
}
