//! Faults of the vehicle, the interface and the bus.

use crate::support::*;
use crate::{
    COMMANDS_OFF_AFTER_SILENCE_S, CYCLE_S, DRIVES_OFF_AFTER_SILENCE_S, assert_off, assert_rearms,
};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sidehill_can::frame::Frame;
use sidehill_can_port::Sender;

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn faults_of_the_vehicle_end_the_commands_until_re_armed() {
    for (fault, limit_s) in [
        ("stop_feedback", COMMANDS_OFF_AFTER_SILENCE_S),
        ("freeze_counter", COMMANDS_OFF_AFTER_SILENCE_S),
        ("corrupt_checksum", COMMANDS_OFF_AFTER_SILENCE_S),
        ("!delay_s 0.6", COMMANDS_OFF_AFTER_SILENCE_S),
        // Up to a report until it is known, and a cycle until it acts.
        ("emergency_stop", 2.0 * CYCLE_S),
        // The command must leave the plausible band first; then 0.3 s, a cycle, the ramp, a cycle.
        ("ignore_commands", 3.0),
    ] {
        let name = fault.replace(['!', ' ', '.'], "");
        let folder = Folder::new(&format!("fault_{name}"));
        let observer = Observer::start();
        let faults = format!("[{{after_enabled_s: 3.0, for_s: 4.0, fault: {fault}}}]");
        let vehicle = Program::vehicle(&folder, &faults);
        let run = Program::run(&folder, &["--arm"]);
        observer.wait_for_driving(2.0);
        sleep_s(7.0);
        let truth = folder.truth();
        let enabled_s = truth
            .iter()
            .find(|row| row.mode == "Enabled")
            .unwrap()
            .unix_s;
        let took_s = observer.off_after_s(enabled_s + 3.0);
        assert_off(fault, took_s, limit_s);
        // A runaway vehicle is off its path, where the controller refuses to drive.
        if fault != "ignore_commands" {
            assert_rearms(fault, &run, &observer);
        }
        drop(vehicle);
    }
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn an_interface_that_goes_down_or_away_stops_the_vehicle_until_re_armed() {
    for deleted in [false, true] {
        let name = if deleted { "deleted" } else { "down" };
        let folder = Folder::new(&format!("interface_{name}"));
        let observer = Observer::start();
        let _vehicle = Program::vehicle(&folder, "");
        let run = Program::run(&folder, &["--arm"]);
        observer.wait_for_driving(2.0);
        if deleted {
            ip(&["link", "delete", BUS]);
        } else {
            ip(&["link", "set", BUS, "down"]);
        }
        sleep_s(2.0);
        // Silence counts from the last command that got through.
        let last_s = observer.seen().last().unwrap().unix_s;
        let back_s = unix_now_s();
        ensure_bus();
        // Longer than the longest pause between attempts to open it again.
        sleep_s(4.0);
        let took_s = standing_after_s(&folder.truth(), last_s);
        assert_off(
            &format!("interface {name}, drives stand"),
            took_s,
            DRIVES_OFF_AFTER_SILENCE_S,
        );
        // The commands were off when the bus came back.
        let seen = observer.seen();
        let mut after = seen.iter().filter(|s| s.unix_s > back_s).peekable();
        assert!(
            after.peek().is_some(),
            "{name}: no command after the bus was back"
        );
        assert!(
            after.all(|s| !s.enable && s.zero),
            "{name}: moved by itself"
        );
        assert_rearms(name, &run, &observer);
    }
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_full_queue_stops_the_vehicle_until_re_armed() {
    let folder = Folder::new("full_queue");
    let observer = Observer::start();
    let _vehicle = Program::vehicle(&folder, "");
    let run = Program::run(&folder, &["--arm"]);
    observer.wait_for_driving(2.0);
    command(
        "tc",
        &[
            "qdisc", "replace", "dev", BUS, "root", "netem", "delay", "1s", "limit", "2",
        ],
    );
    sleep_s(3.0);
    command("tc", &["qdisc", "delete", "dev", BUS, "root"]);
    sleep_s(1.0);
    // Counted from the last command that got through; starting `tc` takes its time.
    let took_s = standing_after_s(&folder.truth(), observer.silent_since_s());
    assert_off(
        "queue full, drives stand",
        took_s,
        DRIVES_OFF_AFTER_SILENCE_S,
    );
    assert!(
        folder
            .events()
            .contains("the queue of the interface is full"),
        "{}",
        folder.events()
    );
    assert_rearms("full queue", &run, &observer);
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_controller_that_has_left_the_bus_stops_until_re_armed() {
    let folder = Folder::new("bus_off");
    let observer = Observer::start();
    let adapter = Adapter::attach();
    let _vehicle = Program::vehicle(&folder, "");
    let run = Program::run_on(&folder, &adapter.interface, &["--arm"]);
    observer.wait_for_driving(2.0);
    // Warning and passive do not stop.
    adapter.say("sw100010\r");
    adapter.say("sp130020\r");
    sleep_s(0.5);
    let off_s = unix_now_s();
    adapter.say("sb255000\r");
    sleep_s(2.0);
    adapter.say("sa000000\r");
    sleep_s(3.0);
    let took_s = standing_after_s(&folder.truth(), off_s);
    // Commands may still get through, on the ramp; or they may not, and the drives time out.
    assert_off(
        "bus-off, drives stand",
        took_s,
        DRIVES_OFF_AFTER_SILENCE_S + CYCLE_S,
    );
    let events = folder.events();
    for event in [
        "Warning",
        "Passive",
        "the link to the drives is BusOff",
        "\"event\":\"restart\"",
    ] {
        assert!(events.contains(event), "no {event}:\n{events}");
    }
    // The adapter is back, but the serial-line driver passes nothing until the interface is switched off and
    // on. Nothing is enabled by itself, before or after that.
    let before = observer.seen().len();
    ip(&["link", "set", &adapter.interface, "down"]);
    sleep_s(0.5);
    ip(&["link", "set", &adapter.interface, "up"]);
    sleep_s(2.0);
    let after = observer.seen().split_off(before);
    assert!(
        !after.is_empty() && after.iter().all(|s| !s.enable && s.zero),
        "{after:?}"
    );
    assert_rearms("bus-off", &run, &observer);
}

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn another_node_that_sends_the_commands_identifier_stops_the_vehicle_and_forbids_arming() {
    let folder = Folder::new("foreign_commands");
    let observer = Observer::start();
    let _vehicle = Program::vehicle(&folder, "");
    let run = Program::run(&folder, &["--arm"]);
    observer.wait_for_driving(2.0);
    let mut foreign = Sender::start(BUS, &[]).unwrap();
    // No drive takes it: its checksum is wrong.
    let frame = Frame::new(layout().command[0].id(), &[0; 8]).unwrap();
    let begin_s = unix_now_s();
    foreign.send(&frame).unwrap();
    sleep_s(1.0);
    assert_off(
        "foreign command",
        observer.off_after_s(begin_s),
        2.0 * CYCLE_S,
    );
    let before = observer.seen().len();
    run.signal(Signal::USR1);
    for _ in 0..20 {
        foreign.send(&frame).unwrap();
        sleep_s(0.1);
    }
    assert!(
        observer.seen()[before..]
            .iter()
            .all(|s| !s.enable && s.zero)
    );
    let events = folder.events();
    for event in [
        "another node sends with this program's identifiers",
        "100#0000000000000000: another node sends with an identifier of this program",
    ] {
        assert!(events.contains(event), "no {event}:\n{events}");
    }
    // It has been silent for longer than 3 s.
    sleep_s(3.5);
    assert_rearms("foreign command", &run, &observer);
}

/// Faults of the vehicle that are drawn.
const DRAWN: [&str; 6] = [
    "stop_feedback",
    "freeze_counter",
    "corrupt_checksum",
    "!delay_s 0.1",
    "!delay_s 0.6",
    "emergency_stop",
];

/// `.ci/vcan` takes another seed than 1 from `FAULT_SEED`, and another number than 4 from `FAULT_DRAWS`.
#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn drawn_faults_stop_the_vehicle_until_re_armed_or_it_drives_on() {
    let number = |name| std::env::var(name).unwrap().parse().unwrap();
    let (seed, draws) = (number("FAULT_SEED"), number("FAULT_DRAWS"));
    for draw in 0..draws {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(draw);
        let mut share = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let mut windows = Vec::new();
        // A fourth of the draws has two at once; short ones are as frequent as long ones.
        for _ in 0..1 + usize::from(share() < 0.25) {
            let (after_s, for_s) = (2.0 + 2.0 * share(), 0.05 * 60_f64.powf(share()));
            let fault = DRAWN[((share() * DRAWN.len() as f64) as usize).min(DRAWN.len() - 1)];
            windows.push((after_s, for_s, fault));
        }
        // What the bus does by itself, now and then.
        let down_s = (share() < 0.25).then(|| 0.05 * 40_f64.powf(share()));
        let name =
            format!("seed {seed}, draw {draw}, {windows:.3?}, interface down for {down_s:.3?} s");

        let folder = Folder::new(&format!("drawn_{draw}"));
        let observer = Observer::start();
        let rows: Vec<String> = windows
            .iter()
            .map(|(after_s, for_s, fault)| {
                format!("{{after_enabled_s: {after_s}, for_s: {for_s}, fault: {fault}}}")
            })
            .collect();
        let _vehicle = Program::vehicle(&folder, &format!("[{}]", rows.join(", ")));
        let run = Program::run(&folder, &["--arm"]);
        observer.wait_for_driving(1.5);
        if let Some(down_s) = down_s {
            ip(&["link", "set", BUS, "down"]);
            sleep_s(down_s);
            ensure_bus();
        }
        let over_s = windows.iter().map(|(after_s, for_s, _)| after_s + for_s);
        // An interface that was down is opened again after 4 s at most.
        sleep_s(over_s.fold(0.0, f64::max) + if down_s.is_some() { 4.0 } else { 2.0 });

        let seen = observer.seen();
        let on = seen.iter().position(|s| s.enable).unwrap();
        let Some(off) = seen[on..].iter().position(|s| !s.enable) else {
            assert!(
                seen.last().is_some_and(|s| !s.zero),
                "{name}: it neither drives nor stops"
            );
            println!("{name}: drove on");
            continue;
        };
        let after = &seen[on + off..];
        assert!(
            after.iter().all(|s| !s.enable && s.zero),
            "{name}: moved by itself"
        );
        let took_s = standing_after_s(&folder.truth(), after[0].unix_s);
        assert_off(&name, took_s, DRIVES_OFF_AFTER_SILENCE_S + CYCLE_S);
        let events = folder.events();
        let stop = "\"to\":\"latched\",\"reason\":\"";
        assert!(events.contains(stop), "{name}: no reason\n{events}");
        assert_rearms(&name, &run, &observer);
    }
}
