use super::*;
use sidehill_controller::path::{Direction, Point2, RawPoint, Smoothing, smooth};

/// Along y, a heading of 0; left is -x.
fn line(length_m: u32) -> Path {
    path((0..=10 * length_m).map(|i| (0.1 * f64::from(i), Direction::Forward)))
}

fn path(along: impl Iterator<Item = (f64, Direction)>) -> Path {
    let points: Vec<RawPoint> = along
        .map(|(y_m, direction)| RawPoint {
            position: Point2 { x_m: 0.0, y_m },
            direction: Some(direction),
            ..RawPoint::default()
        })
        .collect();
    smooth(&points, &Smoothing::default()).unwrap().path
}

/// Whether a vehicle 1.4 m wide and 2.4 m long is clear of posts right and ahead of the path's start.
fn posts<const N: usize>(places: [[f64; 2]; N]) -> impl Fn(&PathPoint) -> bool {
    move |point| {
        let (sin, cos) = point.heading_rad.sin_cos();
        !places.iter().any(|[right_m, ahead_m]| {
            let (x, y) = (right_m - point.position.x_m, ahead_m - point.position.y_m);
            (x * cos + y * sin).abs() <= 0.7 && (-x * sin + y * cos).abs() <= 1.2
        })
    }
}

fn passing<'a>(path: &'a Path, detour: &'a Detour, blocked_m: f64) -> Passing<'a> {
    Passing {
        path,
        detour,
        from_m: 0.3,
        blocked_m,
        corridor_m: 0.6,
        max_curvature_per_m: 1.0,
    }
}

fn largest_m(detour: &Detour, length_m: f64) -> f64 {
    let places = (0..=1000).map(|i| detour.at(0.001 * length_m * f64::from(i)).left_m);
    places.fold(0.0, |most: f64, left_m| {
        if left_m.abs() > most.abs() {
            left_m
        } else {
            most
        }
    })
}

#[track_caller]
fn assert_free(path: &Path, detour: &Detour, is_free: impl Fn(&PathPoint) -> bool) {
    let moved = path.moved_aside(|at_m| detour.at(at_m)).unwrap().path;
    for i in 0..=2000 {
        let at_m = moved.length_m() * f64::from(i) / 2000.0;
        assert!(is_free(&moved.at(at_m)), "at {at_m} m");
    }
    assert!(moved.max_curvature_per_m() <= 1.0);
}

#[test]
fn a_blend_joins_value_slope_and_bend() {
    let detour = Detour::default().then(1.0, 2.0, 0.4);
    let bent = detour.then(2.2, 1.5, -0.3);
    for (at_m, detour) in [(1.0, &detour), (3.0, &detour), (2.2, &bent), (3.7, &bent)] {
        let [before, after] = [-1e-7, 1e-7].map(|by_m| detour.at(at_m + by_m));
        assert!((before.left_m - after.left_m).abs() < 1e-6);
        assert!((before.slope - after.slope).abs() < 1e-5);
        assert!(
            (before.bend_per_m - after.bend_per_m).abs() < 1e-4,
            "{at_m}"
        );
    }
    // The derivatives are those of the values.
    let [a, b, c] = [2.6, 2.601, 2.602].map(|at_m| bent.at(at_m));
    assert!((b.slope - (c.left_m - a.left_m) / 0.002).abs() < 1e-5);
    assert!((b.bend_per_m - (c.slope - a.slope) / 0.002).abs() < 1e-4);
    assert_eq!(detour.at(9.0).left_m, 0.4);
    assert_eq!(bent.at(2.1), detour.at(2.1));
}

#[test]
fn an_obstacle_that_intrudes_is_passed_on_the_other_side_as_near_as_it_lets_pass() {
    let line = line(14);
    let none = Detour::default();
    for (right_m, left_m) in [(0.5, 0.2), (-0.5, -0.2), (0.3, 0.4)] {
        let is_free = posts([[right_m, 6.0]]);
        let detour = passing(&line, &none, 4.8).detour(&is_free).unwrap();
        let found_m = largest_m(&detour, line.length_m());
        assert!((found_m - left_m).abs() < 0.051, "{right_m}: {found_m}");
        assert_free(&line, &detour, &is_free);
        let [begin, end] = [0.3, line.length_m()].map(|at_m| detour.at(at_m));
        assert_eq!([begin, end], [Aside::NONE; 2]);
    }
}

#[test]
fn an_obstacle_that_leaves_no_room_is_not_passed() {
    fn pass<const N: usize>(places: [[f64; 2]; N], blocked_m: f64) -> Option<Detour> {
        passing(&line(14), &Detour::default(), blocked_m).detour(posts(places))
    }
    // In the middle: 0.7 m would be needed on either side.
    assert_eq!(pass([[0.0, 6.0]], 4.8), None);
    // A gate narrower than the vehicle.
    assert_eq!(pass([[0.6, 6.0], [-0.7, 6.0]], 4.8), None);
    // Too near to get aside, and too near to the end to come back.
    assert_eq!(pass([[0.3, 1.8]], 0.6), None);
    assert_eq!(pass([[0.3, 13.0]], 11.8), None);
    // A gate wide enough, but not in the middle of the path.
    let gate = [[0.5, 6.0], [-1.1, 6.0]];
    assert_free(&line(14), &pass(gate, 4.8).unwrap(), posts(gate));
}

#[test]
fn a_second_obstacle_on_the_other_side_changes_the_detour() {
    let line = line(20);
    let none = Detour::default();
    let first = passing(&line, &none, 4.8)
        .detour(posts([[0.5, 6.0]]))
        .unwrap();
    let both = posts([[0.5, 6.0], [-0.3, 11.0]]);
    let next = Passing {
        from_m: 6.0,
        ..passing(&line, &first, 9.8)
    };
    let detour = next.detour(&both).unwrap();
    assert_eq!(detour.at(5.9), first.at(5.9));
    assert!(detour.at(11.0).left_m < -0.3);
    assert_free(&line, &detour, &both);
}

#[test]
fn the_detour_stays_on_one_side_of_a_cusp_and_works_in_reverse() {
    let there = (0..=100).map(|i| (0.1 * f64::from(i), Direction::Forward));
    let back = (0..100).rev();
    let path = path(there.chain(back.map(|i| (0.1 * f64::from(i), Direction::Reverse))));
    let none = Detour::default();
    // On the way back, 6 m after the cusp, which is at 10 m.
    let is_free = posts([[0.5, 4.0]]);
    let back = Passing {
        from_m: 10.5,
        ..passing(&path, &none, 14.8)
    };
    let detour = back.detour(&is_free).unwrap();
    let cusp_m = path.cusps_m().next().unwrap();
    assert_eq!(detour.at(cusp_m), Aside::NONE);
    // Away from the obstacle, which is to the left of travel.
    let aside_m = detour.at(16.0).left_m;
    assert!((-0.26..-0.2).contains(&aside_m), "{aside_m}");
}
