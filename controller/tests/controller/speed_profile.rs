//! A speed profile keeps every one of its limits.

use crate::path::{noisy_route, raw, slalom};
use proptest::prelude::*;
use sidehill_controller::path::{Path, Point2, RawPoint, Smoothing, smooth};
use sidehill_controller::speed_profile::{SpeedLimits, speed_profile};

pub const LIMITS: SpeedLimits = SpeedLimits {
    speed_max_m_s: 0.8,
    traction_max_m_s: 1.0,
    steer_max_m_s: 0.5,
    tread_max_m_s: 1.1,
    acceleration_m_s2: 0.5,
    deceleration_m_s2: 0.3,
    steer_acceleration_m_s2: 0.6,
    lateral_acceleration_m_s2: 0.4,
    track_width_m: 2.05,
};

#[test]
fn limits_that_are_not_positive_are_refused() {
    let limits = SpeedLimits {
        steer_max_m_s: 0.0,
        ..LIMITS
    };
    let error = speed_profile(&slalom(), &limits, |_| 1.0).unwrap_err();
    assert!(error.to_string().contains("steer_max_m_s: 0"));
    let error = speed_profile(&slalom(), &LIMITS, |_| f64::NAN).unwrap_err();
    assert!(error.to_string().contains("speed_cap_m_s"));
}

#[test]
fn a_local_cap_is_kept() {
    let steep = |s_m: f64| (10.0..15.0).contains(&s_m);
    let trajectory = speed_profile(&slalom(), &LIMITS, |p| {
        if steep(p.arc_length_m) { 0.2 } else { 1.0 }
    })
    .unwrap();
    let mut slow_s = 0.0;
    while slow_s < trajectory.duration_s() {
        let here = trajectory.at(slow_s);
        assert!(!steep(here.arc_length_m) || here.speed_m_s <= 0.2 + 1e-9);
        slow_s += 0.01;
    }
}

#[test]
fn the_speeds_of_stretches_are_kept_in_time_and_by_place() {
    // The speed of each stretch, whose ends are no places of a grid; the third is shorter than a step of the profile.
    let speeds = [None, Some(0.3), Some(0.11), None, Some(0.25), None];
    let ends_m = [0.0, 3.333, 7.77, 7.8, 12.1, 16.07, 20.0];
    let points: Vec<RawPoint> = (0..7)
        .map(|i| RawPoint {
            position: Point2 {
                x_m: 0.0,
                y_m: ends_m[i],
            },
            speed_m_s: speeds.get(i).copied().flatten(),
            ..RawPoint::default()
        })
        .collect();
    let path = smooth(&points, &Smoothing::default()).unwrap().path;
    let trajectory = speed_profile(&path, &LIMITS, |_| f64::INFINITY).unwrap();
    let limit_m_s = |at_m: f64| {
        let stretch = (0..6).find(|&i| at_m < ends_m[i + 1]);
        stretch.and_then(|i| speeds[i]).unwrap_or(0.8)
    };
    let mut fastest = [0.0f64; 6];
    for i in 0..20_000 {
        let at_m = 1e-3 * f64::from(i);
        let speed_m_s = trajectory.speed_at(at_m);
        assert!(speed_m_s <= limit_m_s(at_m) + 1e-9, "{speed_m_s} at {at_m}");
        let stretch = (0..6).find(|&i| at_m < ends_m[i + 1]).unwrap();
        fastest[stretch] = fastest[stretch].max(speed_m_s);
    }
    for i in 0..10_000 {
        let here = trajectory.at(f64::from(i) / 1e4 * trajectory.duration_s());
        let speed_m_s = here.speed_m_s;
        assert!(speed_m_s <= limit_m_s(here.arc_length_m) + 1e-9, "{here:?}");
    }
    // Nor slower than they ask for, where there is room.
    assert!(
        fastest[0] > 0.79 && fastest[3] > 0.79 && fastest[5] > 0.79,
        "{fastest:?}"
    );
    for (stretch, speed_m_s) in [(1, 0.3), (2, 0.11), (4, 0.25)] {
        assert!((fastest[stretch] - speed_m_s).abs() < 1e-9, "{fastest:?}");
    }
}

#[test]
fn the_speed_profile_keeps_its_limits_about_a_cusp() {
    let points = raw(&[(0.0, 0.0), (0.0, 5.0), (0.5, 10.0), (1.0, 5.0), (1.0, 0.0)]);
    let path = smooth(&points, &Smoothing::default()).unwrap().path;
    check_profile(&path, &LIMITS).unwrap();
    let trajectory = speed_profile(&path, &LIMITS, |_| 1.0).unwrap();
    let cusp_s = trajectory.time_at(path.cusps_m().next().unwrap());
    assert!(trajectory.at(cusp_s - 0.1).speed_m_s > 0.1);
    assert!(trajectory.at(cusp_s + 0.1).speed_m_s < -0.1);
}

/// Checks every bound of `limits` along the trajectory.
fn check_profile(path: &Path, limits: &SpeedLimits) -> Result<(), TestCaseError> {
    let trajectory = speed_profile(path, limits, |_| f64::INFINITY).unwrap();
    let half_track_m = 0.5 * limits.track_width_m;
    prop_assert!((trajectory.length_m() - path.length_m()).abs() < 1e-6);
    let step_m = 0.02;
    let cusps_m: Vec<f64> = path.cusps_m().collect();
    for i in 0..(path.length_m() / step_m) as usize {
        let at_m = i as f64 * step_m;
        let (speed, curvature) = (trajectory.speed_at(at_m), path.at(at_m).curvature_per_m);
        let sigma = half_track_m * curvature.abs() * speed;
        prop_assert!(speed <= limits.speed_max_m_s + 1e-9);
        prop_assert!(sigma <= limits.steer_max_m_s + 1e-3, "{sigma} at {at_m}");
        prop_assert!(speed + sigma <= limits.tread_max_m_s + 2e-3);
        prop_assert!(curvature.abs() * speed * speed <= limits.lateral_acceleration_m_s2 * 1.01);
        if cusps_m.iter().any(|c| (c - at_m).abs() < 0.1) {
            continue;
        }
        // Between two places 5 cm apart it is the speed, not its square, that changes evenly.
        let gained = (trajectory.speed_at(at_m + step_m).powi(2) - speed * speed) / (2.0 * step_m);
        prop_assert!(
            gained <= limits.acceleration_m_s2 * 1.2,
            "{gained} at {at_m}"
        );
        prop_assert!(
            gained >= -limits.deceleration_m_s2 * 1.2,
            "{gained} at {at_m}"
        );
        // At a constant speed.
        let change = (path.at(at_m + step_m).curvature_per_m - curvature) / step_m;
        let rate = half_track_m * change.abs() * speed * speed;
        prop_assert!(
            rate <= limits.steer_acceleration_m_s2 * 1.05,
            "{rate} at {at_m} m of {} m, {limits:?}",
            path.length_m()
        );
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_speed_profile_keeps_every_limit(points in noisy_route(), steer in 0.1..0.8f64, rate in 0.2..1.0f64) {
        let options = Smoothing { max_curvature_per_m: 0.8, max_deviation_m: 0.3, spacing_m: 0.1, ..Smoothing::default() };
        if let Ok(smoothed) = smooth(&points, &options) {
            let limits = SpeedLimits { steer_max_m_s: steer, steer_acceleration_m_s2: rate, ..LIMITS };
            check_profile(&smoothed.path, &limits)?;
        }
    }
}
