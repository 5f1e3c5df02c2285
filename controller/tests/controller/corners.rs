//! Corners: where a path bends too sharply for its deviation, the vehicle stops and turns on the spot.

use crate::path::raw;
use crate::rig::{LIMITS, Setup, plane};
use proptest::prelude::*;
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::Status;
use sidehill_controller::path::{Direction, Path, PathError, Point2, RawPoint, Smoothing, smooth};
use sidehill_controller::reference::Reference;
use sidehill_controller::speed_profile::speed_profile;
use sidehill_controller::trajectory::{Motion, Trajectory};
use sidehill_plant::frames::wrap_angle;
use std::time::{Duration, Instant};

const TIGHT: Smoothing = Smoothing {
    max_curvature_per_m: 1.0,
    max_deviation_m: 0.1,
    spacing_m: 0.1,
    accuracy_m: None,
};

/// A path up, to the right, and up again.
fn steps() -> Path {
    let points = raw(&[(0.0, 0.0), (0.0, 4.0), (3.0, 4.0), (3.0, 8.0)]);
    smooth(&points, &TIGHT).unwrap().path
}

fn trajectory(path: &Path) -> Trajectory {
    speed_profile(path, &LIMITS, |_| f64::INFINITY).unwrap()
}

#[test]
fn a_bend_that_the_deviation_does_not_allow_is_a_corner_where_it_was_given() {
    let path = steps();
    let corners: Vec<_> = path.corners().collect();
    assert_eq!(corners.len(), 2);
    for (corner, (x_m, y_m, arc_length_m, turn_deg)) in corners
        .iter()
        .zip([(0.0, 4.0, 4.0, -90.0), (3.0, 4.0, 7.0, 90.0)])
    {
        assert!(corner.position.distance_m(&Point2 { x_m, y_m }) < 1e-9);
        assert!((corner.arc_length_m - arc_length_m).abs() < 1e-9);
        assert!((corner.turn_rad.to_degrees() - turn_deg).abs() < 1e-6);
    }
    assert_eq!(path.cusps_m().count(), 0);
    assert!(path.max_curvature_per_m() < 1e-6);
    let wide = Smoothing {
        max_deviation_m: 0.5,
        ..TIGHT
    };
    let points = raw(&[(0.0, 0.0), (0.0, 4.0), (3.0, 4.0), (3.0, 8.0)]);
    let round = smooth(&points, &wide).unwrap().path;
    assert_eq!(round.corners().count(), 0);
}

#[test]
fn a_long_path_of_corners_is_not_smoothed_anew_for_each() {
    // Some minutes where each corner that cannot be rounded has all the rest smoothed again.
    let legs = 950;
    let place = |i: usize| (20.0 * (i / 2) as f64, 20.0 * (i.div_ceil(2)) as f64);
    let points: Vec<_> = (0..=legs).map(place).collect();
    let begun = Instant::now();
    let path = smooth(&raw(&points), &TIGHT).unwrap().path;
    assert_eq!(path.corners().count(), legs - 1);
    assert!((path.length_m() - 20.0 * legs as f64).abs() < 1e-6);
    assert!(begun.elapsed() < Duration::from_secs(30));
}

#[test]
fn a_fold_back_without_a_change_of_direction_is_refused() {
    let point = |x_m, y_m| RawPoint {
        position: Point2 { x_m, y_m },
        direction: Some(Direction::Forward),
        ..RawPoint::default()
    };
    for back_x_m in [0.0, 0.3] {
        let points = [point(0.0, 0.0), point(0.0, 5.0), point(back_x_m, 0.0)];
        match smooth(&points, &TIGHT) {
            Err(PathError::TurnsBack { index, .. } | PathError::TooSharp { index, .. }) => {
                assert_eq!(index, 1);
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn the_trajectory_turns_at_a_corner_before_it_goes_on() {
    let path = steps();
    let trajectory = trajectory(&path);
    let corner = path.corners().next().unwrap();
    let arrives_s = trajectory.time_at(corner.arc_length_m - 1e-6);
    let leaves_s = trajectory.time_at(corner.arc_length_m + 1e-3);
    assert!(leaves_s - arrives_s > std::f64::consts::FRAC_PI_2 / 0.5);
    let mut turned_rad = 0.0;
    let (from_s, to_s) = (arrives_s + 0.1, leaves_s - 0.15);
    let steps = 100;
    for i in 0..steps {
        let point = trajectory.at(from_s + (to_s - from_s) * f64::from(i) / f64::from(steps));
        assert_eq!(point.motion, Motion::Pivot);
        assert!(point.position.distance_m(&corner.position) < 0.01);
        assert_eq!(point.speed_m_s, 0.0);
        turned_rad += point.yaw_rate_rad_s * (to_s - from_s) / f64::from(steps);
    }
    assert!(
        (turned_rad / corner.turn_rad - 1.0).abs() < 0.1,
        "{turned_rad}"
    );
}

#[test]
fn a_reference_drives_to_a_corner_turns_and_drives_on() {
    let path = steps();
    let mut reference = Reference::new(trajectory(&path));
    let mut pose = path.at(0.0).pose();
    for i in 0..=40 {
        pose = path
            .at((0.1 * f64::from(i)).min(4.0_f64.next_down()))
            .pose();
        let progress = reference.advance(0.05, &pose, false);
        assert_eq!(progress.point.motion, Motion::Drive);
    }
    // It stands at the corner with the heading of the way there.
    let progress = reference.advance(0.05, &pose, true);
    assert_eq!(progress.point.motion, Motion::Pivot);
    assert!(progress.point.yaw_rate_rad_s < 0.0);
    for _ in 0..17 {
        pose.yaw_rad = wrap_angle(pose.yaw_rad - 0.09);
        let progress = reference.advance(0.05, &pose, false);
        assert_eq!(progress.point.motion, Motion::Pivot);
        assert!(!progress.ended && (progress.arc_length_m - 4.0).abs() < 1e-9);
        assert!(wrap_angle(progress.point.heading_rad - pose.yaw_rad).abs() < 1e-6);
    }
    pose.yaw_rad = -std::f64::consts::FRAC_PI_2;
    let progress = reference.advance(0.05, &pose, false);
    assert_eq!(progress.point.motion, Motion::Drive);
    assert!((progress.arc_length_m - 4.0).abs() < 0.01 && !progress.ended);
    assert!((reference.stop_at_m() - 7.0).abs() < 1e-9);
}

#[test]
fn every_law_drives_round_corners_and_turns_nowhere_else() {
    for kind in [
        ControllerKind::IcrikMpc,
        ControllerKind::ContactMpc,
        ControllerKind::IcrhkMpc,
        ControllerKind::PurePursuit,
    ] {
        let path = steps();
        let mut setup = Setup::new(trajectory(&path));
        setup.kind = kind;
        setup.terrain = plane(4.0);
        let end = setup.trajectory.at(1e6);
        let mut rig = setup.build();
        let mut finished = false;
        for cycle in 0..1500 {
            let decision = rig.cycle();
            finished = decision.status == Status::Finished;
            if finished {
                break;
            }
            assert_eq!(decision.status, Status::Tracking, "{kind:?} {cycle}");
            let progress = decision.progress.unwrap();
            // The vehicle turns about its ICRs, which are 0.2 m ahead of its origin.
            assert!(progress.cross_track_m.abs() < 0.5, "{kind:?} {progress:?}");
            let near_corner = [4.0, 7.0]
                .iter()
                .any(|corner_m| (progress.arc_length_m - corner_m).abs() < 0.06);
            if progress.point.motion == Motion::Pivot {
                assert!(near_corner, "{kind:?} {progress:?}");
            }
        }
        assert!(finished, "{kind:?}");
        let pose = rig.simulation.state().pose;
        let miss_m = (pose.x_m - end.position.x_m).hypot(pose.y_m - end.position.y_m);
        assert!(miss_m < 0.15, "{kind:?}: {miss_m} m from the end");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_zigzag_becomes_a_path_through_its_corners(
        turns in prop::collection::vec((35.0..115.0f64, any::<bool>(), 1.5..6.0f64), 1..8)
    ) {
        let (mut x, mut y, mut heading_rad) = (0.0, 3.0, 0.0_f64);
        let mut points = vec![(0.0, 0.0), (0.0, 3.0)];
        for (turn_deg, left, length_m) in turns {
            heading_rad += if left { turn_deg.to_radians() } else { -turn_deg.to_radians() };
            x -= length_m * heading_rad.sin();
            y += length_m * heading_rad.cos();
            points.push((x, y));
        }
        let options = Smoothing { max_deviation_m: 0.02, ..TIGHT };
        let smoothed = smooth(&raw(&points), &options).unwrap();
        let path = &smoothed.path;
        prop_assert!(path.max_curvature_per_m() <= options.max_curvature_per_m);
        prop_assert!(smoothed.deviation_max_m <= options.max_deviation_m);
        prop_assert!(smoothed.arc_lengths_m.is_sorted());
        for corner in path.corners() {
            let given = points.iter().any(|&(x_m, y_m)| corner.position.distance_m(&Point2 { x_m, y_m }) < 1e-6);
            prop_assert!(given);
            prop_assert!(corner.turn_rad.abs() < std::f64::consts::PI);
        }
        let trajectory = trajectory(path);
        prop_assert!((trajectory.length_m() - path.length_m()).abs() < 1e-6);
    }
}
