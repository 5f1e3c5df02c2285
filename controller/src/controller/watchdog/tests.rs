#![allow(clippy::unwrap_used)]

use super::*;
use crate::mpc::limits::MotorLimits;
use crate::path::Point2;
use crate::trajectory::ReferencePoint;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use sidehill_plant::frames::Pose;
use sidehill_plant::sample::Stamped;

/// Returns a cycle's readings with a pose of the time `stamp_s`, so far ahead.
fn reading(time_s: f64, stamp_s: f64, y_m: f64) -> Sample {
    Sample {
        time_s,
        tread_speeds: None,
        attitude: None,
        yaw_rate: None,
        pose: Some(Stamped {
            time_s: stamp_s,
            value: Pose {
                y_m,
                ..Pose::default()
            },
        }),
    }
}

/// Returns after how many seconds treads of these speeds are found to dig within 20 s, where the vehicle is by poses of a
/// standard deviation.
fn digs_after(sigma_m: f64, treads_m_s: [f64; 2], y_m: impl Fn(u32) -> f64) -> Option<f64> {
    let told = EstimatorSettings {
        pose_sigma_m: sigma_m,
        ..EstimatorSettings::default()
    };
    let mut watch = DigWatch::new(&told, 0.6);
    let [left_m_s, right_m_s] = treads_m_s;
    let treads = TreadSpeeds {
        left_m_s,
        right_m_s,
    };
    (0..400).find_map(|cycle| {
        let since_s = 0.05 * f64::from(cycle);
        let time_s = 100.0 + since_s;
        let sample = reading(time_s, time_s, y_m(cycle));
        let stopped = watch.observe(&sample, &treads, 0.05);
        stopped.map(|_| since_s)
    })
}

/// Returns the noise of 400 cycles, in standard deviations.
fn noise() -> Vec<f64> {
    let random = ChaCha8Rng::seed_from_u64(1);
    StandardNormal.sample_iter(random).take(400).collect()
}

#[test]
fn treads_dig_that_leave_the_vehicle_where_it_is_within_the_noise_of_its_poses() {
    for (treads_m_s, after_s) in [
        ([0.2, 0.2], 1.4),
        ([-0.2, -0.2], 1.4),
        ([0.4, 0.0], 1.4),
        ([0.0, 0.4], 1.4),
        ([-0.2, 0.2], 1.4),
        ([0.1, 0.1], 2.5),
    ] {
        let found_s =
            digs_after(0.01, treads_m_s, |cycle| 0.015 * f64::from(cycle % 3).sin()).unwrap();
        assert!(
            (after_s..after_s + 0.16).contains(&found_s),
            "{treads_m_s:?} {found_s}"
        );
    }
    // They hardly turn.
    let still_m = |cycle: u32| 1e-3 * f64::from(cycle % 3);
    assert_eq!(digs_after(0.01, [0.02, 0.02], still_m), None);
    // The vehicle moves by a share of their way.
    for (share, digs) in [(0.05, true), (0.15, false), (0.2, false)] {
        let found = digs_after(0.01, [0.4, 0.4], |cycle| share * 0.02 * f64::from(cycle));
        assert_eq!(found.is_some(), digs, "{share}");
    }
}

#[test]
fn coarse_poses_take_a_longer_way_of_the_treads_and_their_noise_is_no_digging() {
    let noise = noise();
    for sigma_m in [0.02, 0.05, 0.1] {
        let moves = |speed_m_s: f64| {
            digs_after(sigma_m, [0.3, 0.3], |cycle| {
                0.05 * speed_m_s * f64::from(cycle) + sigma_m * noise[cycle as usize]
            })
        };
        assert_eq!(moves(0.25), None, "{sigma_m}");
        let found_s = moves(0.0).unwrap();
        let way_m = 0.3 * found_s;
        assert!(
            (20.0 * sigma_m..30.0 * sigma_m + 0.1).contains(&way_m),
            "{sigma_m}: {way_m}"
        );
    }
}

#[test]
fn coarse_headings_take_a_longer_way_of_the_treads() {
    let told = EstimatorSettings {
        pose_sigma_rad: 0.05,
        ..EstimatorSettings::default()
    };
    let noise = noise();
    // Turns on the spot, with treads of 0.12 m/s.
    let found_s = |yaw_rate_rad_s: f64| {
        let mut watch = DigWatch::new(&told, 0.6);
        (0..400_u32).find_map(|cycle| {
            let time_s = 0.05 * f64::from(cycle);
            let mut sample = reading(time_s, time_s, 1e-3 * noise[399 - cycle as usize]);
            if let Some(pose) = &mut sample.pose {
                pose.value.yaw_rad = yaw_rate_rad_s * time_s + 0.05 * noise[cycle as usize];
            }
            let treads = TreadSpeeds {
                left_m_s: -0.12,
                right_m_s: 0.12,
            };
            watch.observe(&sample, &treads, 0.05).map(|_| time_s)
        })
    };
    assert_eq!(found_s(0.15), None);
    let dug_s = found_s(0.0).unwrap();
    assert!((5.0..7.0).contains(&dug_s), "{dug_s}");
}

#[test]
fn treads_that_were_found_to_dig_have_to_do_so_anew_after_a_new_start() {
    let mut watch = DigWatch::new(&EstimatorSettings::default(), 0.6);
    let treads = TreadSpeeds {
        left_m_s: 0.3,
        right_m_s: 0.3,
    };
    let mut found_s = Vec::new();
    for cycle in 0..90 {
        let time_s = 0.05 * f64::from(cycle);
        let stopped = watch.observe(&reading(time_s, time_s, 0.0), &treads, 0.05);
        if stopped.is_some() {
            found_s.push(time_s);
            watch.reset();
        }
    }
    assert_eq!(found_s.len(), 3, "{found_s:?}");
    assert!(found_s.windows(2).all(|pair| pair[1] - pair[0] > 1.3));
}

/// Drives straight ahead for 4 s, from 1 s on at 1 m/s^2, by poses that are `late_s` old and as exact as `noise_m`;
/// returns why it is stopped where the treads move the vehicle by a share of their way.
fn stopped(late_s: f64, share: f64, noise_m: f64) -> Option<StopReason> {
    let mut watch = DigWatch::new(&EstimatorSettings::default(), 0.6);
    let driven_s = |time_s: f64| (time_s - 1.0).max(0.0);
    (0..80).find_map(|cycle| {
        let time_s = 0.05 * f64::from(cycle);
        let stamp_s = time_s - late_s;
        let noise_m = noise_m * f64::from(cycle % 3);
        let y_m = 0.5 * share * driven_s(stamp_s).powi(2) + noise_m;
        let sample = reading(time_s, stamp_s, y_m);
        let treads = TreadSpeeds {
            left_m_s: driven_s(time_s),
            right_m_s: driven_s(time_s),
        };
        watch.observe(&sample, &treads, 0.05)
    })
}

#[test]
fn late_poses_are_compared_with_the_treads_of_their_instant() {
    for late_s in [0.0, 0.6, 1.2] {
        assert_eq!(stopped(late_s, 1.0, 1e-3), None, "{late_s}");
        let digs = stopped(late_s, 0.0, 1e-3);
        let treads = |reason: &StopReason| matches!(reason, StopReason::Stalled { stall, .. } if *stall == Stall::Treads);
        assert!(digs.is_some_and(|reason| treads(&reason)), "{digs:?}");
    }
}

#[test]
fn poses_that_stay_the_same_to_the_bit_are_frozen_and_no_sign_of_digging() {
    for late_s in [0.0, 0.6, 1.2] {
        let reason = stopped(late_s, 0.0, 0.0);
        let frozen = matches!(reason, Some(StopReason::PoseFrozen { .. }));
        assert!(frozen, "{late_s}: {reason:?}");
    }
}

#[test]
fn poses_that_freeze_on_the_way_are_frozen_at_any_speed() {
    for speed_m_s in [0.05, 0.2, 0.5, 1.0, 2.0] {
        let mut watch = DigWatch::new(&EstimatorSettings::default(), 0.6);
        // They freeze after 3 s.
        let reason = (0..240).find_map(|cycle| {
            let time_s = 0.05 * f64::from(cycle);
            let noise_m = 1e-3 * f64::from(cycle.min(60) % 3);
            let sample = reading(time_s, time_s, speed_m_s * time_s.min(3.0) + noise_m);
            let treads = TreadSpeeds {
                left_m_s: speed_m_s,
                right_m_s: speed_m_s,
            };
            let reason = watch.observe(&sample, &treads, 0.05)?;
            Some((time_s, reason))
        });
        let Some((after_s, StopReason::PoseFrozen { .. })) = reason else {
            panic!("{speed_m_s} m/s: {reason:?}");
        };
        let way_s = 0.25 / speed_m_s;
        assert!(
            after_s - 3.0 < way_s.max(1.4) + 0.2,
            "{speed_m_s}: {after_s}"
        );
    }
}

#[test]
fn a_vehicle_that_has_come_back_between_two_poses_does_not_dig() {
    let mut watch = DigWatch::new(&EstimatorSettings::default(), 0.6);
    // Ahead for 2 s, and back from there; there are poses at the beginning and after 4 s.
    let stopped = (0..=80).find_map(|cycle| {
        let time_s = 0.05 * f64::from(cycle);
        let speed_m_s = if time_s < 2.0 { 0.2 } else { -0.2 };
        let mut sample = reading(time_s, time_s, 0.0);
        sample.pose = sample.pose.filter(|_| cycle % 80 == 0);
        let treads = TreadSpeeds {
            left_m_s: speed_m_s,
            right_m_s: speed_m_s,
        };
        watch.observe(&sample, &treads, 0.05)
    });
    assert_eq!(stopped, None);
}

/// Returns what stalls of a vehicle with both motors at their limits that creeps along a bend, turning at a rate.
fn stall_of_creeping(yaw_rate_rad_s: f64) -> Option<Stall> {
    let motor = MotorLimits {
        speed_m_s: 1.0,
        acceleration_m_s2: 1.0,
        deceleration_m_s2: 1.0,
    };
    let limits = InputLimits {
        traction: motor,
        steer: motor,
        tread_speed_m_s: 2.0,
    };
    let mut watchdog = Watchdog::new(&SupervisorConfig::default(), limits, 0.6, 0.05);
    (0..120).find_map(|cycle| {
        let time_s = 0.05 * f64::from(cycle);
        let creep_m = 0.05 * time_s;
        let progress = Progress {
            point: ReferencePoint {
                time_s,
                arc_length_m: creep_m,
                position: Point2::default(),
                heading_rad: 0.0,
                speed_m_s: 0.5,
                yaw_rate_rad_s: 0.3,
                motion: Motion::Drive,
            },
            arc_length_m: creep_m,
            cross_track_m: 0.0,
            ended: false,
        };
        watchdog.observe(&Observation {
            time_s,
            pose: PlanarPose {
                x_m: 0.0,
                y_m: creep_m,
                yaw_rad: yaw_rate_rad_s * time_s,
            },
            command: MotorSpeeds {
                traction_m_s: 1.0,
                steer_m_s: 0.99,
            },
            progress: &progress,
            allowed_m_s: 0.5,
        })
    })
}

#[test]
fn a_vehicle_that_turns_slowly_as_commanded_at_the_end_of_its_grip_goes_on() {
    let rates_deg_s = [2.4_f64, 1.5, 0.8, 0.0, -2.4];
    let stalls = rates_deg_s.map(|rate| stall_of_creeping(rate.to_radians()).is_some());
    assert_eq!(stalls, [false, false, true, true, true]);
}

/// What a vehicle does from one cycle to the next, and what is asked of it.
#[derive(Clone, Copy)]
struct Moment {
    command: MotorSpeeds,
    speed_m_s: f64,
    yaw_rate_rad_s: f64,
    /// How fast it comes along the path.
    along_m_s: f64,
    asked_m_s: f64,
    allowed_m_s: f64,
    motion: Motion,
    ended: bool,
}

/// A vehicle that stands where little is commanded and nothing asked.
const STANDING: Moment = Moment {
    command: MotorSpeeds {
        traction_m_s: 0.2,
        steer_m_s: -0.1,
    },
    speed_m_s: 0.0,
    yaw_rate_rad_s: 0.0,
    along_m_s: 0.0,
    asked_m_s: 0.0,
    allowed_m_s: 2.0,
    motion: Motion::Drive,
    ended: false,
};

fn commanded(traction_m_s: f64, steer_m_s: f64) -> Moment {
    Moment {
        command: MotorSpeeds {
            traction_m_s,
            steer_m_s,
        },
        ..STANDING
    }
}

/// Limits of the motors.
const TRACTION_M_S: f64 = 0.8;
const STEER_M_S: f64 = 0.6;

/// Returns what stalls of a vehicle that drives along a bend for 6 s and then does what `then` says, and after how long,
/// s. Its treads are 1.2 m apart.
fn stall_of(then: impl Fn(f64) -> Moment) -> Option<(Stall, f64)> {
    stall_after(120, STEER_M_S, then)
}

/// The same after so many cycles, with another limit of steer.
fn stall_after(cycles: i32, steer_m_s: f64, then: impl Fn(f64) -> Moment) -> Option<(Stall, f64)> {
    let motor = |speed_m_s| MotorLimits {
        speed_m_s,
        acceleration_m_s2: 1.0,
        deceleration_m_s2: 1.0,
    };
    let limits = InputLimits {
        traction: motor(TRACTION_M_S),
        steer: motor(steer_m_s),
        tread_speed_m_s: 2.0,
    };
    let mut watchdog = Watchdog::new(&SupervisorConfig::default(), limits, 0.6, 0.05);
    let drives = Moment {
        speed_m_s: 0.5,
        yaw_rate_rad_s: 0.2,
        along_m_s: 0.5,
        asked_m_s: 0.5,
        ..commanded(0.5, 0.12)
    };
    let mut pose = PlanarPose {
        x_m: 3.0,
        y_m: -2.0,
        yaw_rad: -0.5,
    };
    let mut along_m = 4.0;
    (0..cycles + 200).find_map(|cycle| {
        let since_s = 0.05 * f64::from(cycle - cycles);
        let now = if cycle < cycles {
            drives
        } else {
            then(since_s)
        };
        pose.x_m -= 0.05 * now.speed_m_s * pose.yaw_rad.sin();
        pose.y_m += 0.05 * now.speed_m_s * pose.yaw_rad.cos();
        pose.yaw_rad = wrap_angle(pose.yaw_rad + 0.05 * now.yaw_rate_rad_s);
        along_m += 0.05 * now.along_m_s;
        let progress = Progress {
            point: ReferencePoint {
                time_s: since_s,
                arc_length_m: along_m,
                position: Point2::default(),
                heading_rad: 0.0,
                speed_m_s: now.asked_m_s,
                yaw_rate_rad_s: 0.0,
                motion: now.motion,
            },
            arc_length_m: along_m,
            cross_track_m: 0.0,
            ended: now.ended,
        };
        let stall = watchdog.observe(&Observation {
            time_s: 100.0 + since_s,
            pose,
            command: now.command,
            progress: &progress,
            allowed_m_s: now.allowed_m_s,
        });
        stall.map(|stall| (stall, since_s))
    })
}

/// Asserts that what stalls is found once it has lasted for the time of a stall.
fn assert_stalls(expected: Stall, then: impl Fn(f64) -> Moment) {
    let (stall, after_s) = stall_of(then).unwrap();
    assert_eq!(stall, expected);
    let time_s = SupervisorConfig::default().stall_time_s;
    assert!((time_s - 0.5..time_s + 0.1).contains(&after_s), "{after_s}");
}

#[test]
fn a_motor_at_its_limit_that_does_not_move_the_vehicle_stalls_and_one_below_does_not() {
    for sense in [1.0, -1.0] {
        let traction = |share: f64| commanded(sense * share * TRACTION_M_S, 0.1);
        let steer = |share: f64| commanded(0.2, sense * share * STEER_M_S);
        assert_stalls(Stall::Steer, |_| steer(0.97));
        assert_stalls(Stall::Traction, |_| traction(0.97));
        for command in [traction(0.94), steer(0.94)] {
            assert_eq!(stall_of(|_| command), None);
        }
        // From one limit to the other.
        let swings = |time_s: f64| (3.0 - time_s % 6.0).signum();
        assert_eq!(stall_of(|time_s| traction(0.97 * swings(time_s))), None);
        // At the limit for 3 s, where that moves the vehicle.
        let moves = |share: f64| Moment {
            speed_m_s: 0.6 * sense,
            yaw_rate_rad_s: 0.6 * sense,
            ..commanded(sense * share * TRACTION_M_S, sense * share * STEER_M_S)
        };
        let limit_then_little = |time_s: f64| match time_s < 3.0 {
            true => moves(1.0),
            false => commanded(0.2 * sense, 0.1 * sense),
        };
        assert_eq!(stall_of(limit_then_little), None);
    }
    // From the begin of a drive on.
    let stalls = stall_after(0, STEER_M_S, |_| commanded(TRACTION_M_S, 0.1));
    assert!(
        stalls.is_some_and(|(_, after_s)| after_s > 4.4),
        "{stalls:?}"
    );
}

#[test]
fn motors_at_their_limits_have_to_give_a_tenth_of_their_motion() {
    for sense in [1.0, -1.0] {
        let creeps = |speed_m_s: f64| Moment {
            speed_m_s: sense * speed_m_s,
            ..commanded(sense * TRACTION_M_S, 0.1)
        };
        assert_stalls(Stall::Traction, |_| creeps(0.06));
        assert_stalls(Stall::Traction, |_| creeps(-0.12));
        assert_eq!(stall_of(|_| creeps(0.13)), None);
        // 0.12 m/s on treads 0.6 m from the middle turn a vehicle by 0.9 rad within 4.5 s.
        let turns = |yaw_rate_rad_s: f64| Moment {
            yaw_rate_rad_s: sense * yaw_rate_rad_s,
            ..commanded(0.2, sense * 0.12)
        };
        let stalls = |yaw_rate_rad_s| stall_after(0, 0.12, |_| turns(yaw_rate_rad_s));
        assert_eq!(stalls(0.021), None);
        assert!(matches!(stalls(0.019), Some((Stall::Steer, _))));
    }
}

#[test]
fn a_vehicle_that_turns_as_commanded_recovers_and_one_that_turns_the_other_way_stalls() {
    for sense in [1.0, -1.0] {
        let at_limit = |yaw_rate_rad_s: f64, steer_m_s: f64| Moment {
            yaw_rate_rad_s: sense * yaw_rate_rad_s,
            ..commanded(TRACTION_M_S, sense * steer_m_s)
        };
        assert_stalls(Stall::Steer, |_| at_limit(-0.1, STEER_M_S));
        assert_eq!(stall_of(|_| at_limit(0.1, STEER_M_S)), None);
        assert_eq!(stall_of(|_| at_limit(0.05, 0.05)), None);
        assert_stalls(Stall::Traction, |_| at_limit(-0.05, 0.05));
    }
}

#[test]
fn a_vehicle_stalls_that_makes_less_than_a_tenth_of_the_way_asked_for() {
    let asked = Moment {
        asked_m_s: 0.5,
        ..STANDING
    };
    assert_stalls(Stall::Path, |_| asked);
    let reverse = Moment {
        asked_m_s: -0.5,
        ..STANDING
    };
    assert_stalls(Stall::Path, |_| reverse);
    let creeps = |speed_m_s: f64, along_m_s: f64| Moment {
        speed_m_s,
        along_m_s,
        ..asked
    };
    assert_stalls(Stall::Path, |_| creeps(0.04, 0.04));
    // It moves, beside the path or along it.
    assert_eq!(stall_of(|_| creeps(0.06, 0.0)), None);
    assert_eq!(stall_of(|_| creeps(0.0, 0.06)), None);
    // However fast it should be, 0.3 m of way is progress.
    let slow = |along_m_s: f64| Moment {
        asked_m_s: 3.0,
        ..creeps(0.0, along_m_s)
    };
    assert_stalls(Stall::Path, |_| slow(0.06));
    assert_eq!(stall_of(|_| slow(0.07)), None);
    // Away and back within the window.
    let swings = |time_s: f64| creeps(0.5 * (1.0 - time_s % 2.0).signum(), 0.0);
    assert_eq!(stall_of(swings), None);
    for yaw_rate_rad_s in [0.06, -0.06] {
        let turns = Moment {
            yaw_rate_rad_s,
            ..asked
        };
        assert_eq!(stall_of(|_| turns), None);
    }
}

#[test]
fn no_way_is_asked_for_that_drives_do_not_allow_nor_on_the_spot_nor_at_the_end() {
    let asked = Moment {
        asked_m_s: 0.5,
        ..STANDING
    };
    let allowed = |allowed_m_s: f64| Moment {
        allowed_m_s,
        ..asked
    };
    // At least 0.3 m within 4.5 s.
    assert_eq!(stall_of(|_| allowed(0.06)), None);
    assert_stalls(Stall::Path, |_| allowed(0.08));
    let pivot = Moment {
        motion: Motion::Pivot,
        ..asked
    };
    assert_eq!(stall_of(|_| pivot), None);
    let ended = Moment {
        ended: true,
        ..asked
    };
    assert_eq!(stall_of(|_| ended), None);
}
