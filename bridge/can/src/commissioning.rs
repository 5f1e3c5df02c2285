//! What is wrong with a layout, by motors that were turned one after the other while somebody looked on.

use crate::layout::{Layout, Profile};
use crate::message::{DriveRole, Quantity};
use serde::Serialize;

/// A command and a report of the drive under test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrialSample {
    /// When, s.
    pub time_s: f64,
    /// Commanded, m/s.
    pub command_m_s: f64,
    /// Reported, m/s.
    pub speed_m_s: f64,
    /// Reported by the other drive, which is to stand, m/s.
    pub other_m_s: f64,
}

/// How a person saw the vehicle move where a drive was commanded forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Seen {
    /// As it should.
    Forward,
    /// The other way round.
    Backward,
    /// As the other drive should.
    Otherwise,
    /// Nothing moved.
    Nothing,
}

/// What an encoder counted during a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncoderCount {
    /// Counts, by object 0x6063 or 0x6064.
    pub counts: f64,
    /// Counts in a turn of the motor, by object 0x608F; none where the drive does not say.
    pub per_turn: Option<f64>,
}

/// A motor that was turned.
#[derive(Debug, Clone, PartialEq)]
pub struct MotorTrial {
    /// In the order of time.
    pub samples: Vec<TrialSample>,
    /// What a person saw.
    pub seen: Seen,
    /// Way of the tread as a person has measured it, m; none where nobody did.
    pub measured_m: Option<f64>,
    /// What its encoder counted; none where it cannot be read.
    pub encoder: Option<EncoderCount>,
}

/// Keys of a layout that a trial judges, and their values.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveKeys {
    /// What the drive moves.
    pub role: DriveRole,
    /// Keys to the scale of its command.
    pub command: String,
    /// Its value.
    pub command_per_unit: f64,
    /// Keys to the scale of its report.
    pub feedback: String,
    /// Its value.
    pub feedback_per_unit: f64,
    /// Keys to the signal of its report.
    pub signal: String,
    /// Rotation of the motor at 1 m/s by its report, rad/s, where the signal counts turns.
    pub rotation_rad_s: Option<f64>,
}

impl DriveKeys {
    /// Returns the keys of both drives, in the order of the layout.
    pub fn of(layout: &Layout) -> [Self; 2] {
        [0, 1].map(|i| {
            let drive = &layout.drives[i];
            let role = drive.role;
            let quantity = Quantity::Command(role);
            let messages = layout.command.iter().enumerate();
            let mut found =
                messages.filter_map(|(at, message)| Some((at, message.per_unit(quantity)?)));
            // A layout has a command for each of its drives.
            let (at, command_per_unit) = found.next().unwrap_or((0, 1.0));
            let name = role.name();
            let [command, feedback] = match &layout.profile {
                Profile::Cia402(_) => [
                    format!("cia402.drives[{i}].command.target_velocity"),
                    format!("cia402.drives[{i}].feedback.actual_velocity"),
                ],
                Profile::Values(_) => [
                    format!("command[{at}].{name}"),
                    format!("feedback.{name}.speed"),
                ],
            };
            let speed = Quantity::Speed(role);
            Self {
                role,
                command: format!("{command}.per_unit"),
                command_per_unit,
                signal: format!("{feedback}.signal"),
                feedback: format!("{feedback}.per_unit"),
                feedback_per_unit: drive.message.per_unit(speed).unwrap_or(1.0),
                rotation_rad_s: drive.message.rotation_rad_s(speed),
            }
        })
    }
}

/// What a trial says of a motor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MotorVerdict {
    /// What the drive moves.
    pub role: DriveRole,
    /// What a person saw.
    pub seen: Seen,
    /// Largest command, m/s.
    pub command_m_s: f64,
    /// Reported over commanded speed; none where too little was reported to say.
    pub gain: Option<f64>,
    /// Ways by command and by report, m.
    pub commanded_m: f64,
    /// By report.
    pub reported_m: f64,
    /// As a person has measured it.
    pub measured_m: Option<f64>,
    /// Encoder counts for 1 m of reported way.
    pub counts_per_m: Option<f64>,
    /// What is wrong or unknown, in words.
    pub complaints: Vec<String>,
}

/// A key of the layout and its right value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Correction {
    /// Keys, with dots between them.
    pub key: String,
    /// Value in the layout.
    pub from: f64,
    /// Right value.
    pub to: f64,
}

/// What the trials of both motors say.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CommissioningVerdict {
    /// Of each motor, in the order of the layout.
    pub motors: [MotorVerdict; 2],
    /// Keys to change.
    pub corrections: Vec<Correction>,
}

impl CommissioningVerdict {
    /// Returns whether nothing is wrong or unknown.
    pub fn is_right(&self) -> bool {
        self.motors.iter().all(|motor| motor.complaints.is_empty())
    }
}

/// Deviation of speeds that is taken for none.
const TOLERANCE: f64 = 0.15;
/// Time of commands below which a ratio of speeds is rough, s.
const LONG_S: f64 = 1.0;
/// How rough it is then.
const SHORT_TOLERANCE: f64 = 0.35;
/// Share of its report that the command must explain, for a motor that reports little, not to be noise.
const EXPLAINED: f64 = 0.5;
/// Share of its command below which a motor reports little.
const LITTLE: f64 = 0.15;
/// Deviation of a measured way that is taken for none: a way is measured by hand.
const WAY_TOLERANCE: f64 = 0.05;
/// Speed above which a motor turns that should stand, m/s.
const TURNS_M_S: f64 = 0.015;
/// Least command that says something, m/s.
const COMMAND_MIN_M_S: f64 = 0.004;

/// Judges both motors, by themselves and against each other.
pub fn judge(keys: &[DriveKeys; 2], trials: &[MotorTrial; 2]) -> CommissioningVerdict {
    let gains = trials.each_ref().map(|trial| gain(&trial.samples));
    let mut corrections = Vec::new();
    let exchanged = trials.iter().all(|trial| trial.seen == Seen::Otherwise);
    let motors = [0, 1].map(|i| {
        let other = 1 - i;
        let mut judged = Judged {
            keys: &keys[i],
            trial: &trials[i],
            gain: gains[i],
            complaints: Vec::new(),
            command: None,
            feedback: None,
        };
        // A motor whose command and report agree shows the other which of its keys deviates.
        let other_agrees = gains[other].is_some_and(|gain| (gain.abs() - 1.0).abs() <= TOLERANCE);
        judged.direction(exchanged, &keys[other]);
        let resolution = judged.resolution(&trials[other]);
        judged.size(other_agrees.then_some(&keys[other]), resolution);
        judged.encoder((&keys[other], &trials[other]));
        let [commanded_m, reported_m] = ways(&trials[i].samples);
        let changes = [
            (&keys[i].command, keys[i].command_per_unit, judged.command),
            (
                &keys[i].feedback,
                keys[i].feedback_per_unit,
                judged.feedback,
            ),
        ];
        for (key, from, to) in changes {
            corrections.extend(to.map(|to| Correction {
                key: key.clone(),
                from,
                to: rounded(to),
            }));
        }
        MotorVerdict {
            role: keys[i].role,
            seen: trials[i].seen,
            command_m_s: largest_command(&trials[i].samples),
            gain: gains[i],
            commanded_m,
            reported_m,
            measured_m: trials[i].measured_m,
            counts_per_m: counts_per_m(&trials[i]),
            complaints: judged.complaints,
        }
    });
    CommissioningVerdict {
        motors,
        corrections,
    }
}

struct Judged<'a> {
    keys: &'a DriveKeys,
    trial: &'a MotorTrial,
    gain: Option<f64>,
    complaints: Vec<String>,
    /// Right scales.
    command: Option<f64>,
    feedback: Option<f64>,
}

impl Judged<'_> {
    fn complain(&mut self, words: String) {
        let role = self.keys.role.name();
        self.complaints.push(format!("the {role} motor {words}"));
    }

    /// Judges whether it moved at all, what moved, and which way.
    fn direction(&mut self, exchanged: bool, other: &DriveKeys) {
        let keys = self.keys;
        let other_turns = self
            .trial
            .samples
            .iter()
            .any(|sample| sample.other_m_s.abs() > TURNS_M_S);
        if self.trial.seen == Seen::Otherwise {
            let name = other.role.name();
            return self.complain(match exchanged {
                true => format!("moves as the {name} motor should, and the other way round: exchange their nodes or messages"),
                false => format!("moves as the {name} motor should, but not the other way round: check what each drive moves"),
            });
        }
        let Some(gain) = self.gain else {
            return self.complain(
                "was not turned for long enough to say anything: hold the key for 3 s or longer"
                    .to_owned(),
            );
        };
        if gain == 0.0 {
            let signal = &keys.signal;
            return self.complain(match (self.trial.seen, other_turns) {
                (Seen::Nothing, _) => "does not turn: check its brake, its limits and the least speed that it follows".to_owned(),
                (_, true) => format!("turns, but the report of the other drive shows it: exchange the feedback messages, or set {signal}"),
                (_, false) => format!("turns, but its report shows no speed: set {signal}, or map its actual velocity (object 0x606C)"),
            });
        }
        if other_turns {
            self.complain("is not the only one whose report shows a speed: check that each report is that of its own drive".to_owned());
        }
        let backward = match self.trial.seen {
            Seen::Forward => false,
            Seen::Backward => true,
            _ => {
                return self.complain(
                    "reports a speed, but nobody saw it move: check that its report is its own"
                        .to_owned(),
                );
            }
        };
        let reports_backward = gain < 0.0;
        let DriveKeys {
            command, feedback, ..
        } = keys;
        let (to_command, to_feedback) = (-keys.command_per_unit, -keys.feedback_per_unit);
        match (backward, reports_backward) {
            (false, false) => {}
            (true, false) => {
                self.command = Some(to_command);
                self.feedback = Some(to_feedback);
                self.complain(format!(
                    "turns backwards: set {command} to {to_command} and {feedback} to {to_feedback}"
                ));
            }
            (true, true) => {
                self.command = Some(to_command);
                self.complain(format!(
                    "turns backwards, as it reports: set {command} to {to_command}"
                ));
            }
            (false, true) => {
                self.feedback = Some(to_feedback);
                self.complain(format!(
                    "turns forward, but reports backward: set {feedback} to {to_feedback}"
                ));
            }
        }
    }

    /// Compares the resolution that its drive was told with the other's; returns theirs where they differ.
    fn resolution(&mut self, other: &MotorTrial) -> Option<[f64; 2]> {
        let per_turn = |trial: &MotorTrial| trial.encoder.and_then(|encoder| encoder.per_turn);
        let is_known = self.trial.measured_m.or(other.measured_m).is_some();
        let [own, other] = [per_turn(self.trial)?, per_turn(other)?];
        if (own / other - 1.0).abs() < 0.01 {
            return None;
        }
        if !is_known {
            self.complain(format!(
                "has {own:.0} counts in a turn by object 0x608F, the other {other:.0}{}: right only if their encoders differ; turn \
                 it again and measure the way to know",
                unit_hint(own / other)
            ));
        }
        Some([own, other])
    }

    /// Judges the size of its speeds by a measured way or, without one, against the `other` motor where that agrees with
    /// itself. A way that the drives' `resolution`s explain, own and other, is no matter of the layout's scales.
    fn size(&mut self, other: Option<&DriveKeys>, resolution: Option<[f64; 2]>) {
        let keys = self.keys;
        let moved = matches!(self.trial.seen, Seen::Forward | Seen::Backward);
        let Some(gain) = self.gain.filter(|gain| moved && *gain != 0.0) else {
            return;
        };
        let size = gain.abs();
        let command = self.command.unwrap_or(keys.command_per_unit);
        let feedback = self.feedback.unwrap_or(keys.feedback_per_unit);
        if let Some(measured_m) = self.trial.measured_m.filter(|_| self.is_long()) {
            let [commanded_m, reported_m] = ways(&self.trial.samples);
            if let Some([own, other]) = resolution
                && (commanded_m / measured_m * own / other - 1.0).abs() <= WAY_TOLERANCE
            {
                return self.complain(format!(
                    "was commanded {commanded_m:.3} m where its tread moved {measured_m:.3} m, as object 0x608F says {own:.0} counts \
                     in a turn and the other's {other:.0}: set its object 0x608F:01 to {other:.0}, in the drive or the layout's setup"
                ));
            }
            for (way_m, key, value, is_command) in [
                (commanded_m, &keys.command, command, true),
                (reported_m.abs(), &keys.feedback, feedback, false),
            ] {
                let share = way_m / measured_m;
                if (share - 1.0).abs() <= WAY_TOLERANCE {
                    continue;
                }
                let to = rounded(value * share);
                let what = match is_command {
                    true => "was commanded",
                    false => "reports",
                };
                self.complain(format!(
                    "{what} {way_m:.3} m where its tread moved {measured_m:.3} m{}: set {key} to {to}",
                    unit_hint(share)
                ));
                match is_command {
                    true => self.command = Some(to),
                    false => self.feedback = Some(to),
                }
            }
            return;
        }
        if (size - 1.0).abs() <= TOLERANCE {
            return;
        }
        let hint = unit_hint(size);
        let same = |one: f64, two: f64| (one.abs() / two.abs() - 1.0).abs() < 0.01;
        let as_other = other.map(|other| {
            (
                same(keys.command_per_unit, other.command_per_unit),
                same(keys.feedback_per_unit, other.feedback_per_unit),
                other,
            )
        });
        let found = match as_other {
            Some((true, false, other)) => {
                let to = self.likely(feedback * factor(size), other.feedback_per_unit);
                to.map(|to| ("report", &keys.feedback, to))
            }
            Some((false, true, other)) => {
                let to = self.likely(command / factor(size), other.command_per_unit);
                to.map(|to| ("command", &keys.command, to))
            }
            _ => None,
        };
        let Some((what, key, to)) = found else {
            let (command, feedback) = (&keys.command, &keys.feedback);
            let remedy = match self.is_long() {
                true => "turn it again and measure the way to know which",
                false => {
                    "it was stopped too soon to say more: correct the one that has another unit, roughly, and test again"
                }
            };
            return self.complain(format!(
                "reports {size:.3} times its command{hint}: {command}, {feedback} or the drive's own scaling is wrong; {remedy}"
            ));
        };
        self.complain(format!(
            "reports {size:.3} times its command{hint}, and only its {what} is scaled unlike the other's: set {key} to {to}"
        ));
        match what {
            "report" => self.feedback = Some(to),
            _ => self.command = Some(to),
        }
    }

    /// Returns the scale that is right by a measurement, the other motor's where that is near; none where the trial was too
    /// short for more.
    fn likely(&self, measured: f64, other: f64) -> Option<f64> {
        let other = other.abs().copysign(measured);
        let near = match self.is_long() {
            true => TOLERANCE,
            false => SHORT_TOLERANCE,
        };
        if (measured / other - 1.0).abs() <= near {
            return Some(other);
        }
        self.is_long().then(|| rounded(measured))
    }

    /// Returns whether it was commanded for long enough to measure a ratio of speeds.
    fn is_long(&self) -> bool {
        let samples = &self.trial.samples;
        let mut commanded = samples.iter().filter(|sample| sample.command_m_s != 0.0);
        let first_s = commanded.next().map(|sample| sample.time_s);
        let last_s = commanded.next_back().map(|sample| sample.time_s);
        let ends = first_s.zip(last_s);
        ends.is_some_and(|(first_s, last_s)| last_s - first_s >= LONG_S)
    }

    /// Compares what its encoder counted with what it reports, and with the other's.
    fn encoder(&mut self, (other_keys, other): (&DriveKeys, &MotorTrial)) {
        let Some(per_m) = counts_per_m(self.trial) else {
            return;
        };
        let per_turn = self.trial.encoder.and_then(|encoder| encoder.per_turn);
        if let (Some(per_turn), Some(rotation_rad_s)) = (per_turn, self.keys.rotation_rad_s) {
            let counted = per_m * std::f64::consts::TAU / rotation_rad_s.abs();
            let share = counted / per_turn;
            if (share - 1.0).abs() > TOLERANCE {
                self.complain(format!(
                    "counts {counted:.0} in a turn of its reported speed, and object 0x608F says {per_turn:.0}{}: set the encoder \
                     resolution of the drive, or the unit of its velocity",
                    unit_hint(share)
                ));
            }
            return;
        }
        let Some(other_per_m) = counts_per_m(other) else {
            return;
        };
        let scales = other_keys.feedback_per_unit / self.keys.feedback_per_unit;
        let share = (per_m / other_per_m * scales).abs();
        if !(1.0 - TOLERANCE..=1.0 / (1.0 - TOLERANCE)).contains(&share) {
            self.complain(format!(
                "counts {share:.3} times what the other counts for the same reported turns: check the encoder resolutions of both \
                 drives"
            ));
        }
    }
}

fn counts_per_m(trial: &MotorTrial) -> Option<f64> {
    let [_, reported_m] = ways(&trial.samples);
    let encoder = trial.encoder?;
    (reported_m.abs() > 0.01).then(|| (encoder.counts / reported_m).abs())
}

fn largest_command(samples: &[TrialSample]) -> f64 {
    let commands = samples.iter().map(|sample| sample.command_m_s.abs());
    commands.fold(0.0, f64::max)
}

/// Returns the ways by command and by report, m.
fn ways(samples: &[TrialSample]) -> [f64; 2] {
    let mut ways = [0.0; 2];
    for pair in samples.windows(2) {
        let time_s = pair[1].time_s - pair[0].time_s;
        ways[0] += time_s * pair[0].command_m_s;
        ways[1] += time_s * 0.5 * (pair[0].speed_m_s + pair[1].speed_m_s);
    }
    ways
}

/// Returns reported over commanded speed; 0 where a report is noise, none where too little was commanded. It is the ratio of
/// the ways from rest to rest, in which delay and lag of a motor do not show.
fn gain(samples: &[TrialSample]) -> Option<f64> {
    if largest_command(samples) < COMMAND_MIN_M_S {
        return None;
    }
    let sum = |product: fn(&TrialSample) -> f64| samples.iter().map(product).sum::<f64>();
    let both = sum(|sample| sample.command_m_s * sample.speed_m_s);
    let command = sum(|sample| sample.command_m_s.powi(2));
    let speed = sum(|sample| sample.speed_m_s.powi(2));
    let [commanded_m, reported_m] = ways(samples);
    let gain = reported_m / commanded_m;
    let noise = gain.abs() < LITTLE && both * both < EXPLAINED * command * speed;
    match noise || speed == 0.0 {
        true => Some(0.0),
        false => gain.is_finite().then_some(gain),
    }
}

/// Ratios of units that are often mistaken for each other.
const UNITS: [(f64, &str); 7] = [
    (60.0, "turns in a minute and in a second"),
    (std::f64::consts::TAU, "turns and radians"),
    (30.0 / std::f64::consts::PI, "turns in a minute and rad/s"),
    (10.0, "a unit and a tenth of it"),
    (100.0, "a unit and a hundredth of it"),
    (1000.0, "a unit and a thousandth of it"),
    (4.0, "encoder lines and their four edges"),
];

/// Returns the ratio of units that a measured ratio is, within a few per cent; else the ratio itself.
fn factor(ratio: f64) -> f64 {
    unit_ratio(ratio).map_or(ratio, |(factor, _)| factor)
}

fn unit_hint(ratio: f64) -> String {
    unit_ratio(ratio).map_or_else(String::new, |(_, words)| format!(" ({words}?)"))
}

fn unit_ratio(ratio: f64) -> Option<(f64, &'static str)> {
    let near = |factor: f64| (ratio / factor - 1.0).abs() < 0.04;
    UNITS.iter().find_map(|(factor, words)| {
        if near(*factor) {
            Some((*factor, *words))
        } else {
            near(1.0 / factor).then_some((1.0 / factor, *words))
        }
    })
}

/// Returns a scale with the digits that a trial can tell.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let digits = 10_f64.powi(5 - value.abs().log10().floor() as i32);
    (value * digits).round() / digits
}

#[cfg(test)]
mod tests;
