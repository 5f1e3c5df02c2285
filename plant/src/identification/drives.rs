//! How the drives respond to commands: delay, lag, gain and limits of each motor, from commanded and measured speeds.
//!
//! The model of a motor is that of [`crate::drive_train`]: a command c acts after a delay d, is nothing within the dead
//! band, and is followed with a lag within rates:
//!
//! ```text
//! dv/dt = sat((u - v) / T),    u = clip(g c(t - d), v_max)
//! ```
//!
//! Measured speeds are compared with this motion, integrated in closed form, by least squares. Delay, time constant and
//! gain always take part. Largest speed, rates and dead band do where the log supports them: each is added if the
//! squares fall by more than chance explains. What is not supported was not reached, and only a bound of it is known.

use super::least_squares::{Residuals, jacobian_columns, minimise};
use super::statistics::{Cluster, covariance};
use crate::log::{DriveRecord, TimedSpeeds};
use crate::speeds::MotorSpeeds;
use crate::statistics::quantile;
use nalgebra::{DMatrix, DVector};

/// What a log says of a quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Finding {
    /// Its value with a 95 % interval.
    Found {
        /// Value.
        value: f64,
        /// Ends of the interval.
        interval: (f64, f64),
    },
    /// It was not reached: at least this.
    AtLeast(f64),
    /// It did not act: at most this.
    AtMost(f64),
    /// Nothing.
    Unknown,
}

impl Finding {
    /// Returns the value, if it was found.
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Found { value, .. } => Some(*value),
            _ => None,
        }
    }
}

/// Response of a motor to its command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorResponse {
    /// Time until a command acts, s.
    pub delay_s: Finding,
    /// Time constant of the lag, s.
    pub time_constant_s: Finding,
    /// Speed over command.
    pub gain: Finding,
    /// Largest speed, m/s.
    pub speed_max_m_s: Finding,
    /// Largest rate away from zero speed, m/s^2.
    pub acceleration_max_m_s2: Finding,
    /// Largest rate towards zero speed, m/s^2.
    pub deceleration_max_m_s2: Finding,
    /// Command below which the motor stands, m/s.
    pub dead_band_m_s: Finding,
    /// Largest command, m/s.
    pub command_max_m_s: f64,
    /// Root mean square of what the response leaves unexplained, m/s.
    pub residual_m_s: f64,
    /// Measured speeds that were compared.
    pub samples: usize,
}

/// Responses of both motors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorResponses {
    /// The motor that drives both treads alike.
    pub traction: Option<MotorResponse>,
    /// The motor that drives them against each other.
    pub steer: Option<MotorResponse>,
}

/// Why nothing can be said of a drive.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum DriveResponseError {
    /// Too little was recorded.
    #[error(
        "{measured} measured speeds and {commands} commands within 0.5 s of each other, at least {SAMPLES_MIN} and 2 are needed"
    )]
    TooShort {
        /// Measured speeds.
        measured: usize,
        /// Commands.
        commands: usize,
    },
    /// The vehicle moved without commands.
    #[error(
        "no command ever changed, but a motor ran at up to {moved_m_s:.2} m/s: are these the commands that the drives got?"
    )]
    NotCommanded {
        /// Largest measured speed of a motor, m/s.
        moved_m_s: f64,
    },
}

/// Fewest measured speeds.
const SAMPLES_MIN: usize = 50;
/// Measured speeds further apart, s, are not connected.
const GAP_MAX_S: f64 = 0.5;
/// Time at the beginning of a connected piece that does not count, s: commands before it are not known.
const BEGIN_S: f64 = 0.3;
/// Length of the blocks whose scatter gives intervals, s.
const BLOCK_S: f64 = 2.0;
/// Spread of a command below which a motor was not driven, m/s.
const DRIVEN_M_S: f64 = 0.01;
/// Delays that are tried first, s: up to 1 s.
const DELAY_STEP_S: f64 = 0.05;
const DELAY_STEPS: u32 = 20;
/// Time constants that are tried first, s.
const TIME_CONSTANTS_S: [f64; 6] = [0.02, 0.05, 0.1, 0.2, 0.4, 0.8];
/// Shortest time constant, s.
const TIME_CONSTANT_MIN_S: f64 = 5e-3;
/// Twice the logarithm of likelihood that a limit must gain: chance gains 10.8 in one of a thousand logs.
const GAIN_MIN: f64 = 11.0;
/// Share of the squares that a limit must explain at least, so that imperfections of the model are not taken for one.
const SHARE_MIN: f64 = 0.02;

/// Finds the responses of both motors; none of a motor that was never commanded to move.
///
/// # Errors
/// [`DriveResponseError`] where there is too little to say anything.
pub fn identify_drives(records: &[DriveRecord]) -> Result<MotorResponses, DriveResponseError> {
    let motor = |speed: fn(&MotorSpeeds) -> f64| -> Vec<LogPiece> {
        records
            .iter()
            .flat_map(|record| pieces(record, speed))
            .collect()
    };
    let traction = motor(|speeds| speeds.traction_m_s);
    let counted: usize = traction.iter().map(LogPiece::counted).sum();
    let commands: usize = records.iter().map(|record| record.commands.len()).sum();
    if counted < SAMPLES_MIN || commands < 2 {
        return Err(DriveResponseError::TooShort {
            measured: counted,
            commands,
        });
    }
    let steer = motor(|speeds| speeds.steer_m_s);
    let response = MotorResponses {
        traction: response(&traction),
        steer: response(&steer),
    };
    let measured = traction
        .iter()
        .chain(&steer)
        .flat_map(|piece| &piece.measured);
    let moved_m_s = measured.fold(0.0_f64, |most, (_, speed)| most.max(speed.abs()));
    if response.traction.is_none() && response.steer.is_none() && moved_m_s > DRIVEN_M_S {
        return Err(DriveResponseError::NotCommanded { moved_m_s });
    }
    Ok(response)
}

/// A connected piece of one motor's record.
struct LogPiece {
    /// Times and values of commands, the first before or at the first measured speed.
    commands: Vec<(f64, f64)>,
    measured: Vec<(f64, f64)>,
}

impl LogPiece {
    fn counted(&self) -> usize {
        self.measured.len() - self.first_counted()
    }

    fn first_counted(&self) -> usize {
        let begin_s = self.measured[0].0 + BEGIN_S;
        self.measured
            .partition_point(|(time_s, _)| *time_s < begin_s)
    }
}

fn pieces(record: &DriveRecord, speed: fn(&MotorSpeeds) -> f64) -> Vec<LogPiece> {
    let connected = record
        .measured
        .chunk_by(|one, next| next.time_s - one.time_s <= GAP_MAX_S);
    let piece = |measured: &[TimedSpeeds]| {
        let (from_s, to_s) = (measured.first()?.time_s, measured.last()?.time_s);
        let first = record
            .commands
            .partition_point(|c| c.time_s <= from_s)
            .max(1)
            - 1;
        let commands: Vec<_> = record
            .commands
            .get(first..)?
            .iter()
            .take_while(|command| command.time_s <= to_s)
            .map(|command| (command.time_s, speed(&command.speeds)))
            .collect();
        let measured: Vec<_> = measured
            .iter()
            .map(|m| (m.time_s, speed(&m.speeds)))
            .collect();
        let piece = LogPiece { commands, measured };
        (!piece.commands.is_empty() && piece.counted() > 1).then_some(piece)
    };
    connected.filter_map(piece).collect()
}

/// Parameters of the model; limits that do not act are infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MotorModel {
    delay_s: f64,
    time_constant_s: f64,
    gain: f64,
    speed_max_m_s: f64,
    acceleration_m_s2: f64,
    deceleration_m_s2: f64,
    dead_band_m_s: f64,
}

/// A motor without limits.
const FREE: MotorModel = MotorModel {
    delay_s: 0.0,
    time_constant_s: 0.1,
    gain: 1.0,
    speed_max_m_s: f64::INFINITY,
    acceleration_m_s2: f64::INFINITY,
    deceleration_m_s2: f64::INFINITY,
    dead_band_m_s: 0.0,
};

/// A quantity that is added where the log supports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MotorLimit {
    Speed,
    Acceleration,
    Deceleration,
    DeadBand,
}

const LIMITS: [MotorLimit; 4] = [
    MotorLimit::Speed,
    MotorLimit::Acceleration,
    MotorLimit::Deceleration,
    MotorLimit::DeadBand,
];

impl MotorModel {
    fn limit(&mut self, limit: MotorLimit) -> &mut f64 {
        match limit {
            MotorLimit::Speed => &mut self.speed_max_m_s,
            MotorLimit::Acceleration => &mut self.acceleration_m_s2,
            MotorLimit::Deceleration => &mut self.deceleration_m_s2,
            MotorLimit::DeadBand => &mut self.dead_band_m_s,
        }
    }

    /// Returns the speed that the motor aims at under a command.
    fn target(&self, command_m_s: f64) -> f64 {
        if command_m_s.abs() < self.dead_band_m_s {
            return 0.0;
        }
        (self.gain * command_m_s).clamp(-self.speed_max_m_s, self.speed_max_m_s)
    }

    /// Returns the speed `time_s` after `from_m_s` towards `target_m_s`.
    fn toward(&self, from_m_s: f64, target_m_s: f64, time_s: f64) -> f64 {
        let lag_s = self.time_constant_s;
        let (mut speed, mut left_s) = (from_m_s, time_s);
        // Towards zero, then away from it; each within its rate, then with the lag.
        for _ in 0..4 {
            let sense = if target_m_s >= speed { 1.0 } else { -1.0 };
            let error = (target_m_s - speed).abs();
            if left_s <= 0.0 || error == 0.0 {
                break;
            }
            let brakes = speed * sense < 0.0;
            let rate = if brakes {
                self.deceleration_m_s2
            } else {
                self.acceleration_m_s2
            };
            let crosses = brakes && target_m_s * sense > 0.0;
            // The margin keeps rounding from ending the linear part more than once.
            if error > rate * lag_s * (1.0 + 1e-9) {
                let mut step_s = left_s.min((error - rate * lag_s) / rate);
                let mut reached = speed + sense * rate * step_s;
                if crosses && reached * sense > 0.0 {
                    (step_s, reached) = (speed.abs() / rate, 0.0);
                }
                speed = reached;
                left_s -= step_s;
            } else {
                let reached = target_m_s + (speed - target_m_s) * (-left_s / lag_s).exp();
                if crosses && reached * sense > 0.0 {
                    left_s -= lag_s * (error / target_m_s.abs()).ln();
                    speed = 0.0;
                } else {
                    return reached;
                }
            }
        }
        speed
    }

    /// Calls `each` with the measured and the model's speed at each counted sample of a piece.
    fn run(&self, piece: &LogPiece, mut each: impl FnMut(f64, f64)) {
        let first_counted = piece.first_counted();
        let (mut time_s, mut speed) = piece.measured[0];
        let mut next = 1;
        for (index, (sample_s, measured)) in piece.measured.iter().enumerate().skip(1) {
            while time_s < *sample_s {
                let arrival = |at: usize| piece.commands.get(at).map(|c| c.0 + self.delay_s);
                while arrival(next).is_some_and(|arrival_s| arrival_s <= time_s) {
                    next += 1;
                }
                let until_s = arrival(next).map_or(*sample_s, |arrival_s| arrival_s.min(*sample_s));
                let target = self.target(piece.commands[next - 1].1);
                speed = self.toward(speed, target, until_s - time_s);
                time_s = until_s;
            }
            if index >= first_counted {
                each(*measured, speed);
            }
        }
    }

    fn squares(&self, pieces: &[LogPiece]) -> f64 {
        let mut squares = 0.0;
        for piece in pieces {
            self.run(piece, |measured, speed| {
                squares += (measured - speed).powi(2)
            });
        }
        squares
    }

    fn residuals(&self, pieces: &[LogPiece]) -> Vec<f64> {
        let mut residuals = Vec::new();
        for piece in pieces {
            self.run(piece, |measured, speed| residuals.push(speed - measured));
        }
        residuals
    }
}

/// The fit of a model with some limits to pieces.
struct DriveFit<'a> {
    pieces: &'a [LogPiece],
    /// Limits that act, and the values of the others.
    limits: &'a [MotorLimit],
    model: MotorModel,
}

impl DriveFit<'_> {
    /// The smooth parameters: delay, logarithm of the time constant, gain, logarithms of the limits.
    fn parameters(&self) -> Vec<f64> {
        let mut model = self.model;
        let base = [model.delay_s, model.time_constant_s.ln(), model.gain];
        let limits = self.smooth_limits().map(|limit| model.limit(limit).ln());
        base.into_iter().chain(limits.collect::<Vec<_>>()).collect()
    }

    /// A step of the dead band changes nothing or much, so it is searched otherwise.
    fn smooth_limits(&self) -> impl Iterator<Item = MotorLimit> + use<'_> {
        self.limits
            .iter()
            .copied()
            .filter(|limit| *limit != MotorLimit::DeadBand)
    }

    fn with(&self, parameters: &[f64]) -> MotorModel {
        let mut model = self.model;
        model.delay_s = parameters[0].clamp(0.0, 2.0);
        model.time_constant_s = parameters[1].exp().clamp(TIME_CONSTANT_MIN_S, 20.0);
        model.gain = parameters[2];
        for (limit, value) in self.smooth_limits().zip(&parameters[3..]) {
            *model.limit(limit) = value.exp().clamp(1e-4, 1e4);
        }
        model
    }

    fn minimised(&self) -> MotorModel {
        self.with(&minimise(self, &self.parameters()).0)
    }
}

impl Residuals for DriveFit<'_> {
    fn residuals(&self, parameters: &[f64]) -> Vec<f64> {
        self.with(parameters).residuals(self.pieces)
    }
}

fn response(pieces: &[LogPiece]) -> Option<MotorResponse> {
    let commands: Vec<f64> = pieces
        .iter()
        .flat_map(|piece| piece.commands.iter().map(|(_, command)| *command))
        .collect();
    let (least, most) = commands.iter().fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(least, most), command| (least.min(*command), most.max(*command)),
    );
    if most - least < DRIVEN_M_S {
        return None;
    }
    let (model, limits) = chosen(pieces, &commands);
    Some(report(pieces, &commands, model, &limits))
}

/// Returns the model that the log supports, and its limits.
fn chosen(pieces: &[LogPiece], commands: &[f64]) -> (MotorModel, Vec<MotorLimit>) {
    let mut limits = Vec::new();
    let fit = |model, limits: &[MotorLimit]| {
        DriveFit {
            pieces,
            limits,
            model,
        }
        .minimised()
    };
    let mut model = fit(start(pieces), &limits);
    let mut squares = model.squares(pieces);
    loop {
        let others = LIMITS.into_iter().filter(|limit| !limits.contains(limit));
        let tried = others.filter_map(|limit| {
            let with: Vec<MotorLimit> = limits.iter().copied().chain([limit]).collect();
            let begin = candidates(pieces, commands, &model, limit)
                .map(|candidate| (candidate.squares(pieces), candidate))
                .min_by(|a, b| a.0.total_cmp(&b.0))?
                .1;
            let model = fit(begin, &with);
            Some((model.squares(pieces), model, with))
        });
        let Some((less, better, with)) = tried.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            break;
        };
        let independent = independent_samples(&better.residuals(pieces));
        let gained = independent * (squares / less.max(1e-300)).ln();
        if gained < GAIN_MIN || less > (1.0 - SHARE_MIN) * squares {
            break;
        }
        (model, squares, limits) = (better, less, with);
    }
    (model, limits)
}

/// Returns the best of a grid of delays and time constants.
fn start(pieces: &[LogPiece]) -> MotorModel {
    let delays = (0..=DELAY_STEPS).map(|step| f64::from(step) * DELAY_STEP_S);
    let grid = delays.flat_map(|delay_s| TIME_CONSTANTS_S.map(|lag_s| (delay_s, lag_s)));
    grid.map(|(delay_s, time_constant_s)| {
        let unit = MotorModel {
            delay_s,
            time_constant_s,
            ..FREE
        };
        // The motion is all but proportional to the gain.
        let (mut both, mut own) = (0.0, 0.0);
        for piece in pieces {
            unit.run(piece, |measured, speed| {
                both += measured * speed;
                own += speed * speed;
            });
        }
        let gain = if own > 0.0 {
            (both / own).clamp(0.05, 5.0)
        } else {
            1.0
        };
        let model = MotorModel { gain, ..unit };
        (model.squares(pieces), model)
    })
    .min_by(|a, b| a.0.total_cmp(&b.0))
    .map_or(FREE, |(_, model)| model)
}

/// Returns models with values of a limit to begin with.
fn candidates<'a>(
    pieces: &[LogPiece],
    commands: &[f64],
    model: &'a MotorModel,
    limit: MotorLimit,
) -> impl Iterator<Item = MotorModel> + use<'a> {
    let of = |values: &mut Vec<f64>, shares: &[f64]| -> Vec<f64> {
        values.sort_by(f64::total_cmp);
        shares
            .iter()
            .filter_map(|share| quantile(values, *share))
            .collect()
    };
    let values: Vec<f64> = match limit {
        MotorLimit::Speed => {
            let mut speeds: Vec<f64> = pieces
                .iter()
                .flat_map(|piece| piece.measured.iter().map(|(_, speed)| speed.abs()))
                .collect();
            of(&mut speeds, &[0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98])
        }
        MotorLimit::Acceleration | MotorLimit::Deceleration => {
            (0..12).map(|i| 0.05 * 1.6_f64.powi(i)).collect()
        }
        MotorLimit::DeadBand => dead_bands(commands),
    };
    let gains = if limit == MotorLimit::Speed {
        vec![model.gain, 1.0]
    } else {
        vec![model.gain]
    };
    values
        .into_iter()
        .filter(|value| *value > 1e-3)
        .flat_map(move |value| {
            gains.clone().into_iter().map(move |gain| {
                let mut with = MotorModel { gain, ..*model };
                *with.limit(limit) = value;
                with
            })
        })
}

/// Returns values of the dead band that differ for these commands: between one size of a command and the next.
fn dead_bands(commands: &[f64]) -> Vec<f64> {
    const MOST: usize = 200;
    let mut sizes: Vec<f64> = commands.iter().map(|command| command.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.dedup_by(|next, one| *next - *one < 1e-4);
    let between: Vec<f64> = sizes
        .windows(2)
        .map(|pair| 0.5 * (pair[0] + pair[1]))
        .collect();
    let stride = between.len().div_ceil(MOST).max(1);
    between.into_iter().step_by(stride).collect()
}

/// Returns how many independent samples tell as much as these residuals, whose neighbours are alike.
fn independent_samples(residuals: &[f64]) -> f64 {
    let squares: f64 = residuals.iter().map(|r| r * r).sum();
    let products: f64 = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let alike = (products / squares.max(1e-300)).clamp(0.0, 0.99);
    residuals.len() as f64 * (1.0 - alike) / (1.0 + alike)
}

fn report(
    pieces: &[LogPiece],
    commands: &[f64],
    model: MotorModel,
    limits: &[MotorLimit],
) -> MotorResponse {
    let fit = DriveFit {
        pieces,
        limits,
        model,
    };
    let parameters = fit.parameters();
    let residuals = model.residuals(pieces);
    let half_widths = half_widths(&fit, &parameters, &residuals);
    let additive = |index: usize, widest: f64, least: f64| {
        let value: f64 = parameters[index];
        match half_widths[index] {
            Some(half) if half <= widest => Finding::Found {
                value: value.max(least),
                interval: ((value - half).max(least), value + half),
            },
            _ => Finding::Unknown,
        }
    };
    let factor = |index: usize, widest: f64| {
        let value: f64 = parameters[index];
        match half_widths[index] {
            Some(half) if half <= widest => Some(Finding::Found {
                value: value.exp(),
                interval: ((value - half).exp(), (value + half).exp()),
            }),
            _ => None,
        }
    };
    let (reached_m_s, rates_m_s2) = reached(pieces, &model);
    let smooth: Vec<MotorLimit> = fit.smooth_limits().collect();
    let limit = |limit: MotorLimit, reached: f64| {
        let index = smooth.iter().position(|own| *own == limit);
        let found = index.and_then(|index| factor(3 + index, 0.7));
        found.unwrap_or(Finding::AtLeast(reached))
    };
    let lag = match (factor(1, 0.7), half_widths[1]) {
        (Some(found), _) => found,
        (None, Some(half)) if half.is_finite() && (parameters[1] + half).exp() < 0.2 => {
            Finding::AtMost((parameters[1] + half).exp())
        }
        _ => Finding::Unknown,
    };
    MotorResponse {
        delay_s: additive(0, 0.15, 0.0),
        time_constant_s: lag,
        gain: additive(2, 0.2, f64::NEG_INFINITY),
        speed_max_m_s: limit(MotorLimit::Speed, reached_m_s),
        acceleration_max_m_s2: limit(MotorLimit::Acceleration, rates_m_s2[0]),
        deceleration_max_m_s2: limit(MotorLimit::Deceleration, rates_m_s2[1]),
        dead_band_m_s: dead_band(&fit, commands, &residuals),
        command_max_m_s: commands.iter().fold(0.0, |most, c| most.max(c.abs())),
        residual_m_s: (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64)
            .sqrt(),
        samples: residuals.len(),
    }
}

/// Returns half the 95 % interval of each parameter; none of those that change nothing.
fn half_widths(fit: &DriveFit, parameters: &[f64], residuals: &[f64]) -> Vec<Option<f64>> {
    let columns = jacobian_columns(fit, parameters);
    let size = |column: &[f64]| column.iter().map(|value| value * value).sum::<f64>().sqrt();
    let largest = columns
        .iter()
        .map(|column| size(column))
        .fold(0.0, f64::max);
    let seen: Vec<usize> = (0..columns.len())
        .filter(|index| size(&columns[*index]) > 1e-6 * largest)
        .collect();
    let mut clusters = Vec::new();
    let mut row = 0;
    for piece in fit.pieces {
        let counted = &piece.measured[piece.first_counted()..];
        let begin_s = counted[0].0;
        let block = |sample: &(f64, f64)| ((sample.0 - begin_s) / BLOCK_S) as u64;
        for samples in counted.chunk_by(|a, b| block(a) == block(b)) {
            let rows = row..row + samples.len();
            row = rows.end;
            clusters.push(Cluster {
                jacobian: DMatrix::from_fn(samples.len(), seen.len(), |i, j| {
                    columns[seen[j]][rows.start + i]
                }),
                residuals: DVector::from_column_slice(&residuals[rows]),
            });
        }
    }
    let mut half_widths = vec![None; columns.len()];
    if let Some(covariance) = covariance(&clusters) {
        for (place, index) in seen.into_iter().enumerate() {
            half_widths[index] = Some(1.96 * covariance[(place, place)].max(0.0).sqrt());
        }
    }
    half_widths
}

/// Returns the largest speed of the model, and its largest rates away from zero and towards it.
fn reached(pieces: &[LogPiece], model: &MotorModel) -> (f64, [f64; 2]) {
    let (mut fastest, mut rates) = (0.0_f64, [0.0_f64; 2]);
    for piece in pieces {
        let counted = &piece.measured[piece.first_counted()..];
        let mut before: Option<f64> = None;
        let mut index = 0;
        model.run(piece, |_, speed| {
            fastest = fastest.max(speed.abs());
            if let Some(before) = before.filter(|before| before * speed >= 0.0) {
                let rate = (speed.abs() - before.abs()) / (counted[index].0 - counted[index - 1].0);
                let [away, towards] = &mut rates;
                *away = away.max(rate);
                *towards = towards.max(-rate);
            }
            before = Some(speed);
            index += 1;
        });
    }
    (fastest, rates)
}

/// Returns what the log says of the dead band, from the sum of squares over its value.
fn dead_band(fit: &DriveFit, commands: &[f64], residuals: &[f64]) -> Finding {
    let squares = |dead_band_m_s: f64| {
        let model = MotorModel {
            dead_band_m_s,
            ..fit.model
        };
        model.squares(fit.pieces)
    };
    let tried = dead_bands(commands).into_iter();
    let mut profile: Vec<(f64, f64)> = tried.map(|value| (value, squares(value))).collect();
    profile.push((fit.model.dead_band_m_s, squares(fit.model.dead_band_m_s)));
    profile.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(best) = profile.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1)) else {
        return Finding::Unknown;
    };
    let independent = independent_samples(residuals);
    let likely = |squares: f64| independent * (squares / best.1.max(1e-300)).ln() < 3.84;
    let mut within = profile
        .iter()
        .filter(|(_, squares)| likely(*squares))
        .map(|(value, _)| *value);
    let first = within.next().unwrap_or(best.0);
    let last = within.next_back().unwrap_or(first);
    if fit.limits.contains(&MotorLimit::DeadBand) {
        Finding::Found {
            value: best.0,
            interval: (first, last),
        }
    } else if last < 0.5 * commands.iter().fold(0.0, |most, c| c.abs().max(most)) {
        Finding::AtMost(last)
    } else {
        Finding::Unknown
    }
}

#[cfg(test)]
mod tests;
