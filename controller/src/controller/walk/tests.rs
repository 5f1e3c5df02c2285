#![allow(clippy::unwrap_used)]

use super::*;
use crate::course::{Circle, Course, Pivot, Straight, Turn};
use crate::mpc::limits::MotorLimits;
use crate::speed_profile::SpeedConfig;
use sidehill_plant::vehicle::Vehicle;

fn asked(motion: Motion) -> StageRequest {
    StageRequest {
        motion,
        ends: false,
        behind: false,
        pose: PlanarPose::default(),
        curvature_per_m: 0.0,
        inputs: MotorSpeeds::STOP,
        scale_m_s: 0.4,
        pace: 1.0,
    }
}

fn limits() -> InputLimits {
    let motor = |speed_m_s, acceleration_m_s2, deceleration_m_s2| MotorLimits {
        speed_m_s,
        acceleration_m_s2,
        deceleration_m_s2,
    };
    InputLimits {
        traction: motor(2.0, 1.0, 3.0),
        steer: motor(1.5, 4.0, 5.0),
        tread_speed_m_s: 2.2,
    }
}

/// Returns what bounds the speeds of a vehicle whose treads are 1.2 m apart.
fn speeds() -> SpeedsNow {
    SpeedsNow::new(&limits(), 0.6)
}

/// Returns the reference of a course, begun at an arc length.
fn reference(course: Course, from_m: f64) -> Reference {
    let limits = SpeedConfig::default().limits(&limits(), &Vehicle::j8());
    Reference::new(course.trajectory(&limits).unwrap()).starting_at(from_m)
}

/// Returns a straight path of 20 m at 0.5 m/s, 30 deg to the left of Y_g.
fn straight(from_m: f64) -> Reference {
    let course = Straight {
        heading_deg: 30.0,
        ..Straight::default()
    };
    reference(Course::Straight(course), from_m)
}

/// Returns the state so far along that path and to the left of it, with its heading.
fn state(along_m: f64, left_m: f64) -> Vector3<f64> {
    let (sin, cos) = f64::to_radians(30.0).sin_cos();
    Vector3::new(
        -sin * along_m - cos * left_m,
        cos * along_m - sin * left_m,
        f64::to_radians(30.0),
    )
}

fn pose_of(state: Vector3<f64>) -> PlanarPose {
    PlanarPose {
        x_m: state.x,
        y_m: state.y,
        yaw_rad: state.z,
    }
}

/// Goes on by one stage.
fn step(walk: &mut Walk, state: Vector3<f64>, end_s: f64) -> StageRequest {
    walk.to(&state, TrackedPoint::ORIGIN, &Vector3::z(), end_s, 1.0)
}

fn along_the_straight(reference: &Reference) -> Walk<'_> {
    let start = pose_of(state(reference.arc_length_m(), 0.0));
    Walk::new(reference, speeds(), &start, MotorSpeeds::STOP)
}

#[test]
fn a_drive_asks_for_the_place_beside_the_plan_and_for_the_pace_with_which_the_plan_comes_there() {
    let reference = straight(5.0);
    let mut walk = along_the_straight(&reference);
    let first = step(&mut walk, state(5.0, 0.2), 0.2);
    assert_eq!(first.pace, 1.0);
    assert!((first.inputs.traction_m_s - 0.5).abs() < 1e-6, "{first:?}");
    for (along_m, end_s, pace) in [(5.15, 0.7, 0.6), (5.25, 0.9, 1.0), (5.2, 1.0, -1.0)] {
        let asked = step(&mut walk, state(along_m, 0.2 + 0.1 * end_s), end_s);
        assert!((asked.pace - pace).abs() < 1e-6, "{asked:?}");
        let expected = state(
            f64::max(along_m, 5.25 * f64::from(u8::from(pace < 0.0))),
            0.0,
        );
        assert!((asked.pose.x_m - expected.x).abs() < 1e-6, "{asked:?}");
        assert!((asked.pose.y_m - expected.y).abs() < 1e-6, "{asked:?}");
        assert!(!asked.behind && !asked.ends);
    }
}

#[test]
fn a_way_costs_its_errors_and_its_slowness_over_each_metre_that_is_driven_of_the_path() {
    let weights = Weights {
        cross_per_m2: 20.0,
        heading_per_rad2: 0.5,
        speed: 0.3,
        ..Weights::default()
    };
    let reference = straight(5.0);
    let cost = |states: &[(f64, f64, f64)]| {
        let mut walk = along_the_straight(&reference);
        assert_eq!(walk.way_cost_per_m(&weights), 0.0);
        for (along_m, left_m, end_s) in states {
            step(&mut walk, state(*along_m, *left_m), *end_s);
        }
        walk.way_cost_per_m(&weights)
    };
    // At the asked 0.5 m/s, a second for half a metre, and at half of that; the first stage has no begin.
    let whole = cost(&[(5.0, 0.1, 0.2), (5.1, 0.1, 0.4)]);
    assert!((0.5 * whole - 20.0 * 0.01).abs() < 1e-6, "{whole}");
    let half = cost(&[(5.0, -0.1, 0.2), (5.05, -0.1, 0.4)]);
    assert!(
        (0.5 * half - (0.2 + 0.3 * 0.25 / 0.5)).abs() < 1e-6,
        "{half}"
    );
    // Headings count as well, but of a vehicle whose origin follows the path alone.
    let aside = TrackedPoint {
        right_m: 0.1,
        forward_m: 0.0,
    };
    for (point, expected) in [(TrackedPoint::ORIGIN, 0.5 * 0.04), (aside, 0.0)] {
        let mut walk = along_the_straight(&reference);
        for (along_m, end_s) in [(5.0, 0.2), (5.1, 0.4)] {
            let turned = state(along_m, 0.0) + Vector3::new(0.0, 0.0, 0.2);
            let back = point.lever(&Vector3::z(), turned.z).offset_m;
            let there = turned - Vector3::new(back.0, back.1, 0.0);
            walk.to(&there, point, &Vector3::z(), end_s, 1.0);
        }
        let turned = walk.way_cost_per_m(&weights);
        assert!((0.5 * turned - expected).abs() < 1e-6, "{turned}");
    }
    // Longer stages count for more.
    let both = cost(&[(5.0, 0.0, 0.2), (5.1, 0.0, 0.4), (5.3, 0.2, 0.8)]);
    assert!((0.5 * both - 0.8 * 0.4 / 0.6).abs() < 1e-6, "{both}");
    // One that stands or backs drives nothing, and its cost has a bound.
    for back_m in [0.0, 0.1] {
        let none = cost(&[(5.0, 0.1, 0.2), (5.0 - back_m, 0.1, 0.4)]);
        assert!((0.5 * none - WAY_COST_MAX).abs() < 1e-6, "{none}");
    }
}

#[test]
fn the_place_asked_for_is_beside_the_point_that_follows_the_path() {
    let reference = straight(5.0);
    let mut walk = along_the_straight(&reference);
    let point = TrackedPoint {
        right_m: -0.2,
        forward_m: 0.4,
    };
    let asked = walk.to(&state(5.0, 0.0), point, &Vector3::z(), 0.2, 1.0);
    let expected = state(5.4, 0.0);
    assert!((asked.pose.x_m - expected.x).abs() < 1e-6, "{asked:?}");
    assert!((asked.pose.y_m - expected.y).abs() < 1e-6, "{asked:?}");
}

#[test]
fn a_plan_is_behind_where_it_is_a_centimetre_before_the_begin_of_the_drive() {
    for (along_m, is_behind) in [(-0.3, true), (-0.02, true), (-0.005, false), (0.3, false)] {
        let reference = straight(0.0);
        let mut walk = along_the_straight(&reference);
        let asked = step(&mut walk, state(along_m, 0.1), 0.2);
        assert_eq!(asked.behind, is_behind, "{along_m}");
    }
}

#[test]
fn a_drive_brakes_to_its_end_with_half_of_the_deceleration_and_ends_within_a_millimetre() {
    for (to_go_m, ends) in [(0.05, false), (0.01, false), (0.0005, true), (0.0, true)] {
        let reference = straight(19.0);
        let mut walk = along_the_straight(&reference);
        walk.at = reference.stop_at_m() - to_go_m;
        let asked = step(&mut walk, state(20.0 - to_go_m, 0.0), 0.2);
        let most_m_s = f64::sqrt(2.0 * 1.5 * to_go_m).min(0.5);
        assert!(asked.inputs.traction_m_s <= most_m_s + 1e-6, "{asked:?}");
        let slow = most_m_s < asked.scale_m_s;
        assert!(
            !slow || asked.inputs.traction_m_s > most_m_s - 1e-6,
            "{asked:?}"
        );
        assert_eq!(asked.ends, ends, "{to_go_m}");
    }
}

#[test]
fn in_a_bend_steer_and_the_turn_of_the_heading_are_those_of_the_path() {
    for (turn, per_m) in [(Turn::Left, 0.5), (Turn::Right, -0.5)] {
        let course = Circle {
            radius_m: 2.0,
            speed_m_s: 0.5,
            turns: 1.0,
            turn,
        };
        let reference = reference(Course::Circle(course), 1.0);
        let pose = reference.ahead(0.0).pose();
        let mut walk = Walk::new(&reference, speeds(), &pose, MotorSpeeds::STOP);
        let asked = step(
            &mut walk,
            Vector3::new(pose.x_m, pose.y_m, pose.yaw_rad),
            0.2,
        );
        assert!((asked.curvature_per_m - per_m).abs() < 0.01, "{asked:?}");
        let steer_m_s = 0.6 * per_m * asked.inputs.traction_m_s;
        assert!(
            (asked.inputs.steer_m_s - steer_m_s).abs() < 0.005,
            "{asked:?}"
        );
    }
}

#[test]
fn times_of_a_drive_follow_from_its_speeds() {
    let reference = straight(5.0);
    let mut walk = along_the_straight(&reference);
    assert!((walk.time_for_s(2.0, 60.0) - 4.0).abs() < 0.21);
    assert_eq!(walk.time_for_s(2.0, 1.5), 1.5);
    assert_eq!(walk.time_for_s(0.0, 60.0), 0.0);
    // 1 m ahead at 0.5 m/s.
    step(&mut walk, state(6.0, 0.0), 2.0);
    assert!((walk.time_ahead_s() - 2.0).abs() < 1e-6);
}

/// Returns a turn on the spot by so many degrees at 0.4 rad/s.
fn pivot(angle_deg: f64) -> Reference {
    let course = Pivot {
        angle_deg,
        yaw_rate_rad_s: 0.4,
        centre_forward_m: 0.0,
    };
    reference(Course::Pivot(course), 0.0)
}

fn on_the_spot(reference: &Reference, yaw_rad: f64, steer_m_s: f64) -> Walk<'_> {
    let start = PlanarPose {
        yaw_rad,
        ..PlanarPose::default()
    };
    let moving = MotorSpeeds {
        traction_m_s: 0.0,
        steer_m_s,
    };
    Walk::new(reference, speeds(), &start, moving)
}

#[test]
fn a_turn_on_the_spot_gains_speed_as_the_motor_can_up_to_the_rate_asked_for() {
    for sense in [1.0, -1.0] {
        let reference = pivot(sense * 170.0);
        let mut walk = on_the_spot(&reference, 0.0, sense * 0.04);
        // 0.6 m times 0.4 rad/s; 4 m/s^2 for 0.02 s.
        let (mut heading_rad, mut before_s) = (0.0, 0.0);
        for (end_s, steer_m_s) in [(0.02, 0.12), (0.04, 0.20), (0.06, 0.24), (0.26, 0.24)] {
            heading_rad += sense * steer_m_s / 0.6 * (end_s - before_s);
            before_s = end_s;
            let yaw_rad = sense * 0.01;
            let asked = step(&mut walk, Vector3::new(0.0, 0.0, yaw_rad), end_s);
            assert_eq!((asked.motion, asked.ends), (Motion::Pivot, false));
            assert!(
                (asked.inputs.steer_m_s - sense * steer_m_s).abs() < 1e-12,
                "{asked:?}"
            );
            assert!((asked.pose.yaw_rad - heading_rad).abs() < 1e-9, "{asked:?}");
        }
    }
}

#[test]
fn a_turn_on_the_spot_brakes_to_its_end_and_comes_back_from_beyond_it() {
    for (to_go_rad, steer_m_s) in [
        // Half of 5 m/s^2, at the treads 0.6 m from the middle.
        (0.008, f64::sqrt(2.0 * 2.5 * 0.6 * 0.008)),
        (1.0, 0.24),
        (-0.008, -f64::sqrt(2.0 * 2.5 * 0.6 * 0.008)),
    ] {
        let reference = pivot(90.0);
        let yaw_rad = f64::to_radians(90.0) - to_go_rad;
        let mut walk = on_the_spot(&reference, yaw_rad, 0.0);
        let here = Vector3::new(0.0, 0.0, yaw_rad);
        let asked = step(&mut walk, here, 0.2);
        assert!(
            (asked.inputs.steer_m_s - steer_m_s).abs() < 1e-12,
            "{asked:?}"
        );
        // Within a stage it is there, and not beyond.
        let there = to_go_rad.abs() < 0.1;
        assert_eq!(asked.ends, there, "{to_go_rad}");
        assert!(
            !there || (asked.pose.yaw_rad - f64::to_radians(90.0)).abs() < 1e-9,
            "{asked:?}"
        );
    }
}

#[test]
fn the_time_of_a_turn_on_the_spot_is_that_of_what_is_left_of_it_at_most_half_a_round() {
    let second = |angle_deg: f64, yaw_rad: f64, most_s: f64| {
        let reference = pivot(angle_deg);
        on_the_spot(&reference, yaw_rad, 0.0).time_for_s(3.0, most_s)
    };
    for sense in [1.0, -1.0] {
        // 1 s for both ramps, and a fifth longer than at 0.4 rad/s.
        assert!(
            (second(sense * 90.0, sense * 0.5, 60.0) - 1.0 - 3.0 * (f64::to_radians(90.0) - 0.5))
                .abs()
                < 1e-9
        );
        assert!((second(sense * 700.0, 0.0, 60.0) - 1.0 - 3.0 * std::f64::consts::PI).abs() < 1e-9);
        assert_eq!(second(sense * 90.0, 0.0, 2.5), 2.5);
    }
}

#[test]
fn in_a_bend_steer_keeps_a_fifth_and_the_outer_tread_its_limit() {
    let now = speeds();
    assert_eq!(now.at(0.0), 0.98 * 2.0);
    for curvature_per_m in [0.3, 1.0, 3.0, -3.0, 10.0] {
        let speed_m_s = now.at(curvature_per_m);
        let steer_m_s = 0.6 * f64::abs(curvature_per_m) * speed_m_s;
        let used = [
            speed_m_s / 1.96,
            steer_m_s / 1.2,
            (speed_m_s + steer_m_s) / 2.2,
        ];
        let most = used.into_iter().fold(0.0, f64::max);
        assert!((most - 1.0).abs() < 1e-12, "{curvature_per_m}: {used:?}");
    }
    // On the spot the treads move at the speed of steer.
    assert!((0.6 * now.yaw_rate_rad_s() - 1.2).abs() < 1e-12);
}

#[test]
fn between_two_stops_a_vehicle_is_as_fast_as_half_of_its_deceleration_lets_it() {
    let now = speeds();
    for (from_m, to_m, nearer_m) in [(5.0, 2.0, 2.0), (0.7, 9.0, 0.7), (0.0, 4.0, SUM_STEP_M)] {
        // It stops within the way at 1.5 m/s^2.
        let way_m = now.between_stops(from_m, to_m).powi(2) / (2.0 * 1.5);
        assert!((way_m - nearer_m).abs() < 1e-12, "{from_m} {to_m}: {way_m}");
    }
}

#[test]
fn the_weight_across_the_path_grows_over_the_ramp_and_only_while_driving() {
    let weights = Weights::default();
    let cross = |asked: StageRequest, end_s| asked.weights(&weights, 0.0, end_s).cross_per_m2;
    let full = weights.cross_per_m2;
    let drive = asked(Motion::Drive);
    assert!((cross(drive, CROSS_RAMP_S / 3.0) - full / 3.0).abs() < 1e-9);
    assert_eq!(cross(drive, CROSS_RAMP_S), full);
    assert_eq!(cross(drive, 7.0), full);
    let pivot = asked(Motion::Pivot);
    for (ends, factor) in [(false, 1.0), (true, 10.0)] {
        let weights = StageRequest { ends, ..pivot }.weights(&weights, 0.0, CROSS_RAMP_S / 3.0);
        assert_eq!(weights.along_per_m2, factor * PIVOT_POSITION_PER_M2);
        assert_eq!(weights.cross_per_m2, factor * PIVOT_POSITION_PER_M2);
        assert_eq!(weights.heading_per_rad2, factor * PIVOT_HEADING_PER_RAD2);
    }
}

#[test]
fn a_drive_is_weighed_in_speed_on_the_way_and_in_place_at_its_end() {
    let all = Weights::default();
    let on_the_way = asked(Motion::Drive);
    let weights = on_the_way.weights(&all, 0.0, 1.0);
    assert_eq!(weights.along_per_m2, 0.0);
    // A vehicle that stands costs the same at every allowed speed.
    let standing = weights.speed_s2_per_m2 * on_the_way.scale_m_s.powi(2);
    assert!((standing - all.speed).abs() < 1e-12);
    let end = StageRequest {
        ends: true,
        ..on_the_way
    };
    let weights = end.weights(&all, 0.0, 1.0);
    assert_eq!(weights.along_per_m2, all.cross_per_m2);
    let behind = StageRequest {
        behind: true,
        ..on_the_way
    };
    let weights = behind.weights(&all, 0.0, CROSS_RAMP_S / 3.0);
    assert_eq!(weights.along_per_m2, weights.cross_per_m2);
    assert!(weights.along_per_m2 > 0.0);
}

#[test]
fn to_stand_costs_what_the_way_costs_that_is_not_driven() {
    let own = Weights::default();
    let standing = |scale_m_s: f64, way_cost_per_m: f64| {
        let asked = StageRequest {
            scale_m_s,
            ..asked(Motion::Drive)
        };
        let weights = asked.weights(&own, way_cost_per_m, 1.0);
        assert_eq!(weights.cross_per_m2, own.cross_per_m2);
        assert_eq!(weights.heading_per_rad2, own.heading_per_rad2);
        weights.speed_s2_per_m2 * scale_m_s.powi(2)
    };
    // A vehicle that may drive fast leaves more of the way than one in the bend after it.
    for scale_m_s in [0.2, 0.6, 2.0] {
        assert!((standing(scale_m_s, 0.0) - own.speed).abs() < 1e-12);
        let price = standing(scale_m_s, 0.4) - own.speed;
        assert!((price - 2.0 * 0.4 * scale_m_s).abs() < 1e-12, "{price}");
    }
}
