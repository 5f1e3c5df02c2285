#![allow(clippy::unwrap_used)]

mod memory;
mod tracked_point;

use super::super::walk::SUM_STEP_M;
use super::*;
use crate::config::{ControllerConfig, ControllerKind};
use crate::course::{Circle, Course, Cusp, Pivot, Slalom, Straight, Turn};
use crate::path::{Point2, Window};
use crate::speed_profile::SpeedConfig;
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::terrain::PlaneTerrain;
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
        // On the way errors count by the way that is driven with them, and at the end they count whole.
        assert!(targets.iter().any(|target| target.errors_share < 0.9));
        assert_eq!(last.errors_share, 1.0);
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
fn the_price_of_speed_follows_the_cost_of_the_way() {
    let course = Course::Straight(Straight::default());
    let price = |beside_m: f64, cycles: usize| {
        let beside = |reference: &Reference| {
            let start = start(reference);
            PlanarPose {
                x_m: start.x_m + beside_m,
                ..start
            }
        };
        let controller = following(ControllerKind::IcrikMpc, &course, 0.0, cycles, beside);
        let target = &controller.horizon.targets[0];
        let own = controller.config.weights.speed / target.speed_m_s.abs().max(0.6).powi(2);
        (
            target.weights.speed_s2_per_m2 / own,
            controller.way_cost_per_m,
        )
    };
    // What the first plan costs is known after it.
    assert!(price(0.3, 1).0 < price(0.3, 3).0);
    let (on_path, beside) = (price(0.0, 10), price(0.3, 10));
    assert!(on_path.1 < 0.1, "{on_path:?}");
    assert!(beside.1 > 5.0 * on_path.1, "{beside:?} {on_path:?}");
    assert!(beside.0 > 3.0 * on_path.0, "{beside:?} {on_path:?}");
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

/// Returns a circle to the left at 0.5 m/s.
fn circle(radius_m: f64) -> Course {
    Course::Circle(Circle {
        radius_m,
        speed_m_s: 0.5,
        turn: Turn::Left,
        ..Circle::default()
    })
}

#[test]
fn stretches_follow_the_track_width_and_change_by_little_between_cycles() {
    let straight = |speed_m_s| {
        let course = Course::Straight(Straight {
            length_m: 40.0,
            speed_m_s,
            ..Straight::default()
        });
        following(ControllerKind::IcrikMpc, &course, 5.0, 1, |reference| {
            reference.path().unwrap().at(5.0).pose()
        })
    };
    let stretch = |controller: &Controller| {
        controller.stretch(controller.mpc().unwrap(), controller.speed_limits())
    };
    for half_track_m in [0.5, 0.8] {
        let mut controller = straight(0.05);
        controller.discard_plan();
        controller.horizon.half_track_m = half_track_m;
        let found_s = stretch(&controller) * controller.mpc().unwrap().stage_times().whole_s();
        let wanted_s = LENGTH_MIN * half_track_m / 0.05;
        let room_s = 2.0 * SUM_STEP_M / 0.05;
        assert!((found_s - wanted_s).abs() < room_s, "{found_s} {wanted_s}");
    }
    for (speed_m_s, factor) in [(0.8, 1.0 / 1.05), (0.04, 1.05)] {
        let mut controller = straight(speed_m_s);
        for now in [2.0, 4.0] {
            let Law::Mpc(mpc) = &mut controller.law else {
                unreachable!()
            };
            mpc.move_on(0.0, now, &Vector3::z());
            let ratio = stretch(&controller) / now;
            assert!((ratio - factor).abs() < 1e-9, "{speed_m_s} {now}: {ratio}");
        }
    }
}

#[test]
fn changes_cost_more_in_longer_stages_and_those_of_steer_less_beside_the_path() {
    let course = Course::Straight(Straight {
        length_m: 30.0,
        speed_m_s: 0.1,
        ..Straight::default()
    });
    for (kind, beside_m, factor) in [
        (ControllerKind::IcrikMpc, 0.0, 2.5),
        // Half way between 2.5 and 0.25.
        (ControllerKind::IcrikMpc, 0.05, 1.375),
        (ControllerKind::ContactMpc, 0.0, 2.5),
        (ControllerKind::ContactMpc, 0.05, 1.375),
    ] {
        let beside = |reference: &Reference| {
            let start = start(reference);
            PlanarPose {
                x_m: start.x_m + beside_m,
                ..start
            }
        };
        let controller = following(kind, &course, 0.0, 1, beside);
        let own = controller.config.weights.changes();
        let weights = controller.horizon.change_weights;
        let longer = controller.mpc().unwrap().stage_times().stretch().powi(3);
        assert!(longer > 2.0, "{longer}");
        assert!((weights.traction / (longer * own.traction) - 1.0).abs() < 1e-9);
        // After one pose the noise is that of the settings.
        let found = weights.steer / (longer * own.steer);
        assert!(
            (found - factor).abs() < 0.01,
            "{kind:?} {beside_m}: {found}"
        );
    }
}

#[test]
fn a_change_of_steer_costs_more_where_positions_are_noisy() {
    for (noise_m, share) in [
        (0.0, 0.0625),
        (0.002, 0.0625),
        (0.005, 0.25),
        (0.01, 1.0),
        (0.1, 1.0),
    ] {
        assert!((noise_share(noise_m) - share).abs() < 1e-9, "{noise_m}");
    }
}

#[test]
fn the_weight_of_a_change_of_steer_follows_the_noise_that_poses_show() {
    let course = Course::Straight(Straight::default());
    for (noise_m, least, most) in [(0.0, 0.06, 0.15), (0.005, 0.3, 0.5), (0.02, 0.8, 1.0)] {
        let mut controller = following(ControllerKind::ContactMpc, &course, 0.0, 1, start);
        let at = start(controller.reference.as_ref().unwrap());
        for cycle in 1..60 {
            let sign = if cycle % 2 == 0 { 1.0 } else { -1.0 };
            let pose = PlanarPose {
                x_m: at.x_m + sign * noise_m,
                ..at
            };
            see(&mut controller, &pose, cycle..cycle + 1);
        }
        let longer = controller.mpc().unwrap().stage_times().stretch().powi(3);
        let whole = STEER_CHANGE_ON_PATH * controller.config.weights.changes().steer;
        let share = controller.horizon.change_weights.steer / (longer * whole);
        assert!((least..=most).contains(&share), "{noise_m}: {share}");
    }
}

#[test]
fn a_vehicle_that_knows_less_where_it_is_drives_slower() {
    for (uncertainty, share) in [
        (0.0, 1.0),
        (0.5, 1.0),
        (0.875, 0.5),
        (1.0, 1.0 / 3.0),
        (2.0, 1.0 / 3.0),
    ] {
        assert!((certain_share(uncertainty) - share).abs() < 1e-9);
    }
    let course = Course::Straight(Straight::default());
    let controller = following(ControllerKind::IcrikMpc, &course, 3.0, 20, |reference| {
        reference.path().unwrap().at(3.0).pose()
    });
    let pose = controller
        .reference
        .as_ref()
        .unwrap()
        .path()
        .unwrap()
        .at(3.0)
        .pose();
    let sample = sample(20.0 * controller.config.period_s, &pose);
    let bound_m = controller
        .clone()
        .step(&sample, None)
        .cross_track_bound_m()
        .unwrap();
    let speed_m_s = |largest_m: f64| {
        let mut controller = controller.clone();
        controller.config.supervisor.cross_track_uncertainty_max_m = largest_m;
        controller.step(&sample, None);
        let targets = controller.horizon.targets.iter();
        targets.fold(0.0_f64, |m, target| m.max(target.speed_m_s))
    };
    let share = speed_m_s(bound_m / 0.875) / speed_m_s(100.0 * bound_m);
    assert!((share - 0.5).abs() < 0.01, "{share}");
}

#[test]
fn the_ground_ahead_is_that_of_the_map_where_it_is_to_be_looked_at() {
    let course = Course::Straight(Straight::default());
    for preview in [AttitudePreview::Terrain, AttitudePreview::Measured] {
        let mut controller = following(ControllerKind::IcrikMpc, &course, 0.0, 0, start)
            .with_terrain(Terrain::Plane(PlaneTerrain::new(10.0, 0.0).unwrap()));
        controller.config.attitude_preview = preview;
        let pose = start(controller.reference.as_ref().unwrap());
        see(&mut controller, &pose, 0..1);
        for target in &controller.horizon.targets {
            let slope_deg = target.normal_in_world.z.acos().to_degrees();
            let looks = preview == AttitudePreview::Terrain;
            assert!((slope_deg - if looks { 10.0 } else { 0.0 }).abs() < 1e-6);
        }
    }
}

#[test]
fn rounds_of_the_heading_change_nothing_on_a_turn_on_the_spot() {
    let course = Course::Pivot(Pivot::default());
    let mut controller = following(ControllerKind::IcrikMpc, &course, 0.0, 5, start);
    let mut pose = start(controller.reference.as_ref().unwrap());
    let turns = |controller: &Controller| -> Vec<f64> {
        let targets = controller.horizon.targets.iter();
        targets.map(|target| target.pose.yaw_rad).collect()
    };
    let mut twin = controller.clone();
    see(&mut twin, &pose, 5..10);
    pose.yaw_rad += std::f64::consts::TAU;
    see(&mut controller, &pose, 5..10);
    for (own, expected) in turns(&controller).iter().zip(turns(&twin)) {
        assert!(wrap_angle(own - expected).abs() < 1e-9, "{own} {expected}");
    }
}
