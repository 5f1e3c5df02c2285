//! The cycle's times and threads: 100 Hz, real-time priority, a controller that hangs, a panic.

use super::support::*;
use super::{CYCLE_S, RAMP_S, assert_off, assert_rearms, print_timing};
use sidehill_bridge::control_loop::record::ring;
use sidehill_bridge::control_loop::runner::ControllerRunner;
use sidehill_bridge::control_loop::{ControlLoop, CycleConfig};
use sidehill_bridge::drives::{Clock, Epoch};
use sidehill_bridge::safety::{OperatorRequests, SafetyConfig, SafetyState};
use sidehill_can_port::CanPort;
use sidehill_controller::controller::{Decision, Status};
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::Vehicle;
use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Documented limit of docs/can.md, s: the time-out, a cycle until it acts, the ramp, and a cycle.
const COMMANDS_OFF_AFTER_A_HANG_S: f64 = 0.15 + CYCLE_S + RAMP_S + CYCLE_S;

/// A frozen thread of another program, as if it hung. A signal would stop the whole program; the freezer of control
/// groups (version 1) can freeze single threads.
struct Held;

const FREEZER: &str = "/run/freezer";

impl Held {
    fn hold(thread: u32) -> Self {
        let group = Path::new(FREEZER).join("held");
        if !group.exists() {
            std::fs::create_dir_all(FREEZER).unwrap();
            command(
                "mount",
                &["-t", "cgroup", "-o", "freezer", "freezer", FREEZER],
            );
            std::fs::create_dir(&group).unwrap();
        }
        std::fs::write(group.join("tasks"), thread.to_string()).unwrap();
        Self::set("FROZEN");
        Self
    }

    fn set(state: &str) {
        let file = Path::new(FREEZER).join("held/freezer.state");
        std::fs::write(&file, state).unwrap();
        while std::fs::read_to_string(&file).unwrap().trim() != state {
            sleep_s(0.001);
        }
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        Self::set("THAWED");
    }
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_controller_that_hangs_stops_until_re_armed_and_does_not_hold_the_end() {
    let folder = Folder::new("hang");
    let observer = Observer::start();
    let _vehicle = Program::vehicle(&folder, "");
    let run = Program::run(&folder, &["--arm"]);
    observer.wait_for_driving(2.0);
    let held = Held::hold(run.thread("controller"));
    let held_s = unix_now_s();
    sleep_s(2.0);
    drop(held);
    sleep_s(0.5);
    let took_s = observer.off_after_s(held_s);
    assert_off("controller hangs", took_s, COMMANDS_OFF_AFTER_A_HANG_S);
    assert!(folder.events().contains("the command is 0."));
    assert_rearms("hang", &run, &observer);

    // It does not delay the end of the program either; the kernel keeps the frozen thread until then.
    let held = Held::hold(run.thread("controller"));
    run.signal(Signal::TERM);
    sleep_s(2.0);
    let output = run.output();
    assert!(output.contains("\"ended\":\"signal\""), "{output}");
    drop(held);
    run.wait(Duration::from_secs(5));
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_program_that_is_frozen_and_thawed_does_not_move_by_itself() {
    let folder = Folder::new("frozen");
    let observer = Observer::start();
    let _vehicle = Program::vehicle(&folder, "");
    let run = Program::run(&folder, &["--arm"]);
    observer.wait_for_driving(2.0);
    run.signal(Signal::STOP);
    let frozen_s = unix_now_s();
    sleep_s(1.5);
    run.signal(Signal::CONT);
    sleep_s(1.5);
    let took_s = standing_after_s(&folder.truth(), frozen_s);
    assert_off(
        "program frozen, drives stand",
        took_s,
        super::DRIVES_OFF_AFTER_SILENCE_S,
    );
    let last = *observer.seen().last().unwrap();
    assert!(!last.enable && last.zero, "{last:?}");
    assert_rearms("frozen", &run, &observer);
}

/// Drives straight ahead until it panics.
struct Panicking {
    moving: u32,
    panicked_s: Arc<Mutex<Option<f64>>>,
}

impl ControllerRunner for Panicking {
    fn decide(&mut self, sample: &Sample, engaged: bool, _: Option<Duration>) -> Option<Decision> {
        self.moving += u32::from(engaged);
        if self.moving > 30 {
            *self.panicked_s.lock().unwrap() = Some(unix_now_s());
            panic!("on purpose");
        }
        Some(Decision::of_command(
            sample.time_s,
            MotorSpeeds {
                traction_m_s: 0.1 * f64::from(self.moving.min(5)),
                steer_m_s: 0.0,
            },
            Status::Tracking,
        ))
    }
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_panic_of_the_cycle_says_zero_and_off() {
    let folder = Folder::new("panic");
    let observer = Observer::start();
    let _vehicle = Program::vehicle(&folder, "");
    let panicked_s = Arc::new(Mutex::new(None));
    let pilot = Panicking {
        moving: 0,
        panicked_s: Arc::clone(&panicked_s),
    };
    let ended = std::thread::spawn(move || {
        let vehicle: Vehicle =
            serde_yaml::from_str(include_str!("../../../../config/vehicles/j8.yaml")).unwrap();
        let epoch = Epoch::now();
        let [(heard, _heard), (sent, _sent)] = [64; 2].map(ring);
        let (records, _records) = ring(64);
        let layout = Arc::new(layout());
        let port = CanPort::new(BUS, layout, vehicle.encoder_scale, epoch, heard, sent).unwrap();
        let mut cycle = ControlLoop::new(
            CycleConfig::default(),
            SafetyConfig::default(),
            Clock::Real(epoch),
            port,
            pilot,
            records,
        )
        .unwrap();
        let mut operator = OperatorRequests::default();
        for _ in 0..200 {
            let row = cycle.step(operator);
            operator.arm = row.feedback_age_s < 0.1 && row.state == SafetyState::Disarmed;
        }
    })
    .join();
    assert!(ended.is_err());
    let panicked_s = panicked_s.lock().unwrap().expect("it never drove");
    sleep_s(1.5);
    let seen = observer.seen();
    assert!(seen.iter().any(|seen| seen.enable && !seen.zero));
    assert_off("panic", observer.off_after_s(panicked_s), 0.0);
    let took_s = standing_after_s(&folder.truth(), panicked_s);
    // A report until the drives are seen off, and their own ramp from 0.5 m/s.
    assert_off("panic, drives stand", took_s, 0.25 + 2.0 * CYCLE_S);
}

/// The changes for 100 Hz from docs/can.md.
fn at_100_hz(text: String) -> String {
    assert_eq!(text.matches("period_s: 0.05").count(), 2);
    text.replace("period_s: 0.05", "period_s: 0.01")
        .replace("decision_time_s: 0.03", "decision_time_s: 0.006")
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_hundred_cycles_a_second_follow_the_path() {
    let folder = Folder::new("hundred");
    let _vehicle = Program::vehicle(&folder, "");
    let run = Program::run_changed(&folder, at_100_hz, &["--arm", "--duration-s", "15"]);
    let ending = run.wait(Duration::from_secs(25));
    print_timing(&ending);
    assert_eq!(ending["ended"], "time_over", "{}", folder.events());
    assert_eq!(ending["unsent"], 0);
    let count = |key: &str| ending[key].as_f64().unwrap();
    let (cycles, skipped) = (count("cycles"), count("skipped"));
    // From the first cycle on: how long the program takes to start is not what is measured here.
    let (first_s, last_s) = folder.cycle_times_s();
    let due = (last_s - first_s) / 0.01 + 1.0;
    assert!(first_s < 2.0 && last_s > 14.9, "{first_s} to {last_s} s");
    assert!((cycles + skipped - due).abs() < 3.0, "{due}, {ending}");
    // A kernel of 100 Hz may be a period late.
    assert!(skipped < 0.05 * cycles, "{ending}");
    let rms_m = cross_track_rms_m(&folder.truth(), 200);
    println!("100 Hz: cross-track RMS {rms_m:.4} m");
    assert!(rms_m <= 0.02, "{rms_m}");
}

const REALTIME: &str = "realtime: {fifo_priority: 50, cpu: 0, lock_memory: true}";

/// Real-time priority and policy of a thread, as the kernel has them; 1 is `SCHED_FIFO`.
fn scheduling(run: &Program, thread: &str) -> [u32; 2] {
    let file = format!("/proc/{}/task/{}/stat", run.id(), run.thread(thread));
    let stat = std::fs::read_to_string(file).unwrap();
    let after_name = stat.rsplit_once(')').unwrap().1;
    let fields: Vec<&str> = after_name.split_whitespace().collect();
    // Fields 40 and 41, of which the first two are before this.
    [fields[40 - 3], fields[41 - 3]].map(|field| field.parse().unwrap())
}

fn with_realtime(text: String) -> String {
    let commented =
        "# realtime: {fifo_priority: 50, helper_fifo_priority: 40, cpu: 1, lock_memory: true}";
    assert!(text.contains(commented));
    text.replace(commented, REALTIME)
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn real_time_settings_are_applied_or_refused_with_what_to_do() {
    let folder = Folder::new("realtime");
    let observer = Observer::start();
    let _vehicle = Program::vehicle(&folder, "");
    let run = Program::run_changed(&folder, with_realtime, &["--arm"]);
    observer.wait_for_driving(2.0);
    assert_eq!(scheduling(&run, "cycle"), [50, 1]);
    // Below the cycle's by default; threads that nobody waits for have none.
    assert_eq!(scheduling(&run, "controller"), [40, 1]);
    assert_eq!(scheduling(&run, "can-listener"), [40, 1]);
    assert_eq!(scheduling(&run, "can-opener"), [0, 0]);
    let task = format!("/proc/{}/task/{}", run.id(), run.thread("cycle"));
    let status = std::fs::read_to_string(format!("{task}/status")).unwrap();
    let value = |key: &str| {
        let line = status.lines().find(|line| line.starts_with(key)).unwrap();
        line[key.len()..].trim().to_owned()
    };
    assert_eq!(value("Cpus_allowed_list:"), "0");
    let locked = value("VmLck:");
    println!("SCHED_FIFO 50 and 40, CPU 0, locked {locked}");
    assert!(
        locked.trim_end_matches(" kB").parse::<u64>().unwrap() > 10_000,
        "{locked}"
    );
    run.signal(Signal::INT);
    let ending = run.wait(Duration::from_secs(5));
    print_timing(&ending);

    // A priority of their own, or none.
    for (helper, expected) in [("7", [7, 1]), ("0", [0, 0])] {
        let settings = format!("realtime: {{fifo_priority: 50, helper_fifo_priority: {helper}}}");
        let change = |text: String| with_realtime(text).replace(REALTIME, &settings);
        let run = Program::run_changed(&folder, change, &[]);
        // Once cycles are reported, both threads have their priorities.
        wait_until("cycles", || run.output().contains("lateness_s"));
        assert_eq!(scheduling(&run, "cycle"), [50, 1]);
        for thread in ["controller", "can-listener"] {
            assert_eq!(scheduling(&run, thread), expected, "{thread}");
        }
    }

    // The same without the capabilities.
    for (settings, expected) in [
        (
            "{fifo_priority: 50}",
            "SCHED_FIFO priority 50 is not permitted",
        ),
        ("{lock_memory: true}", "memory cannot be locked"),
        ("{cpu: 63}", "CPU 63 is not available"),
    ] {
        let change =
            |text: String| with_realtime(text).replace(REALTIME, &format!("realtime: {settings}"));
        let config = configuration(&folder, "run_vcan0.yaml", change);
        let output = Command::new("setpriv")
            .args([
                "--bounding-set=-sys_nice,-ipc_lock",
                env!("CARGO_BIN_EXE_sidehill-drive"),
            ])
            .args(["run", &config, "--duration-s", "2"])
            .output()
            .unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        println!("{text}");
        assert_eq!(output.status.code(), Some(2), "{text}");
        for part in [expected, "run_vcan0.yaml", "leave"] {
            assert!(text.contains(part), "no {part}: {text}");
        }
    }
}
