//! Finds the nodes of a bus and reads who they are. It has no socket and no clock, and sends nothing but requests to read
//! objects.

use crate::cia402::{
    Emergency, NmtState, NodeId, NodeReading, PROFILE_402, PowerState, SdoRequest,
};
use crate::frame::{Frame, FrameId};
use std::collections::{BTreeMap, VecDeque};

/// Objects of a node.
mod object {
    pub(super) const DEVICE_TYPE: (u16, u8) = (0x1000, 0);
    pub(super) const ERROR_REGISTER: (u16, u8) = (0x1001, 0);
    pub(super) const ERRORS: u16 = 0x1003;
    pub(super) const IDENTITY: u16 = 0x1018;
    pub(super) const ERROR_CODE: (u16, u8) = (0x603F, 0);
    pub(super) const STATUSWORD: (u16, u8) = (0x6041, 0);
    pub(super) const MODE: (u16, u8) = (0x6061, 0);
}

/// Most of the last errors that are read.
const ERRORS_MAX: u32 = 4;

/// What a scan has found of a node.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundNode {
    /// Its number.
    pub node: NodeId,
    /// Its state, as its heartbeat has it; none without a heartbeat.
    pub nmt: Option<NmtState>,
    /// Whether it has answered a request.
    pub answers: bool,
    /// Object 0x1000: its device type.
    pub device_type: Option<u32>,
    /// Object 0x1018: vendor, product, revision and serial number.
    pub identity: [Option<u32>; 4],
    /// Whether it is a drive of CiA 402.
    pub is_drive: bool,
    /// Object 0x6041: the state of a drive.
    pub power: Option<PowerState>,
    /// Object 0x6061: the mode of operation of a drive.
    pub mode: Option<i8>,
    /// Object 0x1001: its error register.
    pub error_register: Option<u8>,
    /// Codes of its last errors, the newest first: object 0x1003, or 0x603F where that is empty.
    pub errors: Vec<u16>,
    /// The newest emergency that it has sent meanwhile.
    pub emergency: Option<Emergency>,
}

/// A scan of all numbers.
pub struct NetworkScan {
    nodes: Vec<ScannedNode>,
    begin_s: f64,
    sent_s: f64,
}

impl NetworkScan {
    /// Time in which nothing is sent and heartbeats are listened for, s.
    pub const LISTEN_S: f64 = 1.5;
    /// Longest wait for an answer, s. Then the request is sent once more.
    pub const ANSWER_S: f64 = 0.25;
    /// Least time between two requests, s: a request and its answer take half of it at 125 kbit/s.
    const PACE_S: f64 = 0.005;

    /// Returns a scan that begins at `now_s`.
    pub fn new(now_s: f64) -> Self {
        Self {
            nodes: (1..=127)
                .filter_map(NodeId::new)
                .map(ScannedNode::new)
                .collect(),
            begin_s: now_s,
            sent_s: f64::NEG_INFINITY,
        }
    }

    /// Returns the identifiers of the frames that nodes send.
    pub fn received_ids(&self) -> Vec<FrameId> {
        let ids = self.nodes.iter().map(|node| node.node.received_ids());
        ids.flatten().collect()
    }

    /// Returns the identifiers of the frames that a scan sends.
    pub fn request_ids(&self) -> Vec<FrameId> {
        self.nodes.iter().map(|node| node.node.request()).collect()
    }

    /// Takes a frame that arrived at `time_s`. Frames of other identifiers, and those that are not valid, have no effect.
    pub fn take(&mut self, frame: &Frame, time_s: f64) {
        for node in &mut self.nodes {
            if node.node.received_ids().contains(&frame.id) {
                let _ = node.reading.take(node.node, frame, time_s);
            }
        }
    }

    /// Returns the request that is to be sent now.
    pub fn next(&mut self, now_s: f64) -> Option<Frame> {
        self.nodes.iter_mut().for_each(|node| node.notice(now_s));
        if now_s < self.begin_s + Self::LISTEN_S || now_s < self.sent_s + Self::PACE_S {
            return None;
        }
        let frame = self.nodes.iter_mut().find_map(|node| node.ask(now_s))?;
        self.sent_s = now_s;
        Some(frame)
    }

    /// Returns whether all has been asked, and answered or not.
    pub fn is_done(&self, now_s: f64) -> bool {
        now_s >= self.begin_s + Self::LISTEN_S && self.nodes.iter().all(ScannedNode::is_done)
    }

    /// Returns the nodes that have been heard.
    pub fn found(&self) -> Vec<FoundNode> {
        self.nodes.iter().filter_map(ScannedNode::found).collect()
    }
}

/// Reads some objects of two drives, one after the other of each. It has no socket and no clock.
pub struct ObjectReader([ScannedNode; 2]);

impl ObjectReader {
    /// Returns a reader of these objects, by index and subindex.
    pub fn new(nodes: [NodeId; 2], objects: &[(u16, u8)]) -> Self {
        Self(nodes.map(|node| ScannedNode {
            questions: objects.iter().copied().collect(),
            ..ScannedNode::new(node)
        }))
    }

    /// Returns the identifiers of the answers.
    pub fn received_ids(&self) -> [FrameId; 2] {
        self.0.each_ref().map(|node| node.node.answer())
    }

    /// Takes a frame that arrived at `time_s`. Frames that are no answers have no effect.
    pub fn take(&mut self, frame: &Frame, time_s: f64) {
        for node in &mut self.0 {
            if frame.id == node.node.answer() {
                let _ = node.reading.take(node.node, frame, time_s);
            }
        }
    }

    /// Returns a request that is to be sent now.
    pub fn next(&mut self, now_s: f64) -> Option<Frame> {
        self.0.iter_mut().for_each(|node| node.notice(now_s));
        self.0.iter_mut().find_map(|node| node.ask(now_s))
    }

    /// Returns whether all has been asked, and answered or not.
    pub fn is_done(&self) -> bool {
        self.0.iter().all(ScannedNode::is_done)
    }

    /// Returns the bits of an object of a drive; none where it does not have it or has not answered.
    pub fn read(&self, drive: usize, object: (u16, u8)) -> Option<u32> {
        self.0.get(drive)?.objects.get(&object).copied()
    }
}

/// A request on its way.
#[derive(Debug, Clone, Copy)]
struct Asked {
    request: SdoRequest,
    at_s: f64,
    /// Answers before it.
    answers: u32,
}

struct ScannedNode {
    node: NodeId,
    reading: NodeReading,
    /// What is asked next.
    questions: VecDeque<(u16, u8)>,
    asked: Option<Asked>,
    /// Whether the question has been asked without an answer before.
    repeated: bool,
    /// What was read.
    objects: BTreeMap<(u16, u8), u32>,
    answers: bool,
}

impl ScannedNode {
    fn new(node: NodeId) -> Self {
        Self {
            node,
            reading: NodeReading::default(),
            questions: VecDeque::from([object::DEVICE_TYPE]),
            asked: None,
            repeated: false,
            objects: BTreeMap::new(),
            answers: false,
        }
    }

    fn is_done(&self) -> bool {
        self.questions.is_empty() && self.asked.is_none()
    }

    /// Takes the answer to what was asked, or gives it up.
    fn notice(&mut self, now_s: f64) {
        let Some(asked) = self.asked else { return };
        let address = (asked.request.object, asked.request.sub);
        match self.reading.answer_to(&asked.request, asked.answers) {
            Some(answer) => {
                self.asked = None;
                self.repeated = false;
                self.answers = true;
                let value = answer.result.ok().flatten();
                if let Some(value) = value {
                    self.objects.insert(address, value);
                }
                self.ask_further(address, value);
            }
            None if now_s - asked.at_s <= NetworkScan::ANSWER_S => {}
            None if !self.repeated => {
                self.asked = None;
                self.repeated = true;
                self.questions.push_front(address);
            }
            // Nobody there, or no longer: the rest would be waited for in vain.
            None => {
                self.asked = None;
                self.questions.clear();
            }
        }
    }

    /// Adds the questions that follow from an answer; `value` is none where the object is refused.
    fn ask_further(&mut self, address: (u16, u8), value: Option<u32>) {
        match (address, value) {
            (object::DEVICE_TYPE, _) => {
                self.questions.push_back(object::ERROR_REGISTER);
                self.questions
                    .extend((1..=4).map(|sub| (object::IDENTITY, sub)));
                self.questions.push_back((object::ERRORS, 0));
                self.questions.push_back(object::STATUSWORD);
            }
            ((object::ERRORS, 0), Some(count)) => {
                let count = (count & 0xFF).min(ERRORS_MAX) as u8;
                self.questions
                    .extend((1..=count).map(|sub| (object::ERRORS, sub)));
            }
            (object::STATUSWORD, Some(_)) => {
                self.questions.extend([object::MODE, object::ERROR_CODE]);
            }
            _ => {}
        }
    }

    fn ask(&mut self, now_s: f64) -> Option<Frame> {
        if self.asked.is_some() {
            return None;
        }
        let (object, sub) = self.questions.pop_front()?;
        let request = SdoRequest::read(self.node, object, sub, 0);
        self.asked = Some(Asked {
            request,
            at_s: now_s,
            answers: self.reading.answers.count(),
        });
        Some(request.frame)
    }

    fn found(&self) -> Option<FoundNode> {
        let emergency = self.reading.emergencies.since(0).last();
        let heard = self.answers || self.reading.nmt.is_some() || emergency.is_some();
        heard.then(|| {
            let read = |address| self.objects.get(&address).copied();
            let device_type = read(object::DEVICE_TYPE);
            let statusword = read(object::STATUSWORD);
            let stored = (1..=ERRORS_MAX as u8)
                .filter_map(|sub| read((object::ERRORS, sub)))
                // The high half is the maker's own.
                .map(|error| error as u16)
                .filter(|code| *code != 0);
            let mut errors: Vec<u16> = stored.collect();
            let newest = read(object::ERROR_CODE).map(|code| code as u16);
            if errors.is_empty() {
                errors.extend(newest.filter(|code| *code != 0));
            }
            FoundNode {
                node: self.node,
                nmt: self.reading.nmt.map(|nmt| nmt.value),
                answers: self.answers,
                device_type,
                identity: [1, 2, 3, 4].map(|sub| read((object::IDENTITY, sub))),
                is_drive: statusword.is_some()
                    || device_type.is_some_and(|device| device & 0xFFFF == PROFILE_402),
                power: statusword.and_then(|word| PowerState::of(word as u16)),
                mode: read(object::MODE).map(|mode| mode as u8 as i8),
                error_register: read(object::ERROR_REGISTER).map(|register| register as u8),
                errors,
                emergency,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cia402::objects::Objects;

    /// A bus on which `answer` answers requests with node and request, after 1 ms.
    fn scan(
        mut answer: impl FnMut(u8, &Frame) -> Option<Frame>,
        heard: &[Frame],
    ) -> (Vec<FoundNode>, f64, Vec<Frame>) {
        let mut scan = NetworkScan::new(10.0);
        let (mut now_s, mut sent) = (10.0, Vec::new());
        heard.iter().for_each(|frame| scan.take(frame, now_s));
        while !scan.is_done(now_s) {
            now_s += 0.001;
            assert!(now_s < 20.0, "no end");
            if let Some(frame) = scan.next(now_s) {
                assert!(now_s >= 10.0 + NetworkScan::LISTEN_S);
                let FrameId::Standard(id) = frame.id else {
                    panic!("extended");
                };
                if let Some(frame) = answer((id - 0x600) as u8, &frame) {
                    scan.take(&frame, now_s);
                }
                sent.push(frame);
            }
        }
        (scan.found(), now_s - 10.0, sent)
    }

    fn id(node: u8) -> NodeId {
        NodeId::new(node).unwrap()
    }

    #[test]
    fn a_drive_is_found_with_its_identity_state_and_errors() {
        let mut objects = Objects::new();
        objects.set((0x1018, 1), 0xFB);
        objects.set((0x1018, 4), 4711);
        objects.set(object::ERROR_REGISTER, 0x11);
        objects.set((object::ERRORS, 0), 2);
        objects.set((object::ERRORS, 1), 0x1234_8130);
        objects.set((object::ERRORS, 2), 0x3210);
        objects.set(object::STATUSWORD, 0x0240);
        let heartbeat = NmtState::PreOperational.heartbeat(id(5));
        let answer = |node, frame: &Frame| {
            let answered = (node == 5).then(|| objects.answer(id(5), frame));
            answered.flatten()
        };
        let (found, time_s, sent) = scan(answer, &[heartbeat]);
        assert_eq!(found.len(), 1);
        let node = &found[0];
        assert_eq!(
            (node.node, node.nmt),
            (id(5), Some(NmtState::PreOperational))
        );
        assert_eq!(node.device_type, Some(0x0002_0192));
        assert_eq!(
            (node.identity[0], node.identity[3]),
            (Some(0xFB), Some(4711))
        );
        assert!(node.is_drive && node.answers);
        assert_eq!(node.power, Some(PowerState::SwitchOnDisabled));
        assert_eq!((node.mode, node.error_register), (Some(0), Some(0x11)));
        assert_eq!(node.errors, [0x8130, 0x3210]);
        assert!(time_s < 5.0, "{time_s}");
        // Nothing but requests to read.
        assert!(sent.iter().all(|frame| frame.data[0] == 0x40));
    }

    #[test]
    fn objects_of_two_drives_are_read_as_far_as_there_are_any() {
        let (first, second) = (id(1), id(2));
        let wanted = [(0x6063, 0), (0x6064, 0), (0x608F, 1)];
        let mut reader = ObjectReader::new([first, second], &wanted);
        let mut objects = Objects::new();
        objects.set((0x6064, 0), (-5_i32) as u32);
        let mut now_s = 0.0;
        while !reader.is_done() {
            now_s += 0.05;
            assert!(now_s < 2.0, "no end");
            let Some(frame) = reader.next(now_s) else {
                continue;
            };
            // The second is silent.
            if frame.id == first.request() {
                reader.take(&objects.answer(first, &frame).unwrap(), now_s);
            }
        }
        assert_eq!(reader.read(0, (0x6063, 0)), None);
        assert_eq!(reader.read(0, (0x6064, 0)), Some((-5_i32) as u32));
        assert_eq!(reader.read(0, (0x608F, 1)), Some(4096));
        assert_eq!(reader.read(1, (0x6064, 0)), None);
    }

    #[test]
    fn a_bus_on_which_nobody_answers_is_given_up_in_time() {
        let (found, time_s, sent) = scan(|_, _| None, &[]);
        assert!(found.is_empty());
        // Two requests to each number.
        assert_eq!(sent.len(), 2 * 127);
        assert!(time_s < 4.0, "{time_s}");
        // A node that is stopped is known by its heartbeat alone.
        let (found, ..) = scan(|_, _| None, &[NmtState::Stopped.heartbeat(id(9))]);
        assert_eq!((found[0].node, found[0].answers), (id(9), false));
    }

    #[test]
    fn a_node_of_127_that_refuse_all_and_one_that_falls_silent_end_the_scan() {
        let refuse = |node: u8, frame: &Frame| {
            let data = frame.data;
            let abort = [0x80, data[1], data[2], data[3], 0, 0, 2, 6];
            Frame::new(id(node).answer(), &abort)
        };
        let (found, ..) = scan(refuse, &[]);
        assert_eq!(found.len(), 127);
        assert!(
            found
                .iter()
                .all(|node| !node.is_drive && node.errors.is_empty())
        );
        let mut left = 3;
        let (found, time_s, _) = scan(
            |node, frame| {
                let answers = node == 7 && left > 0;
                left -= u8::from(answers);
                answers
                    .then(|| Objects::new().answer(id(7), frame))
                    .flatten()
            },
            &[],
        );
        assert_eq!((found.len(), found[0].is_drive), (1, true));
        assert!(time_s < 4.0, "{time_s}");
    }
}
