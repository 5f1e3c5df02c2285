use super::*;
use crate::can::config::CanConfig;
use crate::can::controller_side::{MotorOrder, VehicleReader};
use crate::can::frame::Frame;
use crate::can::layout::{DriveMode, Layout, Profile};
use crate::can::message::FrameFault;
use crate::motors::MeasuredMotorSpeeds;
use proptest::prelude::*;
use std::sync::Arc;

const DBC: &str = include_str!("../../../../config/bridge/cia402.dbc");
const YAML: &str = include_str!("../../../../config/bridge/cia402.yaml");

fn layout_of(yaml: &str) -> Result<Layout, LayoutError> {
    let config: CanConfig = serde_yaml::from_str(yaml).unwrap();
    Layout::new(&config, &Database::parse("cia402.dbc", DBC).unwrap())
}

fn master() -> (Master, VehicleReader) {
    let layout = Arc::new(layout_of(YAML).unwrap());
    let Profile::Cia402(cia402) = layout.profile.clone() else {
        panic!("not CiA 402");
    };
    (
        Master::new(Arc::clone(&layout), cia402),
        VehicleReader::new(layout),
    )
}

#[test]
fn statuswords_are_told_apart_as_cia_402_tells_them() {
    use PowerState::*;
    // The table of the profile: mask, value, state. Whatever is in the other bits changes nothing.
    let table = [
        (0x4F, 0x00, NotReadyToSwitchOn),
        (0x4F, 0x40, SwitchOnDisabled),
        (0x6F, 0x21, ReadyToSwitchOn),
        (0x6F, 0x23, SwitchedOn),
        (0x6F, 0x27, OperationEnabled),
        (0x6F, 0x07, QuickStopActive),
        (0x4F, 0x0F, FaultReactionActive),
        (0x4F, 0x08, Fault),
    ];
    let mut legal = 0_u32;
    for word in 0..=u16::MAX {
        let rows: Vec<_> = table
            .iter()
            .filter(|(mask, value, _)| word & mask == *value)
            .collect();
        assert!(rows.len() <= 1, "{word:#06X}");
        let expected = rows.first().map(|(_, _, state)| *state);
        assert_eq!(PowerState::of(word), expected, "{word:#06X}");
        legal += u32::from(expected.is_some());
    }
    // Four rows leave bit 5 free: of the 64 patterns of six bits, 12 are legal.
    assert_eq!(legal, 12 * 1024);
}

#[test]
fn objects_are_written_as_cia_301_has_it() {
    let node = NodeId::new(0x22).unwrap();
    let request = |object, sub, kind, value| {
        let object = ObjectValue {
            object,
            sub,
            kind,
            value,
        };
        object.request(node).map(|frame| frame.to_string())
    };
    for (object, sub, kind, value, frame) in [
        (0x6060, 0, ObjectType::I8, 3, "622#2F60600003000000"),
        (0x6007, 0, ObjectType::I16, -2, "622#2B076000FEFF0000"),
        (
            0x1016,
            1,
            ObjectType::U32,
            0x7F_00C8,
            "622#23161001C8007F00",
        ),
        (0x60FF, 0, ObjectType::I32, -1, "622#23FF6000FFFFFFFF"),
        (0x1017, 0, ObjectType::U16, 0xFFFF, "622#2B171000FFFF0000"),
    ] {
        assert_eq!(request(object, sub, kind, value).unwrap(), frame);
    }
    for (kind, value) in [
        (ObjectType::U8, 256),
        (ObjectType::U8, -1),
        (ObjectType::I8, 128),
        (ObjectType::I16, -32_769),
        (ObjectType::U32, 1 << 32),
        (ObjectType::I32, i64::MIN),
    ] {
        assert_eq!(request(0x6060, 0, kind, value), None);
    }
}

/// A drive that follows CiA 402's table of transitions, with the node behind it.
struct Peer {
    node: u8,
    word: u16,
    speed_raw: i32,
    control: u16,
    target_raw: i32,
    /// Objects written.
    written: Vec<(u16, u8, Vec<u8>)>,
    /// Heartbeat's byte; none is silent.
    nmt: Option<u8>,
    /// Object that is refused.
    refuses: Option<u16>,
    deaf: bool,
    /// Frames to send.
    says: Vec<Frame>,
    resets: u32,
}

impl Peer {
    fn new(node: u8) -> Self {
        Self {
            node,
            word: 0x0240,
            speed_raw: 0,
            control: 0,
            target_raw: 0,
            written: Vec::new(),
            nmt: Some(0x7F),
            refuses: None,
            deaf: false,
            says: Vec::new(),
            resets: 0,
        }
    }

    fn hear(&mut self, frame: &Frame) {
        let FrameId::Standard(id) = frame.id else {
            panic!("extended");
        };
        let data = frame.data;
        let node = u16::from(self.node);
        if self.deaf {
            return;
        }
        if id == 0 && data[1] == self.node {
            self.nmt = Some(match data[0] {
                0x01 => 0x05,
                0x02 => 0x04,
                0x80 => 0x7F,
                other => panic!("NMT command {other:#04X}"),
            });
        } else if id == 0x600 + node {
            let (index, sub) = (u16::from_le_bytes([data[1], data[2]]), data[3]);
            let answer = if self.refuses == Some(index) {
                vec![0x80, data[1], data[2], sub, 0x30, 0x00, 0x09, 0x06]
            } else {
                let length = 4 - usize::from(data[0] >> 2 & 3);
                self.written
                    .push((index, sub, data[4..4 + length].to_vec()));
                vec![0x60, data[1], data[2], sub, 0, 0, 0, 0]
            };
            self.says
                .push(Frame::new(FrameId::Standard(0x580 + node), &answer).unwrap());
        } else if id == 0x200 + node && self.nmt == Some(0x05) {
            let before =
                std::mem::replace(&mut self.control, u16::from_le_bytes([data[0], data[1]]));
            self.target_raw = i32::from_le_bytes([data[2], data[3], data[4], data[5]]);
            self.word = match (self.word & 0x6F, self.control & 0x0F) {
                (0x40, 0x06) => 0x0221,
                (0x21, 0x07) => 0x0223,
                (0x23, 0x0F) => 0x0227,
                (0x27, 0x02) => 0x0207,
                (0x27 | 0x07 | 0x23 | 0x21, 0x00) | (0x23 | 0x21, 0x02) => 0x0240,
                (0x08 | 0x28, _) if self.control & !before & 0x80 != 0 => {
                    self.resets += 1;
                    0x0240
                }
                _ => self.word,
            };
            self.speed_raw = if self.word == 0x0227 {
                self.target_raw
            } else {
                0
            };
        }
    }

    fn say(&mut self) -> Vec<Frame> {
        let node = u16::from(self.node);
        let mut frames = std::mem::take(&mut self.says);
        if let Some(nmt) = self.nmt {
            frames.push(Frame::new(FrameId::Standard(0x700 + node), &[nmt]).unwrap());
        }
        if self.nmt == Some(0x05) {
            let mut data = self.word.to_le_bytes().to_vec();
            data.extend(self.speed_raw.to_le_bytes());
            frames.push(Frame::new(FrameId::Standard(0x180 + node), &data).unwrap());
        }
        frames
    }
}

/// A bus of a master and two peers, with 20 cycles a second.
struct Bus {
    master: Master,
    reader: VehicleReader,
    peers: [Peer; 2],
    now_s: f64,
    words: [Vec<u16>; 2],
    sent: Vec<Frame>,
    events: Vec<(u8, DriveEvent)>,
}

impl Bus {
    fn new() -> Self {
        let (master, reader) = master();
        Self {
            master,
            reader,
            peers: [Peer::new(1), Peer::new(2)],
            now_s: 0.0,
            words: Default::default(),
            sent: Vec::new(),
            events: Vec::new(),
        }
    }

    fn cycle(&mut self, speeds: [f64; 2], enable: bool, fault_reset: bool) {
        self.now_s += 0.05;
        for peer in &mut self.peers {
            for frame in peer.say() {
                self.reader.take(&frame, self.now_s).unwrap();
            }
        }
        let order = MotorOrder {
            motors: MeasuredMotorSpeeds {
                traction_m_s: speeds[0],
                steer_m_s: speeds[1],
            },
            enable,
        };
        let (peers, sent, words) = (&mut self.peers, &mut self.sent, &mut self.words);
        let events = &mut self.events;
        self.master
            .write::<FrameFault>(
                self.now_s,
                &order,
                fault_reset,
                self.reader.readings(),
                |node, event| events.push((node, event)),
                |frame| {
                    for (i, peer) in peers.iter_mut().enumerate() {
                        peer.hear(frame);
                        if frame.id == FrameId::Standard(0x201 + i as u16) {
                            words[i].push(u16::from_le_bytes([frame.data[0], frame.data[1]]));
                        }
                    }
                    sent.push(*frame);
                    Ok(())
                },
            )
            .unwrap();
    }

    fn off(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.cycle([0.0; 2], false, false);
        }
    }

    fn arm(&mut self) {
        for _ in 0..5 {
            self.cycle([0.0; 2], false, true);
        }
    }

    fn on(&mut self, speeds: [f64; 2], cycles: u32) {
        for _ in 0..cycles {
            self.cycle(speeds, true, false);
        }
    }

    fn mode(&self, drive: usize) -> Option<DriveMode> {
        let report = self.master.report(drive, self.reader.readings());
        report.map(|report| report.value.mode)
    }

    fn driving() -> Self {
        let mut bus = Self::new();
        bus.off(10);
        bus.arm();
        bus.on([0.5, -0.25], 8);
        bus
    }
}

#[test]
fn drives_are_set_up_enabled_step_by_step_and_driven() {
    let mut bus = Bus::new();
    // Six objects, one a cycle; then the node is started and reports.
    bus.off(7);
    assert_eq!(bus.mode(0), None);
    assert_eq!(bus.peers[0].written.len(), 6);
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
    assert_eq!(heartbeats.count(), 23);
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
        assert_eq!(bus.mode(0), Some(DriveMode::Disabled));
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
    node.says
        .push(Frame::new(FrameId::Standard(0x701), &[0]).unwrap());
    let boot = node.say()[0];
    bus.reader.take(&boot, bus.now_s + 0.01).unwrap();
    assert_eq!(bus.mode(0), Some(DriveMode::Disabled));
    bus.off(10);
    assert_eq!(bus.peers[0].written.len(), 6);
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

#[test]
fn what_is_wrong_with_a_layout_is_named() {
    let wrong = |old: &str, new: &str| {
        assert!(YAML.contains(old), "{old}");
        layout_of(&YAML.replacen(old, new, 1))
            .err()
            .unwrap()
            .to_string()
    };
    for (old, new, expected) in [
        (
            "node_id: 2",
            "node_id: 1",
            "node_id 1 is out of range (from 1 to 127) or given twice",
        ),
        ("node_id: 2", "node_id: 127", "node_id 127"),
        ("node_id: 1 ", "node_id: 128 ", "node_id 128"),
        ("role: steer", "role: right", "the roles must be"),
        (
            "value: 3}",
            "value: 300}",
            "object 0x6060:00: 300 does not fit",
        ),
        (
            "statusword: Statusword",
            "statusword: VelocityActual",
            "overlap",
        ),
        (
            "quick_stop_time_s: 1.0",
            "quick_stop_time_s: .nan",
            "cia402.quick_stop_time_s: NaN is out of range",
        ),
        (
            "answer_time_s: 0.5",
            "answer_time_s: 0",
            "cia402.answer_time_s: 0",
        ),
        (
            "controlword: Controlword",
            "controlword: Control",
            "cia402.dbc: message TractionRpdo1 has no signal Control",
        ),
        (
            "message: SteerTpdo1",
            "message: TractionTpdo1",
            "one and the same",
        ),
    ] {
        let error = wrong(old, new);
        assert!(error.contains(expected), "{error}");
    }
    let config: CanConfig = serde_yaml::from_str(YAML).unwrap();
    for (old, new, expected) in [
        (
            "BO_ 513 ",
            "BO_ 129 ",
            "identifier 081 belongs to a service",
        ),
        (
            "BO_ 386 ",
            "BO_ 1794 ",
            "identifier 702 belongs to a service",
        ),
        (
            "Controlword : 0|16@1+ (1,0)",
            "Controlword : 0|16@1+ (2,0)",
            "Controlword must be unsigned with 16 bits",
        ),
        (
            "Statusword : 0|16@1+",
            "Statusword : 0|15@1+",
            "Statusword must be unsigned with 16 bits",
        ),
    ] {
        assert!(DBC.contains(old), "{old}");
        let database = Database::parse("cia402.dbc", &DBC.replacen(old, new, 1)).unwrap();
        let error = Layout::new(&config, &database).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let both = YAML.replace(
        "cia402:\n",
        "command: [{message: TractionRpdo1}]\ncia402:\n",
    );
    assert_eq!(layout_of(&both).err(), Some(LayoutError::Profile));
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
            let order = MotorOrder {
                motors: MeasuredMotorSpeeds { traction_m_s: 0.5, steer_m_s: 0.1 },
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
