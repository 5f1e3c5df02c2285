//! Properties of paths, of projections onto them, and of smoothing.

use crate::speed_profile::LIMITS;
use proptest::prelude::*;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::Distribution;
use sidehill_controller::course::{Course, FigureEight, Slalom};
use sidehill_controller::path::{
    Direction, GeodeticOrigin, Path, PathError, Point2, RawPoint, Smoothing, Window, read_csv,
    read_gpx, smooth,
};
use std::f64::consts::{PI, TAU};

fn eight() -> Path {
    FigureEight::default()
        .trajectory()
        .unwrap()
        .path()
        .unwrap()
        .clone()
}

pub fn slalom() -> Path {
    Course::Slalom(Slalom::default())
        .trajectory(&LIMITS)
        .unwrap()
        .path()
        .unwrap()
        .clone()
}

pub fn raw(points: &[(f64, f64)]) -> Vec<RawPoint> {
    points
        .iter()
        .map(|&(x_m, y_m)| RawPoint {
            position: Point2 { x_m, y_m },
            ..RawPoint::default()
        })
        .collect()
}

/// A random walk of steps of about 0.5 m that turns gently, with noise.
pub fn noisy_route() -> impl Strategy<Value = Vec<RawPoint>> {
    prop::collection::vec((-0.25..0.25f64, -0.03..0.03f64, -0.03..0.03f64), 4..120).prop_map(
        |steps| {
            let (mut x, mut y, mut heading) = (0.0, 0.0, 0.0_f64);
            let mut points = vec![(0.0, 0.0)];
            for (turn, noise_x, noise_y) in steps {
                heading += turn;
                x += 0.5 * heading.cos();
                y += 0.5 * heading.sin();
                points.push((x + noise_x, y + noise_y));
            }
            raw(&points)
        },
    )
}

fn beside(path: &Path, arc_length_m: f64, left_m: f64) -> Point2 {
    let point = path.at(arc_length_m);
    let (sin, cos) = point.travel_heading_rad().sin_cos();
    Point2 {
        x_m: point.position.x_m - cos * left_m,
        y_m: point.position.y_m - sin * left_m,
    }
}

#[test]
fn the_length_of_the_eight_is_that_of_its_polygon() {
    let w = TAU / 60.0;
    let at = |t: f64| Point2 {
        x_m: 2.4 * (2.0 * w * t).sin(),
        y_m: 3.9 * (w * t).sin(),
    };
    let polygon_m: f64 = (0..60_000)
        .map(|i| at(f64::from(i) * 1e-3).distance_m(&at(f64::from(i + 1) * 1e-3)))
        .sum();
    assert!((eight().length_m() - polygon_m).abs() < 1e-5);
}

#[test]
fn a_crossing_does_not_switch_the_branch() {
    let path = eight();
    let window = Window {
        behind_m: 0.5,
        ahead_m: 0.5,
    };
    for offset_m in [-0.1, 0.0, 0.1] {
        let mut reached_m = 1.0;
        let mut travelled_m = 1.0;
        while travelled_m < 2.5 * path.length_m() {
            let place = beside(&path, travelled_m, offset_m);
            let projected = path.nearest_within(&place, reached_m, &window);
            reached_m = projected.point.arc_length_m;
            assert!((projected.point.arc_length_m - travelled_m).abs() < 1e-3);
            assert!((projected.cross_track_m - offset_m).abs() < 1e-6);
            travelled_m += 0.03;
        }
    }
}

#[test]
fn unusable_points_are_refused_by_name() {
    let options = Smoothing::default();
    assert_eq!(smooth(&[], &options), Err(PathError::Empty));
    assert_eq!(
        smooth(&raw(&[(1.0, 2.0)]), &options),
        Err(PathError::SinglePoint)
    );
    assert_eq!(
        smooth(&raw(&[(1.0, 2.0), (1.0, 2.0)]), &options),
        Err(PathError::ZeroLength)
    );
    assert!(matches!(
        smooth(&raw(&[(0.0, 0.0), (1.0, 0.0), (f64::NAN, 0.0)]), &options),
        Err(PathError::NotFinite { index: 2, .. })
    ));
    assert!(matches!(
        smooth(&raw(&[(0.0, 0.0), (0.0, 2.1e4)]), &options),
        Err(PathError::TooLong { .. })
    ));
    let tight = Smoothing {
        max_deviation_m: 0.01,
        ..options
    };
    let bend = raw(&[(0.0, 0.0), (0.0, 5.0), (2.0, 9.0), (5.0, 15.0)]);
    match smooth(&bend, &tight) {
        Err(PathError::TooSharp {
            index,
            curvature_per_m,
            position,
            ..
        }) => {
            assert_eq!(index, 1);
            assert!(curvature_per_m > 1.0);
            assert!(position.distance_m(&Point2 { x_m: 0.0, y_m: 5.0 }) < 0.5);
        }
        other => panic!("{other:?}"),
    }
    let smoothed = smooth(&bend, &options).unwrap();
    assert!(smoothed.deviation_max_m < 0.5 && smoothed.path.max_curvature_per_m() <= 1.0);
}

#[test]
fn repeated_points_are_dropped_and_keep_their_place() {
    let points = raw(&[(0.0, 0.0), (0.0, 3.0), (0.0, 3.0), (0.0, 8.0)]);
    let smoothed = smooth(&points, &Smoothing::default()).unwrap();
    let expected = [0.0, 3.0, 3.0, 8.0];
    for (found, expected) in smoothed.arc_lengths_m.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6);
    }
}

#[test]
fn a_way_back_is_driven_in_reverse() {
    let points = raw(&[(0.0, 0.0), (0.0, 5.0), (0.5, 10.0), (1.0, 5.0), (1.0, 0.0)]);
    let path = smooth(&points, &Smoothing::default()).unwrap().path;
    let cusp_m = path.cusps_m().next().unwrap();
    assert_eq!(path.cusps_m().count(), 1);
    let (before, after) = (path.at(cusp_m - 1e-6), path.at(cusp_m + 1e-6));
    assert_eq!(before.direction, Direction::Forward);
    assert_eq!(after.direction, Direction::Reverse);
    assert!((before.heading_rad - after.heading_rad).abs() < 1e-3);
    let there = Point2 {
        x_m: 0.5,
        y_m: 10.0,
    };
    assert!(before.position.distance_m(&there) < 1e-4);
    // Past the cusp the projection goes on along the way back.
    let mut reached_m = cusp_m - 1.0;
    let mut travelled_m = cusp_m - 1.0;
    while travelled_m < path.length_m() {
        let position = path.at(travelled_m).position;
        let found = path.nearest_within(
            &position,
            reached_m,
            &Window {
                behind_m: 0.3,
                ahead_m: 0.3,
            },
        );
        reached_m = found.point.arc_length_m;
        assert!(
            (reached_m - travelled_m).abs() < 0.02,
            "{travelled_m} {found:?}"
        );
        travelled_m += 0.04;
    }
}

#[test]
fn directions_in_a_csv_are_kept() {
    let text = "x_m,y_m,z_m,direction\n0,0,1.5,forward\n0,4,2,reverse\n0.2,1,2,\n0.4,-3,1,\n";
    let route = read_csv(text.as_bytes()).unwrap();
    assert_eq!(route.points[0].elevation_m, Some(1.5));
    let path = smooth(&route.points, &Smoothing::default()).unwrap().path;
    assert_eq!(path.cusps_m().count(), 1);
    assert_eq!(path.at(2.0).direction, Direction::Forward);
    assert_eq!(path.at(7.0).direction, Direction::Reverse);
    assert!(path.at(7.0).heading_rad.abs() < 0.2);
}

#[test]
fn speeds_of_a_csv_hold_until_the_next_and_actions_belong_to_their_rows() {
    let text =
        "action,speed_m_s,x_m,y_m\n,,0,0\n\"stop, look\",0.3,0,2\n,,0,4\nprobe,0.8,0,6\n,,0,8\n";
    let route = read_csv(text.as_bytes()).unwrap();
    let speeds: Vec<Option<f64>> = route.points.iter().map(|point| point.speed_m_s).collect();
    assert_eq!(speeds, [None, Some(0.3), Some(0.3), Some(0.8), Some(0.8)]);
    let actions = [(1, "stop, look".to_owned()), (3, "probe".to_owned())];
    assert_eq!(route.actions, actions);
}

#[test]
fn faults_in_a_csv_carry_their_line() {
    let fault = |text: &str| read_csv(text.as_bytes()).unwrap_err().to_string();
    assert!(fault("x_m,y_m\n0,0\n1,nan\n").contains("line 3"));
    assert!(fault("x_m,y_m\n0,0\n1\n").contains("line 3"));
    assert!(fault("x_m\n0\n").contains("`y_m` is missing"));
    assert!(fault("x_m,y_m,w\n0,0,0\n").contains("`w` is unknown"));
    assert!(fault("x_m,y_m,direction\n0,0,up\n").contains("`up` is unknown"));
    for (speed, cause) in [
        ("fast", "`fast` is not a finite number"),
        ("0", "`0` would let the vehicle stand"),
        ("-0.3", "must be from 0.01 to 20 m/s"),
        ("25", "must be from 0.01 to 20 m/s"),
        ("inf", "not a finite number"),
    ] {
        let found = fault(&format!("x_m,y_m,speed_m_s\n0,0,\n1,0,{speed}\n"));
        for part in ["line 3", cause, "leave it empty"] {
            assert!(found.contains(part), "{found}");
        }
    }
    let long = fault(&format!("x_m,y_m,action\n0,0,{}\n", "a".repeat(65)));
    assert!(long.contains("line 2") && long.contains("65 characters, at most 64"));
    let broken = fault("x_m,y_m,action\n0,0,\"a\nb\"\n");
    assert!(
        broken.contains("line 2") && broken.contains("on one line"),
        "{broken}"
    );
    assert_eq!(read_csv("x_m,y_m\n".as_bytes()), Err(PathError::Empty));
}

#[test]
fn a_gpx_is_read_into_the_tangent_plane() {
    let text = r#"<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><rte>
        <rtept lat="45" lon="7"><ele>100</ele></rtept>
        <rtept lat="45.001" lon="7"><ele>103.5</ele></rtept>
        <rtept lat="45" lon="7.001"/></rte></gpx>"#;
    let points = read_gpx(text.as_bytes(), None).unwrap().points;
    // Radii of curvature of WGS 84 at 45 deg: meridian 6 367 381.8 m, prime vertical 6 388 838.3 m.
    let step_rad = 1e-3_f64.to_radians();
    assert!((points[1].position.y_m - 6_367_381.8 * step_rad).abs() < 1e-2);
    assert!(points[1].position.x_m.abs() < 1e-6);
    let east_m = 6_388_838.3 * (PI / 4.0).cos() * step_rad;
    assert!((points[2].position.x_m - east_m).abs() < 1e-2);
    assert_eq!(points[1].elevation_m, Some(3.5));
    assert_eq!(points[2].elevation_m, None);
}

/// A track whose segments hold points given in metres north and east of 47 N 8 E.
fn track(segments: &[&[(f64, f64)]]) -> String {
    let datum = GeodeticOrigin {
        latitude_deg: 47.0,
        longitude_deg: 8.0,
        elevation_m: 0.0,
    };
    let mut text = String::from("<gpx><trk>\n");
    for segment in segments {
        text += "<trkseg>\n";
        for &(y_m, x_m) in *segment {
            let (latitude, longitude) = datum.unproject(Point2 { x_m, y_m });
            text += &format!("<trkpt lat=\"{latitude:.10}\" lon=\"{longitude:.10}\"/>\n");
        }
        text += "</trkseg>\n";
    }
    text + "</trk></gpx>"
}

fn line(from_m: f64, to_m: f64, east_m: f64) -> Vec<(f64, f64)> {
    let steps = (to_m - from_m).abs().round() as i32;
    let share = |i: i32| f64::from(i) / f64::from(steps);
    (0..=steps)
        .map(|i| (from_m + share(i) * (to_m - from_m), east_m))
        .collect()
}

#[test]
fn segments_with_a_way_between_them_that_nobody_recorded_are_refused() {
    let refusal = |segments: &[&[(f64, f64)]]| {
        read_gpx(track(segments).as_bytes(), None)
            .unwrap_err()
            .to_string()
    };
    // A place far away, a row that begins where the one before did, and one that begins beside its end.
    let text = refusal(&[&line(0.0, 20.0, 0.0), &line(500.0, 502.0, 0.0)]);
    assert!(
        text.contains("line 26 of the GPX") && text.contains("480.0 m from the end"),
        "{text}"
    );
    assert!(refusal(&[&line(0.0, 20.0, 0.0), &line(0.0, 20.0, 3.0)]).contains("Keep one segment"));
    assert!(refusal(&[&line(0.0, 20.0, 0.0), &line(20.0, 0.0, 4.0)]).contains("4.0 m from"));
    // A logger that began a new segment without standing still loses nothing.
    let route = read_gpx(
        track(&[&line(0.0, 20.0, 0.0), &line(21.0, 30.0, 0.0)]).as_bytes(),
        None,
    )
    .unwrap();
    assert_eq!(route.points.len(), 31);
    assert!(
        route.notes[0].contains("2 segments") && route.notes[0].contains("1.00 m"),
        "{:?}",
        route.notes
    );
    assert!(
        read_gpx(track(&[&line(0.0, 20.0, 0.0)]).as_bytes(), None)
            .unwrap()
            .notes
            .is_empty()
    );
}

#[test]
fn what_a_gpx_leaves_open_is_said() {
    // A logger that lost its fixes on the way, without a new segment.
    let lost = [line(0.0, 20.0, 0.0), line(61.0, 80.0, 0.0)].concat();
    let notes = read_gpx(track(&[&lost]).as_bytes(), None).unwrap().notes;
    assert!(
        notes[0].contains("line 24 of the GPX: the point is 41.0 m")
            && notes[0].contains("1.0 m are usual"),
        "{notes:?}"
    );
    // A planned route has points where it bends only.
    let planned = track(&[&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (90.0, 0.0)]])
        .replace("trkpt", "rtept")
        .replace("trkseg", "rte");
    assert_eq!(
        read_gpx(planned.as_bytes(), None).unwrap().notes,
        Vec::<String>::new()
    );
    let both = track(&[&line(0.0, 20.0, 0.0)])
        .replace("<trk>", "<rte><rtept lat=\"47\" lon=\"8\"/></rte><trk>");
    let route = read_gpx(both.as_bytes(), None).unwrap();
    assert_eq!(route.points.len(), 21);
    assert!(
        route.notes[0].contains("only the tracks are driven"),
        "{:?}",
        route.notes
    );
    // Heights that a program did not know.
    let unknown = track(&[&line(0.0, 2.0, 0.0)]).replace("/>", "><ele>NaN</ele></trkpt>");
    let route = read_gpx(unknown.as_bytes(), None).unwrap();
    assert!(route.points.iter().all(|point| point.elevation_m.is_none()));
}

#[test]
fn the_datum_keeps_places_where_they_are_and_a_far_one_is_refused() {
    let datum = GeodeticOrigin {
        latitude_deg: 47.0,
        longitude_deg: 8.0,
        elevation_m: 0.0,
    };
    let whole = track(&[&line(3.0, 30.0, 7.0)]);
    let trimmed = track(&[&line(8.0, 30.0, 7.0)]);
    let last = |text: &str, datum| {
        *read_gpx(text.as_bytes(), datum)
            .unwrap()
            .points
            .last()
            .unwrap()
    };
    let place = Point2 {
        x_m: 7.0,
        y_m: 30.0,
    };
    for text in [&whole, &trimmed] {
        assert!(last(text, Some(&datum)).position.distance_m(&place) < 1e-3);
    }
    assert!((last(&whole, None).position.y_m - 27.0).abs() < 1e-3);
    assert!((last(&trimmed, None).position.y_m - 22.0).abs() < 1e-3);
    let exchanged = GeodeticOrigin {
        latitude_deg: 8.0,
        longitude_deg: 47.0,
        ..datum
    };
    let error = read_gpx(whole.as_bytes(), Some(&exchanged))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("line 3") && error.contains("exchanged"),
        "{error}"
    );
}

#[test]
fn points_that_cannot_be_meant_are_refused_with_their_line() {
    let fault = |text: &str| read_gpx(text.as_bytes(), None).unwrap_err().to_string();
    let mut points = line(0.0, 20.0, 0.0);
    points[7] = (7.0, 60.0);
    let text = fault(&track(&[&points]));
    assert!(text.contains("line 10") && text.contains("stray"), "{text}");
    let straight = track(&[&line(0.0, 20.0, 0.0)]);
    let sixth = straight.lines().nth(7).unwrap();
    let text = fault(&straight.replace(sixth, "<trkpt lat=\"0\" lon=\"0.0\"/>"));
    assert!(
        text.contains("line 8") && text.contains("without a fix"),
        "{text}"
    );
    let text = fault(&straight.replace(sixth, "<trkpt lat=\"8.0\" lon=\"47.0\"/>"));
    assert!(
        text.contains("line 8") && text.contains("km from the one before"),
        "{text}"
    );
    let in_japan = straight.replace(sixth, "<trkpt lat=\"139.7\" lon=\"35.7\"/>");
    assert!(fault(&in_japan).contains("are lat and lon exchanged?"));
    // A simulated world may be at 0, 0, and waypoints may be far apart.
    let world = "<gpx><rte><rtept lat=\"0\" lon=\"0\"/><rtept lat=\"0.001\" lon=\"0\"/><rtept lat=\"0.005\" lon=\"0\"/></rte></gpx>";
    assert_eq!(read_gpx(world.as_bytes(), None).unwrap().points.len(), 3);
}

#[test]
fn an_empty_elevation_is_not_known() {
    let text = "<gpx><rte><rtept lat=\"45\" lon=\"7\"><ele/></rtept><rtept lat=\"45.001\" lon=\"7\"><ele> </ele></rtept></rte></gpx>";
    let route = read_gpx(text.as_bytes(), None).unwrap();
    assert!(route.points.iter().all(|point| point.elevation_m.is_none()));
}

#[test]
fn faults_in_a_gpx_carry_their_line() {
    let fault = |text: &str| read_gpx(text.as_bytes(), None).unwrap_err().to_string();
    let in_track = |point: &str| format!("<gpx><trk><trkseg>\n{point}\n</trkseg></trk></gpx>");
    assert!(fault(&in_track(r#"<trkpt lat="91" lon="0"/>"#)).contains("line 2 of the GPX: lat"));
    assert!(fault(&in_track(r#"<trkpt lat="1"/>"#)).contains("no `lon`"));
    assert!(fault(&in_track("<trkpt")).contains("line"));
    assert!(fault("<kml/>").contains("kml"));
    assert!(fault("<gpx/>").contains("there is no point of a track"));
}

#[test]
fn a_way_back_on_the_spot_needs_a_change_of_direction() {
    let turns_back = |text: &str, place: (f64, f64), at: usize| {
        let route = read_csv(text.as_bytes()).unwrap();
        match smooth(&route.points, &Smoothing::default()) {
            Err(PathError::TurnsBack { index, position }) => {
                assert_eq!(index, at, "{text}");
                let (x_m, y_m) = place;
                assert!(
                    position.distance_m(&Point2 { x_m, y_m }) < 0.6,
                    "{text}{position:?}"
                );
            }
            other => panic!("{text}: {other:?}"),
        }
    };
    // Along an axis, beside it, and in reverse after a cusp.
    turns_back(
        "x_m,y_m,direction\n0,0,forward\n0,6,forward\n0,1,forward\n",
        (0.0, 6.0),
        1,
    );
    turns_back(
        "x_m,y_m,direction\n1,1,reverse\n4,5,\n1.3,1.4,\n",
        (4.0, 5.0),
        1,
    );
    turns_back(
        "x_m,y_m,direction\n0,0,forward\n5,0,reverse\n2,0,reverse\n6,0,reverse\n",
        (2.0, 0.0),
        2,
    );
    let marked = "x_m,y_m,direction\n0,0,forward\n0,6,reverse\n0,1,reverse\n";
    let route = read_csv(marked.as_bytes()).unwrap();
    assert_eq!(
        smooth(&route.points, &Smoothing::default())
            .unwrap()
            .path
            .cusps_m()
            .count(),
        1
    );
}

#[test]
fn a_way_out_and_exactly_back_turns_at_its_far_end() {
    for spacing_m in [0.05, 0.1, 0.2, 1.0] {
        let steps = (3.0_f64 / spacing_m).round() as i32;
        let out = (0..=steps).chain((0..steps).rev());
        let points: Vec<(f64, f64)> = out.map(|i| (1.0, spacing_m * f64::from(i))).collect();
        let path = smooth(&raw(&points), &Smoothing::default()).unwrap().path;
        let cusps: Vec<f64> = path.cusps_m().collect();
        assert_eq!(cusps.len(), 1, "{spacing_m}: {cusps:?}");
        assert!((cusps[0] - 3.0).abs() < 1e-6, "{spacing_m}: {cusps:?}");
    }
}

#[test]
fn a_mark_beside_the_place_of_turning_back_means_that_place_and_one_on_a_straight_line_none() {
    let points = |marked: usize| {
        let out = (0..=10).chain((0..10).rev());
        let mut points: Vec<RawPoint> =
            raw(&out.map(|i| (0.0, 0.3 * f64::from(i))).collect::<Vec<_>>());
        for (index, point) in points.iter_mut().enumerate() {
            let reverse = index >= marked;
            point.direction = Some(if reverse {
                Direction::Reverse
            } else {
                Direction::Forward
            });
        }
        points
    };
    for marked in [9, 10, 11] {
        let path = smooth(&points(marked), &Smoothing::default()).unwrap().path;
        assert!(
            (path.cusps_m().next().unwrap() - 3.0).abs() < 1e-6,
            "{marked}"
        );
    }
    assert!(matches!(
        smooth(&points(5), &Smoothing::default()),
        Err(PathError::NoCusp { index: 5, .. })
    ));
}

/// A drive of 40 m at `speed_m_s`, fixes at 10 Hz, that stands for 5 s at its start, with white noise.
fn recorded(noise_m: f64, speed_m_s: f64, seed: u64) -> (Vec<RawPoint>, impl Fn(f64) -> Point2) {
    let course = |at_m: f64| Point2 {
        x_m: 2.0 * (0.25 * at_m).sin(),
        y_m: at_m,
    };
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let noise = rand_distr::Normal::new(0.0, noise_m).unwrap();
    let moving = (40.0 / (0.1 * speed_m_s)) as usize;
    let ways = std::iter::repeat_n(0.0, 50).chain((0..=moving).map(|i| 0.1 * speed_m_s * i as f64));
    let points = ways
        .map(|at_m| {
            let Point2 { x_m, y_m } = course(at_m);
            (
                x_m + noise.sample(&mut random),
                y_m + noise.sample(&mut random),
            )
        })
        .collect::<Vec<_>>();
    (raw(&points), course)
}

#[test]
fn a_recording_with_noise_and_a_stand_at_its_start_becomes_a_calm_path_near_the_truth() {
    let steer = |path: &Path| -> f64 {
        let steps = (path.length_m() / 0.1) as usize;
        let curvatures: Vec<f64> = (0..steps)
            .map(|i| path.at(0.1 * i as f64).curvature_per_m)
            .collect();
        curvatures
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).abs())
            .sum()
    };
    let exact = smooth(&recorded(0.0, 1.0, 0).0, &Smoothing::default()).unwrap();
    assert_eq!(exact.accuracy_m, 0.0);
    let calm = steer(&exact.path);
    for (noise_m, speed_m_s) in [
        (0.005, 0.4),
        (0.01, 1.0),
        (0.02, 0.5),
        (0.05, 1.0),
        (0.1, 0.8),
    ] {
        for seed in 0..5 {
            let (points, course) = recorded(noise_m, speed_m_s, seed);
            let smoothed = smooth(&points, &Smoothing::default())
                .unwrap_or_else(|error| panic!("{noise_m} m, seed {seed}: {error}"));
            let path = &smoothed.path;
            assert!(
                (0.6 * noise_m..1.25 * noise_m).contains(&smoothed.accuracy_m),
                "{noise_m} {}",
                smoothed.accuracy_m
            );
            assert_eq!(path.cusps_m().count(), 0, "{noise_m} m, seed {seed}");
            // It leaves along the course: its first heading is atan(2 * 0.25) clockwise.
            let heading_rad = path.at(0.0).heading_rad + 0.5_f64.atan();
            assert!(
                heading_rad.abs() < 0.1 + 4.0 * noise_m,
                "{noise_m} m, seed {seed}: {heading_rad}"
            );
            let nearest_m = |place: Point2| {
                (0..=4200)
                    .map(|i| course(0.01 * f64::from(i) - 1.0).distance_m(&place))
                    .fold(f64::INFINITY, f64::min)
            };
            let worst_m = (0..100)
                .map(|i| nearest_m(path.at(path.length_m() * f64::from(i) / 100.0).position))
                .fold(0.0, f64::max);
            assert!(
                worst_m < 0.02 + 2.0 * noise_m,
                "{noise_m} m, seed {seed}: {worst_m} m off"
            );
            let found = steer(path);
            assert!(
                found < calm + 5.0,
                "{noise_m} m, seed {seed}: {found} against {calm}"
            );
        }
    }
}

#[test]
fn what_would_do_is_said_and_does() {
    let mut curvatures = 0;
    for turn_deg in [20.0_f64, 24.0, 27.0, 29.0] {
        for max_deviation_m in [0.005, 0.01, 0.015] {
            let (sin, cos) = turn_deg.to_radians().sin_cos();
            let bend = raw(&[(0.0, 0.0), (0.0, 5.0), (6.0 * sin, 5.0 + 6.0 * cos)]);
            let tight = Smoothing {
                max_deviation_m,
                max_curvature_per_m: 0.5,
                ..Smoothing::default()
            };
            let Err(error) = smooth(&bend, &tight) else {
                panic!("accepted: {turn_deg} {max_deviation_m}")
            };
            assert!(matches!(error, PathError::TooSharp { .. }), "{error}");
            let text = error.to_string();
            let said = |key: &str| -> Option<f64> {
                let (_, value) = text.rsplit_once("; ")?.1.split_once(key)?;
                let digits = value.split([' ', ',']).next()?;
                Some(digits.parse().unwrap())
            };
            let deviation = said("max_deviation_m: ").map(|max_deviation_m| Smoothing {
                max_deviation_m,
                ..tight
            });
            let curvature = said("max_curvature_per_m: ").map(|max_curvature_per_m| Smoothing {
                max_curvature_per_m,
                ..tight
            });
            assert!(deviation.is_some(), "{text}");
            curvatures += usize::from(curvature.is_some());
            for would_do in [deviation, curvature].into_iter().flatten() {
                assert!(smooth(&bend, &would_do).is_ok(), "{would_do:?}: {text}");
            }
        }
    }
    assert!(curvatures > 0);
}

#[test]
fn a_stored_path_that_stands_still_is_refused() {
    let path = slalom();
    let mut stored = serde_json::to_value(&path).unwrap();
    assert_eq!(
        serde_json::from_value::<Path>(stored.clone()).unwrap(),
        path
    );
    let samples = stored["pieces"][0]["samples"].as_array_mut().unwrap();
    let here = samples[40]["position"].clone();
    samples[41]["position"] = here;
    let error = serde_json::from_value::<Path>(stored)
        .unwrap_err()
        .to_string();
    assert!(error.contains("standstill"), "{error}");
}

/// Points on a small lattice, so that places repeat and lines fold back, at any scale, with and without directions.
fn any_points() -> impl Strategy<Value = Vec<RawPoint>> {
    let scale = prop_oneof![
        (-9..2i32).prop_map(|power| 10_f64.powi(power)),
        (6..200i32).prop_map(|power| 10_f64.powi(power)),
    ];
    let place = prop_oneof![
        3 => (-3..4i32, -1..2i32).prop_map(|(x, y)| (f64::from(x), f64::from(y))),
        1 => (-3.0..3.0f64, -3.0..3.0f64),
        1 => (-3..4i32, -1e-7..1e-7f64).prop_map(|(x, y)| (f64::from(x), y)),
    ];
    let direction = prop_oneof![
        3 => Just(None),
        1 => Just(Some(Direction::Forward)),
        1 => Just(Some(Direction::Reverse)),
    ];
    let points = prop::collection::vec((place, direction), 2..14);
    let offset = prop_oneof![Just(0.0), Just(4.5e6), Just(-9.9e7)];
    (points, scale, offset, any::<bool>()).prop_map(|(points, scale, offset_m, marked)| {
        points
            .into_iter()
            .map(|((x, y), direction)| RawPoint {
                position: Point2 {
                    x_m: scale * x + offset_m,
                    y_m: scale * y,
                },
                direction: direction.filter(|_| marked),
                ..RawPoint::default()
            })
            .collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_points_are_refused_or_a_path_on_which_any_place_is_found(
        points in any_points(), at in 0.0..1.0f64, left_m in -5.0..5.0f64, guess_m in -1.0..1.0f64
    ) {
        let options = Smoothing::default();
        let Ok(smoothed) = smooth(&points, &options) else { return Ok(()) };
        let path = &smoothed.path;
        prop_assert!(path.max_curvature_per_m() <= options.max_curvature_per_m);
        prop_assert!(smoothed.deviation_max_m <= options.max_deviation_m);
        let at_m = at * path.length_m();
        for window_m in [0.0, 1.0, 1e9] {
            let window = Window { behind_m: window_m, ahead_m: window_m };
            let found = path.nearest_within(&beside(path, at_m, left_m), at_m + guess_m, &window);
            prop_assert!((0.0..=path.length_m()).contains(&found.point.arc_length_m));
            prop_assert!(found.cross_track_m.is_finite());
        }
        // It moves by its arc length and turns by no more than its curvature allows.
        let step_m = 1e-3 * path.length_m().min(1.0);
        let (a, b) = (path.at(at_m), path.at(at_m + step_m));
        let moved_m = b.arc_length_m - a.arc_length_m;
        if path.stops_m().all(|stop_m| !(a.arc_length_m..=b.arc_length_m).contains(&stop_m)) {
            prop_assert!((a.position.distance_m(&b.position) - moved_m).abs() <= 0.1 * moved_m + 1e-7);
            let turned_rad = (b.heading_rad - a.heading_rad).abs();
            prop_assert!(turned_rad <= 2.0 * options.max_curvature_per_m * moved_m + 1e-6, "{turned_rad}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_point_beside_the_path_is_found_with_its_offset(at_m in 0.0..24.0f64, left_m in -0.3..0.3f64,
                                                        guess_m in -0.4..0.4f64) {
        let path = slalom();
        let found = path.nearest_within(&beside(&path, at_m, left_m), at_m + guess_m,
                                        &Window { behind_m: 0.5, ahead_m: 0.5 });
        prop_assert!((found.cross_track_m - left_m).abs() < 1e-7);
        prop_assert!((found.point.arc_length_m - at_m).abs() < 1e-4);
    }

    #[test]
    fn arc_length_is_the_length_of_the_curve(at_m in 0.0..30.0f64) {
        let path = eight();
        let step_m = 1e-3;
        let (a, b) = (path.at(at_m), path.at(at_m + step_m));
        prop_assert!((a.position.distance_m(&b.position) - step_m).abs() < 1e-7);
        let curvature = (b.heading_rad - a.heading_rad) / step_m;
        prop_assert!((curvature - a.curvature_per_m).abs() < 2e-2);
        let (sin, cos) = a.heading_rad.sin_cos();
        prop_assert!(((b.position.x_m - a.position.x_m) / step_m + sin).abs() < 2e-3);
        prop_assert!(((b.position.y_m - a.position.y_m) / step_m - cos).abs() < 2e-3);
    }

    #[test]
    fn smoothing_keeps_its_bounds(points in noisy_route()) {
        let options = Smoothing { max_curvature_per_m: 0.8, max_deviation_m: 0.3, spacing_m: 0.1, ..Smoothing::default() };
        let smoothed = smooth(&points, &options);
        // A walk that turns by at most 0.5 1/m, with 4 cm of noise, can always be smoothed.
        let smoothed = smoothed.map_err(|error| TestCaseError::fail(error.to_string()))?;
        let path = &smoothed.path;
        prop_assert!(path.max_curvature_per_m() <= 0.8);
        prop_assert!(smoothed.arc_lengths_m.is_sorted());
        let mut worst_m: f64 = 0.0;
        for point in &points {
            // By brute force, apart from the code under test.
            let nearest_m = (0..=(path.length_m() / 0.01).ceil() as usize)
                .map(|i| path.at(i as f64 * 0.01).position.distance_m(&point.position))
                .fold(f64::INFINITY, f64::min);
            worst_m = worst_m.max(nearest_m);
        }
        // Half a step along a curve that bends by at most 0.24 of its distance.
        let found_m = smoothed.deviation_max_m;
        prop_assert!(worst_m <= found_m.hypot(0.006), "{worst_m} > {found_m}");
        prop_assert!(smoothed.deviation_max_m <= 0.3);
    }
}
