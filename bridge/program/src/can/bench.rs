use super::terminal::Terminal;
use crate::interrupts::Interrupts;
use anyhow::{Result, anyhow, bail, ensure};
use sidehill::config::RunConfig;
use sidehill::console::Printer;
use sidehill_bridge::control_loop::record::{
    CycleRow, EventLine, LogSource, Outputs, Recorder, ring,
};
use sidehill_bridge::control_loop::{ControlLoop, JogRunner};
use sidehill_bridge::drives::{Clock, Epoch, InputStatus, MeasuredMotorSpeeds};
use sidehill_bridge::safety::{
    DeadMan, OperatorRequests, Reason, SafetyConfig, SafetyState, StopCause,
};
use sidehill_can::canopen::ObjectReader;
use sidehill_can::cia402::NodeId;
use sidehill_can::commissioning::{EncoderCount, MotorTrial, Seen, TrialSample};
use sidehill_can::layout::{Layout, Profile};
use sidehill_can::message::DriveRole;
use sidehill_can_port::{BusEvent, BusMonitor, CanInputs, CanPort, Sender};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::speeds::{EncoderScale, MotorSpeeds};
use std::sync::{Arc, mpsc};

/// The layout alone is tested, without the corrections of a vehicle.
const SCALE: EncoderScale = EncoderScale {
    left: 1.0,
    right: 1.0,
};
/// Records that a ring holds: seconds of a busy bus.
const RING: usize = 8192;
/// Longest wait for the drives' feedback, s.
const FEEDBACK_WAIT_S: f64 = 10.0;
/// Longest wait for the key, s.
const KEY_WAIT_S: f64 = 60.0;
/// Longest wait for an answer, s.
const ANSWER_WAIT_S: f64 = 120.0;
/// Longest wait for the objects of the drives, s.
const OBJECTS_WAIT_S: f64 = 3.0;
/// Time for which a motor turns before it goes to zero by itself, s.
const TURN_S: f64 = 5.0;
/// Time that says enough, s.
const ENOUGH_S: f64 = 3.0;
/// Time for which reports are taken after the drives were switched off, s.
const REST_S: f64 = 1.0;
/// Times that a motor may be turned, or a question be asked.
const TRIES: u32 = 5;
/// Time for which the drives are commanded off at the end, s, where they need no longer.
const OFF_S: f64 = 0.25;

const RESOLUTION: [(u16, u8); 2] = [(0x608F, 1), (0x608F, 2)];
/// In increments, else in the units of the drive.
const POSITION: [(u16, u8); 2] = [(0x6063, 0), (0x6064, 0)];

/// Two drives whose motors are turned one at a time, under the safety of `run`, while a person holds a key. On drop, also
/// after a panic, they are switched off.
pub(super) struct Bench<'a> {
    control_loop: ControlLoop<CanPort, JogRunner>,
    recorder: Recorder,
    inputs: Option<CanInputs>,
    encoders: Option<Encoders>,
    layout: Arc<Layout>,
    epoch: Epoch,
    terminal: Terminal,
    interrupts: &'a Interrupts,
    printer: &'a Printer,
    speed_m_s: f64,
    /// When the drives were last commanded to be on, s.
    on_s: Option<f64>,
}

/// What came of turning a motor.
struct Jog {
    samples: Vec<TrialSample>,
    driven_s: f64,
    /// Why it ended, if not by the key.
    stopped: Option<Reason>,
}

impl<'a> Bench<'a> {
    pub(super) fn start(
        (config, interface, layout): (&RunConfig, &str, &Arc<Layout>),
        speed_m_s: f64,
        terminal: Terminal,
        interrupts: &'a Interrupts,
        printer: &'a Printer,
    ) -> Result<Self> {
        let epoch = Epoch::now();
        let (received, received_log) = ring(RING);
        let (sent, sent_log) = ring(RING);
        let (records, loop_log) = ring(RING);
        let of_port = Arc::clone(layout);
        let mut port = CanPort::new(interface, of_port, SCALE, epoch, received, sent)?;
        let inputs = port.take_inputs();
        let encoders = match &layout.profile {
            Profile::Cia402(cia402) => Some(Encoders::start(interface, cia402.nodes, epoch)?),
            Profile::Values(_) => None,
        };
        let safety = SafetyConfig {
            speed_max_m_s: config.safety.speed_max_m_s.min(speed_m_s),
            ..config.safety
        };
        let (clock, runner) = (Clock::Real(epoch), JogRunner::new());
        let control_loop = ControlLoop::new(config.cycle, safety, clock, port, runner, records)?;
        let logs: Vec<Box<dyn LogSource>> = vec![
            Box::new(loop_log),
            Box::new(received_log),
            Box::new(sent_log),
        ];
        Ok(Self {
            control_loop,
            recorder: Recorder::new(logs, epoch, interface),
            inputs,
            encoders,
            layout: Arc::clone(layout),
            epoch,
            terminal,
            interrupts,
            printer,
            speed_m_s,
            on_s: None,
        })
    }

    /// Turns a motor and asks what was seen.
    ///
    /// # Errors
    /// A signal, the end of standard input, or a wait that took too long.
    pub(super) fn trial(&mut self, drive: usize) -> Result<MotorTrial> {
        let role = self.layout.drives[drive].role;
        for _ in 0..TRIES {
            self.wait_for_drives()?;
            let before = self.position(drive)?;
            self.say(format_args!(
                "{}: hold the space bar for {:.0} s. It turns at {} m/s while you hold it, so that {}.",
                role.name(),
                TURN_S + 3.0,
                self.speed_m_s,
                moves(role)
            ));
            let jog = self.jog(drive)?;
            if let Some(reason) = jog.stopped {
                self.say(format_args!(
                    "stopped after {:.1} s: {reason}",
                    jog.driven_s
                ));
            }
            let is_enough = match jog.stopped {
                None => jog.driven_s >= ENOUGH_S,
                // It would end so again.
                Some(_) => jog.driven_s > 0.0,
            };
            if !is_enough {
                if jog.stopped.is_none() {
                    self.say(format_args!(
                        "released after {:.1} s, which is too soon: once more",
                        jog.driven_s
                    ));
                }
                continue;
            }
            let after = self.position(drive)?;
            let encoder = before.zip(after).map(|(before, after)| EncoderCount {
                counts: f64::from(after.0.wrapping_sub(before.0) as i32),
                per_turn: after.1,
            });
            let (seen, measured_m) = self.ask(role)?;
            return Ok(MotorTrial {
                samples: jog.samples,
                seen,
                measured_m,
                encoder,
            });
        }
        bail!("the {} motor was not turned in {TRIES} tries", role.name())
    }

    fn wait_for_drives(&mut self) -> Result<()> {
        let begun_s = self.epoch.elapsed_s();
        loop {
            let row = self.cycle(OperatorRequests::default())?;
            if row.bus.carries()
                && row.feedback_age_s <= self.control_loop.safety_config().feedback_timeout_s
            {
                return Ok(());
            }
            let now_s = self.epoch.elapsed_s();
            if now_s - begun_s > FEEDBACK_WAIT_S {
                let inputs = self.inputs.iter_mut();
                let missing: Vec<String> = inputs
                    .flat_map(|inputs| inputs.inputs(now_s))
                    // The bus and the drives come first; nothing else is needed.
                    .take(3)
                    .filter(|input| input.missing.is_some())
                    .map(|input| input.to_string())
                    .collect();
                bail!(
                    "the drives do not report within {FEEDBACK_WAIT_S:.0} s: {}",
                    missing.join("; ")
                );
            }
        }
    }

    /// Turns a motor while the key is held, for [`TURN_S`] at most, and takes reports until it rests.
    fn jog(&mut self, drive: usize) -> Result<Jog> {
        let mut speeds_m_s = [0.0; 2];
        speeds_m_s[drive] = self.speed_m_s;
        let target = self.layout.motors(speeds_m_s).effective(&SCALE);
        self.control_loop.runner_mut().set(target);
        self.terminal.take_keys()?;
        let begun_s = self.epoch.elapsed_s();
        let (mut key, mut samples) = (DeadMan::new(), Vec::new());
        let (mut armed, mut over, mut since_s, mut driven_s) = (false, false, None, 0.0);
        loop {
            let presses = self.terminal.presses();
            if presses.other {
                key.let_go();
            }
            let now_s = self.epoch.elapsed_s();
            let held = key.look(now_s, presses.space) && !over;
            armed |= held;
            ensure!(
                armed || now_s - begun_s <= KEY_WAIT_S,
                "the space bar was not held within {KEY_WAIT_S:.0} s; held, it must repeat 5 times a second or more"
            );
            let row = self.cycle(OperatorRequests {
                arm: held,
                stop: None,
                halt: (!held).then_some(StopCause::Operator),
            })?;
            samples.extend(self.sample(drive, &row).filter(|_| armed));
            match row.state {
                SafetyState::Driving => {
                    driven_s = row.time_s - *since_s.get_or_insert(row.time_s);
                    if driven_s >= TURN_S {
                        self.control_loop.runner_mut().set(MotorSpeeds::STOP);
                        over = row.traction_m_s == 0.0 && row.steer_m_s == 0.0;
                    }
                }
                SafetyState::Latched if armed => break,
                _ => {}
            }
        }
        let rest_s = self.epoch.elapsed_s() + REST_S;
        while self.epoch.elapsed_s() < rest_s {
            let row = self.cycle(OFF)?;
            samples.extend(self.sample(drive, &row));
        }
        let stopped = self.control_loop.stopped_by();
        Ok(Jog {
            samples,
            driven_s,
            stopped: stopped.filter(|reason| *reason != Reason::Requested(StopCause::Operator)),
        })
    }

    fn sample(&self, drive: usize, row: &CycleRow) -> Option<TrialSample> {
        let motors = |traction_m_s, steer_m_s| MeasuredMotorSpeeds {
            traction_m_s,
            steer_m_s,
        };
        let commanded = motors(row.traction_m_s, row.steer_m_s);
        let reported = motors(row.feedback_traction_m_s, row.feedback_steer_m_s);
        let role = |drive: usize| self.layout.drives[drive].role;
        let speed_m_s = role(drive).speed_m_s(&reported);
        speed_m_s.is_finite().then(|| TrialSample {
            time_s: row.time_s,
            command_m_s: role(drive).speed_m_s(&commanded),
            speed_m_s,
            other_m_s: role(1 - drive).speed_m_s(&reported),
        })
    }

    /// Returns what a drive's encoder has counted, and its counts in a turn, as far as it says so.
    fn position(&mut self, drive: usize) -> Result<Option<(u32, Option<f64>)>> {
        let begun_s = self.epoch.elapsed_s();
        if let Some(encoders) = &mut self.encoders {
            encoders.begin();
        }
        while self.epoch.elapsed_s() - begun_s <= OBJECTS_WAIT_S {
            let now_s = self.epoch.elapsed_s();
            let Some(encoders) = &mut self.encoders else {
                return Ok(None);
            };
            if encoders.is_done(now_s) {
                let read = |object| encoders.reader.read(drive, object);
                let position = POSITION.into_iter().find_map(read);
                let [counts, turns] = RESOLUTION.map(read);
                let per_turn = counts
                    .map(|counts| f64::from(counts) / f64::from(turns.unwrap_or(1)))
                    .filter(|per_turn| per_turn.is_finite() && *per_turn > 0.0);
                return Ok(position.map(|position| (position, per_turn)));
            }
            self.cycle(OperatorRequests::default())?;
        }
        Ok(None)
    }

    /// Asks what was seen.
    fn ask(&mut self, role: DriveRole) -> Result<(Seen, Option<f64>)> {
        self.terminal.take_lines()?;
        self.say(format_args!(
            "What moved? Type f where it was so that {}, b the other way round, o as the other motor should move, n nothing; then, if \
             you have measured it, the way of the tread in m, as in `f 0.24`; and Enter.",
            moves(role)
        ));
        let begun_s = self.epoch.elapsed_s();
        for _ in 0..TRIES {
            let line = loop {
                self.cycle(OFF)?;
                if let Some(line) = self.terminal.line() {
                    break line;
                }
                ensure!(
                    self.epoch.elapsed_s() - begun_s <= ANSWER_WAIT_S,
                    "there was no answer within {ANSWER_WAIT_S:.0} s"
                );
            };
            match answer(&line) {
                Ok(answer) => return Ok(answer),
                Err(why) => self.say(why),
            }
        }
        bail!("there was no answer in {TRIES} lines")
    }

    fn cycle(&mut self, requests: OperatorRequests) -> Result<CycleRow> {
        let row = self.control_loop.step(requests);
        if row.enable {
            self.on_s = Some(row.time_s);
        }
        let printer = self.printer;
        let mut seen = |event: &EventLine<'_>| {
            // Changes of state are told as what they mean.
            if event.from.is_none() && event.event != "refused" {
                printer.error_line(format_args!("{}: {}", event.event, event.reason));
            }
        };
        self.recorder.drain(&mut Outputs {
            seen: Some(&mut seen),
            ..Outputs::default()
        })?;
        ensure!(!self.interrupts.ended(), "ended by a signal");
        ensure!(!self.terminal.is_closed(), "standard input was closed");
        Ok(row)
    }

    fn say(&self, text: impl std::fmt::Display) {
        self.printer.error_line(text);
    }
}

impl Drop for Bench<'_> {
    /// Commands the drives off for as long as the safety would take to stop a node that does not follow.
    fn drop(&mut self) {
        if std::thread::panicking() {
            // The loop itself sends what is needed, without another cycle.
            return;
        }
        let needed_s = match &self.layout.profile {
            Profile::Cia402(cia402) => 2.0 * cia402.quick_stop_time_s + OFF_S,
            Profile::Values(_) => OFF_S,
        };
        let on_s = self.on_s.unwrap_or(f64::NEG_INFINITY);
        let until_s = (on_s + needed_s).max(self.epoch.elapsed_s() + OFF_S);
        while self.epoch.elapsed_s() < until_s {
            self.control_loop.step(OFF);
        }
    }
}

/// Zero speed and disable.
const OFF: OperatorRequests = OperatorRequests {
    arm: false,
    stop: None,
    halt: Some(StopCause::ProgramEnds),
};

/// Returns what moves where a drive is commanded forward.
fn moves(role: DriveRole) -> &'static str {
    match role {
        DriveRole::Traction => "all treads go forward",
        DriveRole::Steer => "the right tread goes forward and the left backward",
        DriveRole::Left => "the left tread goes forward",
        DriveRole::Right => "the right tread goes forward",
    }
}

/// Returns what was seen and measured, m.
fn answer(line: &str) -> Result<(Seen, Option<f64>)> {
    let mut words = line.split_whitespace();
    let seen = match words.next() {
        Some("f") => Seen::Forward,
        Some("b") => Seen::Backward,
        Some("o") => Seen::Otherwise,
        Some("n") => Seen::Nothing,
        _ => bail!("type f, b, o or n"),
    };
    let measured_m = match words.next() {
        None => None,
        Some(word) => {
            let way_m = word.replace(',', ".").parse();
            let way_m = way_m.map_err(|_| anyhow!("`{word}` is no way in m: type it as 0.24"))?;
            Some(Bounds::new(0.01, 2.0, "m").check("the way", way_m)?)
        }
    };
    ensure!(
        words.next().is_none()
            && (measured_m.is_none() || matches!(seen, Seen::Forward | Seen::Backward)),
        "type a letter, and after f or b a way in m, nothing else"
    );
    Ok((seen, measured_m))
}

/// Reads the encoders of CANopen drives while they are off: beside the port, whose reads of objects are of drives that are
/// on.
struct Encoders {
    reader: ObjectReader,
    nodes: [NodeId; 2],
    sender: Sender,
    heard: mpsc::Receiver<BusEvent>,
    _monitor: BusMonitor,
}

impl Encoders {
    fn start(interface: &str, nodes: [NodeId; 2], epoch: Epoch) -> Result<Self> {
        let reader = ObjectReader::new(nodes, &[]);
        let (news, heard) = mpsc::channel();
        let monitor = BusMonitor::start(interface, &reader.received_ids(), epoch, move |event| {
            // The program ends.
            let _ = news.send(event);
        })?;
        Ok(Self {
            reader,
            nodes,
            sender: Sender::start(interface, &[])?,
            heard,
            _monitor: monitor,
        })
    }

    fn begin(&mut self) {
        // Answers that came too late for the last time.
        self.heard.try_iter().for_each(drop);
        let objects: Vec<_> = POSITION.into_iter().chain(RESOLUTION).collect();
        self.reader = ObjectReader::new(self.nodes, &objects);
    }

    /// Takes answers and asks further; returns whether all has been read.
    fn is_done(&mut self, now_s: f64) -> bool {
        for event in self.heard.try_iter() {
            if let BusEvent::Frame { time_s, frame } = event {
                self.reader.take(&frame, time_s);
            }
        }
        while let Some(frame) = self.reader.next(now_s) {
            // One that is lost is sent again when its answer is late.
            let _ = self.sender.send(&frame);
        }
        self.reader.is_done()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_a_letter_and_perhaps_a_way() {
        assert_eq!(answer("f").unwrap(), (Seen::Forward, None));
        assert_eq!(answer("  b 0,24 ").unwrap(), (Seen::Backward, Some(0.24)));
        assert_eq!(answer("n").unwrap(), (Seen::Nothing, None));
        for wrong in ["", "x", "f 0.2 m", "f 240", "f -0.2", "f nan", "n 0.2"] {
            assert!(answer(wrong).is_err(), "{wrong}");
        }
        let said = answer("f 24cm").unwrap_err().to_string();
        assert_eq!(said, "`24cm` is no way in m: type it as 0.24");
    }
}
