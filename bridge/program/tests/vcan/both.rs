//! The normal set-up on a vehicle: drives told over CAN, paths and the emergency stop over ROS 2.

use super::support::*;
use super::{
    COMMANDS_OFF_AFTER_SILENCE_S, CYCLE_S, DRIVES_OFF_AFTER_SILENCE_S, RAMP_S, assert_off,
    print_timing,
};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::Duration;

/// Statuses of a goal and codes of nav2_msgs/FollowPath.
const SUCCEEDED: i64 = 4;
const CANCELED: i64 = 5;
const ABORTED: i64 = 6;
const UNKNOWN: i64 = 100;
const TF_ERROR: i64 = 102;
/// Levels of diagnostics.
const ERROR: i64 = 2;

/// An independent client of the action, which also holds the emergency stop.
struct Client {
    child: Child,
    orders: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Client {
    fn start(domain: u16) -> Self {
        let mut child = python("goals.py", &[&domain.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let orders = child.stdin.take().unwrap();
        let answers = BufReader::new(child.stdout.take().unwrap());
        let mut client = Self {
            child,
            orders,
            answers,
        };
        assert_eq!(client.line(), "ready\n");
        client
    }

    /// The client's own time limit bounds this wait; an end without output fails.
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.answers.read_line(&mut line).unwrap();
        line
    }

    fn ask(&mut self, order: &str) -> Value {
        writeln!(self.orders, "{order}").unwrap();
        let line = self.line();
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{order}: {error}: {line}"))
    }

    #[track_caller]
    fn assert_result(&mut self, status: i64, code: i64, message: &str) {
        let result = self.ask("result");
        println!("{result}");
        assert_eq!(result["status"], status, "{result}");
        assert_eq!(result["code"], code, "{result}");
        let told = result["message"].as_str().unwrap();
        assert!(told.contains(message), "{result}");
        assert_eq!(told.is_empty(), status == SUCCEEDED, "{result}");
    }

    #[track_caller]
    fn assert_accepted(&mut self, order: &str, accepted: bool) {
        assert_eq!(self.ask(order)["accepted"], accepted, "{order}");
    }

    #[track_caller]
    fn assert_stopped_by(&mut self, told: &str) {
        let diagnostics = self.ask("diagnostics");
        let stopped_by = diagnostics["stopped_by"].as_str().unwrap();
        assert!(stopped_by.contains(told), "{diagnostics}");
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A vehicle and a controller on the bus, a client on ROS 2, and an observer of the bus.
struct Rig {
    folder: Folder,
    observer: Observer,
    vehicle: Program,
    run: Program,
    client: Client,
}

impl Rig {
    fn new(name: &str) -> Self {
        // A separate domain for each test, so that tests do not interfere.
        static TESTS: AtomicU16 = AtomicU16::new(1);
        let domain = TESTS.fetch_add(1, Ordering::Relaxed);
        let folder = Folder::new(name);
        let observer = Observer::start();
        let vehicle = Program::vehicle(&folder, "");
        let run = Program::run_for_goals(&folder, domain);
        Self {
            client: Client::start(domain),
            folder,
            observer,
            vehicle,
            run,
        }
    }

    /// Sends a goal that is driven, with a handshake before it.
    #[track_caller]
    fn drive(&mut self) {
        let before = self.observer.seen().len();
        self.client.assert_accepted("straight 15", true);
        self.observer.wait_for_driving(1.0);
        let seen = self.observer.seen().split_off(before);
        let enabled = seen.iter().position(|s| s.enable).unwrap();
        let moved = seen.iter().position(|s| !s.zero).unwrap();
        assert!(moved > enabled, "{seen:?}");
        let events = self.folder.events();
        let states = events.lines().filter_map(|line| {
            let event: Value = serde_json::from_str(line).unwrap();
            Some((event["to"].as_str()?.to_owned(), event["time_s"].as_f64()?))
        });
        let states: Vec<(String, f64)> = states.collect();
        let [.., zeroing, enabling, driving] = &states[..] else {
            panic!("{states:?}");
        };
        let names = [zeroing, enabling, driving].map(|(state, _)| state.as_str());
        assert_eq!(names, ["zeroing", "enabling", "driving"]);
        assert!(enabling.1 - zeroing.1 >= 0.2, "{states:?}");
    }

    /// Asserts that nothing moves for a while.
    #[track_caller]
    fn assert_stays_off(&self) {
        let before = self.observer.seen().len();
        sleep_s(1.0);
        let seen = self.observer.seen().split_off(before);
        assert!(!seen.is_empty() && seen.iter().all(|s| !s.enable && s.zero));
    }
}

/// A cycle of the record.
#[derive(serde::Deserialize)]
struct Row {
    state: String,
    cross_track_m: Option<f64>,
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_goal_of_ros_2_is_driven_over_can() {
    let mut rig = Rig::new("both_figure_eight");
    let client = &mut rig.client;
    let idle = client.ask("diagnostics");
    assert_eq!(idle["cross_track_m"], "NaN", "{idle}");
    client.assert_accepted("figure_eight", true);
    rig.observer.wait_for_driving(2.0);
    let diagnostics = client.ask("diagnostics");
    println!("{diagnostics}");
    assert_eq!(diagnostics["safety"], "driving");
    let number = |key: &str| diagnostics[key].as_str().unwrap().parse::<f64>().unwrap();
    assert!(number("cross_track_m").abs() < 0.03);
    assert!(number("solve_p50_us") > 0.0 && number("cycles") > 40.0);
    client.assert_result(SUCCEEDED, 0, "");
    client.assert_stopped_by("the reference has been followed to its end");
    let feedback = client.ask("feedback");
    println!("feedback {feedback}");
    assert!(feedback["count"].as_u64().unwrap() > 100);
    assert!((feedback["first_m"].as_f64().unwrap() - 26.6).abs() < 1.0);
    assert!(feedback["last_m"].as_f64().unwrap() < 0.5);

    rig.run.signal(Signal::TERM);
    let ending = rig.run.wait(Duration::from_secs(5));
    assert_eq!(ending["ended"], "signal");
    print_timing(&ending);
    assert_eq!(ending["unsent"], 0);
    let rms_m = cross_track_rms_m(&rig.folder.truth(), 800);
    println!("CAN and ROS 2: cross-track RMS {rms_m:.4} m");
    assert!(rms_m <= 0.03, "{rms_m}");
    decode_with_cantools(&rig.folder, "j8.dbc");

    // Without a path there is no cross-track error: before the goal and after it.
    let file = rig.folder.0.join("run/cycles.csv");
    let mut reader = csv::Reader::from_path(file).unwrap();
    let rows: Vec<Row> = reader.deserialize().collect::<Result<_, _>>().unwrap();
    let driving: Vec<&Row> = rows.iter().filter(|row| row.state == "driving").collect();
    assert!(driving.len() > 800);
    // A drive starts with a new estimate, which needs the first readings.
    for row in &driving[10..] {
        assert!(row.cross_track_m.unwrap().abs() < 0.05);
    }
    for row in [rows.first(), rows.last()] {
        assert_eq!(row.unwrap().cross_track_m, None);
    }
    drop(rig.vehicle);
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn the_emergency_stop_of_ros_2_and_a_cancel_stop_the_drives_on_the_bus() {
    let mut rig = Rig::new("both_stops");
    rig.drive();
    let pressed_s = unix_now_s();
    rig.client.ask("press");
    rig.client
        .assert_result(ABORTED, UNKNOWN, "the emergency stop is pressed");
    sleep_s(1.0);
    let took_s = rig.observer.off_after_s(pressed_s);
    assert_off("emergency stop of ROS 2", took_s, 2.0 * CYCLE_S);
    let pressed = rig.client.ask("diagnostics");
    assert_eq!(pressed["level"], ERROR, "{pressed}");
    assert_eq!(pressed["emergency_stop"], "true", "{pressed}");
    rig.client
        .assert_stopped_by("the emergency stop is pressed");
    // While it is pressed nothing moves, and releasing it does not start driving.
    rig.client.assert_accepted("straight 15", true);
    rig.client
        .assert_result(ABORTED, UNKNOWN, "the emergency stop is pressed");
    rig.client.ask("release");
    rig.assert_stays_off();

    rig.drive();
    let asked_s = unix_now_s();
    assert_eq!(rig.client.ask("cancel")["return_code"], 0);
    rig.client.assert_result(CANCELED, 0, "cancelled");
    sleep_s(1.0);
    let took_s = rig.observer.off_after_s(asked_s);
    assert_off("goal cancelled", took_s, RAMP_S + 3.0 * CYCLE_S);
    rig.client.assert_stopped_by("the goal was cancelled");

    rig.drive();
    let asked_s = unix_now_s();
    rig.run.signal(Signal::TERM);
    let ending = rig.run.wait(Duration::from_secs(5));
    assert_eq!(ending["ended"], "signal");
    let took_s = rig.observer.off_after_s(asked_s);
    assert_off("SIGTERM with ROS 2", took_s, 2.0 * CYCLE_S);
    let events = rig.folder.events();
    for told in [
        "the emergency stop is pressed",
        "the goal was cancelled",
        "the program ends",
    ] {
        assert!(events.contains(told), "no {told}:\n{events}");
    }
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_bus_that_falls_silent_ends_the_goal_and_another_drives_again() {
    let mut rig = Rig::new("both_silence");
    rig.drive();
    rig.vehicle.signal(Signal::STOP);
    let frozen_s = unix_now_s();
    rig.client
        .assert_result(ABORTED, TF_ERROR, "the feedback is 0.");
    rig.assert_stays_off();
    let took_s = rig.observer.off_after_s(frozen_s);
    assert_off("vehicle frozen", took_s, COMMANDS_OFF_AFTER_SILENCE_S);
    rig.client.assert_stopped_by("the feedback is 0.");
    rig.vehicle.signal(Signal::CONT);
    rig.assert_stays_off();

    rig.drive();
    ip(&["link", "set", BUS, "down"]);
    rig.client
        .assert_result(ABORTED, UNKNOWN, "the link to the drives is Down");
    let last_s = rig.observer.seen().last().unwrap().unix_s;
    ensure_bus();
    rig.assert_stays_off();
    let took_s = standing_after_s(&rig.folder.truth(), last_s);
    let limit_s = DRIVES_OFF_AFTER_SILENCE_S;
    assert_off("interface down, drives stand", took_s, limit_s);
    rig.client
        .assert_stopped_by("the link to the drives is Down");
    rig.drive();
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_program_that_was_suspended_stops_the_drives_and_ends() {
    let mut rig = Rig::new("both_suspended");
    rig.drive();
    rig.run.signal(Signal::STOP);
    let frozen_s = unix_now_s();
    sleep_s(1.5);
    let took_s = standing_after_s(&rig.folder.truth(), frozen_s);
    let limit_s = DRIVES_OFF_AFTER_SILENCE_S;
    assert_off("program suspended, drives stand", took_s, limit_s);
    rig.run.signal(Signal::CONT);
    let ending = rig.run.wait(Duration::from_secs(5));
    assert_eq!(ending["ended"], "suspended");
    let last = *rig.observer.seen().last().unwrap();
    assert!(!last.enable && last.zero, "{last:?}");
    let events = rig.folder.events();
    assert!(events.contains("the program was suspended"), "{events}");
}
