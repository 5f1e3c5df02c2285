use super::*;
use crate::server::test_data::route_settings;
use sidehill_controller::trajectory::Motion;
use std::f64::consts::{FRAC_PI_2, PI};

/// Poses along X_g, which is a heading of -90 deg.
fn line(count: usize) -> RequestedPath {
    let poses = (0..count).map(|i| PlanarPose {
        x_m: 0.1 * i as f64,
        y_m: 0.0,
        yaw_rad: -FRAC_PI_2,
    });
    RequestedPath {
        frame: "map".to_owned(),
        poses: poses.collect(),
        ..RequestedPath::default()
    }
}

#[test]
fn a_kink_close_to_an_end_is_smoothed_within_the_deviation_or_turned_at_on_the_spot() {
    let at = |places: &[(f64, f64)]| RequestedPath {
        frame: "map".to_owned(),
        poses: places
            .iter()
            .map(|&(x_m, y_m)| PlanarPose {
                x_m,
                y_m,
                yaw_rad: 0.0,
            })
            .collect(),
        ..RequestedPath::default()
    };
    let pose = PlanarPose::default();
    let path = at(&[(0.0, 0.0), (0.1, 0.1), (0.1, 0.2), (0.1, 0.3)]);
    let route = ProfiledRoute::build(&path, &pose, &route_settings()).unwrap();
    let end = route.trajectory.at(1e3).position;
    assert!((end.x_m - 0.1).hypot(end.y_m - 0.3) < 1e-6, "{end:?}");
    let exact = RouteSettings {
        smoothing: Smoothing {
            max_deviation_m: 0.02,
            ..Smoothing::default()
        },
        ..route_settings()
    };
    let turns = |settings: &RouteSettings| {
        let route = ProfiledRoute::build(&path, &pose, settings).unwrap();
        let mut times_s = (0..1000).map(|i| 0.01 * f64::from(i));
        times_s.any(|time_s| route.trajectory.at(time_s).motion == Motion::Pivot)
    };
    assert!(!turns(&route_settings()) && turns(&exact));
}

#[test]
fn a_single_pose_is_no_path() {
    let path = line(1);
    let error = ProfiledRoute::build(&path, &PlanarPose::default(), &route_settings()).unwrap_err();
    assert_eq!(error.code, code::INVALID_PATH);
}

#[test]
fn a_path_is_joined_where_the_vehicle_is() {
    let path = line(101);
    let pose = PlanarPose {
        x_m: 4.02,
        y_m: 0.3,
        yaw_rad: -FRAC_PI_2,
    };
    let route = ProfiledRoute::build(&path, &pose, &route_settings()).unwrap();
    let start = route.trajectory.at(0.0);
    assert!((start.position.x_m - 4.0).abs() < 0.05, "{start:?}");
    assert!((route.trajectory.length_m() - 6.0).abs() < 0.05);
    let slow = route.with_speeds(&SpeedLimits {
        speed_max_m_s: 0.2,
        ..route_settings().limits
    });
    let slow = slow.unwrap().trajectory;
    assert!((slow.at(slow.duration_s() / 2.0).speed_m_s - 0.2).abs() < 1e-6);
}

#[test]
fn a_route_keeps_the_speeds_of_its_poses_at_other_speeds_too() {
    let mut path = line(101);
    // Slow from 5 m to 6 m; the vehicle joins at 4 m.
    path.speeds_m_s = (0..101)
        .map(|index| {
            if (50..60).contains(&index) {
                0.2
            } else {
                f64::INFINITY
            }
        })
        .collect();
    let pose = PlanarPose {
        x_m: 4.0,
        ..path.poses[0]
    };
    let route = ProfiledRoute::build(&path, &pose, &route_settings()).unwrap();
    let fastest = |route: &ProfiledRoute, from_m: f64, to_m: f64| {
        (0..=100)
            .map(|i| from_m + f64::from(i) / 100.0 * (to_m - from_m))
            .map(|at_m| route.trajectory.speed_at(at_m))
            .fold(0.0, f64::max)
    };
    assert_eq!(fastest(&route, 1.0, 2.0), 0.2);
    assert_eq!(fastest(&route, 2.0, 6.0), 0.5);
    for (speed_max_m_s, slow_m_s, open_m_s) in [(0.3, 0.2, 0.3), (0.1, 0.1, 0.1)] {
        let limits = SpeedLimits {
            speed_max_m_s,
            ..route_settings().limits
        };
        let limited = route.with_speeds(&limits).unwrap();
        assert_eq!(fastest(&limited, 1.0, 2.0), slow_m_s);
        assert_eq!(fastest(&limited, 2.0, 6.0), open_m_s);
    }
}

#[test]
fn orientations_say_where_a_path_is_driven_in_reverse() {
    let mut path = line(41);
    for pose in &mut path.poses {
        pose.yaw_rad += PI;
    }
    let backward = RouteSettings {
        use_orientations: true,
        ..route_settings()
    };
    let route = ProfiledRoute::build(&path, &path.poses[0], &backward).unwrap();
    assert!(route.trajectory.at(2.0).speed_m_s < 0.0);
    let forward = ProfiledRoute::build(&path, &path.poses[0], &route_settings()).unwrap();
    assert!(forward.trajectory.at(2.0).speed_m_s > 0.0);
}

#[test]
fn a_pivot_turns_by_its_angle_within_the_steer_limit() {
    let from = PlanarPose {
        x_m: 1.0,
        y_m: 2.0,
        yaw_rad: 0.5,
    };
    let slow = SpeedLimits {
        steer_max_m_s: 0.1,
        ..route_settings().limits
    };
    for (limits, rate_rad_s) in [(route_settings().limits, PIVOT_RAD_S), (slow, 0.1)] {
        let pivot = pivot(&from, -2.0, &limits).unwrap();
        assert_eq!(pivot.length_m(), 0.0);
        assert!((pivot.at(1e3).heading_rad + 1.5).abs() < 1e-6);
        let duration_s = pivot.duration_s();
        assert!(duration_s >= 2.0 / rate_rad_s, "{duration_s}");
    }
}

#[test]
fn a_way_back_in_one_direction_is_refused_with_its_place() {
    let oriented = RouteSettings {
        use_orientations: true,
        ..route_settings()
    };
    // Each pose looks towards the next along Y_g: all forward, but back and forth.
    for ways in [
        &[0.0, 1.0, -1.0, 1.0][..],
        &[0.0, 4.0, -2.0, -6.0],
        &[0.0, 2.0, -3.0],
    ] {
        let ahead = |i: usize| {
            ways.get(i + 1)
                .map_or_else(|| ways[i] - ways[i - 1], |next| next - ways[i])
        };
        let poses = (0..ways.len()).map(|i| PlanarPose {
            x_m: 0.0,
            y_m: ways[i],
            yaw_rad: if ahead(i) > 0.0 { 0.0 } else { PI },
        });
        let path = RequestedPath {
            frame: "map".to_owned(),
            poses: poses.collect(),
            ..RequestedPath::default()
        };
        let error = ProfiledRoute::build(&path, &PlanarPose::default(), &oriented).unwrap_err();
        assert_eq!(error.code, code::INVALID_PATH);
        assert!(
            error.message.contains("turns back on the spot"),
            "{}",
            error.message
        );
    }
}

#[test]
fn poses_of_a_vehicle_that_stood_are_one_place() {
    // Noise of a standard deviation of 1 cm, the sum of uniform numbers, on 40 poses at either end or at both.
    let mut seed = 1_u64;
    let mut noise = move || {
        let mut uniform = || {
            seed = seed
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        0.01 * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0)
    };
    for (before, after) in [(40, 0), (0, 40), (40, 40)] {
        for sigmas in [0.5, 1.0] {
            let mut stand = |x_m: f64, count: usize| -> Vec<PlanarPose> {
                (0..count)
                    .map(|_| PlanarPose {
                        x_m: x_m + sigmas * noise(),
                        y_m: sigmas * noise(),
                        yaw_rad: -FRAC_PI_2,
                    })
                    .collect()
            };
            let mut path = line(31);
            path.poses.splice(0..0, stand(0.0, before));
            path.poses.extend(stand(3.0, after));
            let pose = path.poses[0];
            let route = ProfiledRoute::build(&path, &pose, &route_settings()).unwrap();
            let length_m = route.trajectory.length_m();
            assert!((length_m - 3.0).abs() < 0.1, "{length_m}");
            let start = route.trajectory.at(0.0);
            assert!(
                (start.heading_rad + FRAC_PI_2).abs() < 0.2,
                "{}",
                start.heading_rad
            );
        }
    }
    // Poses 5 cm apart are a path, and so are many more within a place where nothing else is.
    let exact = line(31);
    let each: Vec<(PlanarPose, usize)> = exact.poses.iter().copied().zip(0..).collect();
    assert_eq!(places(&exact.poses), each);
    // A place has the index of its last pose, whose speed says how to go on.
    let mut stood = line(31);
    stood.poses.splice(10..10, vec![stood.poses[10]; 8]);
    let indices: Vec<usize> = places(&stood.poses)
        .into_iter()
        .map(|(_, index)| index)
        .collect();
    assert_eq!(indices[9..12], [9, 18, 19]);
}
