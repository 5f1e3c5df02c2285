//! What a vehicle that cannot follow is not asked for, and what the geometric baseline does at ends.

// The lints' exceptions for tests do not reach helper functions.
#![allow(clippy::unwrap_used, clippy::panic)]

mod rig;

use nalgebra::{Matrix3, Vector3};
use rig::{Setup, course};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::Status;
use sidehill_controller::estimator::Estimate;
use sidehill_controller::reference::{Reference, Tracking};
use sidehill_plant::correction::{Gains, Terms};
use sidehill_plant::frames::{Attitude, PlanarPose};
use sidehill_plant::speeds::TreadSpeeds;

#[test]
fn a_timed_reference_waits_for_a_vehicle_that_stands_and_goes_on_with_it() {
    let trajectory = course("{shape: circle, radius_m: 4, speed_m_s: 0.4}");
    let mut reference = Reference::new(trajectory, Tracking::Time, 1);
    let start = reference.ahead(0.0);
    let standing = PlanarPose {
        x_m: start.position.x_m,
        y_m: start.position.y_m,
        yaw_rad: start.heading_rad,
    };
    for _ in 0..200 {
        reference.advance(0.05, &standing);
    }
    // 0.6 m ahead at 0.4 m/s.
    assert!(
        (reference.time_s() - 1.5).abs() < 0.1,
        "{}",
        reference.time_s()
    );
    let point = reference.ahead(0.0);
    let there = PlanarPose {
        x_m: point.position.x_m,
        y_m: point.position.y_m,
        yaw_rad: point.heading_rad,
    };
    let before_s = reference.time_s();
    reference.advance(0.05, &there);
    assert!((reference.time_s() - before_s - 0.05).abs() < 1e-12);
}

#[test]
fn at_a_cusp_only_the_geometric_laws_reference_waits_for_the_vehicle() {
    let cusp = "{shape: cusp, radius_m: 3, angle_deg: 90, speed_m_s: 0.5}";
    for (tracking, passes) in [
        (Tracking::Path { lead_max_m: 0.3 }, true),
        (Tracking::PathByCusps { lead_max_m: 0.3 }, false),
    ] {
        let mut reference = Reference::new(course(cusp), tracking, 1);
        let path = reference.path().unwrap().clone();
        let cusp_m = path.cusps_m().next().unwrap();
        // The vehicle drives on the path and stops 0.2 m short of the cusp.
        let mut driven_m: f64 = 0.0;
        for _ in 0..400 {
            driven_m = (driven_m + 0.025).min(cusp_m - 0.2);
            let at = path.at(driven_m);
            let pose = PlanarPose {
                x_m: at.position.x_m,
                y_m: at.position.y_m,
                yaw_rad: at.heading_rad,
            };
            reference.advance(0.05, &pose);
        }
        let reached_m = reference.ahead(0.0).arc_length_m;
        assert_eq!(reached_m > cusp_m, passes, "{tracking:?} {reached_m}");
        assert!(reached_m > cusp_m - 0.05, "{tracking:?} {reached_m}");
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
fn learned_gains_never_turn_the_vehicle_against_its_treads() {
    let half_track_m = 1.0;
    let slope_rad = 0.25_f64;
    let estimate = |gains: Gains| Estimate {
        time_s: 0.0,
        pose: PlanarPose::default(),
        covariance: Matrix3::identity(),
        attitude: Attitude::default(),
        normal_in_world: Vector3::new(0.0, -slope_rad.sin(), slope_rad.cos()),
        treads: TreadSpeeds::default(),
        gains,
        model_error_m_s: 0.0,
        pose_age_s: 0.0,
        attitude_age_s: 0.0,
        speeds_age_s: 0.0,
        poses_gated: 0,
    };
    let small = Gains::from_fn(|i, j| 0.01 * (i + j) as f64);
    assert_eq!(estimate(small).bounded_gains(half_track_m), small);
    // What spinning treads teach: steer does not turn.
    let mut spun = small;
    for (k, gain) in [-0.9, 1.0, -2.0, 1.5, -1.5].into_iter().enumerate() {
        spun[(2, k)] = gain;
    }
    let bounded = estimate(spun).bounded_gains(half_track_m);
    assert_eq!(bounded.row(0), spun.row(0));
    assert!((bounded[(2, 1)] / bounded[(2, 0)] - spun[(2, 1)] / spun[(2, 0)]).abs() < 1e-12);
    for heading in 0..36 {
        let heading_rad = f64::from(heading).to_radians() * 10.0;
        let attitude = Attitude::on_plane(&estimate(small).normal_in_world, heading_rad);
        for steer_m_s in [-0.5, 0.5] {
            let own = steer_m_s / half_track_m;
            let learned = (bounded * Terms::at(attitude, steer_m_s, 1e-9).value).z;
            assert!((learned / own).abs() < 0.62, "{heading_rad} {learned}");
        }
    }
}
