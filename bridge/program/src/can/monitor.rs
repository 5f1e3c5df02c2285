//! `sidehill can monitor`: what the drives of a configuration say.

use super::bus::{BUS_KNOWN_S, ConfiguredBus};
use crate::interrupts::Interrupts;
use anyhow::Result;
use serde::Serialize;
use sidehill::console;
use sidehill::drive::{CanMonitorArgs, RunFormat};
use sidehill_bridge::drives::{Epoch, LinkState};
use sidehill_can::cia402::{Emergency, NmtState, error_words};
use sidehill_can::watch::{DriveWatch, Traffic, WatchedDrive};
use sidehill_can_port::{BusEvent, BusMonitor, bit_rate, bus_fault, lost_frames};
use std::fmt::Write;
use std::io::IsTerminal;
use std::process::ExitCode;
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// Time between two states, s.
const EVERY_S: f64 = 1.0;
/// Least time between two states where something has changed, s.
const CHANGE_S: f64 = 0.1;
/// Wait for frames.
const WAIT: Duration = Duration::from_millis(20);

/// A line of JSON.
#[derive(Debug, Serialize)]
struct MonitorLine<'a> {
    unix_s: f64,
    #[serde(flatten)]
    state: &'a BusView,
    /// Emergencies since the line before.
    emergencies: &'a [EmergencyView],
}

/// The bus and its drives at an instant.
#[derive(Debug, Serialize)]
struct BusView {
    interface: String,
    bus: LinkState,
    /// bit/s; none for a virtual bus.
    bit_rate: Option<u32>,
    /// Share of the bit rate that is used; none for a virtual bus.
    load: Option<f64>,
    #[serde(flatten)]
    traffic: Traffic,
    /// Frames that the interface has lost since the start.
    lost: u64,
    /// Frames of the vehicle that failed a check since the start, and why the last one did.
    refused: u64,
    refused_why: Option<String>,
    /// State of the node with the program's number; none where no controller is heard.
    controller: Option<NmtState>,
    drives: [WatchedDrive; 2],
}

#[derive(Debug, Serialize)]
struct EmergencyView {
    node: u8,
    code: u16,
    meaning: &'static str,
    register: u8,
}

/// Prints what the drives say until a signal arrives or the duration is over. Sends nothing.
///
/// # Errors
/// A file that cannot be read, or a setting out of range.
pub(super) fn run(args: &CanMonitorArgs) -> Result<ExitCode> {
    let bus = ConfiguredBus::read(&args.config)?;
    let interrupts = Interrupts::watch()?;
    let epoch = Epoch::now();
    let (news, heard) = mpsc::channel();
    let _monitor = BusMonitor::start_all(&bus.interface, epoch, move |event| {
        // The program ends.
        let _ = news.send(event);
    })?;
    let mut watch = DriveWatch::new(Arc::clone(&bus.layout), epoch.elapsed_s());
    let mut output = MonitorOutput::new(args.format, epoch);
    let lost_before = lost_frames(&bus.interface).unwrap_or(0);
    let (mut link, mut rate) = (LinkState::Absent, None);
    let mut emergencies = Vec::new();
    let (mut printed_s, mut printed_words) = (f64::NEG_INFINITY, String::new());
    while !interrupts.ended() && console::dropped() == 0 {
        let news = heard.recv_timeout(WAIT);
        for event in news.into_iter().chain(heard.try_iter()) {
            match event {
                BusEvent::Frame { time_s, frame } => {
                    watch.take(&frame, time_s, |node, emergency| {
                        emergencies.push(EmergencyView::of(node, emergency));
                    });
                }
                BusEvent::Bus { state, .. } => {
                    link = state;
                    rate = bit_rate(&bus.interface);
                }
                BusEvent::Restart { .. } => {}
            }
        }
        let now_s = epoch.elapsed_s();
        if args
            .duration_s
            .is_some_and(|duration_s| now_s >= duration_s)
        {
            break;
        }
        let traffic = watch.traffic(now_s);
        let drives = watch.drives(now_s);
        let words = format!("{link:?} {} {}", drives[0].words(), drives[1].words());
        let changed = words != printed_words || !emergencies.is_empty();
        let since_s = now_s - printed_s;
        if now_s < BUS_KNOWN_S || since_s < CHANGE_S || (since_s < EVERY_S && !changed) {
            continue;
        }
        (printed_s, printed_words) = (now_s, words);
        let (refused, refused_why) = watch.refused();
        let state = BusView {
            interface: bus.interface.clone(),
            bus: link,
            bit_rate: rate,
            load: rate.map(|rate| traffic.bits_s / f64::from(rate)),
            traffic,
            lost: lost_frames(&bus.interface)
                .unwrap_or(0)
                .saturating_sub(lost_before),
            refused,
            refused_why,
            controller: watch.controller(now_s),
            drives,
        };
        output.print(now_s, &state, &emergencies)?;
        emergencies.clear();
    }
    Ok(ExitCode::SUCCESS)
}

impl EmergencyView {
    fn of(node: u8, emergency: Emergency) -> Self {
        Self {
            node,
            code: emergency.code,
            meaning: error_words(emergency.code),
            register: emergency.register,
        }
    }
}

struct MonitorOutput {
    format: RunFormat,
    epoch: Epoch,
    /// Whether the last state is replaced in place.
    terminal: bool,
    /// Lines of the last state.
    lines: usize,
}

impl MonitorOutput {
    fn new(format: Option<RunFormat>, epoch: Epoch) -> Self {
        let terminal = std::io::stdout().is_terminal();
        let usual = match terminal {
            true => RunFormat::Text,
            false => RunFormat::Json,
        };
        Self {
            format: format.unwrap_or(usual),
            epoch,
            terminal,
            lines: 0,
        }
    }

    fn print(&mut self, now_s: f64, state: &BusView, news: &[EmergencyView]) -> Result<()> {
        if self.format == RunFormat::Json {
            let line = MonitorLine {
                unix_s: self.epoch.unix_s(now_s),
                state,
                emergencies: news,
            };
            console::line(serde_json::to_string(&line)?);
            return Ok(());
        }
        let mut text = String::new();
        if self.terminal && self.lines > 0 {
            write!(text, "\x1b[{}A\x1b[J", self.lines)?;
        }
        for emergency in news {
            let EmergencyView {
                node,
                code,
                meaning,
                register,
            } = emergency;
            writeln!(
                text,
                "{now_s:7.1} s  node {node}: emergency {code:#06X}, error register {register:#04X}: {meaning}"
            )?;
        }
        let lines = state.lines();
        for (i, line) in lines.iter().enumerate() {
            let time = match i {
                0 => format!("{now_s:7.1} s"),
                _ => String::new(),
            };
            // A terminal that is too narrow cuts the line, so that the count of lines holds.
            match self.terminal {
                true => writeln!(text, "\x1b[?7l{time:9}  {line}\x1b[?7h")?,
                false => writeln!(text, "{time:9}  {line}")?,
            }
        }
        self.lines = lines.len();
        console::text(text);
        Ok(())
    }
}

impl BusView {
    /// Returns the state for a person: a line of the bus, one for each drive.
    fn lines(&self) -> Vec<String> {
        let bus = match bus_fault(self.bus, &self.interface) {
            Some(fault) => fault,
            None => {
                let load = match (self.load, self.bit_rate) {
                    (Some(load), Some(rate)) => {
                        format!(
                            "{:.0} % of {:.0} kbit/s",
                            100.0 * load,
                            f64::from(rate) / 1e3
                        )
                    }
                    _ => format!("{:.1} kbit/s", self.traffic.bits_s / 1e3),
                };
                let errors = match self.bus {
                    LinkState::Warning => ", error-warning",
                    LinkState::Passive => ", error-passive",
                    _ => "",
                };
                format!("{load}{errors}, {:.0} frames/s", self.traffic.frames_s)
            }
        };
        let controller = match self.controller {
            Some(nmt) => format!("a controller is heard ({nmt})"),
            None => "no controller is heard".to_owned(),
        };
        let refused = match &self.refused_why {
            Some(why) => format!(", {} refused (the last: {why})", self.refused),
            None => String::new(),
        };
        let mut lines = vec![format!(
            "{}: {bus}, {} lost{refused}; {controller}",
            self.interface, self.lost
        )];
        lines.extend(self.drives.iter().map(drive_line));
        lines
    }
}

fn drive_line(drive: &WatchedDrive) -> String {
    let mut line = format!("{:<8}", drive.role.name());
    if let Some(node) = drive.node {
        line += &format!(" node {node}:");
    }
    if let Some(speed_m_s) = drive.speed_m_s {
        line += &format!(" {speed_m_s:+.3} m/s");
        if let Some(speed_rad_s) = drive.speed_rad_s {
            line += &format!(" ({speed_rad_s:+.1} rad/s)");
        }
        match drive.commanded_m_s {
            Some(commanded_m_s) => line += &format!(" of {commanded_m_s:+.3} m/s"),
            None => line += ", nothing commanded",
        }
        line += &format!(", {:.0} reports/s;", drive.reports_s);
    }
    line += &format!(" {}", drive.words());
    if let Some(code) = drive.error.filter(|code| *code != 0) {
        line += &format!("; error {code:#06X}: {}", error_words(code));
    }
    line
}
