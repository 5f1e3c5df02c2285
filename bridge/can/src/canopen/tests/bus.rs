//! A bus with two drives as CiA 402 has them.

use super::*;

/// A drive that follows CiA 402's table of transitions, with the node behind it.
pub struct Peer {
    node: u8,
    pub word: u16,
    pub speed_raw: i32,
    pub control: u16,
    pub target_raw: i32,
    /// Objects written.
    pub written: Vec<(u16, u8, Vec<u8>)>,
    /// Heartbeat's byte; none is silent.
    pub nmt: Option<u8>,
    /// Object that is refused.
    pub refuses: Option<u16>,
    /// Object that reads 0, whatever is written.
    pub forgets: Option<u16>,
    /// What the display of its mode shows; none where it has no such object.
    pub mode: Option<u8>,
    pub deaf: bool,
    /// Frames to send.
    pub says: Vec<Frame>,
    pub resets: u32,
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
            forgets: None,
            mode: Some(3),
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
            let read = data[0] == 0x40;
            let value = match self
                .written
                .iter()
                .rev()
                .find(|w| (w.0, w.1) == (index, sub))
            {
                _ if index == 0x6061 => self.mode.map(|mode| vec![mode]),
                written => written.map(|written| written.2.clone()),
            };
            let answer = if read && let Some(value) = value {
                let mut answer = vec![0x43 | (4 - value.len() as u8) << 2, data[1], data[2], sub];
                let keeps = self.forgets != Some(index);
                answer.extend(value.iter().map(|byte| if keeps { *byte } else { 0 }));
                answer.resize(8, 0);
                answer
            } else if read {
                vec![0x80, data[1], data[2], sub, 0x00, 0x00, 0x02, 0x06]
            } else if self.refuses == Some(index) {
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

    pub fn say(&mut self) -> Vec<Frame> {
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
pub struct Bus {
    pub master: Master,
    pub reader: VehicleReader,
    pub peers: [Peer; 2],
    pub now_s: f64,
    pub words: [Vec<u16>; 2],
    pub sent: Vec<Frame>,
    pub events: Vec<(u8, DriveEvent)>,
}

impl Bus {
    pub fn new() -> Self {
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

    pub fn cycle(&mut self, speeds: [f64; 2], enable: bool, fault_reset: bool) {
        self.now_s += 0.05;
        for peer in &mut self.peers {
            for frame in peer.say() {
                self.reader.take(&frame, self.now_s).unwrap();
            }
        }
        let order = MotorCommand {
            speeds: MeasuredMotorSpeeds {
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

    pub fn off(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.cycle([0.0; 2], false, false);
        }
    }

    pub fn arm(&mut self) {
        for _ in 0..5 {
            self.cycle([0.0; 2], false, true);
        }
    }

    pub fn on(&mut self, speeds: [f64; 2], cycles: u32) {
        for _ in 0..cycles {
            self.cycle(speeds, true, false);
        }
    }

    pub fn mode(&self, drive: usize) -> Option<DriveMode> {
        let report = self.master.report(drive, self.reader.readings());
        report.map(|report| report.value.mode)
    }

    pub fn driving() -> Self {
        let mut bus = Self::new();
        bus.off(14);
        bus.arm();
        bus.on([0.5, -0.25], 8);
        bus
    }
}
