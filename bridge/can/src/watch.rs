//! What the drives of a layout say, for somebody who only listens.

use crate::cia402::{
    Cia402, Emergency, NmtState, NodeReading, PowerState, SdoRequest, mode_words, statusword_notes,
};
use crate::controller_side::VehicleReader;
use crate::frame::Frame;
use crate::layout::{Layout, Profile};
use crate::load::bits_on_bus;
use crate::message::{DriveRole, Quantity};
use serde::Serialize;
use sidehill_bridge::drives::{DriveMode, MISSING_AFTER_S};
use sidehill_plant::sample::Stamped;
use std::sync::Arc;

/// Time over which frames are counted, s.
const COUNTING_S: f64 = 1.0;

/// A drive as it reports.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WatchedDrive {
    /// What it moves.
    pub role: DriveRole,
    /// Its node number, if it speaks CANopen.
    pub node: Option<u8>,
    /// State of its node.
    pub nmt: Option<NmtState>,
    /// Age of its heartbeat, s.
    pub nmt_age_s: Option<f64>,
    /// What its state means to the safety.
    pub state: Option<DriveMode>,
    /// State of CiA 402.
    pub power: Option<PowerState>,
    /// Statusword.
    pub statusword: Option<u16>,
    /// What other bits of the statusword say.
    pub notes: Vec<&'static str>,
    /// Mode of operation, object 0x6061, as somebody has read it last.
    pub mode: Option<i8>,
    /// Speed, m/s of the treads.
    pub speed_m_s: Option<f64>,
    /// The same of the motor, rad/s, where the database says that the signal counts turns.
    pub speed_rad_s: Option<f64>,
    /// Age of its report, s.
    pub age_s: Option<f64>,
    /// Reports in a second.
    pub reports_s: f64,
    /// Speed that somebody commands, m/s; none where no command has been heard for a second.
    pub commanded_m_s: Option<f64>,
    /// Code of its last emergency, 0 if that is over; none without one.
    pub error: Option<u16>,
    /// Error register of its last emergency.
    pub error_register: Option<u8>,
}

/// How many frames there were.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Traffic {
    /// Frames in a second.
    pub frames_s: f64,
    /// Bits in a second, stuff bits included.
    pub bits_s: f64,
}

/// Reads everything on a bus and sends nothing. It has no socket and no clock.
pub struct DriveWatch {
    layout: Arc<Layout>,
    reader: VehicleReader,
    commands: [Option<Stamped<f64>>; 2],
    modes: [Option<i8>; 2],
    /// Answers and emergencies of each node that have been looked at.
    answers: [u32; 2],
    emergencies: [u32; 2],
    /// Heartbeat of a controller with this program's number.
    controller: Option<Stamped<NmtState>>,
    counted: Counted,
    traffic: Traffic,
    reports_s: [f64; 2],
}

/// Since the counting began.
#[derive(Debug, Clone, Copy, Default)]
struct Counted {
    since_s: f64,
    frames: u32,
    bits: u32,
    reports: [u32; 2],
}

impl DriveWatch {
    /// Returns a watch that begins at `now_s`.
    pub fn new(layout: Arc<Layout>, now_s: f64) -> Self {
        Self {
            reader: VehicleReader::new(Arc::clone(&layout)),
            layout,
            commands: [None; 2],
            modes: [None; 2],
            answers: [0; 2],
            emergencies: [0; 2],
            controller: None,
            counted: Counted {
                since_s: now_s,
                ..Counted::default()
            },
            traffic: Traffic::default(),
            reports_s: [0.0; 2],
        }
    }

    /// Takes a frame that arrived at `time_s`, and passes the emergencies in it, with the number of their node, to `tell`.
    pub fn take(&mut self, frame: &Frame, time_s: f64, mut tell: impl FnMut(u8, Emergency)) {
        let counted = &mut self.counted;
        counted.frames += 1;
        counted.bits += bits_on_bus(frame);
        // What is refused is counted by the reader.
        let taken = self.reader.take(frame, time_s);
        for (drive, codec) in self.layout.drives.iter().enumerate() {
            if codec.message.id() == frame.id && taken.is_ok() {
                counted.reports[drive] += 1;
            }
        }
        let roles = self.layout.drives.each_ref().map(|drive| drive.role);
        for message in &self.layout.command {
            if message.id() != frame.id {
                continue;
            }
            let Ok(Some(contents)) = message.decode(frame) else {
                continue;
            };
            for (command, role) in self.commands.iter_mut().zip(roles) {
                if let Some(value) = contents.get(Quantity::Command(role)) {
                    *command = Some(Stamped { time_s, value });
                }
            }
        }
        if let Profile::Cia402(cia402) = &self.layout.profile {
            if frame.id == cia402.own.heartbeat() {
                let mut own = NodeReading::default();
                if own.take(cia402.own, frame, time_s).is_ok() {
                    self.controller = own.nmt;
                }
            }
            for (i, node) in cia402.nodes.into_iter().enumerate() {
                let reading = &self.reader.readings().nodes[i];
                let display = SdoRequest::read(node, 0x6061, 0, 0);
                let read = reading.answer_to(&display, self.answers[i]);
                if let Some(Ok(Some(mode))) = read.map(|answer| answer.result) {
                    self.modes[i] = Some(mode as u8 as i8);
                }
                self.answers[i] = reading.answers.count();
                for emergency in reading.emergencies.since(self.emergencies[i]) {
                    tell(node.get(), emergency);
                }
                self.emergencies[i] = reading.emergencies.count();
            }
        }
    }

    /// Returns how many frames there were in the last whole second.
    pub fn traffic(&mut self, now_s: f64) -> Traffic {
        let counted = &mut self.counted;
        let time_s = now_s - counted.since_s;
        if time_s >= COUNTING_S {
            self.traffic = Traffic {
                frames_s: f64::from(counted.frames) / time_s,
                bits_s: f64::from(counted.bits) / time_s,
            };
            self.reports_s = counted.reports.map(|reports| f64::from(reports) / time_s);
            *counted = Counted {
                since_s: now_s,
                ..Counted::default()
            };
        }
        self.traffic
    }

    /// Returns the state of the node with this program's number, if another program has sent its heartbeat lately.
    pub fn controller(&self, now_s: f64) -> Option<NmtState> {
        self.controller
            .filter(|heard| now_s - heard.time_s <= MISSING_AFTER_S)
            .map(|heard| heard.value)
    }

    /// Returns how many frames of the vehicle were refused, and why the last one was.
    pub fn refused(&self) -> (u64, Option<String>) {
        let readings = self.reader.readings();
        let reason = readings.last_fault.map(|fault| fault.to_string());
        (readings.refused, reason)
    }

    /// Returns what the drives have reported until `now_s`.
    pub fn drives(&self, now_s: f64) -> [WatchedDrive; 2] {
        let cia402 = match &self.layout.profile {
            Profile::Cia402(cia402) => Some(cia402),
            Profile::Values(_) => None,
        };
        [0, 1].map(|drive| self.drive(drive, cia402, now_s))
    }

    fn drive(&self, drive: usize, cia402: Option<&Cia402>, now_s: f64) -> WatchedDrive {
        let readings = self.reader.readings();
        let codec = &self.layout.drives[drive];
        let report = readings.drives[drive];
        let node = &readings.nodes[drive];
        let statusword = node.power.map(|_| node.statusword);
        let rotation = codec.message.rotation_rad_s(Quantity::Speed(codec.role));
        let speed_m_s = report.map(|report| report.value.speed_m_s);
        let emergency = node
            .emergencies
            .since(node.emergencies.count().wrapping_sub(1));
        let emergency = emergency.last();
        WatchedDrive {
            role: codec.role,
            node: cia402.map(|cia402| cia402.nodes[drive].get()),
            nmt: node.nmt.map(|nmt| nmt.value),
            nmt_age_s: node.nmt.map(|nmt| now_s - nmt.time_s),
            state: report.map(|report| report.value.mode),
            power: node.power,
            statusword,
            notes: statusword.map_or(Vec::new(), statusword_notes),
            mode: self.modes[drive],
            speed_m_s,
            speed_rad_s: speed_m_s
                .zip(rotation)
                .map(|(speed_m_s, rotation)| speed_m_s * rotation),
            age_s: report.map(|report| now_s - report.time_s),
            reports_s: self.reports_s[drive],
            commanded_m_s: self.commands[drive]
                .filter(|command| now_s - command.time_s <= MISSING_AFTER_S)
                .map(|command| command.value),
            error: emergency.map(|emergency| emergency.code),
            error_register: emergency.map(|emergency| emergency.register),
        }
    }
}

impl WatchedDrive {
    /// Returns its state in words; speeds and counts are not in it.
    pub fn words(&self) -> String {
        let mut words = Vec::new();
        let is_old = |age_s: Option<f64>| age_s.is_none_or(|age_s| age_s > MISSING_AFTER_S);
        match (self.node, self.nmt) {
            (None, _) => {}
            (Some(_), None) => words.push("no heartbeat".to_owned()),
            (Some(_), Some(_)) if is_old(self.nmt_age_s) => {
                words.push("its heartbeat has ended".to_owned());
            }
            (Some(_), Some(nmt)) => words.push(nmt.to_string()),
        }
        match (self.power, self.state) {
            (_, None) => words.push("no report".to_owned()),
            (_, Some(_)) if is_old(self.age_s) => words.push("its reports have ended".to_owned()),
            (Some(power), _) => words.push(power.to_string()),
            (None, Some(state)) => words.push(state_words(state).to_owned()),
        }
        words.extend(self.notes.iter().map(|note| (*note).to_owned()));
        words.extend(self.mode.map(|mode| mode_words(mode).to_owned()));
        words.join(", ")
    }
}

fn state_words(state: DriveMode) -> &'static str {
    match state {
        DriveMode::Disabled => "off",
        DriveMode::Enabled => "on",
        DriveMode::EmergencyStop => "emergency stop",
        DriveMode::Fault => "fault",
        DriveMode::NotOperational => "node not operational",
        DriveMode::OtherMode => "in another mode of operation",
        DriveMode::Frozen => "frozen",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cia402::NodeId;
    use crate::config::CanConfig;
    use crate::database::Database;
    use crate::frame::FrameId;

    fn watch() -> DriveWatch {
        let config: CanConfig =
            serde_yaml::from_str(include_str!("../../../config/bridge/cia402.yaml")).unwrap();
        let database = include_str!("../../../config/bridge/cia402.dbc");
        let database = Database::parse("cia402.dbc", database).unwrap();
        DriveWatch::new(Arc::new(Layout::new(&config, &database).unwrap()), 0.0)
    }

    fn frame(id: u16, data: &[u8]) -> Frame {
        Frame::new(FrameId::Standard(id), data).unwrap()
    }

    #[test]
    fn a_drive_is_told_in_words_with_its_speeds_and_mode() {
        let mut watch = watch();
        assert_eq!(watch.drives(0.0)[0].words(), "no heartbeat, no report");
        let mut told = Vec::new();
        let node = NodeId::new(1).unwrap();
        let heard = [
            NmtState::Operational.heartbeat(node),
            // Enabled and remote, at an internal limit; 376 rpm in tenths.
            frame(0x181, &[0x37, 0x0A, 0xB0, 0x0E, 0, 0]),
            // Somebody reads its mode of operation, and commands 0.4 m/s.
            frame(0x581, &[0x4F, 0x61, 0x60, 0, 3, 0, 0, 0]),
            frame(0x201, &[0x0F, 0, 0xB0, 0x0E, 0, 0]),
            frame(0x77F, &[5]),
            Emergency {
                code: 0x4310,
                register: 9,
            }
            .frame(node),
        ];
        for frame in &heard {
            watch.take(frame, 0.5, |node, emergency| {
                told.push((node, emergency.code))
            });
        }
        assert_eq!(told, [(1, 0x4310)]);
        let [traction, steer] = watch.drives(0.6);
        assert_eq!(
            traction.words(),
            "operational, operation enabled, at an internal limit, profile velocity"
        );
        assert!((traction.speed_m_s.unwrap() - 0.4).abs() < 1e-9);
        assert!((traction.speed_rad_s.unwrap() - 39.374).abs() < 1e-3);
        assert!((traction.commanded_m_s.unwrap() - 0.4).abs() < 1e-9);
        assert_eq!(
            (traction.error, traction.error_register),
            (Some(0x4310), Some(9))
        );
        assert_eq!(steer.words(), "no heartbeat, no report");
        assert_eq!(watch.controller(0.6), Some(NmtState::Operational));
        // Six frames in a second, of more than 44 bits each.
        let traffic = watch.traffic(1.0);
        assert_eq!(traffic.frames_s, 6.0);
        assert!(traffic.bits_s > 6.0 * 55.0);
        assert_eq!(watch.drives(1.0)[0].reports_s, 1.0);
        // Silence is said, and what is commanded no longer.
        let [traction, _] = watch.drives(2.0);
        let words = "its heartbeat has ended, its reports have ended, at an internal limit, profile velocity";
        assert_eq!(traction.words(), words);
        assert_eq!(
            (traction.commanded_m_s, watch.controller(2.0)),
            (None, None)
        );
        assert_eq!(watch.traffic(2.5).frames_s, 0.0);
    }

    #[test]
    fn a_frame_that_is_refused_is_counted_with_its_reason() {
        let mut watch = watch();
        watch.take(&frame(0x181, &[0; 4]), 0.1, |_, _| {});
        let (count, reason) = watch.refused();
        assert_eq!((count, reason.as_deref()), (1, Some("4 bytes, expected 6")));
        assert_eq!(watch.drives(0.1)[0].words(), "no heartbeat, no report");
    }
}
