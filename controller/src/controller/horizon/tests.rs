#![allow(clippy::unwrap_used)]

use super::super::walk::SUM_STEP_M;
use super::*;
use crate::config::{ControllerConfig, ControllerKind};
use crate::course::{Course, Cusp, Slalom, Straight};
use crate::path::{Point2, Window};
use crate::speed_profile::SpeedConfig;
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle::Vehicle;

/// Returns the readings of a vehicle that stands on level ground.
pub fn sample(time_s: f64, pose: &PlanarPose) -> Sample {
    Sample {
        time_s,
        tread_speeds: Some(Stamped {
            time_s,
            value: MeasuredTreadSpeeds::default(),
        }),
        attitude: Some(Stamped {
            time_s,
            value: Attitude::default(),
        }),
        yaw_rate: None,
        pose: Some(Stamped {
            time_s,
            value: Pose {
                x_m: pose.x_m,
                y_m: pose.y_m,
                z_m: 0.0,
                yaw_rad: pose.yaw_rad,
            },
        }),
    }
}

/// Returns a controller that follows a course from a pose which is seen for so many cycles.
pub fn following(
    kind: ControllerKind,
    course: &Course,
    from_m: f64,
    cycles: usize,
    pose: impl Fn(&Reference) -> PlanarPose,
) -> Controller {
    let config = ControllerConfig::default();
    let limits = SpeedConfig::default().limits(&config.limits, &Vehicle::j8());
    let reference = Reference::new(course.trajectory(&limits).unwrap()).starting_at(from_m);
    let pose = pose(&reference);
    let mut controller = Controller::new(kind, config, &Vehicle::j8()).unwrap();
    controller.follow(reference);
    see(&mut controller, &pose, 0..cycles);
    controller
}

fn see(controller: &mut Controller, pose: &PlanarPose, cycles: std::ops::Range<usize>) {
    let period_s = controller.config.period_s;
    for cycle in cycles {
        controller.step(&sample(cycle as f64 * period_s, pose), None);
    }
}

pub fn start(reference: &Reference) -> PlanarPose {
    reference.ahead(0.0).pose()
}

#[test]
fn targets_lie_on_the_path_in_order_and_ask_for_no_more_than_is_allowed() {
    let course = Course::Slalom(Slalom::default());
    for kind in [ControllerKind::IcrikMpc, ControllerKind::ContactMpc] {
        let controller = following(kind, &course, 3.0, 20, |reference| {
            let mut pose = reference.path().unwrap().at(3.0).pose();
            pose.x_m += 0.2 * pose.yaw_rad.cos();
            pose.y_m += 0.2 * pose.yaw_rad.sin();
            pose
        });
        let reference = controller.reference.as_ref().unwrap();
        let path = reference.path().unwrap();
        let mut before_m = reference.arc_length_m();
        assert_eq!(controller.horizon.targets.len(), controller.config.stages);
        for target in &controller.horizon.targets {
            let place = Point2 {
                x_m: target.pose.x_m,
                y_m: target.pose.y_m,
            };
            let window = Window {
                behind_m: 0.01,
                ahead_m: 1.0,
            };
            let nearest = path.nearest_within(&place, before_m, &window);
            assert!(nearest.cross_track_m.abs() < 1e-6, "{nearest:?}");
            before_m = nearest.point.arc_length_m;
            let allowed_m_s = reference.trajectory().speed_at(before_m);
            assert!((0.0..allowed_m_s + 1e-6).contains(&target.speed_m_s));
            // No place is asked for along the path on the way.
            assert_eq!(target.weights.along_per_m2, 0.0);
        }
        assert!(before_m > reference.arc_length_m() + 1.0, "{before_m}");
    }
}

#[test]
fn no_target_lies_beyond_a_cusp_and_the_end_of_a_drive_is_a_place() {
    let course = Course::Cusp(Cusp::default());
    for kind in [ControllerKind::IcrikMpc, ControllerKind::ContactMpc] {
        let mut cusp_m = 0.0;
        let mut controller = following(kind, &course, 0.0, 0, start);
        let reference = controller.reference.take().unwrap();
        cusp_m += reference.stop_at_m();
        let from_m = cusp_m - 0.5;
        let path = reference.path().unwrap().clone();
        controller.follow(reference.starting_at(from_m));
        see(&mut controller, &path.at(from_m).pose(), 0..20);
        let end = path.at(cusp_m.next_down()).position;
        let targets = &controller.horizon.targets;
        let to_end_m = |target: &StageTarget| {
            let place = Point2 {
                x_m: target.pose.x_m,
                y_m: target.pose.y_m,
            };
            place.distance_m(&end)
        };
        for pair in targets.windows(2) {
            assert!(to_end_m(&pair[1]) <= to_end_m(&pair[0]) + 1e-9);
            assert!(pair[1].speed_m_s >= 0.0);
        }
        let last = targets.last().unwrap();
        assert!(to_end_m(last) < 2e-3, "{kind:?}: {}", to_end_m(last));
        assert!(last.speed_m_s < 0.05, "{kind:?}: {}", last.speed_m_s);
        assert_eq!(
            last.weights.along_per_m2,
            controller.config.weights.cross_per_m2
        );
    }
}

#[test]
fn a_plan_is_held_to_the_begin_of_its_drive_while_it_is_behind() {
    let course = Course::Straight(Straight::default());
    let along = |behind_m: f64| {
        let place = |reference: &Reference| {
            let start = start(reference);
            PlanarPose {
                x_m: start.x_m + 0.1,
                y_m: start.y_m - behind_m,
                ..start
            }
        };
        let controller = following(ControllerKind::IcrikMpc, &course, 0.0, 1, place);
        let targets = controller.horizon.targets.iter();
        let shares =
            targets.map(|target| target.weights.along_per_m2 / target.weights.cross_per_m2);
        shares.collect::<Vec<f64>>()
    };
    let behind = along(1.0);
    let until = behind.iter().position(|share| *share == 0.0).unwrap();
    // It comes to the path, and then is held in speed only.
    assert!(
        until > 5 && behind[..until].iter().all(|share| *share == 1.0),
        "{behind:?}"
    );
    assert!(
        behind[until..].iter().all(|share| *share == 0.0),
        "{behind:?}"
    );
    assert!(along(0.0).iter().all(|share| *share == 0.0));
}

#[test]
fn rounds_between_the_headings_of_vehicle_and_path_turn_no_target_of_a_tracked_point() {
    let course = Course::Slalom(Slalom::default());
    for forward_m in [0.4, -0.4] {
        let turns_rad = |rounds: f64| -> Vec<f64> {
            let mut controller = following(ControllerKind::IcrikMpc, &course, 0.0, 0, start);
            controller.config.tracked_point.forward_m = forward_m;
            let mut pose = start(controller.reference.as_ref().unwrap());
            pose.yaw_rad += rounds * std::f64::consts::TAU;
            see(&mut controller, &pose, 0..1);
            let targets = controller.horizon.targets.iter();
            targets
                .map(|target| target.pose.yaw_rad - pose.yaw_rad)
                .collect()
        };
        let same = turns_rad(0.0);
        assert_eq!(same.len(), ControllerConfig::default().stages);
        for rounds in [-1.0, 2.0] {
            for (turn_rad, same_rad) in turns_rad(rounds).iter().zip(&same) {
                assert!((turn_rad - same_rad).abs() < 1e-9, "{forward_m} {rounds}");
            }
        }
    }
}

#[test]
fn a_body_that_leads_its_tracked_point_is_held_to_its_heading_where_the_horizon_ends() {
    let course = Course::Slalom(Slalom::default());
    let heading_weights = |forward_m: f64| -> Vec<f64> {
        let mut controller = following(ControllerKind::ContactMpc, &course, 3.0, 0, |reference| {
            reference.path().unwrap().at(3.0).pose()
        });
        controller.config.tracked_point.forward_m = forward_m;
        let pose = controller.reference.as_ref().unwrap().ahead(0.0).pose();
        see(&mut controller, &pose, 0..1);
        let targets = controller.horizon.targets.iter();
        targets
            .map(|target| target.weights.heading_per_rad2)
            .collect()
    };
    let same = |weights: &[f64]| weights.windows(2).all(|pair| pair[0] == pair[1]);
    assert!(same(&heading_weights(0.4)));
    let led = heading_weights(-0.4);
    let (end, others) = led.split_last().unwrap();
    assert!(same(others));
    // As an error across the path of the distance that the point is behind the ICRs, for each rad.
    assert!(*end > 40.0 * 50.0 * 0.4 * 0.4, "{end}");
}

#[test]
fn the_price_of_speed_grows_while_the_vehicle_waits_and_falls_when_it_moves_on() {
    let course = Course::Straight(Straight::default());
    let mut controller = following(ControllerKind::IcrikMpc, &course, 0.0, 1, start);
    let price = |controller: &Controller| controller.horizon.targets[0].weights.speed_s2_per_m2;
    let mut pose = start(controller.reference.as_ref().unwrap());
    let first = price(&controller);
    // To set off takes less than a second.
    see(&mut controller, &pose, 1..20);
    assert_eq!(price(&controller), first);
    let mut before = first;
    for cycle in 20..60 {
        see(&mut controller, &pose, cycle..cycle + 1);
        assert!(price(&controller) >= before);
        before = price(&controller);
    }
    assert!(before > 20.0 * first, "{before} {first}");
    assert!(before <= pressing(WAITED_S) * first, "{before} {first}");
    let asked_m_s = controller.horizon.targets[0].speed_m_s.max(0.4);
    for cycle in 60..300 {
        pose.x_m -= 0.05 * asked_m_s * pose.yaw_rad.sin();
        pose.y_m += 0.05 * asked_m_s * pose.yaw_rad.cos();
        let mut sample = sample(0.05 * f64::from(cycle), &pose);
        for reading in sample.tread_speeds.iter_mut() {
            reading.value.left_m_s = asked_m_s;
            reading.value.right_m_s = asked_m_s;
        }
        controller.step(&sample, None);
    }
    assert_eq!(price(&controller), first);
}

#[test]
fn the_stages_stretch_until_the_horizon_is_long_enough_for_a_turn() {
    for speed_m_s in [0.05, 0.1, 0.2, 0.4, 0.8] {
        let course = Course::Straight(Straight {
            length_m: 30.0,
            speed_m_s,
            ..Straight::default()
        });
        let controller = following(ControllerKind::IcrikMpc, &course, 0.0, 1, start);
        let times = controller.mpc().unwrap().stage_times();
        let length_m = LENGTH_MIN * controller.horizon.half_track_m;
        let wanted_s = (length_m / speed_m_s).clamp(times.whole_s(), STRETCH_MAX * times.whole_s());
        // The sum of times has steps of 0.1 m.
        let room_s = 2.0 * SUM_STEP_M / speed_m_s;
        let found_s = times.duration_s();
        assert!(
            (found_s - wanted_s).abs() < room_s,
            "{speed_m_s}: {found_s} {wanted_s}"
        );
    }
}
