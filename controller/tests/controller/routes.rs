//! The J8's routes become paths that can be driven to their ends.

use crate::rig::LIMITS;
use sidehill_controller::path::{Route, Smoothed, Smoothing, read_gpx, smooth};
use sidehill_controller::speed_profile::speed_profile;

struct Expected {
    points: usize,
    cusps: usize,
    length_m: f64,
    deviation_max_m: f64,
    deviation_rms_m: f64,
}

fn check(gpx: &str, expected: &Expected) -> (Route, Smoothed) {
    let options = Smoothing::default();
    let route = read_gpx(gpx.as_bytes(), None).unwrap();
    let smoothed = smooth(&route.points, &options).unwrap();
    let path = &smoothed.path;
    let trajectory = speed_profile(path, &LIMITS, |_| f64::INFINITY).unwrap();
    let heights = || route.points.iter().filter_map(|point| point.elevation_m);
    println!(
        "{} points, {:.1} m, cusps at {:.1?} m, deviation max {:.3} m, rms {:.3} m, curvature {:.3} 1/m, elevation {:.2} to {:.2} m, {:.1} s",
        route.points.len(),
        path.length_m(),
        path.cusps_m().collect::<Vec<_>>(),
        smoothed.deviation_max_m,
        smoothed.deviation_rms_m,
        path.max_curvature_per_m(),
        heights().fold(f64::INFINITY, f64::min),
        heights().fold(f64::NEG_INFINITY, f64::max),
        trajectory.duration_s(),
    );
    assert_eq!(route.points.len(), expected.points);
    assert_eq!(path.cusps_m().count(), expected.cusps);
    assert!((path.length_m() - expected.length_m).abs() < 2.0);
    assert!(smoothed.deviation_max_m < expected.deviation_max_m);
    assert!(smoothed.deviation_rms_m < expected.deviation_rms_m);
    assert!(path.max_curvature_per_m() <= options.max_curvature_per_m);
    assert!(smoothed.arc_lengths_m.is_sorted());
    let goal = route.points[route.points.len() - 1].position;
    let end = trajectory.at(trajectory.duration_s() + 1.0);
    assert!(end.position.distance_m(&goal) < 1e-6, "ends at {end:?}");
    let mut time_s = 0.0;
    while time_s < trajectory.duration_s() {
        let here = trajectory.at(time_s);
        let steer_m_s = 0.5 * LIMITS.track_width_m * here.yaw_rate_rad_s;
        assert!(here.speed_m_s.abs() <= LIMITS.speed_max_m_s + 1e-9);
        assert!(steer_m_s.abs() <= LIMITS.steer_max_m_s + 1e-6);
        time_s += 0.05;
    }
    (route, smoothed)
}

#[test]
fn path_1_is_smoothed_and_driven_to_its_end() {
    let (route, smoothed) = check(
        include_str!("../../../config/routes/path_1_june_26.gpx"),
        &Expected {
            points: 1468,
            cusps: 2,
            length_m: 612.5,
            deviation_max_m: 0.20,
            deviation_rms_m: 0.015,
        },
    );
    let origin = route.origin.unwrap();
    assert!((origin.latitude_deg - 36.716_000_4).abs() < 1e-12);
    assert!((origin.elevation_m - 96.156_001_6).abs() < 1e-12);
    // It turns back beside the places farthest to the north and to the south.
    let cusps: Vec<_> = smoothed
        .path
        .cusps_m()
        .map(|s_m| smoothed.path.at(s_m).position)
        .collect();
    assert!(cusps[0].y_m > 95.0 && cusps[1].y_m < -120.0, "{cusps:?}");
}

#[test]
fn path_2_is_smoothed_and_driven_to_its_end() {
    check(
        include_str!("../../../config/routes/path_2_june_26.gpx"),
        &Expected {
            points: 988,
            cusps: 2,
            length_m: 434.2,
            deviation_max_m: 0.45,
            deviation_rms_m: 0.035,
        },
    );
}

#[test]
fn spin_is_smoothed_and_driven_to_its_end() {
    check(
        include_str!("../../../config/routes/spin.gpx"),
        &Expected {
            points: 245,
            cusps: 0,
            length_m: 555.3,
            deviation_max_m: 0.12,
            deviation_rms_m: 0.05,
        },
    );
}
