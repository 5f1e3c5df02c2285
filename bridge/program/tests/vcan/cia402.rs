//! Drives of CiA 402, played by canopen (PyPI).

use super::running::Running;
use super::support::*;
use super::{COMMANDS_OFF_AFTER_SILENCE_S, CYCLE_S, RAMP_S, assert_off, assert_rearms};
use sidehill_can::frame::{Frame, FrameId};
use sidehill_can_port::Sender;
use std::io::Write;
use std::path::Path;
use std::process::{ChildStdin, Command, Stdio};
use std::time::{Duration, Instant};

/// From the drives' setup: how long this program may be silent, s, how long commands may be missing, s, and their time to stop.
const CONSUMER_S: f64 = 0.2;
const DEADLINE_S: f64 = 0.2;
const QUICK_STOP_S: f64 = 0.75 / 3.0;
/// Age of the newest heartbeat or PDO, s.
const HEARTBEAT_S: f64 = 0.05;

/// The vehicle.
pub struct Peer {
    process: Running,
    input: ChildStdin,
}

impl Peer {
    pub fn start(folder: &Folder, heading_deg: f64) -> Self {
        let truth = folder.0.join("truth.csv").display().to_string();
        let heading = heading_deg.to_string();
        let database = database("cia402.dbc");
        let mut process = Running::start(
            python("cia402_vehicle.py", &[&database, BUS, &heading, &truth]).stdin(Stdio::piped()),
        );
        let input = process.0.stdin.take().unwrap();
        let mut peer = Self { process, input };
        let start = Instant::now();
        while !Path::new(&truth).exists() {
            // Its modules take long to load on a machine that others keep busy.
            assert!(start.elapsed() < Duration::from_secs(60), "no peer");
            assert!(
                peer.process.0.try_wait().unwrap().is_none(),
                "the peer has ended"
            );
            sleep_s(0.05);
        }
        peer
    }

    pub fn tell(&mut self, words: &str) {
        writeln!(self.input, "{words}").unwrap();
    }
}

pub fn of_cia402(text: String) -> String {
    assert!(text.contains("/can.yaml"));
    text.replace("/can.yaml", "/cia402.yaml")
}

fn run(folder: &Folder, arguments: &[&str], course: &str) -> Program {
    let change = |text: String| {
        assert!(text.contains(FIGURE_EIGHT));
        of_cia402(text).replace(FIGURE_EIGHT, course)
    };
    Program::run_changed(folder, change, arguments)
}

const FIGURE_EIGHT: &str = "{shape: figure_eight}";
const HEADING_DEG: f64 = -50.906;

/// Watches the PDOs to both drives.
fn observer() -> Observer {
    let mut newest = [(false, true); 2];
    let ids = [0x201, 0x202].map(FrameId::Standard);
    Observer::watch(&ids, move |frame| {
        let [low, high, target @ ..] = frame.data;
        let drive = ids.iter().position(|id| *id == frame.id)?;
        newest[drive] = (u16::from_le_bytes([low, high]) & 8 != 0, target == [0; 6]);
        let [(first_on, first_zero), (second_on, second_zero)] = newest;
        Some((first_on || second_on, first_zero && second_zero))
    })
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn drives_of_canopen_are_set_up_enabled_and_driven_forward_and_back() {
    let folder = Folder::new("cia402_drive");
    let _peer = Peer::start(&folder, 0.0);
    let course = "{shape: cusp, radius_m: 2, angle_deg: 50, turn: left, speed_m_s: 0.5}";
    let run = run(&folder, &["--arm"], course);
    let ending = run.wait(Duration::from_secs(40));
    println!("{ending}\n{}", folder.events());
    assert_eq!(ending["ended"], "finished");
    decode_with_cantools(&folder, "cia402.dbc");
    // The drives' own log.
    let truth = folder.truth();
    let range = |value: fn(&Truth) -> f64| {
        let values = || truth.iter().map(value);
        (values().fold(0.0, f64::min), values().fold(0.0, f64::max))
    };
    let (traction, steer) = (range(|row| row.traction_m_s), range(|row| row.steer_m_s));
    println!("traction {traction:?}, steer {steer:?}");
    assert!(traction.0 < -0.4 && traction.1 > 0.4, "{traction:?}");
    assert!(steer.1 > 0.1, "{steer:?}");
    let last = truth.last().unwrap();
    assert!(last.off(), "{last:?}");
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_node_that_does_not_answer_is_found_from_the_screen_alone() {
    let folder = Folder::new("cia402_silent");
    let run = run(&folder, &["--format", "text"], FIGURE_EIGHT);
    let start = Instant::now();
    let says = ["node 1: nothing answers", "node 2: nothing answers"];
    while !says.iter().all(|part| run.output().contains(part)) {
        let waited = start.elapsed() < Duration::from_secs(20);
        assert!(waited, "{}", run.output());
        sleep_s(0.1);
    }
    println!("{}", run.output());
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn faults_of_canopen_drives_stop_both_until_re_armed() {
    let folder = Folder::new("cia402_faults");
    let observer = observer();
    let mut peer = Peer::start(&folder, HEADING_DEG);
    let run = run(&folder, &["--arm"], FIGURE_EIGHT);
    observer.wait_for_driving(1.5);
    for (fault, end, limit_s) in [
        // Up to a report until it is known, and a cycle until it acts.
        ("fault steer", None, HEARTBEAT_S + CYCLE_S),
        ("stop traction", None, HEARTBEAT_S + CYCLE_S),
        (
            "mute traction",
            Some("talk traction"),
            HEARTBEAT_S + COMMANDS_OFF_AFTER_SILENCE_S,
        ),
        // The boot-up message comes at once; starting `cansend` takes its time.
        ("reset", None, 2.0 * CYCLE_S),
    ] {
        let begin_s = unix_now_s();
        if fault == "reset" {
            // By another NMT master.
            send_as_another("000#8101");
        } else {
            peer.tell(fault);
        }
        sleep_s(1.5);
        let took_s = observer.off_after_s(begin_s);
        assert_off(&format!("cia402: {fault}"), took_s, limit_s);
        if let Some(end) = end {
            peer.tell(end);
            sleep_s(0.5);
        }
        // Nothing has reset the fault or switched anything on by itself.
        assert!(folder.truth().last().unwrap().off(), "{fault}");
        assert_rearms(fault, &run, &observer);
    }
    let events = folder.events();
    for event in [
        "node 2: emergency 0x3210, error register 0x05",
        "a drive reports a fault",
        "the drives report an emergency stop",
        "the feedback is 0.2",
        "node 1: it has started",
        "a drive is off that was told to be on",
    ] {
        assert!(events.contains(event), "no {event}:\n{events}");
    }
    assert_eq!(events.matches("node 1: set up and operational").count(), 2);

    // The program dies: the drives miss its heartbeat.
    let killed_s = unix_now_s();
    drop(run);
    sleep_s(2.0);
    let took_s = standing_after_s(&folder.truth(), killed_s);
    assert_off(
        "cia402: controller killed, drives stand",
        took_s,
        CONSUMER_S + QUICK_STOP_S + CYCLE_S,
    );
}

/// Sends a frame as another master would; starting `cansend` takes its time.
pub fn send_as_another(frame: &str) {
    let sent = Command::new("cansend").args([BUS, frame]).status();
    assert!(sent.unwrap().success());
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn canopen_drives_that_another_master_makes_pre_operational_are_stopped_as_nodes() {
    let folder = Folder::new("cia402_pre_operational");
    let observer = observer();
    let _peer = Peer::start(&folder, HEADING_DEG);
    let run = run(&folder, &["--arm"], FIGURE_EIGHT);
    observer.wait_for_driving(1.5);
    let begin_s = unix_now_s();
    send_as_another("000#8000");
    sleep_s(1.5);
    // The drives keep their targets until a heartbeat and a cycle have told and stopped them.
    let took_s = standing_after_s(&folder.truth(), begin_s);
    let limit_s = HEARTBEAT_S + CYCLE_S + QUICK_STOP_S + 2.0 * CYCLE_S;
    assert_off("cia402: pre-operational, drives stand", took_s, limit_s);
    let events = folder.events();
    for event in [
        "node 1: no longer operational while on, stopped as a node",
        "node 2: no longer operational while on, stopped as a node",
        "a drive takes no commands: its node is not operational",
    ] {
        assert!(events.contains(event), "no {event}:\n{events}");
    }
    // The first arming sets the nodes up again, the second drives.
    run.signal(Signal::USR1);
    sleep_s(2.0);
    assert!(folder.truth().last().unwrap().off());
    assert_rearms("cia402: pre-operational", &run, &observer);
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn canopen_drives_stop_without_the_program_though_another_sends_its_heartbeat() {
    let folder = Folder::new("cia402_foreign_heartbeat");
    let observer = observer();
    let _peer = Peer::start(&folder, HEADING_DEG);
    let program = run(&folder, &["--arm"], FIGURE_EIGHT);
    observer.wait_for_driving(1.5);
    let mut foreign = Sender::start(BUS, &[]).unwrap();
    let heartbeat = Frame::new(FrameId::Standard(0x77F), &[0x05]).unwrap();
    let mut beat = |for_s: f64| {
        for _ in 0..(for_s / 0.05) as u32 {
            foreign.send(&heartbeat).unwrap();
            sleep_s(0.05);
        }
    };
    let killed_s = unix_now_s();
    drop(program);
    beat(2.0);
    let took_s = standing_after_s(&folder.truth(), killed_s);
    let limit_s = DEADLINE_S + QUICK_STOP_S + 2.0 * CYCLE_S;
    assert_off("cia402: foreign heartbeat, drives stand", took_s, limit_s);
    // A program that starts beside it does not arm.
    let before = observer.seen().len();
    let _program = run(&folder, &["--arm"], FIGURE_EIGHT);
    beat(4.0);
    assert!(
        observer.seen()[before..]
            .iter()
            // Until both drives have been commanded anew.
            .skip(2)
            .all(|seen| !seen.enable && seen.zero)
    );
    let events = folder.events();
    let told = "77F#05: another node sends with an identifier of this program";
    assert!(events.contains(told), "{events}");
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn canopen_drives_that_report_wrong_speeds_are_stopped() {
    for (fault, limit_s, reasons) in [
        // Until the commands of the curve have changed by 0.03 m/s; then 0.5 s, a cycle, the ramp, a cycle.
        (
            "freeze",
            1.0 + 0.5 + 2.0 * CYCLE_S + RAMP_S,
            ["stays the same to the bit while", "differs by"],
        ),
        // Two reports, a cycle, the ramp, a cycle.
        (
            "mirror",
            4.0 * CYCLE_S + RAMP_S,
            ["differs by", "differs by"],
        ),
    ] {
        let folder = Folder::new(&format!("cia402_{fault}"));
        let observer = observer();
        let mut peer = Peer::start(&folder, HEADING_DEG);
        let _run = run(&folder, &["--arm"], FIGURE_EIGHT);
        observer.wait_for_driving(4.0);
        let begin_s = unix_now_s();
        for drive in ["traction", "steer"] {
            peer.tell(&format!("{fault} {drive}"));
        }
        sleep_s(4.0);
        let took_s = standing_after_s(&folder.truth(), begin_s);
        assert_off(&format!("cia402: {fault}, drives stand"), took_s, limit_s);
        let events = folder.events();
        let known = reasons.iter().any(|reason| events.contains(reason));
        assert!(known, "{events}");
    }
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn canopen_drives_that_another_master_changes_or_switches_on_are_stopped() {
    let folder = Folder::new("cia402_another_master");
    let observer = observer();
    let _peer = Peer::start(&folder, HEADING_DEG);
    let run = run(&folder, &["--arm"], FIGURE_EIGHT);
    observer.wait_for_driving(1.5);
    let begin_s = unix_now_s();
    // Profile position, by an SDO.
    send_as_another("601#2F60600001000000");
    sleep_s(1.5);
    // Two looks at the display, each with an answer a cycle later, and a cycle until it acts.
    let limit_s = 2.0 * (0.1 + CYCLE_S) + 2.0 * CYCLE_S;
    assert_off("cia402: other mode", observer.off_after_s(begin_s), limit_s);
    let told = |what: &str| {
        let events = folder.events();
        assert!(events.contains(what), "no {what}:\n{events}");
    };
    told("node 1: on in mode of operation 1 (object 0x6061)");
    told("a drive does not follow speeds: its mode of operation was changed");
    // The first arming sets the drive up again, the second drives.
    run.signal(Signal::USR1);
    sleep_s(2.0);
    assert_rearms("cia402: other mode", &run, &observer);
    run.signal(Signal::USR2);
    sleep_s(3.0);
    assert!(folder.truth().last().unwrap().off());
    let mut foreign = Sender::start(BUS, &[]).unwrap();
    let event = "node 2: switched on by another node, stopped as a node";
    wait_until(event, || {
        for word in [0x06, 0x07, 0x0F] {
            let frame = Frame::new(FrameId::Standard(0x202), &[word, 0, 0x10, 0x10, 0, 0]);
            foreign.send(&frame.unwrap()).unwrap();
        }
        folder.events().contains(event)
    });
    sleep_s(1.0);
    assert!(folder.truth().last().unwrap().off());
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn canopen_drives_that_refuse_or_do_not_obey_are_told_of_and_stopped() {
    let folder = Folder::new("cia402_refusal");
    let observer = observer();
    let mut peer = Peer::start(&folder, HEADING_DEG);
    peer.tell("refuse steer 605A");
    let program = run(&folder, &["--arm"], FIGURE_EIGHT);
    sleep_s(5.5);
    assert!(observer.seen().iter().all(|seen| !seen.enable && seen.zero));
    let refusal = "node 2: not set up: object 0x605A:00: refused with abort code 0x06090030, \
                   value range exceeded";
    let events = folder.events();
    assert_eq!(events.matches(refusal).count(), 1, "{events}");
    peer.tell("accept steer");
    wait_until("setup", || {
        folder.events().contains("node 2: set up and operational")
    });
    // The request of the start has expired.
    sleep_s(1.0);
    assert!(observer.seen().iter().all(|seen| !seen.enable && seen.zero));
    program.signal(Signal::USR1);
    observer.wait_for_driving(1.5);
    let asked_s = unix_now_s();
    program.signal(Signal::TERM);
    assert_eq!(program.wait(Duration::from_secs(5))["ended"], "signal");
    sleep_s(1.0);
    assert_off(
        "cia402: SIGTERM, commands off",
        observer.off_after_s(asked_s),
        2.0 * CYCLE_S,
    );
    assert_off(
        "cia402: SIGTERM, drives stand",
        standing_after_s(&folder.truth(), asked_s),
        2.0 * CYCLE_S + QUICK_STOP_S + CYCLE_S,
    );

    // A drive that no longer obeys is stopped as a node, 2 s after the order to be off.
    let program = run(&folder, &["--arm"], FIGURE_EIGHT);
    observer.wait_for_driving(1.5);
    peer.tell("loose traction");
    let loose_s = unix_now_s();
    program.signal(Signal::USR2);
    sleep_s(5.0);
    let took_s = standing_after_s(&folder.truth(), loose_s);
    // A ramp that is not followed is implausible or ends; then the two times and the quick stop.
    assert_off(
        "cia402: not obeyed, drives stand",
        took_s,
        0.375 + 2.0 * 1.0 + QUICK_STOP_S + 4.0 * CYCLE_S,
    );
    assert!(folder.events().contains("node 1: not off in time"));
    drop(program);
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn the_virtual_vehicle_plays_drives_of_cia_402() {
    let folder = Folder::new("cia402_virtual");
    let observer = observer();
    let faults = "faults: [{after_enabled_s: 3.0, for_s: 1.0, fault: emergency_stop}]";
    let vehicle = Program::vehicle_changed(&folder, |text| {
        of_cia402(text).replace("faults: []", faults)
    });
    let program = run(&folder, &["--arm"], FIGURE_EIGHT);
    observer.wait_for_driving(1.5);
    let truth = folder.truth();
    let on = truth.iter().find(|row| row.mode == "Enabled").unwrap();
    sleep_s(4.0);
    let took_s = observer.off_after_s(on.unix_s + 3.0);
    // Up to a PDO until it is known, and a cycle until it acts.
    assert_off("cia402: virtual emergency stop", took_s, 2.0 * CYCLE_S);
    let events = folder.events();
    for event in [
        "node 2: set up and operational",
        "the drives report an emergency stop",
    ] {
        assert!(events.contains(event), "no {event}:\n{events}");
    }
    assert_rearms("cia402: virtual", &program, &observer);
    // The program dies: the drives miss its heartbeat.
    let killed_s = unix_now_s();
    drop(program);
    sleep_s(2.0);
    let took_s = standing_after_s(&folder.truth(), killed_s);
    let limit_s = CONSUMER_S + RAMP_S + CYCLE_S;
    assert_off("cia402: virtual drives stand", took_s, limit_s);
    drop(vehicle);

    let folder = Folder::new("cia402_figure_eight");
    let _vehicle = Program::vehicle_changed(&folder, of_cia402);
    let program = run(&folder, &["--arm"], FIGURE_EIGHT);
    let ending = program.wait(Duration::from_secs(90));
    assert_eq!(ending["ended"], "finished");
    let rms_m = cross_track_rms_m(&folder.truth(), 1100);
    println!("cia402: cross-track RMS {rms_m:.4} m");
    assert!(rms_m <= 0.02, "{rms_m}");
    decode_with_cantools(&folder, "cia402.dbc");
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_master_of_other_make_leads_a_virtual_drive() {
    let folder = Folder::new("cia402_master");
    let _vehicle = Program::vehicle_changed(&folder, of_cia402);
    let database = database("cia402.dbc");
    let output = python("cia402_master.py", &[&database, BUS, "1"])
        .output()
        .unwrap();
    let (said, errors) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(output.status.success(), "{said}\n{errors}");
    println!("{said}");
    let found: serde_json::Value = serde_json::from_str(&said).unwrap();
    // A servo drive of CiA 402; there is no object 0x5FFF; profile velocity.
    assert_eq!(found["device"], 0x0002_0192);
    assert_eq!(found["abort"], 0x0602_0000);
    assert_eq!(
        (&found["mode"], &found["nmt"]),
        (&3.into(), &"OPERATIONAL".into())
    );
    let states = [
        "SWITCH ON DISABLED",
        "READY TO SWITCH ON",
        "SWITCHED ON",
        "OPERATION ENABLED",
    ];
    assert_eq!(found["states"], serde_json::json!(states));
    let number = |key: &str| found[key].as_f64().unwrap();
    assert!((number("speed_m_s") - 0.3).abs() < 0.01);
    assert!((0.15..0.2 + TOLERANCE_S + CYCLE_S).contains(&number("noticed_s")));
    assert!(number("stood_m_s").abs() < 0.01);
    assert_eq!(found["emergency"], 0x8130);
}
