//! Which messages of the vehicle arrive, for an operator who wants to know why a vehicle does not move.

use super::sender::FOREIGN_S;
use sidehill_bridge::drives::{Input, InputStatus, LinkState, MISSING_AFTER_S};
use sidehill_can::cia402::NmtState;
use sidehill_can::frame::Frame;
use sidehill_can::layout::{Layout, Profile};
use sidehill_can::message::FrameFault;
use sidehill_plant::sample::Stamped;
use std::sync::Arc;
use triple_buffer::Output;

/// What the bus monitor has seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arrivals {
    pub(super) bus: LinkState,
    /// When the newest frame of each of [`Layout::from_vehicle`] came, s, and why it was refused.
    pub(super) messages: [Option<(f64, Option<FrameFault>)>; Layout::FROM_VEHICLE_MAX],
    /// Whether a position and a heading have fitted together.
    pub(super) has_pose: bool,
    /// Heartbeats of the drives, where they are CANopen nodes.
    pub(super) nodes: [Option<Stamped<NmtState>>; 2],
}

impl Default for Arrivals {
    fn default() -> Self {
        Self {
            bus: LinkState::Absent,
            messages: [None; Layout::FROM_VEHICLE_MAX],
            has_pose: false,
            nodes: [None; 2],
        }
    }
}

/// The messages that a [`CanPort`](super::CanPort) waits for.
pub struct CanInputs {
    interface: String,
    layout: Arc<Layout>,
    newest: Output<Arrivals>,
    /// The newest frame that another node has sent with an identifier of this program.
    foreign: Output<Option<Stamped<Frame>>>,
}

/// What the messages of [`Layout::from_vehicle`] carry, after those of the drives.
const SENSORS: [&str; 4] = ["attitude", "position", "heading", "yaw rate"];

impl CanInputs {
    pub(super) fn new(
        interface: &str,
        layout: Arc<Layout>,
        newest: Output<Arrivals>,
        foreign: Output<Option<Stamped<Frame>>>,
    ) -> Self {
        Self {
            interface: interface.to_owned(),
            layout,
            newest,
            foreign,
        }
    }

    fn of(&self, arrivals: &Arrivals, foreign: Option<Stamped<Frame>>, now_s: f64) -> Vec<Input> {
        let foreign = foreign.filter(|foreign| now_s - foreign.time_s <= FOREIGN_S);
        let mut inputs = vec![Input {
            input: "bus".to_owned(),
            source: self.interface.clone(),
            missing: bus_fault(arrivals.bus, &self.interface)
                .or_else(|| foreign.map(|foreign| foreign_fault(&foreign.value))),
        }];
        // Without a bus nothing else can arrive: one cause, one line.
        let bus_is_up = arrivals.bus.carries();
        for (index, message) in self.layout.from_vehicle().enumerate() {
            let input = match self.layout.drives.get(index) {
                Some(drive) => format!("{} drive", drive.role.name()),
                None => SENSORS[index - 2].to_owned(),
            };
            let missing = self.message_fault(arrivals, index, now_s);
            inputs.push(Input {
                input,
                source: format!("{} (message {})", message.id(), message.name()),
                missing: missing.filter(|_| bus_is_up && index < Layout::FROM_VEHICLE_NEEDED),
            });
        }
        inputs
    }

    fn message_fault(&self, arrivals: &Arrivals, index: usize, now_s: f64) -> Option<String> {
        if let (Profile::Cia402(cia402), true) = (&self.layout.profile, index < 2)
            && let Some(fault) = node_fault(
                cia402.nodes[index].get(),
                arrivals.nodes[index],
                arrivals.messages[index].is_some(),
                now_s,
            )
        {
            return Some(fault);
        }
        match arrivals.messages[index] {
            None => Some("no frame has arrived".to_owned()),
            Some((_, Some(fault))) => Some(format!("its frames are refused: {fault}")),
            Some((time_s, None)) if now_s - time_s > MISSING_AFTER_S => {
                Some(format!("no frame for {:.0} s", now_s - time_s))
            }
            // The last of the two messages of a pose.
            Some(_) if index == 4 && !arrivals.has_pose => {
                Some("no position with the same counter has arrived".to_owned())
            }
            Some(_) => None,
        }
    }
}

impl InputStatus for CanInputs {
    fn inputs(&mut self, now_s: f64) -> Vec<Input> {
        let arrivals = *self.newest.read();
        let foreign = *self.foreign.read();
        self.of(&arrivals, foreign, now_s)
    }
}

/// Returns why a bus carries nothing and what to do; none for one that does.
pub fn bus_fault(bus: LinkState, interface: &str) -> Option<String> {
    match bus {
        LinkState::Active | LinkState::Warning | LinkState::Passive => None,
        LinkState::BusOff => Some(
            "bus-off after too many errors: check the bit rate, the termination and the wiring"
                .to_owned(),
        ),
        LinkState::Down => Some(format!("the interface is down: ip link set {interface} up")),
        // The sender hears those, not the monitor.
        LinkState::Foreign => None,
        LinkState::Absent => Some("there is no such interface: ip link lists them".to_owned()),
    }
}

fn foreign_fault(frame: &Frame) -> String {
    format!(
        "another node sends {}, an identifier of this program: end it or give it another number",
        frame.id
    )
}

/// Returns why a CANopen node is not ready as a drive yet.
fn node_fault(
    node: u8,
    nmt: Option<Stamped<NmtState>>,
    pdo_arrived: bool,
    now_s: f64,
) -> Option<String> {
    let Some(nmt) = nmt else {
        let hint = match pdo_arrived {
            true => "its PDO arrives, but no heartbeat (object 1017)",
            false => "nothing answers: check node number, power and bit rate",
        };
        return Some(format!("node {node}: {hint}"));
    };
    let age_s = now_s - nmt.time_s;
    if age_s > MISSING_AFTER_S {
        return Some(format!("node {node}: no heartbeat for {age_s:.0} s"));
    }
    (nmt.value != NmtState::Operational && !pdo_arrived)
        .then(|| format!("node {node}: it is {:?}, its setup is not done", nmt.value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_can::config::CanConfig;
    use sidehill_can::database::Database;
    use sidehill_can::frame::FrameId;
    use triple_buffer::triple_buffer;

    fn of(yaml: &str, dbc: &str) -> CanInputs {
        let config: CanConfig = serde_yaml::from_str(yaml).unwrap();
        let layout = Layout::new(&config, &Database::parse("dbc", dbc).unwrap()).unwrap();
        let (_, newest) = triple_buffer(&Arrivals::default());
        let (_, foreign) = triple_buffer(&None);
        CanInputs::new("can0", Arc::new(layout), newest, foreign)
    }

    fn missing(inputs: &CanInputs, arrivals: &Arrivals, now_s: f64) -> Vec<String> {
        let inputs = inputs.of(arrivals, None, now_s);
        let missing = inputs.iter().filter(|input| input.missing.is_some());
        missing.map(Input::to_string).collect()
    }

    #[test]
    fn a_message_that_does_not_come_is_named_with_its_identifier() {
        let inputs = of(
            include_str!("../../../../config/bridge/can.yaml"),
            include_str!("../../../../config/bridge/j8.dbc"),
        );
        let mut arrivals = Arrivals::default();
        let absent = missing(&inputs, &arrivals, 5.0);
        assert_eq!(absent.len(), 1, "one cause, one line: {absent:?}");
        assert!(absent[0].contains("bus on can0: there is no such interface"));
        arrivals.bus = LinkState::Active;
        assert_eq!(missing(&inputs, &arrivals, 5.0).len(), 5);
        arrivals.messages = [Some((5.0, None)); Layout::FROM_VEHICLE_MAX];
        arrivals.has_pose = true;
        assert_eq!(missing(&inputs, &arrivals, 5.1), [""; 0]);
        let frame = Frame::new(FrameId::Standard(0x100), &[0; 8]).unwrap();
        let foreign = Some(Stamped {
            time_s: 5.0,
            value: frame,
        });
        let bus = |now_s| inputs.of(&arrivals, foreign, now_s)[0].missing.clone();
        assert!(bus(5.1).unwrap().starts_with("another node sends 100,"));
        assert_eq!(bus(8.1), None);
        let fault = FrameFault::Length {
            found: 4,
            expected: 8,
        };
        arrivals.messages[2] = Some((5.0, Some(fault)));
        let refused = missing(&inputs, &arrivals, 5.1);
        assert!(refused[0].starts_with("attitude on "), "{refused:?}");
        assert!(refused[0].contains("refused: 4 bytes, expected 8"));
        arrivals.messages[2] = Some((1.0, None));
        assert!(missing(&inputs, &arrivals, 5.0)[0].ends_with("no frame for 4 s"));
    }

    #[test]
    fn nothing_waits_for_a_yaw_rate() {
        let yaml =
            include_str!("../../../../config/bridge/can.yaml").replace("# yaw_rate:", "yaw_rate:");
        let inputs = of(&yaml, include_str!("../../../../config/bridge/j8.dbc"));
        let mut arrivals = Arrivals {
            bus: LinkState::Active,
            messages: [Some((5.0, None)); Layout::FROM_VEHICLE_MAX],
            has_pose: true,
            ..Arrivals::default()
        };
        arrivals.messages[5] = None;
        let listed = inputs.of(&arrivals, None, 5.0);
        assert_eq!(listed.last().unwrap().input, "yaw rate");
        assert_eq!(missing(&inputs, &arrivals, 5.0), [""; 0]);
    }

    #[test]
    fn a_node_that_does_not_answer_is_named_with_its_number() {
        let inputs = of(
            include_str!("../../../../config/bridge/cia402.yaml"),
            include_str!("../../../../config/bridge/cia402.dbc"),
        );
        let mut arrivals = Arrivals {
            bus: LinkState::Active,
            messages: [None, Some((5.0, None)), None, None, None, None],
            ..Arrivals::default()
        };
        let silent = missing(&inputs, &arrivals, 5.0);
        assert!(silent[0].contains("node 1: nothing answers"), "{silent:?}");
        assert!(silent[1].contains("node 2: its PDO arrives, but no heartbeat"));
        let heartbeat = |time_s, value| Some(Stamped { time_s, value });
        arrivals.nodes = [
            heartbeat(5.0, NmtState::PreOperational),
            heartbeat(5.0, NmtState::Operational),
        ];
        let early = missing(&inputs, &arrivals, 5.0);
        assert!(
            early[0].contains("node 1: it is PreOperational"),
            "{early:?}"
        );
        assert!(!early.iter().any(|line| line.contains("node 2")));
        assert!(missing(&inputs, &arrivals, 9.0)[0].contains("node 1: no heartbeat for 4 s"));
    }
}
