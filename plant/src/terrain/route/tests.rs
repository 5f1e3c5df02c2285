use super::*;
use crate::terrain::{Terrain, tests::assert_normal_is_gradient};
use proptest::prelude::*;
use std::f64::consts::TAU;

fn point(x_m: f64, y_m: f64, z_m: f64) -> RoutePoint {
    RoutePoint { x_m, y_m, z_m }
}

fn smoothing() -> RouteSmoothing {
    RouteSmoothing::new(5.0, 3.0).unwrap()
}

/// An eight of 60 m width over hills, so that it crosses itself at the origin.
fn eight() -> RouteTerrain {
    let points: Vec<RoutePoint> = (0..=400)
        .map(|i| f64::from(i) * TAU / 400.0)
        .map(|t| (20.0 * (2.0 * t).sin(), 30.0 * t.sin()))
        .map(|(x, y)| point(x, y, 100.0 + 2.0 * (0.1 * y).sin() + 0.03 * x))
        .collect();
    RouteTerrain::new(&points, smoothing()).unwrap()
}

#[test]
fn a_straight_climb_is_exact_on_it_beside_it_and_a_little_beyond() {
    let points: Vec<RoutePoint> = (0..40)
        .map(|i| f64::from(i) * 1.3)
        .map(|s| point(0.6 * s, 0.8 * s, 700.0 + 0.1 * s))
        .collect();
    let terrain = RouteTerrain::new(&points, smoothing()).unwrap();
    for (along, beside) in [
        (20.0, 0.0),
        (20.3, 2.5),
        (0.0, 0.0),
        (-2.0, 1.0),
        (31.7, -2.0),
    ] {
        let (x, y) = (0.6 * along - 0.8 * beside, 0.8 * along + 0.6 * beside);
        let surface = terrain.surface(x, y).unwrap();
        let [gx, gy] = surface.gradient_in_world();
        assert!((surface.height_m - (700.0 + 0.1 * along)).abs() < 1e-9);
        assert!((0.6 * gx + 0.8 * gy - 0.1).abs() < 1e-9, "slope along");
        assert!((-0.8 * gx + 0.6 * gy).abs() < 1e-9, "slope across");
    }
}

#[test]
fn noise_is_smoothed_away_over_the_stated_length() {
    let noisy = |i: i32| if i % 2 == 0 { 0.1 } else { -0.1 };
    let points: Vec<RoutePoint> = (0..200)
        .map(|i| point(0.4 * f64::from(i), 0.0, 0.02 * f64::from(i) + noisy(i)))
        .collect();
    let terrain = RouteTerrain::new(&points, smoothing()).unwrap();
    for i in 0..100 {
        let x = 10.0 + 0.5 * f64::from(i);
        let [slope, _] = terrain.surface(x, 0.0).unwrap().gradient_in_world();
        assert!((slope - 0.05).abs() < 0.005, "slope {slope} at {x}");
    }
}

#[test]
fn where_passes_cross_a_hillside_keeps_most_of_its_slope_along_each() {
    let points: Vec<RoutePoint> = (0..=400)
        .map(|i| f64::from(i) * TAU / 400.0)
        .map(|t| (20.0 * (2.0 * t).sin(), 30.0 * t.sin()))
        .map(|(x, y)| point(x, y, 0.03 * x + 0.2 * y))
        .collect();
    let terrain = RouteTerrain::new(&points, smoothing()).unwrap();
    let [gx, gy] = terrain.surface(0.0, 0.0).unwrap().gradient_in_world();
    for (x, y) in [(0.8, 0.6), (-0.8, 0.6)] {
        let (got, truth) = (gx * x + gy * y, 0.03 * x + 0.2 * y);
        assert!((got - truth).abs() < 0.25 * truth, "{got} for {truth}");
    }
}

#[test]
fn away_from_the_route_there_is_no_ground() {
    let error = eight().surface(25.0, 0.0).unwrap_err();
    assert!(matches!(error, TerrainError::OffRoute { .. }));
    assert!(error.to_string().contains("x 25.000 m"), "{error}");
}

#[test]
fn passes_in_both_directions_and_turns_on_the_spot_are_one_ground() {
    let out: Vec<RoutePoint> = (0..60)
        .map(|i| point(0.0, f64::from(i), 0.1 * f64::from(i)))
        .collect();
    let mut points = out.clone();
    points.extend(std::iter::repeat_n(point(0.0, 59.0, 5.9), 50));
    points.extend(out.iter().rev());
    let terrain = RouteTerrain::new(&points, smoothing()).unwrap();
    for y in [10.0, 35.5, 58.9, 60.0] {
        let [across, along] = terrain.surface(0.4, y).unwrap().gradient_in_world();
        assert!(
            (along - 0.1).abs() < 1e-6 && across.abs() < 1e-9,
            "{along} at {y}"
        );
    }
}

#[test]
fn a_thousand_rounds_take_no_more_planes_than_a_few() {
    let rounds = |n: i32| -> Vec<RoutePoint> {
        (0..n * 40)
            .map(|i| f64::from(i) * TAU / 40.3)
            .map(|t| point(3.0 * t.cos(), 3.0 * t.sin(), 0.0))
            .collect()
    };
    let near = |n| {
        RouteTerrain::new(&rounds(n), smoothing())
            .unwrap()
            .planes
            .near([0.0, 0.0])
            .count()
    };
    assert!(
        near(1000) < 4 * near(1),
        "{} against {}",
        near(1000),
        near(1)
    );
}

#[test]
fn bad_points_and_lengths_are_named() {
    let error = RouteTerrain::new(
        &[point(0.0, 0.0, 0.0), point(1.0, f64::NAN, 0.0)],
        smoothing(),
    );
    assert!(error.unwrap_err().to_string().contains("route point 1"));
    for points in [vec![], vec![point(1.0, 2.0, 3.0); 5]] {
        let error = RouteTerrain::new(&points, smoothing()).unwrap_err();
        assert!(matches!(error, TerrainError::RouteLength { .. }), "{error}");
    }
    assert_eq!(
        RouteSmoothing::new(0.0, 1.0).unwrap_err().key,
        "smoothing_length_m"
    );
}

proptest! {
    #[test]
    fn the_normal_is_the_gradient(t in 0.0..TAU, beside in -2.0..2.0f64) {
        let (x, y) = (20.0 * (2.0 * t).sin() + beside, 30.0 * t.sin());
        assert_normal_is_gradient(&Terrain::Route(eight()), x, y, 1e-5);
    }

    #[test]
    fn the_ground_is_followed_closely_and_without_steps(t in 0.0..TAU) {
        let terrain = eight();
        let (x, y) = (20.0 * (2.0 * t).sin(), 30.0 * t.sin());
        let here = terrain.surface(x, y).unwrap();
        let truth = 100.0 + 2.0 * (0.1 * y).sin() + 0.03 * x;
        prop_assert!((here.height_m - truth).abs() < 0.12, "{} {}", here.height_m, truth);
        let there = terrain.surface(x + 1e-7, y).unwrap();
        prop_assert!((here.normal_in_world - there.normal_in_world).norm() < 1e-6);
    }
}

#[test]
fn an_elevation_that_jumps_is_named() {
    let hill: Vec<RoutePoint> = (0..30)
        .map(|i| RoutePoint {
            x_m: 0.0,
            y_m: f64::from(i),
            z_m: 90.0 + 0.3 * f64::from(i),
        })
        .collect();
    assert!(RouteTerrain::new(&hill, smoothing()).is_ok());
    let mut zero = hill.clone();
    zero[12].z_m = 0.0;
    let text = RouteTerrain::new(&zero, smoothing())
        .unwrap_err()
        .to_string();
    assert!(
        text.contains("points 11 and 12") && text.contains("y 12.0 m"),
        "{text}"
    );
    let mut step = hill.clone();
    step.iter_mut().skip(20).for_each(|point| point.z_m -= 8.0);
    let text = RouteTerrain::new(&step, smoothing())
        .unwrap_err()
        .to_string();
    assert!(
        text.contains("-7.7 m between the points 19 and 20"),
        "{text}"
    );
}
