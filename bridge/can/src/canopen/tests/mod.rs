mod bus;
mod coding;
mod layout;

use super::*;
use crate::cia402::*;
use crate::config::{CanConfig, ObjectType, ObjectValue};
use crate::controller_side::VehicleReader;
use crate::database::Database;
use crate::frame::{Frame, FrameId};
use crate::layout::{Layout, LayoutError, Profile};
use crate::message::{DriveRole, FrameFault};
use bus::Bus;
use proptest::prelude::*;
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::{MeasuredMotorSpeeds, MotorCommand};
use std::sync::{Arc, LazyLock};

const DBC: &str = include_str!("../../../../../config/bridge/cia402.dbc");
const YAML: &str = include_str!("../../../../../config/bridge/cia402.yaml");

fn layout_of(yaml: &str) -> Result<Layout, LayoutError> {
    let config: CanConfig = serde_yaml::from_str(yaml).unwrap();
    Layout::new(&config, &Database::parse("cia402.dbc", DBC).unwrap())
}

/// Read once for the thousands of cases.
static LAYOUT: LazyLock<Arc<Layout>> = LazyLock::new(|| Arc::new(layout_of(YAML).unwrap()));

fn master() -> (Master, VehicleReader) {
    let layout = Arc::clone(&LAYOUT);
    let Profile::Cia402(cia402) = layout.profile.clone() else {
        panic!("not CiA 402");
    };
    (
        Master::new(Arc::clone(&layout), cia402),
        VehicleReader::new(layout),
    )
}

#[test]
fn drives_are_set_up_enabled_step_by_step_and_driven() {
    let mut bus = Bus::new();
    // Seven objects are written and three read back, one a cycle; then the node is started and reports.
    bus.off(11);
    assert_eq!(bus.mode(0), None);
    assert_eq!(bus.peers[0].written.len(), 7);
    assert_eq!(bus.peers[1].written[0], (0x6060, 0, vec![3]));
    assert_eq!(bus.peers[1].written[3], (0x1016, 1, vec![0xC8, 0, 0x7F, 0]));
    bus.off(3);
    assert_eq!(bus.mode(0), Some(DriveMode::Disabled));
    assert_eq!(bus.mode(1), Some(DriveMode::Disabled));
    bus.arm();
    assert_eq!(bus.peers.each_ref().map(|peer| peer.word), [0x0240; 2]);
    bus.words = Default::default();
    bus.on([0.5, -0.25], 8);
    for words in &bus.words {
        assert_eq!(words[..3], [0x0006, 0x0007, 0x000F], "{words:X?}");
        assert!(words[3..].iter().all(|word| *word == 0x000F));
    }
    assert_eq!(bus.mode(0), Some(DriveMode::Enabled));
    // 940 rpm in 1 m/s, 0.1 rpm a count.
    assert_eq!(bus.peers[0].speed_raw, 4700);
    assert_eq!(bus.peers[1].speed_raw, -2350);
    let report = bus.master.report(1, bus.reader.readings()).unwrap();
    assert!((report.value.speed_m_s + 0.25).abs() < 1e-9);
    // This program's own heartbeat, every cycle.
    let heartbeats = bus
        .sent
        .iter()
        .filter(|frame| frame.to_string() == "77F#05");
    assert_eq!(heartbeats.count(), 27);
    let ready = [(1, DriveEvent::Ready), (2, DriveEvent::Ready)];
    assert_eq!(bus.events, ready);
}

#[test]
fn a_target_is_told_only_to_a_drive_that_says_it_is_on() {
    let mut bus = Bus::new();
    bus.off(10);
    for _ in 0..10 {
        let before = bus.peers[0].word;
        bus.cycle([0.5, 0.5], true, false);
        if before != 0x0227 {
            assert_eq!(bus.peers[0].target_raw, 0);
        }
    }
    assert_eq!(bus.peers[0].target_raw, 4700);
}

#[test]
fn off_is_a_quick_stop_then_no_voltage_then_no_node() {
    let mut bus = Bus::driving();
    bus.words = Default::default();
    bus.off(1);
    assert_eq!(bus.peers[0].word, 0x0207);
    assert_eq!(bus.peers[0].target_raw, 0);
    // This peer holds its quick stop, until its voltage is disabled after 1 s.
    bus.off(19);
    assert!(bus.words[0].iter().all(|word| *word == 0x0002));
    bus.off(3);
    assert_eq!(bus.words[0].last(), Some(&0x0000));
    assert_eq!(bus.peers[0].word, 0x0240);
    bus.off(40);
    assert!(
        !bus.sent
            .iter()
            .any(|frame| frame.to_string().starts_with("000#02"))
    );
    assert_eq!(bus.mode(0), Some(DriveMode::Disabled));

    // One that does not obey, and one that can no longer be seen, are stopped as nodes.
    for silent in [false, true] {
        let mut bus = Bus::driving();
        bus.peers[0].deaf = true;
        if silent {
            bus.peers[0].nmt = None;
        }
        bus.off(40);
        let stop = |bus: &Bus| {
            let is_stop = |frame: &&Frame| frame.to_string() == "000#0201";
            bus.sent.iter().filter(is_stop).count()
        };
        assert_eq!(stop(&bus), 0);
        bus.off(3);
        assert!(stop(&bus) > 0);
        assert_eq!(bus.events.last(), Some(&(1, DriveEvent::NodeStopped)));
        // It hears again: it stops, and is told no more.
        bus.peers[0].deaf = false;
        bus.off(3);
        assert_eq!(bus.peers[0].nmt, Some(0x04));
        assert_eq!(bus.mode(0), Some(DriveMode::NotOperational));
        let before = stop(&bus);
        bus.off(10);
        assert_eq!(stop(&bus), before);
        // Arming sets it up again.
        bus.arm();
        bus.off(10);
        assert_eq!(bus.peers[0].nmt, Some(0x05));
        assert!(bus.master.report(0, bus.reader.readings()).is_some());
    }
}

#[test]
fn a_fault_is_reset_only_by_arming_and_once() {
    let mut bus = Bus::driving();
    bus.peers[1].word = 0x021F;
    bus.on([0.5, 0.0], 1);
    assert_eq!(bus.mode(1), Some(DriveMode::Fault));
    assert_eq!(bus.peers[1].target_raw, 0);
    bus.peers[1].word = 0x0218;
    bus.off(50);
    bus.on([0.0; 2], 10);
    bus.off(10);
    assert_eq!((bus.peers[1].word, bus.peers[1].resets), (0x0218, 0));
    bus.arm();
    assert_eq!((bus.peers[1].word, bus.peers[1].resets), (0x0240, 1));
    assert_eq!(bus.peers[0].resets, 0);
    // A fault that comes back is left alone until the next arming.
    bus.peers[1].word = 0x0218;
    for _ in 0..10 {
        bus.cycle([0.0; 2], false, true);
    }
    assert_eq!((bus.peers[1].word, bus.peers[1].resets), (0x0218, 1));
    bus.off(2);
    bus.arm();
    assert_eq!((bus.peers[1].word, bus.peers[1].resets), (0x0240, 2));
}

#[test]
fn an_emergency_stop_of_the_drive_is_told_as_one() {
    let mut bus = Bus::driving();
    bus.peers[0].word = 0x0207;
    bus.on([0.5, 0.0], 1);
    assert_eq!(bus.mode(0), Some(DriveMode::EmergencyStop));
    assert_eq!(bus.peers[0].control, 0x0002);
}

#[test]
fn a_node_that_starts_again_is_off_until_it_is_set_up_again() {
    let mut bus = Bus::driving();
    let node = &mut bus.peers[0];
    node.nmt = Some(0x7F);
    node.word = 0x0240;
    node.written.clear();
    let boot = Frame::new(FrameId::Standard(0x701), &[0]).unwrap();
    bus.reader.take(&boot, bus.now_s + 0.01).unwrap();
    assert_eq!(bus.mode(0), Some(DriveMode::Disabled));
    bus.off(14);
    assert_eq!(bus.peers[0].written.len(), 7);
    assert_eq!(bus.mode(0), Some(DriveMode::Disabled));
    assert!(bus.events.contains(&(1, DriveEvent::Started)));
    bus.arm();
    bus.on([0.5, 0.0], 8);
    assert_eq!(bus.peers[0].speed_raw, 4700);
}

#[test]
fn a_heartbeat_that_stops_ages_the_report() {
    let mut bus = Bus::driving();
    let seen_s = bus.now_s;
    bus.peers[0].nmt = None;
    // Its PDO still comes.
    let mut data = 0x0227_u16.to_le_bytes().to_vec();
    data.extend(4700_i32.to_le_bytes());
    let pdo = Frame::new(FrameId::Standard(0x181), &data).unwrap();
    bus.reader.take(&pdo, seen_s + 1.0).unwrap();
    let report = bus.master.report(0, bus.reader.readings()).unwrap();
    assert_eq!(report.time_s, seen_s);
}

#[test]
fn a_setup_that_fails_is_told_once_tried_again_and_enables_nothing() {
    for (refuses, deaf, expected) in [
        (
            Some(0x605A),
            false,
            "object 0x605A:00: refused with abort code 0x06090030, value range exceeded",
        ),
        (None, true, "object 0x6060:00: no answer"),
    ] {
        let mut bus = Bus::new();
        bus.peers[0].refuses = refuses;
        bus.peers[0].deaf = deaf;
        bus.off(100);
        bus.on([0.5, 0.5], 20);
        assert_eq!(bus.mode(0), None);
        assert_eq!(bus.peers[0].word, 0x0240);
        let failed: Vec<String> = bus
            .events
            .iter()
            .filter(|(node, _)| *node == 1)
            .map(|(_, event)| event.to_string())
            .collect();
        assert_eq!(failed, [format!("not set up: {expected}")]);
        bus.peers[0].refuses = None;
        bus.peers[0].deaf = false;
        bus.off(40);
        assert_eq!(bus.mode(0), Some(DriveMode::Disabled));
    }
}

fn told(bus: &Bus, node: u8) -> Vec<String> {
    let events = bus.events.iter().filter(|(number, _)| *number == node);
    events.map(|(_, event)| event.to_string()).collect()
}

fn node_stops(bus: &Bus) -> usize {
    let frames = bus.sent.iter().map(Frame::to_string);
    frames.filter(|frame| frame == "000#0201").count()
}

#[test]
fn a_deadline_that_a_drive_does_not_keep_or_does_not_have_is_told() {
    let mut bus = Bus::new();
    bus.peers[0].forgets = Some(0x1400);
    bus.off(60);
    assert_eq!(bus.mode(0), None);
    let differs = "not set up: object 0x1400:05: 0xC8 was written, 0x0 is read";
    assert_eq!(told(&bus, 1), [differs]);
    // One whose setup has none drives, and is named.
    let line = YAML.lines().find(|line| line.contains("0x1400")).unwrap();
    let layout = Arc::new(layout_of(&YAML.replace(line, "")).unwrap());
    let Profile::Cia402(cia402) = layout.profile.clone() else {
        panic!("not CiA 402");
    };
    let mut bus = Bus::new();
    bus.master = Master::new(layout, cia402);
    bus.off(14);
    bus.on([0.5, -0.25], 8);
    assert_eq!(bus.mode(0), Some(DriveMode::Enabled));
    let named = told(&bus, 1);
    assert!(
        named[1].starts_with("no deadline for commands"),
        "{named:?}"
    );
}

#[test]
fn a_mode_of_operation_that_another_changes_ends_the_drive_until_it_is_set_up_again() {
    let mut bus = Bus::driving();
    bus.on([0.5, 0.0], 20);
    assert_eq!(bus.mode(0), Some(DriveMode::Enabled));
    bus.peers[0].mode = Some(0xFF);
    // Two looks, each a request and an answer.
    bus.on([0.5, 0.0], 7);
    assert_eq!(bus.mode(0), Some(DriveMode::OtherMode));
    assert_eq!(bus.mode(1), Some(DriveMode::Enabled));
    let event = "on in mode of operation -1 (object 0x6061), not that of its setup".to_owned();
    assert_eq!(told(&bus, 1).last(), Some(&event));
    bus.peers[0].mode = Some(3);
    bus.off(40);
    assert_eq!(bus.mode(0), Some(DriveMode::OtherMode));
    bus.peers[0].written.clear();
    bus.arm();
    bus.off(14);
    assert_eq!(bus.peers[0].written[0], (0x6060, 0, vec![3]));
    assert_eq!(bus.mode(0), Some(DriveMode::Disabled));
    // The answers to another client do not hide those to this one.
    let mut bus = Bus::driving();
    bus.peers[0].mode = Some(1);
    for _ in 0..7 {
        bus.on([0.5, 0.0], 1);
        let other = Frame::new(FrameId::Standard(0x581), &[0x60, 0x60, 0x60, 0, 0, 0, 0, 0]);
        bus.peers[0].says.push(other.unwrap());
    }
    assert_eq!(bus.mode(0), Some(DriveMode::OtherMode));
    // A drive without the object is named once.
    let mut bus = Bus::new();
    bus.peers[0].mode = None;
    bus.off(14);
    bus.on([0.5, 0.0], 40);
    assert_eq!(bus.mode(0), Some(DriveMode::Enabled));
    let unread = "its mode of operation cannot be read (object 0x6061)".to_owned();
    let said = told(&bus, 1);
    assert_eq!(said.iter().filter(|said| **said == unread).count(), 1);
}

#[test]
fn a_drive_that_another_switches_on_is_stopped_as_a_node_each_time() {
    let mut bus = Bus::driving();
    bus.off(30);
    assert_eq!(
        (bus.mode(0), node_stops(&bus)),
        (Some(DriveMode::Disabled), 0)
    );
    for _ in 0..2 {
        // The other is as fast as this master, so that the drive stays on.
        let before = node_stops(&bus);
        for _ in 0..3 {
            bus.peers[0].deaf = node_stops(&bus) == before;
            bus.peers[0].nmt = Some(0x05);
            bus.peers[0].word = 0x0227;
            bus.cycle([0.0; 2], false, false);
        }
        assert!(node_stops(&bus) > before);
        bus.peers[0].deaf = false;
        bus.off(3);
        assert_eq!(bus.peers[0].nmt, Some(0x04));
        assert_eq!(bus.mode(0), Some(DriveMode::NotOperational));
    }
    let event = "switched on by another node, stopped as a node".to_owned();
    assert_eq!(told(&bus, 1).last(), Some(&event));
    assert_eq!(
        told(&bus, 1).iter().filter(|told| **told == event).count(),
        1
    );
}

#[test]
fn every_state_and_every_emergency_of_a_cycle_counts() {
    let mut bus = Bus::driving();
    let before = bus.reader.readings().modes;
    let emergency = |code: u16| {
        let [low, high] = code.to_le_bytes();
        Frame::new(FrameId::Standard(0x81), &[low, high, 1, 0, 0, 0, 0, 0]).unwrap()
    };
    let pdo = |word: u16| {
        let mut data = word.to_le_bytes().to_vec();
        data.extend(4700_i32.to_le_bytes());
        Frame::new(FrameId::Standard(0x181), &data).unwrap()
    };
    let worst = |bus: &Bus| {
        let readings = bus.reader.readings();
        [0, 1].map(|drive| readings.modes[drive].worst_since(&before[drive]))
    };
    for (word, expected) in [
        (0x0227, DriveMode::Enabled),
        (0x0240, DriveMode::Disabled),
        (0x0208, DriveMode::Fault),
        (0x0227, DriveMode::Fault),
        (0x0207, DriveMode::EmergencyStop),
        (0x0227, DriveMode::EmergencyStop),
    ] {
        bus.reader.take(&pdo(word), bus.now_s).unwrap();
        assert_eq!(worst(&bus), [expected, DriveMode::Enabled]);
    }
    assert_eq!(bus.mode(0), Some(DriveMode::Enabled), "the newest");
    for code in [0x3210, 0x8611, 0] {
        bus.reader.take(&emergency(code), bus.now_s).unwrap();
    }
    bus.on([0.5, 0.0], 2);
    let said = told(&bus, 1);
    let expected = [
        "emergency 0x3210, error register 0x01: DC link over-voltage",
        "emergency 0x8611, error register 0x01: following error",
        "its error has gone",
    ];
    assert_eq!(said[said.len() - 3..], expected);
}

#[test]
fn left_and_right_drives_are_told_the_treads() {
    let yaml = YAML
        .replace("role: traction", "role: left")
        .replace("role: steer", "role: right");
    let layout = layout_of(&yaml).unwrap();
    let motors = MeasuredMotorSpeeds {
        traction_m_s: 0.5,
        steer_m_s: 0.2,
    };
    let told = [DriveRole::Left, DriveRole::Right].map(|role| role.speed_m_s(&motors));
    assert_eq!(told, [0.3, 0.7]);
    let back = layout.motors(told);
    assert!((back.traction_m_s - 0.5).abs() < 1e-12 && (back.steer_m_s - 0.2).abs() < 1e-12);
    let Profile::Cia402(cia402) = layout.profile.clone() else {
        panic!("not CiA 402");
    };
    let (mut bus, layout) = (Bus::new(), Arc::new(layout));
    bus.reader = VehicleReader::new(Arc::clone(&layout));
    bus.master = Master::new(layout, cia402);
    bus.off(10);
    bus.arm();
    bus.on([0.5, 0.2], 8);
    assert_eq!(
        bus.peers.each_ref().map(|peer| peer.speed_raw),
        [2820, 6580]
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// Whatever is on the bus: no panic, and no speed to a drive that is not seen on.
    #[test]
    fn any_frames_move_nothing_that_is_not_on(
        frames in prop::collection::vec((0..12_usize, 0..=8_u8, any::<[u8; 8]>()), 1..12),
        enable: bool,
        fault_reset: bool,
    ) {
        let (mut master, mut reader) = master();
        let mut now_s = 0.0;
        for (kind, length, data) in frames {
            now_s += 0.05;
            let id = [0, 0x80, 0x81, 0x181, 0x182, 0x201, 0x581, 0x582, 0x701, 0x702, 0x77F, 0x82];
            let frame = Frame::new(FrameId::Standard(id[kind]), &data[..usize::from(length)]).unwrap();
            let before = *reader.readings();
            if reader.take(&frame, now_s).is_err() {
                prop_assert_eq!(before.drives, reader.readings().drives);
                prop_assert_eq!(before.nodes, reader.readings().nodes);
            }
            for drive in 0..2 {
                // Nothing was written yet, so nothing is believed yet.
                if let Some(report) = master.report(drive, reader.readings()) {
                    prop_assert!(report.value.speed_m_s.abs() <= 3200.05 / 940.0);
                }
            }
            let order = MotorCommand {
                speeds: MeasuredMotorSpeeds { traction_m_s: 0.5, steer_m_s: 0.1 },
                enable,
            };
            let readings = *reader.readings();
            let mut moved = Vec::new();
            master.write::<FrameFault>(now_s, &order, fault_reset, &readings, |_, _| {}, |frame| {
                if let FrameId::Standard(id @ 0x201..=0x202) = frame.id
                    && frame.data[2..6] != [0; 4]
                {
                    moved.push(usize::from(id - 0x201));
                }
                Ok(())
            }).unwrap();
            for drive in moved {
                prop_assert!(enable);
                prop_assert_eq!(readings.nodes[drive].power, Some(PowerState::OperationEnabled));
            }
        }
    }
}
