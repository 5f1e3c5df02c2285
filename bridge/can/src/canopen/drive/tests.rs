use super::*;
use crate::canopen::Master;
use crate::config::CanConfig;
use crate::controller_side::VehicleReader;
use crate::database::Database;
use crate::layout::Profile;
use proptest::prelude::*;
use sidehill_bridge::drives::MotorCommand;

const DBC: &str = include_str!("../../../../../config/bridge/cia402.dbc");
const YAML: &str = include_str!("../../../../../config/bridge/cia402.yaml");
const CYCLE_S: f64 = 0.05;
const STEP_S: f64 = 0.005;
const RAMP_M_S2: f64 = 2.0;

/// This program's master and virtual drives on a bus without delay, with motors on a ramp.
struct Bench {
    master: Master,
    reader: VehicleReader,
    drives: VirtualDrives,
    motors: MeasuredMotorSpeeds,
    time_s: f64,
    events: Vec<String>,
    master_speaks: bool,
    emergency_stop: bool,
}

impl Bench {
    fn new(yaml: &str) -> Self {
        let config: CanConfig = serde_yaml::from_str(yaml).unwrap();
        let database = Database::parse("cia402.dbc", DBC).unwrap();
        let layout = Arc::new(Layout::new(&config, &database).unwrap());
        let Profile::Cia402(cia402) = layout.profile.clone() else {
            panic!("not CiA 402");
        };
        Self {
            drives: VirtualDrives::new(Arc::clone(&layout), &cia402),
            master: Master::new(Arc::clone(&layout), cia402),
            reader: VehicleReader::new(layout),
            motors: MeasuredMotorSpeeds::default(),
            time_s: 0.0,
            events: Vec::new(),
            master_speaks: true,
            emergency_stop: false,
        }
    }

    /// A cycle of the master, then the drives until the next.
    fn cycle(&mut self, enable: bool, traction_m_s: f64) {
        let order = MotorCommand {
            speeds: MeasuredMotorSpeeds {
                traction_m_s,
                steer_m_s: 0.0,
            },
            enable,
        };
        let (now_s, readings) = (self.time_s, *self.reader.readings());
        let mut frames = Vec::new();
        let tell = |node, event| self.events.push(format!("{node}: {event}"));
        self.master
            .write::<FrameFault>(now_s, &order, false, &readings, tell, |frame| {
                frames.push(*frame);
                Ok(())
            })
            .unwrap();
        for frame in frames.iter().filter(|_| self.master_speaks) {
            self.drives.take(frame, now_s).unwrap();
        }
        for _ in 0..(CYCLE_S / STEP_S).round() as u32 {
            self.time_s += STEP_S;
            let target = self
                .drives
                .step(self.time_s, &self.motors, self.emergency_stop)
                .unwrap();
            let step_m_s = RAMP_M_S2 * STEP_S;
            let change = target.traction_m_s - self.motors.traction_m_s;
            self.motors.traction_m_s += change.clamp(-step_m_s, step_m_s);
            assert_eq!(target.steer_m_s, 0.0);
            while let Some(frame) = self.drives.next_frame() {
                self.reader.take(&frame, self.time_s).unwrap();
            }
        }
    }

    fn cycles(&mut self, count: u32, enable: bool, traction_m_s: f64) {
        for _ in 0..count {
            self.cycle(enable, traction_m_s);
        }
    }

    /// What the master says of both drives; none before they are set up.
    fn modes(&self) -> [Option<DriveMode>; 2] {
        let readings = self.reader.readings();
        [0, 1].map(|drive| Some(self.master.report(drive, readings)?.value.mode))
    }

    fn driving() -> Self {
        let mut bench = Self::new(YAML);
        bench.cycles(20, false, 0.0);
        assert_eq!(bench.modes(), [Some(DriveMode::Disabled); 2]);
        bench.cycles(20, true, 0.5);
        assert_eq!(bench.modes(), [Some(DriveMode::Enabled); 2]);
        assert_eq!(bench.motors.traction_m_s, 0.5);
        bench
    }
}

#[test]
fn the_master_sets_drives_up_switches_them_on_and_drives_them() {
    let mut bench = Bench::driving();
    let events = ["1: it has started", "2: it has started"];
    for event in events.into_iter().chain(["1: set up and operational"]) {
        let count = bench.events.iter().filter(|told| *told == event).count();
        assert_eq!(count, 1, "{event}: {:?}", bench.events);
    }
    let speed = bench.reader.readings().drives[0].unwrap().value.speed_m_s;
    assert!((speed - 0.5).abs() < 1e-3, "{speed}");
    // Off is a quick stop, at the end of which they are off.
    bench.cycles(10, false, 0.0);
    assert_eq!(bench.drives.mode(), DriveMode::Disabled);
    assert_eq!(bench.motors.traction_m_s, 0.0);
}

#[test]
fn drives_that_miss_their_master_stop_quickly_and_say_why() {
    let mut bench = Bench::driving();
    bench.master_speaks = false;
    // It was heard a cycle ago, and may be silent for 0.2 s.
    bench.cycles(2, true, 0.5);
    assert_eq!(bench.drives.mode(), DriveMode::Enabled);
    bench.cycles(2, true, 0.5);
    assert_eq!(bench.drives.mode(), DriveMode::EmergencyStop);
    bench.cycles(6, true, 0.5);
    assert_eq!(bench.drives.mode(), DriveMode::Disabled);
    assert_eq!(bench.motors.traction_m_s, 0.0);
    let emergency = "emergency 0x8130, error register 0x11: heartbeat or life guarding lost";
    assert!(bench.events.contains(&format!("1: {emergency}")));
    bench.master_speaks = true;
    bench.cycles(2, false, 0.0);
    assert!(bench.events.contains(&"2: its error has gone".to_owned()));
}

#[test]
fn drives_that_miss_commands_stop_though_another_sends_their_masters_heartbeat() {
    let mut bench = Bench::driving();
    bench.master_speaks = false;
    let heartbeat = Frame::new(FrameId::Standard(0x77F), &[0x05]).unwrap();
    for _ in 0..10 {
        bench.drives.take(&heartbeat, bench.time_s).unwrap();
        bench.cycle(true, 0.5);
    }
    assert_eq!(bench.motors.traction_m_s, 0.0);
    assert_eq!(bench.drives.mode(), DriveMode::Disabled);
    let emergency = "emergency 0x8250, error register 0x11: commands missing (RPDO time-out)";
    assert!(bench.events.contains(&format!("2: {emergency}")));
}

#[test]
fn an_emergency_stop_is_a_quick_stop_that_holds() {
    let mut bench = Bench::driving();
    bench.emergency_stop = true;
    bench.cycle(true, 0.5);
    assert_eq!(bench.modes(), [Some(DriveMode::EmergencyStop); 2]);
    bench.cycles(20, true, 0.5);
    assert_eq!(bench.modes(), [Some(DriveMode::EmergencyStop); 2]);
    assert_eq!(bench.motors.traction_m_s, 0.0);
    bench.emergency_stop = false;
    bench.cycles(2, false, 0.0);
    assert_eq!(bench.modes(), [Some(DriveMode::Disabled); 2]);
}

/// CiA 402 lists it among the events of 0x6007 neither in its text nor in its table.
#[test]
fn drives_that_are_made_pre_operational_are_stopped_as_nodes_at_once() {
    for (node, left) in [(0, [true, true]), (2, [false, true])] {
        let mut bench = Bench::driving();
        let frame = Frame::new(NMT, &[NmtCommand::EnterPreOperational as u8, node]).unwrap();
        bench.drives.take(&frame, bench.time_s).unwrap();
        for _ in 0..10 {
            bench.time_s += STEP_S;
            let moves = bench.drives.step(bench.time_s, &bench.motors, false);
            assert_eq!(moves.unwrap().traction_m_s, 0.5, "it keeps its target");
            while let Some(frame) = bench.drives.next_frame() {
                bench.reader.take(&frame, bench.time_s).unwrap();
            }
        }
        let expected = left.map(|left| match left {
            true => Some(DriveMode::NotOperational),
            false => Some(DriveMode::Enabled),
        });
        assert_eq!(bench.modes(), expected);
        // The cycle that knows of it stops the nodes, on their own ramps.
        bench.cycle(false, 0.0);
        bench.cycles(6, false, 0.0);
        assert_eq!(bench.motors, MeasuredMotorSpeeds::default());
        assert_eq!(bench.drives.mode(), DriveMode::Disabled);
        let told = "2: no longer operational while on, stopped as a node".to_owned();
        let count = bench.events.iter().filter(|event| **event == told).count();
        assert_eq!(count, 1, "{:?}", bench.events);
    }
}

#[test]
fn a_stopped_or_reset_node_moves_nothing() {
    for (command, nmt) in [
        (NmtCommand::Stop as u8, NmtState::Stopped),
        (0x81, NmtState::PreOperational),
    ] {
        let mut bench = Bench::driving();
        let stop = Frame::new(NMT, &[command, 0]).unwrap();
        bench.drives.take(&stop, bench.time_s).unwrap();
        for _ in 0..100 {
            bench.time_s += STEP_S;
            let moves = bench.drives.step(bench.time_s, &bench.motors, false);
            assert_eq!(moves.unwrap(), MeasuredMotorSpeeds::default());
        }
        assert!(bench.drives.drives.iter().all(|drive| drive.nmt == nmt));
        let frames: Vec<Frame> = std::iter::from_fn(|| bench.drives.next_frame()).collect();
        let pdos = [0x181, 0x182].map(FrameId::Standard);
        assert!(!frames.iter().any(|frame| pdos.contains(&frame.id)));
    }
}

#[test]
fn what_cannot_be_written_is_refused_with_its_abort_code() {
    for (from, to, told) in [
        (
            "{object: 0x6060, type: i8, value: 3}",
            "{object: 0x6060, type: i8, value: 6}",
            "object 0x6060:00: refused with abort code 0x06090030",
        ),
        (
            "{object: 0x6060, type: i8, value: 3}",
            "{object: 0x6060, type: u32, value: 3}",
            "object 0x6060:00: refused with abort code 0x06070010",
        ),
        (
            "{object: 0x6060, type: i8, value: 3}",
            "{object: 0x6041, type: u16, value: 3}",
            "object 0x6041:00: refused with abort code 0x06010002",
        ),
        (
            "{object: 0x1016, sub: 1,",
            "{object: 0x1016, sub: 2,",
            "object 0x1016:02: refused with abort code 0x06090011",
        ),
        (
            "{object: 0x1017, type",
            "{object: 0x2017, type",
            "object 0x2017:00: refused with abort code 0x06020000",
        ),
    ] {
        assert!(YAML.contains(from), "{from}");
        let mut bench = Bench::new(&YAML.replace(from, to));
        bench.cycles(30, false, 0.0);
        assert_eq!(bench.modes(), [None; 2]);
        assert!(
            bench.events.iter().any(|event| event.contains(told)),
            "{told}: {:?}",
            bench.events
        );
    }
}

/// Frames written by hand from CiA 301.
#[test]
fn objects_are_read_and_written_byte_for_byte() {
    let node = NodeId::new(1).unwrap();
    let mut objects = Objects::new();
    for (request, answer) in [
        ("2F60600003000000", "6060600000000000"),
        ("4061600000000000", "4F61600003000000"),
        ("4000100000000000", "4300100092010200"),
        ("2B17100032000000", "6017100000000000"),
        ("4017100000000000", "4B17100032000000"),
        // Without its size, which is that of the object.
        ("2217100019000000", "6017100000000000"),
        ("4017100000000000", "4B17100019000000"),
        // Segmented, and a block transfer.
        ("2117100004000000", "8017100001000405"),
        ("C217100004000000", "8017100001000405"),
    ] {
        let bytes: Vec<u8> = (0..8)
            .map(|i| u8::from_str_radix(&request[2 * i..2 * i + 2], 16).unwrap())
            .collect();
        let request = Frame::new(node.request(), &bytes).unwrap();
        let answered = objects.answer(node, &request).unwrap();
        assert_eq!(answered.to_string(), format!("581#{answer}"), "{request}");
    }
    let abort = Frame::new(node.request(), &[0x80, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    assert_eq!(objects.answer(node, &abort), None);
}

/// The table of transitions of CiA 402.
#[test]
fn states_follow_the_controlword_as_cia_402_has_it() {
    use PowerState::*;
    for state in [
        NotReadyToSwitchOn,
        SwitchOnDisabled,
        ReadyToSwitchOn,
        SwitchedOn,
        OperationEnabled,
        QuickStopActive,
        FaultReactionActive,
        Fault,
    ] {
        assert_eq!(PowerState::of(state.statusword()), Some(state));
    }
    let table = [
        (SwitchOnDisabled, 0x06, ReadyToSwitchOn),
        (SwitchOnDisabled, 0x07, SwitchOnDisabled),
        (SwitchOnDisabled, 0x0F, SwitchOnDisabled),
        (SwitchOnDisabled, 0x02, SwitchOnDisabled),
        (ReadyToSwitchOn, 0x07, SwitchedOn),
        (ReadyToSwitchOn, 0x0F, OperationEnabled),
        (ReadyToSwitchOn, 0x00, SwitchOnDisabled),
        (ReadyToSwitchOn, 0x02, SwitchOnDisabled),
        (SwitchedOn, 0x0F, OperationEnabled),
        (SwitchedOn, 0x06, ReadyToSwitchOn),
        (SwitchedOn, 0x00, SwitchOnDisabled),
        (SwitchedOn, 0x02, SwitchOnDisabled),
        (OperationEnabled, 0x07, SwitchedOn),
        (OperationEnabled, 0x06, ReadyToSwitchOn),
        (OperationEnabled, 0x00, SwitchOnDisabled),
        (OperationEnabled, 0x02, QuickStopActive),
        (OperationEnabled, 0x0F, OperationEnabled),
        (QuickStopActive, 0x00, SwitchOnDisabled),
        (QuickStopActive, 0x0F, QuickStopActive),
        (QuickStopActive, 0x06, QuickStopActive),
        (Fault, 0x0F, Fault),
        (Fault, 0x00, Fault),
        (Fault, 0x80, SwitchOnDisabled),
        (FaultReactionActive, 0x80, FaultReactionActive),
    ];
    for (state, word, after) in table {
        assert_eq!(state.after(word, 0), after, "{state:?} {word:#04X}");
    }
    // Only the rising bit resets.
    assert_eq!(Fault.after(0x80, 0x80), Fault);
}

proptest! {
    /// Whatever is on the bus, the drives go on, and head for what a command can say.
    #[test]
    fn any_frames_leave_the_drives_sane(
        frames in prop::collection::vec((0..8usize, 0..=8u8, any::<[u8; 8]>()), 1..200)
    ) {
        let mut bench = Bench::driving();
        let ids = bench.drives.received_ids();
        for (id, length, data) in frames {
            let id = ids[id % ids.len()];
            let frame = Frame::new(id, &data[..usize::from(length)]).unwrap();
            let _ = bench.drives.take(&frame, bench.time_s);
            bench.time_s += STEP_S;
            let motors = bench.drives.step(bench.time_s, &bench.motors, false).unwrap();
            prop_assert!(motors.traction_m_s.abs() < 3.3 && motors.steer_m_s.abs() < 3.3);
            while let Some(frame) = bench.drives.next_frame() {
                prop_assert!(frame.length <= 8);
            }
        }
    }
}
