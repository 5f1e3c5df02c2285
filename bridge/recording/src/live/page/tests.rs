use super::*;
use proptest::prelude::*;
use sidehill_bridge::ros2::message::cdr::to_cdr;
use sidehill_bridge::ros2::message::{KeyValue, Point, Quaternion};
use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;

const SECOND_NS: u64 = 1_000_000_000;

fn put<M: serde::Serialize>(page: &mut Page, topic: Topic, time_ns: u64, message: &M) {
    page.take(&TopicMessage {
        topic,
        time_ns,
        message: to_cdr(message).unwrap().into(),
    });
}

/// Puts a cycle of the loop at each of these times, s.
fn drive(page: &mut Page, times_s: impl Iterator<Item = f64>) {
    for time_s in times_s {
        let cycle = LoopCycle {
            state: "driving".to_owned(),
            ..LoopCycle::default()
        };
        put(
            page,
            Topic::LoopCycle,
            (time_s * 1e9).round() as u64,
            &cycle,
        );
    }
}

fn fifths(from: u64, to: u64) -> impl Iterator<Item = f64> {
    (5 * from..5 * to).map(|i| i as f64 / 5.0)
}

fn read(reader: &mut Reader, page: &Page) -> Option<Value> {
    reader
        .next(page)
        .map(|text| serde_json::from_str(&text).unwrap())
}

/// Reads until nothing is left and returns the times of all frames, in fifths of a second, and the last `have`.
fn read_all(reader: &mut Reader, page: &Page) -> (Vec<i64>, String) {
    let (mut times, mut have) = (Vec::new(), String::new());
    while let Some(message) = read(reader, page) {
        for name in ["frames", "earlier"] {
            let frames = message[name].as_array().into_iter().flatten();
            times.extend(frames.map(|frame| (5.0 * frame[0].as_f64().unwrap()).round() as i64));
        }
        message["have"].as_str().unwrap().clone_into(&mut have);
    }
    (times, have)
}

fn event(page: &mut Page, time_ns: u64, name: &str, text: &str) {
    let line = LogLine {
        level: LogLine::INFO,
        name: name.to_owned(),
        msg: text.to_owned(),
        ..LogLine::default()
    };
    put(page, Topic::Events, time_ns, &line);
}

fn status(page: &Page) -> Value {
    serde_json::from_str(&page.parts["status"].1).unwrap()
}

#[test]
fn a_page_gets_the_newest_first_and_then_ten_minutes() {
    let mut page = Page::new();
    drive(&mut page, fifths(0, 1000));
    let mut reader = Reader::new(None);
    let first = read(&mut reader, &page).unwrap();
    assert_eq!(first["frames"].as_array().unwrap().len(), 1);
    assert_eq!(first["frames"][0][0], json!(999.8));
    let (times, _) = read_all(&mut reader, &page);
    let once: BTreeSet<i64> = times.iter().copied().collect();
    assert_eq!(once.len(), times.len());
    let (oldest, newest) = (once.first().unwrap(), once.last().unwrap());
    assert!((2000..=2005).contains(oldest), "{oldest}");
    assert!(*newest >= 4993, "{newest}");
    // At least one a second.
    assert!(
        once.iter()
            .zip(once.iter().skip(1))
            .all(|(a, b)| b - a <= 5)
    );
}

#[test]
fn a_page_that_comes_again_gets_only_what_it_lacks() {
    let mut page = Page::new();
    drive(&mut page, fifths(0, 20));
    event(
        &mut page,
        20 * SECOND_NS,
        "state",
        "Disarmed -> Zeroing: armed",
    );
    let mut reader = Reader::new(None);
    let (before, have) = read_all(&mut reader, &page);
    drive(&mut page, fifths(21, 31));
    event(
        &mut page,
        31 * SECOND_NS,
        "state",
        "Zeroing -> Enabling: standing",
    );
    let mut again = Reader::new(Some(&have));
    let first = read(&mut again, &page).unwrap();
    assert_eq!(first["events"].as_array().unwrap().len(), 1);
    assert!(first["hello"].is_object() && first["parts"]["status"].is_object());
    let (mut times, _) = read_all(&mut again, &page);
    times.push((5.0 * first["frames"][0][0].as_f64().unwrap()).round() as i64);
    let mut all: Vec<i64> = before.into_iter().chain(times).collect();
    all.sort_unstable();
    let count = all.len();
    all.dedup();
    assert_eq!(all.len(), count, "nothing comes twice");
    let made = page.frames.end() as usize;
    assert_eq!(count, made, "and nothing is missing");
    // Of another run, all is new, and nonsense is no harm.
    for have in [
        "0.1-7-7",
        "x",
        "--",
        "-99999999999999999999-1",
        &format!("{}-999-999", page.run),
    ] {
        let message = read(&mut Reader::new(Some(have)), &page).unwrap();
        assert!(message["hello"].is_object(), "{have}");
        assert_eq!(message["frames"].as_array().unwrap().len(), 1, "{have}");
    }
}

#[test]
fn a_player_that_goes_back_begins_again() {
    let mut page = Page::new();
    drive(&mut page, fifths(0, 100));
    let mut reader = Reader::new(None);
    let (_, have) = read_all(&mut reader, &page);
    drive(&mut page, fifths(50, 52));
    let message = read(&mut reader, &page).unwrap();
    assert!(message["hello"]["run"].as_str().unwrap() != have.split('-').next().unwrap());
    let (times, _) = read_all(&mut reader, &page);
    assert!(
        times.iter().all(|time| (250..260).contains(time)),
        "{times:?}"
    );
}

#[test]
fn old_readings_are_not_shown_as_the_present() {
    let mut page = Page::new();
    put(
        &mut page,
        Topic::Guard,
        0,
        &GuardState {
            friction_use: 0.5,
            ..GuardState::default()
        },
    );
    drive(&mut page, fifths(0, 3));
    let column = COLUMNS
        .iter()
        .position(|name| *name == "friction_use")
        .unwrap();
    let uses: Vec<Value> = (0..page.frames.end())
        .map(|i| {
            serde_json::from_str::<Value>(page.frames.get(i).unwrap()).unwrap()[column].clone()
        })
        .collect();
    assert_eq!(uses.first(), Some(&json!(0.5)));
    assert_eq!(uses.last(), Some(&Value::Null));
}

#[test]
fn the_reason_of_a_stop_stays_when_the_ramp_has_ended() {
    let mut page = Page::new();
    event(&mut page, 0, "waits_for", "waits for pose: no publisher");
    drive(&mut page, fifths(0, 1));
    assert_eq!(status(&page)["waits_for"], "waits for pose: no publisher");
    event(&mut page, SECOND_NS, "inputs", "all inputs arrive");
    event(
        &mut page,
        SECOND_NS,
        "state",
        "Driving -> Stopping: the pose is old: 2 s",
    );
    event(
        &mut page,
        SECOND_NS,
        "state",
        "Stopping -> Latched: the ramp has ended",
    );
    drive(&mut page, fifths(1, 2));
    let status = status(&page);
    assert_eq!(status["reason"], "the pose is old: 2 s");
    assert_eq!(status["waits_for"], "");
}

#[test]
fn diagnostics_come_by_name() {
    let mut page = Page::new();
    let status = message::DiagnosticStatus {
        name: "sidehill: controller".to_owned(),
        message: "tracking".to_owned(),
        values: vec![KeyValue {
            key: "drives".to_owned(),
            value: "short".to_owned(),
        }],
        ..message::DiagnosticStatus::default()
    };
    let array = DiagnosticArray {
        status: vec![status],
        ..DiagnosticArray::default()
    };
    put(&mut page, Topic::Diagnostics, 0, &array);
    let all: Value = serde_json::from_str(&page.parts["diagnostics"].1).unwrap();
    assert_eq!(all["controller"]["values"]["drives"], "short");
    assert_eq!(all["controller"]["message"], "tracking");
}

/// Returns a pose at a place with a rotation about an axis.
fn turned(x: f64, y: f64, axis: [f64; 3], angle_rad: f64) -> message::Pose {
    let (sin, cos) = (0.5 * angle_rad).sin_cos();
    message::Pose {
        position: Point { x, y, z: 0.0 },
        orientation: Quaternion {
            x: sin * axis[0],
            y: sin * axis[1],
            z: sin * axis[2],
            w: cos,
        },
    }
}

#[test]
fn ground_comes_as_a_grid() {
    // Triangles over six nodes, 2 m apart along x and 1 m along y.
    let node = |i: u32, j: u32| Point {
        x: 2.0 * f64::from(i) - 1.0,
        y: f64::from(j),
        z: 0.1 * f64::from(i) + f64::from(j),
    };
    let squares = [(0, 0), (1, 0)].map(|(i, j)| {
        let (a, b, c, d) = (
            node(i, j),
            node(i + 1, j),
            node(i + 1, j + 1),
            node(i, j + 1),
        );
        [a.clone(), b, c.clone(), a, c, d]
    });
    let marker = crate::scene::Marker {
        ns: "ground".to_owned(),
        points: squares.concat(),
        ..Default::default()
    };
    let scene = MarkerArray {
        markers: vec![marker],
    };
    let grid = ground(&scene).unwrap();
    assert_eq!(grid["corner"], json!([-1.0, 0.0]));
    assert_eq!(
        (&grid["size"], &grid["nodes"]),
        (&json!([4.0, 1.0]), &json!([3, 2]))
    );
    assert_eq!(grid["heights"], json!([0.0, 0.1, 0.2, 1.0, 1.1, 1.2]));
    assert!(ground(&MarkerArray::default()).is_none());
}

#[test]
fn obstacles_come_where_they_have_changed_and_at_a_stop() {
    let told = |page: &mut Page, time_s: u64, x: f64| {
        let obstacles = crate::Obstacles {
            cell_m: 0.05,
            rows: vec![[[x, 1.0], [x + 0.5, 1.0]]],
        };
        let scene = MarkerArray {
            markers: vec![crate::scene::obstacles(&obstacles, 0.0)],
        };
        put(page, Topic::Scene, time_s * SECOND_NS, &scene);
    };
    let mut page = Page::new();
    drive(&mut page, fifths(0, 1));
    told(&mut page, 1, 2.0);
    let mut reader = Reader::new(None);
    let first = read(&mut reader, &page).unwrap();
    assert_eq!(
        first["parts"]["obstacles"],
        json!([1.0, 0.05, 2, 1, 2.5, 1])
    );
    told(&mut page, 2, 2.0);
    assert!(read(&mut reader, &page).is_none_or(|message| message["parts"]["obstacles"].is_null()));
    told(&mut page, 3, 2.1);
    assert_eq!(
        read(&mut reader, &page).unwrap()["parts"]["obstacles"][2],
        2.1
    );
    assert!(!page.newest.contains_key(&Topic::Scene));

    // Of a whole drive of 10 min, every 3 s; and what is known when the state has changed.
    let mut drive = crate::live::WholeDrive::new(600 * SECOND_NS);
    for time_s in 0..10 {
        if time_s == 7 {
            event(
                &mut drive.0,
                7 * SECOND_NS,
                "state",
                "Driving -> Stopping: x",
            );
        }
        told(&mut drive.0, time_s, 0.1 * time_s as f64);
    }
    let all: Value = serde_json::from_str(&drive.json()).unwrap();
    let times: Vec<_> = all["obstacles"].as_array().unwrap().iter().collect();
    let times: Vec<f64> = times.iter().map(|view| view[0].as_f64().unwrap()).collect();
    assert_eq!(times, [0.0, 3.0, 6.0, 7.0]);
}

#[test]
fn places_where_the_vehicle_has_dug_in_stay_on_the_page() {
    let mut page = Page::new();
    drive(&mut page, fifths(0, 1));
    for number in 0..2_u8 {
        let pose = sidehill_plant::frames::Pose {
            x_m: 3.0,
            y_m: -1.25 * f64::from(number),
            ..Default::default()
        };
        let scene = MarkerArray {
            markers: vec![crate::scene::dug_in(i32::from(number), &pose)],
        };
        put(&mut page, Topic::Scene, SECOND_NS, &scene);
    }
    let mut reader = Reader::new(None);
    let first = read(&mut reader, &page).unwrap();
    assert_eq!(first["parts"]["dug_in"], json!([3, 0, 3, -1.25]));
    assert!(!page.newest.contains_key(&Topic::Scene));
}

#[test]
fn downhill_is_where_the_vehicle_leans() {
    // Rolled about its forward axis, which is x, so that the right side, towards -y, is down.
    let rolled = turned(0.0, 0.0, [1.0, 0.0, 0.0], 0.3);
    let [x, y] = downhill(&rolled.orientation);
    assert!(x.abs() < 1e-12 && (y + 0.3_f64.sin()).abs() < 1e-12);
    // A nose that is down by a turn about the left axis, which is y.
    let [x, y] = downhill(&turned(0.0, 0.0, [0.0, 1.0, 0.0], 0.3).orientation);
    assert!((x - 0.3_f64.sin()).abs() < 1e-12 && y.abs() < 1e-12);
    let turned = turned(0.0, 0.0, [0.0, 0.0, 1.0], FRAC_PI_2);
    assert!((heading_rad(&turned) - FRAC_PI_2).abs() < 1e-12);
}

proptest! {
    #[test]
    fn numbers_are_short_and_close(value in -1e7..1e7f64, digits in 0_usize..6) {
        let mut text = String::new();
        number(&mut text, value, digits);
        let read: f64 = serde_json::from_str::<Value>(&text).unwrap().as_f64().unwrap();
        prop_assert!((read - value).abs() <= 0.5001 * 10_f64.powi(-(digits as i32)), "{}", text);
        let whole = format!("{value:.digits$}");
        prop_assert!(text.len() <= whole.len());
    }

    #[test]
    fn a_shortened_path_stays_where_it_was(radius_m in 0.5..20.0f64, round_rad in 0.5..6.0f64) {
        let count = (radius_m * round_rad / 0.1).ceil().max(2.0) as usize;
        let at = |i: usize| round_rad * i as f64 / count as f64;
        let place = |angle: f64| [radius_m * angle.cos(), radius_m * angle.sin()];
        let poses = (0..=count).map(|i| {
            let [x, y] = place(at(i));
            let pose = turned(x, y, [0.0, 0.0, 1.0], at(i) + FRAC_PI_2);
            PoseStamped { pose, ..PoseStamped::default() }
        });
        let path = Path { poses: poses.collect(), ..Path::default() };
        let shown: Vec<f64> = serde_json::from_str(&points(&path)).unwrap();
        let shown: Vec<[f64; 2]> = shown.chunks(2).map(|at| [at[0], at[1]]).collect();
        prop_assert!(shown.len() <= count + 1);
        for i in 0..=count {
            let [x, y] = place(at(i));
            let nearest = shown.windows(2).map(|ends| {
                let [[ax, ay], [bx, by]] = [ends[0], ends[1]];
                let (dx, dy) = (bx - ax, by - ay);
                let share = (((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy).max(1e-12)).clamp(0.0, 1.0);
                (x - ax - share * dx).hypot(y - ay - share * dy)
            });
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            // The sagitta of a chord of 0.1 rad, and two digits.
            prop_assert!(nearest <= radius_m * (1.0 - (0.1_f64 / 2.0).cos()) + 0.1_f64.powi(2) / 8.0 / radius_m + 0.008, "{}", nearest);
        }
    }
}

#[test]
fn numbers_that_are_none_are_null() {
    for value in [f64::NAN, f64::INFINITY] {
        let mut text = String::new();
        number(&mut text, value, 4);
        assert_eq!(text, "null");
    }
    for (value, digits, expected) in [
        (-0.00001, 4, "0"),
        (100.0, 2, "100"),
        (100.0, 0, "100"),
        (-2.50, 4, "-2.5"),
        (0.0, 4, "0"),
    ] {
        let mut text = String::new();
        number(&mut text, value, digits);
        assert_eq!(text, expected);
    }
}
