//! `sidehill can test`: motors that are turned while a key is held.

use super::assert_off;
use super::cia402::of_cia402;
use super::running::Running;
use super::support::*;
use crate::program::{repository, sidehill};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, tcgetattr};
use serde_json::Value;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest time from the last repeat of the key to standstill, s: a repeat is late, the cycle that looks, the one that sends,
/// and the brakes.
const RELEASE_S: f64 = 0.2 + 2.0 * 0.05 + 0.05 / 2.0;

/// A person at a terminal in which `can test` runs.
struct Operator {
    process: Running,
    keyboard: Option<File>,
    holds: Arc<AtomicBool>,
    said: std::path::PathBuf,
    verdict: std::path::PathBuf,
}

impl Operator {
    fn start(folder: &Folder, config: &str, arguments: &[&str]) -> Self {
        let master =
            openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let terminal = OpenOptions::new()
            .read(true)
            .write(true)
            .open(name.to_str().unwrap())
            .unwrap();
        let keyboard = File::from(master);
        let (said, verdict) = (folder.0.join("said.out"), folder.0.join("verdict.json"));
        let process = Running::start(
            sidehill()
                .args(["can", "test", config, "--format", "json"])
                .args(arguments)
                .stdin(terminal)
                .stderr(File::create(&said).unwrap())
                .stdout(File::create(&verdict).unwrap()),
        );
        let holds = Arc::new(AtomicBool::new(false));
        let (held, mut keys) = (Arc::clone(&holds), keyboard.try_clone().unwrap());
        // A key that is held repeats, until the test ends.
        std::thread::spawn(move || {
            loop {
                if Arc::strong_count(&held) == 1 {
                    return;
                }
                if held.load(Ordering::Relaxed) {
                    let _ = keys.write_all(b" ");
                }
                sleep_s(0.04);
            }
        });
        Self {
            process,
            keyboard: Some(keyboard),
            holds,
            said,
            verdict,
        }
    }

    fn said(&self) -> String {
        std::fs::read_to_string(&self.said).unwrap()
    }

    /// Waits until it has said words so many times.
    fn wait_for(&self, words: &str, times: usize) {
        let start = std::time::Instant::now();
        while self.said().matches(words).count() < times {
            let waited = start.elapsed() < Duration::from_secs(40);
            assert!(waited, "no `{words}`:\n{}", self.said());
            sleep_s(0.02);
        }
    }

    fn hold(&self, holds: bool) {
        self.holds.store(holds, Ordering::Relaxed);
    }

    fn type_line(&mut self, line: &str) {
        writeln!(self.keyboard.as_mut().unwrap(), "{line}").unwrap();
    }

    /// Turns both motors and answers, and returns the exit status and the verdict.
    fn go_through(&mut self, answers: [&str; 2]) -> (Option<i32>, Value) {
        for (i, answer) in answers.into_iter().enumerate() {
            self.wait_for("hold the space bar", i + 1);
            self.hold(true);
            self.wait_for("What moved?", i + 1);
            self.hold(false);
            self.type_line(answer);
        }
        let status = self.end();
        let verdict = std::fs::read_to_string(&self.verdict).unwrap();
        println!("{}{verdict}", self.said());
        (status, serde_json::from_str(&verdict).unwrap())
    }

    /// Waits for its end and returns the exit status.
    fn end(&mut self) -> Option<i32> {
        wait_until("end", || self.process.0.try_wait().unwrap().is_some());
        self.process.0.wait().unwrap().code()
    }

    fn signal(&self, signal: Signal) {
        let id = rustix::process::Pid::from_raw(self.process.0.id() as i32).unwrap();
        rustix::process::kill_process(id, signal).unwrap();
    }
}

impl Drop for Operator {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("{}", self.said());
        }
    }
}

/// Writes a run whose layout differs from the vehicle's.
fn config(folder: &Folder, change: impl Fn(String) -> String) -> String {
    let file = |name: &str| repository("config/bridge").join(name);
    std::fs::copy(file("cia402.dbc"), folder.0.join("cia402.dbc")).unwrap();
    let text = std::fs::read_to_string(file("cia402.yaml")).unwrap();
    std::fs::write(folder.0.join("cia402.yaml"), change(text)).unwrap();
    with_layout(folder, "cia402.yaml")
}

fn with_layout(folder: &Folder, name: &str) -> String {
    let layout = repository("config/bridge/can.yaml").display().to_string();
    configuration(folder, "run_vcan0.yaml", |text| {
        assert!(text.contains(&layout));
        text.replace(&layout, &folder.0.join(name).display().to_string())
    })
}

const COMMAND: &str = "target_velocity: {signal: TargetVelocity, per_unit: 940.0}";
const FEEDBACK: &str = "actual_velocity: {signal: VelocityActual, per_unit: 940.0}";

/// Returns the text with what follows the last place of `old` that is in it as it was.
fn replace_last(text: &str, old: &str, new: &str) -> String {
    let at = text.rfind(old).unwrap();
    format!("{}{new}{}", &text[..at], &text[at + old.len()..])
}

/// Returns the greatest speeds of both motors by the truth, m/s.
fn greatest_m_s(folder: &Folder) -> [f64; 2] {
    let truth = folder.truth();
    [|row: &Truth| row.traction_m_s, |row: &Truth| row.steer_m_s]
        .map(|speed| truth.iter().map(|row| speed(row).abs()).fold(0.0, f64::max))
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_layout_that_is_right_is_found_right_by_turning_one_motor_at_a_time() {
    let folder = Folder::new("test_right");
    let vehicle = Program::vehicle_changed(&folder, of_cia402);
    let config = config(&folder, |text| text);
    let mut operator = Operator::start(&folder, &config, &[]);
    let (status, verdict) = operator.go_through(["f", "f"]);
    drop(vehicle);
    assert_eq!(status, Some(0));
    for motor in verdict["motors"].as_array().unwrap() {
        assert_eq!(motor["complaints"], Value::Array(Vec::new()));
        let number = |key: &str| motor[key].as_f64().unwrap();
        assert!((number("gain") - 1.0).abs() < 0.05, "{motor}");
        // 4096 counts in a turn, 940 turns a minute in 1 m/s.
        let counts_per_m = 4096.0 * 940.0 / 60.0;
        assert!(
            (number("counts_per_m") / counts_per_m - 1.0).abs() < 0.05,
            "{motor}"
        );
    }
    let greatest = greatest_m_s(&folder);
    println!("greatest speeds {greatest:?}");
    assert!(greatest.iter().all(|speed| (0.045..0.055).contains(speed)));
    let truth = folder.truth();
    let both = truth
        .iter()
        .filter(|row| row.traction_m_s.abs() > 0.01 && row.steer_m_s.abs() > 0.01);
    assert_eq!(both.count(), 0, "both motors turned at once");
    assert!(truth.last().unwrap().off());
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_wrong_sign_and_a_wrong_unit_are_found_and_the_corrected_layout_is_right() {
    let folder = Folder::new("test_wrong");
    let _vehicle = Program::vehicle_changed(&folder, of_cia402);
    let wrong = config(&folder, |text| {
        let text = text.replacen(COMMAND, &COMMAND.replace("940.0", "-940.0"), 1);
        // Reported in tenths.
        replace_last(&text, FEEDBACK, &FEEDBACK.replace("940.0", "9400.0"))
    });
    let fixed = folder.0.join("fixed.yaml").display().to_string();
    let mut operator = Operator::start(&folder, &wrong, &["--write", &fixed]);
    let (status, verdict) = operator.go_through(["b", "f"]);
    assert_eq!(status, Some(1));
    let corrections = verdict["corrections"].as_array().unwrap();
    let to: Vec<_> = corrections
        .iter()
        .map(|correction| (correction["key"].as_str().unwrap(), &correction["to"]))
        .collect();
    assert_eq!(
        to,
        [
            (
                "cia402.drives[0].command.target_velocity.per_unit",
                &940.0.into()
            ),
            (
                "cia402.drives[1].feedback.actual_velocity.per_unit",
                &940.0.into()
            ),
        ]
    );
    // All of the corrected file is that of the vehicle, comments included.
    let text = |path| std::fs::read_to_string(path).unwrap();
    assert_eq!(
        text(fixed.as_str().into()),
        text(repository("config/bridge/cia402.yaml"))
    );
    // It is not overwritten.
    let mut operator = Operator::start(&folder, &wrong, &["--write", &fixed]);
    assert_eq!(operator.end(), Some(2));
    assert!(
        operator.said().contains("exists already"),
        "{}",
        operator.said()
    );
    let config = with_layout(&folder, "fixed.yaml");
    let mut operator = Operator::start(&folder, &config, &[]);
    let (status, _) = operator.go_through(["f", "f"]);
    assert_eq!(status, Some(0));
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_unit_that_is_far_off_and_a_wrong_resolution_are_found() {
    let folder = Folder::new("test_far_off");
    let _vehicle = Program::vehicle_changed(&folder, of_cia402);
    let config = config(&folder, |text| {
        // It is set up for encoder lines in place of edges; the other reports a hundred times its speed.
        let line = "- {object: 0x6060, type: i8, value: 3}";
        let resolution = "- {object: 0x608F, sub: 1, type: u32, value: 1024}";
        assert!(text.contains("setup: *setup"));
        let setup = format!(
            "setup:\n        {line}\n        {resolution}\n        - {{object: 0x1017, type: u16, value: 50}}\n        - {{object: 0x1800, sub: 5, type: u16, value: 25}}"
        );
        let text = text.replace("setup: *setup", &setup);
        text.replacen(FEEDBACK, &FEEDBACK.replace("940.0", "9.4"), 1)
    });
    let mut operator = Operator::start(&folder, &config, &[]);
    // A quarter of 0.25 m.
    let (status, verdict) = operator.go_through(["f", "f 0.0625"]);
    assert_eq!(status, Some(1));
    let said = |motor: usize| verdict["motors"][motor]["complaints"].to_string();
    assert!(
        said(0).contains("set cia402.drives[0].feedback.actual_velocity.per_unit to 9"),
        "{}",
        said(0)
    );
    assert!(
        said(1).contains("set its object 0x608F:01 to 4096"),
        "{}",
        said(1)
    );
    // The safety has stopped the motor that seemed to run away.
    assert!(
        operator.said().contains("stopped after 0."),
        "{}",
        operator.said()
    );
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_key_that_is_let_go_and_every_other_end_stop_the_motor() {
    for (name, layout) in [("cia402", true), ("values", false)] {
        for end in [
            "let go",
            "other key",
            "interrupt",
            "terminate",
            "hang up",
            "kill",
        ] {
            let folder = Folder::new(&format!("test_end_{name}_{}", end.replace(' ', "_")));
            let vehicle = Program::vehicle_changed(&folder, |text| match layout {
                true => of_cia402(text),
                false => text,
            });
            let config = match layout {
                true => config(&folder, |text| text),
                false => configuration(&folder, "run_vcan0.yaml", |text| text),
            };
            let mut operator = Operator::start(&folder, &config, &[]);
            operator.wait_for("hold the space bar", 1);
            let modes = |operator: &Operator| {
                let keyboard = operator.keyboard.as_ref().unwrap();
                tcgetattr(keyboard).unwrap().local_modes
            };
            let lines = LocalModes::ICANON | LocalModes::ECHO;
            assert!(!modes(&operator).intersects(lines));
            operator.hold(true);
            sleep_s(3.0);
            let ended_s = unix_now_s();
            let (status, limit_s) = match end {
                "let go" => {
                    operator.hold(false);
                    (None, RELEASE_S + 0.04)
                }
                "other key" => {
                    operator.hold(false);
                    operator.keyboard.as_mut().unwrap().write_all(b"x").unwrap();
                    (None, 2.0 * 0.05 + 0.05)
                }
                "interrupt" => {
                    operator.signal(Signal::INT);
                    (Some(2), 2.0 * 0.05 + 0.05)
                }
                "terminate" => {
                    operator.signal(Signal::TERM);
                    (Some(2), 2.0 * 0.05 + 0.05)
                }
                "hang up" => {
                    operator.hold(false);
                    // The thread of the key has the other end.
                    operator.holds = Arc::default();
                    operator.keyboard = None;
                    (Some(2), RELEASE_S + 0.04)
                }
                _ => {
                    operator.signal(Signal::KILL);
                    // The drives' own time-out.
                    (Some(0), 0.2 + 3.0 * 0.05)
                }
            };
            if status == Some(2) {
                assert_eq!(operator.end(), Some(2), "{end}");
                if operator.keyboard.is_some() {
                    assert!(
                        modes(&operator).contains(lines),
                        "{end}: the terminal stays raw"
                    );
                }
            }
            sleep_s(2.5);
            drop(vehicle);
            let truth = folder.truth();
            let before = truth.iter().filter(|row| row.unix_s < ended_s);
            let turned = before.map(|row| row.traction_m_s).fold(0.0, f64::max);
            assert!(
                (0.04..0.055).contains(&turned),
                "{end}: it turned at {turned} m/s"
            );
            assert_off(
                &format!("can test, {name}: {end}"),
                standing_after_s(&truth, ended_s),
                limit_s,
            );
        }
    }
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_test_that_was_suspended_does_not_go_on_before_the_key_is_let_go() {
    for (name, is_cia402) in [("cia402", true), ("values", false)] {
        let folder = Folder::new(&format!("test_suspended_{name}"));
        let vehicle = Program::vehicle_changed(&folder, |text| match is_cia402 {
            true => of_cia402(text),
            false => text,
        });
        let config = match is_cia402 {
            true => config(&folder, |text| text),
            false => configuration(&folder, "run_vcan0.yaml", |text| text),
        };
        let mut operator = Operator::start(&folder, &config, &[]);
        operator.wait_for("hold the space bar", 1);
        operator.hold(true);
        sleep_s(3.0);
        let suspended_s = unix_now_s();
        operator.signal(Signal::STOP);
        sleep_s(0.8);
        let resumed_s = unix_now_s();
        operator.signal(Signal::CONT);
        // The key is still held.
        sleep_s(2.5);
        let held_s = unix_now_s();
        operator.hold(false);
        assert!(operator.said().contains("stopped after"));
        operator.type_line("f");
        operator.wait_for("hold the space bar", 2);
        operator.hold(true);
        sleep_s(2.0);
        drop(operator);
        drop(vehicle);
        let truth = folder.truth();
        let greatest = |from_s: f64, to_s: f64| {
            let rows = truth
                .iter()
                .filter(|row| (from_s..to_s).contains(&row.unix_s));
            rows.map(|row| row.traction_m_s.abs().max(row.steer_m_s.abs()))
                .fold(0.0, f64::max)
        };
        assert!(greatest(0.0, suspended_s) > 0.04);
        // The drives' own time-out.
        assert_eq!(
            greatest(suspended_s + 0.2 + 3.0 * 0.05, resumed_s),
            0.0,
            "{name}"
        );
        let again = greatest(resumed_s, held_s);
        println!("can test, {name}: greatest speed after it was resumed {again} m/s");
        assert!(again < 0.005, "{name}: {again} m/s");
        assert!(greatest(held_s, f64::INFINITY) > 0.01, "{name}");
    }
}
