//! What the drives do with commands, learned while driving.
//!
//! Configured limits and delays are starting values that may be wrong: a motor may reach less speed than it is told
//! to have, gain it slower, or run faster or slower than commanded at all speeds, and a command may act later. All of
//! it shows in the measured tread speeds beside the commands.

mod gain;
mod rate;
mod scale;

use super::issued::IssuedCommands;
use crate::config::ControllerConfig;
use crate::mpc::limits::{InputLimits, MotorLimits};
use gain::Gain;
use rate::Rate;
use scale::{SHORT_M_S, Scale, is_short};
use serde::{Deserialize, Serialize};
use sidehill_plant::speeds::MotorSpeeds;

/// Delays that are compared with the speeds, and the time between two of them, s.
const DELAYS: usize = 19;
const DELAY_STEP_S: f64 = 0.05;
/// Time over which errors of the delays are remembered, s.
const MEMORY_S: f64 = 10.0;
/// Weight of the configured delay, (m/s)^2 for each second squared beside it: noise must not move it.
const TOLD_WEIGHT: f64 = 0.3;
/// Time constant with which the delay in use follows the one that fits best, s.
const FOLLOW_S: f64 = 1.0;

/// Rate at which the speed of a motor that is short changes, m/s^2, from which it is on its way and not at a limit.
const STEADY_M_S2: f64 = 0.1;
/// Rate at which a command changes up to which its motor can follow, m/s^2.
const SETTLED_M_S2: f64 = 0.2;
/// Factor on its command, beside the part above, beyond which a motor is faster than that.
const FASTER: f64 = 1.2;
/// Share of its limit from which on a motor that obeys confirms it.
const NEAR_LIMIT: f64 = 0.8;
/// Time for which a motor is short before its speed is taken for its limit, s.
const SHORT_S: f64 = 0.4;
/// Time for which no limit is taken after one was taken back, s: commands rise, and the motor follows or does not.
const TRIED_S: f64 = 0.6;
/// Speed that a motor reaches at least where that is a limit and not a friction that it overcomes, m/s.
const REACHED_MIN_M_S: f64 = 0.02;
/// Lowest limit, m/s: commands within a lower one would end in the dead band.
const LIMIT_MIN_M_S: f64 = 0.1;
/// Command up to which a motor is at the lowest limit, m/s.
const LOWEST_M_S: f64 = 1.2 * LIMIT_MIN_M_S;
/// What is added to the speed that a motor reaches, m/s, so that its limit does not sink with noise.
const MARGIN_M_S: f64 = 0.01;
/// Rate at which a limit rises while the motor reaches its commands, m/s^2.
const RECOVERY_M_S2: f64 = 0.03;
/// Distance from its command up to which a motor's speed tells of the delay, m/s.
const NEAR_M_S: f64 = 0.15;
/// Time constant of the speeds that are compared, s.
const SMOOTHING_S: f64 = 0.2;
/// Difference of a gain from 1 that a driver has to know.
const NAMED: f64 = 0.1;
/// Speed of traction from which it tells whether something scales commands down, m/s.
const MOVES_M_S: f64 = 0.05;
/// Lead of a command over a motor that gains speed slowly, beyond what it gains while it is read, m/s.
const LEAD_M_S: f64 = 0.1;

/// How the drives respond, as far as it differs from the configuration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DriveResponse {
    /// Motor that drives both treads alike.
    pub traction: LearnedMotor,
    /// Motor that drives them against each other.
    pub steer: LearnedMotor,
    /// Share of commands that the motors follow, where something scales them down; otherwise 1.
    pub share: f64,
    /// Time after which a command acts, lag included, s.
    pub delay_s: f64,
}

/// What was learned of a motor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LearnedMotor {
    /// Largest speed that it reaches, m/s; at most that configured.
    pub speed_max_m_s: f64,
    /// Speed that it was commanded when it was last short of that, m/s; 0 where it was not.
    pub asked_m_s: f64,
    /// Largest rate at which it gains speed, m/s^2; at most that configured.
    pub acceleration_max_m_s2: f64,
    /// Its speed over that commanded, where neither its largest speed nor [`DriveResponse::share`] explains it; otherwise
    /// 1. Commands are divided by it.
    pub gain: f64,
}

impl LearnedMotor {
    /// Returns the largest speed that the motor reaches, m/s, where it is short of its commands.
    pub fn short_m_s(&self) -> Option<f64> {
        (self.asked_m_s > self.speed_max_m_s).then_some(self.speed_max_m_s)
    }

    /// Returns the motor's gain where that is far from 1.
    pub fn gain_off(&self) -> Option<f64> {
        ((self.gain - 1.0).abs() > NAMED).then_some(self.gain)
    }
}

impl DriveResponse {
    /// Returns the share of commands that the motors follow, where something scales them down.
    pub fn scaled(&self) -> Option<f64> {
        (self.share < 1.0).then_some(self.share)
    }
}

impl std::fmt::Display for DriveResponse {
    /// Writes what a driver has to know; nothing where the drives do as they are told.
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut separator = "";
        for (name, motor) in [("traction", &self.traction), ("steer", &self.steer)] {
            if let Some(reached_m_s) = motor.short_m_s() {
                let asked_m_s = motor.asked_m_s;
                write!(
                    out,
                    "{separator}the {name} motor reaches {reached_m_s:.2} m/s of {asked_m_s:.2} commanded"
                )?;
                separator = "; ";
            }
            if let Some(gain) = motor.gain_off() {
                let percent = 100.0 * gain;
                write!(
                    out,
                    "{separator}the {name} motor runs at {percent:.0} % of its commands"
                )?;
                separator = "; ";
            }
        }
        if let Some(share) = self.scaled() {
            write!(
                out,
                "{separator}commands are scaled down to {:.0} %",
                100.0 * share
            )?;
        }
        Ok(())
    }
}

/// A motor and the largest speed that it was seen to reach.
#[derive(Debug, Clone, Copy)]
struct Motor {
    configured_m_s: f64,
    limit_m_s: f64,
    /// Last limit at which it was seen to obey, m/s, or a larger one since.
    obeyed_m_s: f64,
    /// Largest command that it was short of while it has been limited, m/s; 0 where it is not.
    asked_m_s: f64,
    short_s: f64,
    /// Smoothed speed and command, m/s.
    speed_m_s: f64,
    command_m_s: f64,
    rate: Rate,
    gain: Gain,
}

impl Motor {
    fn new(configured: &MotorLimits) -> Self {
        Self {
            configured_m_s: configured.speed_m_s,
            limit_m_s: configured.speed_m_s,
            obeyed_m_s: configured.speed_m_s,
            asked_m_s: 0.0,
            short_s: 0.0,
            speed_m_s: 0.0,
            command_m_s: 0.0,
            rate: Rate::new(configured.acceleration_m_s2),
            gain: Gain::default(),
        }
    }

    /// Returns whether the motor is near its command, and not on a long way there, which says more of its acceleration
    /// than of a delay.
    fn is_near(&self) -> bool {
        let command_m_s = self.command_m_s.clamp(-self.limit_m_s, self.limit_m_s);
        (self.speed_m_s - command_m_s).abs() < NEAR_M_S
    }

    /// Returns what the motor is known to follow of a command: one that is far ahead of a motor that gains speed slowly
    /// says little of what it will do. `delay_s` is that of commands.
    fn followed(&self, command_m_s: f64, delay_s: f64) -> f64 {
        let gains = command_m_s * self.speed_m_s >= 0.0 && command_m_s.abs() > self.speed_m_s.abs();
        if !(self.rate.is_learned() && gains) {
            return command_m_s;
        }
        let lead_m_s = LEAD_M_S + self.rate.limit_m_s2() * (delay_s + SMOOTHING_S);
        command_m_s.clamp(self.speed_m_s - lead_m_s, self.speed_m_s + lead_m_s)
    }

    fn response(&self) -> LearnedMotor {
        LearnedMotor {
            speed_max_m_s: self.limit_m_s,
            asked_m_s: self.asked_m_s,
            acceleration_max_m_s2: self.rate.limit_m_s2(),
            gain: self.gain.value(),
        }
    }

    /// Returns the limits of the speed asked of the motor as known now, where it follows a share of it.
    fn limits(&self, configured: &MotorLimits, share: f64) -> MotorLimits {
        // Commands are bounded as configured.
        let of_command = self.gain.value().min(1.0);
        let rate_m_s2 = of_command * configured.acceleration_m_s2;
        MotorLimits {
            speed_m_s: (self.limit_m_s / share).min(of_command * configured.speed_m_s),
            acceleration_m_s2: (self.rate.limit_m_s2() / share).min(rate_m_s2),
            deceleration_m_s2: of_command * configured.deceleration_m_s2,
        }
    }

    /// Takes the speed of a reading and the command that acts at its time. Returns both, positive m/s, where the motor had
    /// the time to follow.
    fn observe(&mut self, speed_m_s: f64, command_m_s: f64, elapsed_s: f64) -> Option<(f64, f64)> {
        let gain = (elapsed_s / SMOOTHING_S).min(1.0);
        let (before_m_s, commanded_m_s) = (self.speed_m_s, self.command_m_s);
        self.speed_m_s += gain * (speed_m_s - self.speed_m_s);
        self.command_m_s += gain * (command_m_s - self.command_m_s);
        let (speed, command) = (self.speed_m_s.abs(), self.command_m_s.abs());
        let same_sense = self.speed_m_s * self.command_m_s >= 0.0;
        let behind = same_sense && speed < command && !self.is_near();
        let gained_m_s2 = (speed - before_m_s.abs()) / elapsed_s;
        self.rate.observe(gained_m_s2, behind, elapsed_s);
        let steady = (speed - before_m_s.abs()).abs() <= STEADY_M_S2 * elapsed_s;
        let below = is_short(speed, command);
        if same_sense && below && steady {
            self.short_s = (self.short_s + elapsed_s).min(SHORT_S);
        } else {
            self.short_s = (self.short_s - elapsed_s).max(0.0);
            if !below {
                let rise_m_s = RECOVERY_M_S2 * elapsed_s;
                self.limit_m_s = (self.limit_m_s + rise_m_s).min(self.configured_m_s);
            }
        }
        if self.short_s >= SHORT_S && speed > REACHED_MIN_M_S && speed + MARGIN_M_S < self.limit_m_s
        {
            self.limit_m_s = (speed + MARGIN_M_S).max(LIMIT_MIN_M_S);
            self.asked_m_s = self.asked_m_s.max(command);
        }
        if self.limit_m_s >= self.configured_m_s {
            self.asked_m_s = 0.0;
        }
        let settled = (command - commanded_m_s.abs()).abs() <= SETTLED_M_S2 * elapsed_s;
        let follows = same_sense && steady && settled && speed > REACHED_MIN_M_S;
        let obeys = follows && !below && command > NEAR_LIMIT * self.limit_m_s;
        if obeys || self.limit_m_s > self.obeyed_m_s {
            self.obeyed_m_s = self.limit_m_s;
        }
        follows.then_some((speed, command))
    }

    /// Takes what [`Motor::observe`] returned, of a command at the gain known until now.
    fn observe_gain(&mut self, seen: Option<(f64, f64)>, elapsed_s: f64) {
        let before = self.gain.value();
        if let Some((speed, command)) = seen {
            self.gain.observe(speed, command / before, elapsed_s);
        }
        if before == 1.0 && self.gain.value() != 1.0 {
            self.release();
        }
    }

    /// Returns whether the motor moves and is not short.
    fn moves_as_commanded(&self) -> bool {
        let (speed, command) = (self.speed_m_s.abs(), self.command_m_s.abs());
        speed > MOVES_M_S && !is_short(speed, command)
    }

    /// Returns whether the motor is short at the lowest limit: more has to be commanded to know why.
    fn is_short_at_lowest(&self) -> bool {
        self.short_s >= SHORT_S && self.command_m_s.abs() < LOWEST_M_S
    }

    /// Returns whether the motor is faster than commanded.
    fn is_faster(&self) -> bool {
        self.speed_m_s.abs() > FASTER * self.command_m_s.abs() + SHORT_M_S
    }

    /// Takes back what was learned while nothing was known of a share or a gain.
    fn release(&mut self) {
        (self.limit_m_s, self.short_s) = (self.obeyed_m_s, -TRIED_S);
        self.rate.forget();
    }
}

/// The response of the drives, followed from cycle to cycle; nothing is allocated after [`Drives::new`].
#[derive(Debug, Clone)]
pub(super) struct Drives {
    /// Has no gain below 1: that may be a slow-down on purpose.
    traction: Motor,
    steer: Motor,
    /// What scales commands down does it to both motors alike. It is seen by the traction motor: steer commands change
    /// all the time.
    scale: Scale,
    told_delay_s: f64,
    delay_s: f64,
    /// Sums of the squared differences between speeds and commands so much earlier, (m/s)^2.
    misfits: [f64; DELAYS],
    read_s: Option<f64>,
}

impl Drives {
    pub(super) fn new(config: &ControllerConfig) -> Self {
        Self {
            traction: Motor {
                gain: Gain::at_least(1.0),
                ..Motor::new(&config.limits.traction)
            },
            steer: Motor::new(&config.limits.steer),
            scale: Scale::default(),
            told_delay_s: config.delay_s(),
            delay_s: config.delay_s(),
            misfits: [0.0; DELAYS],
            read_s: None,
        }
    }

    /// Returns how the drives respond as known now.
    pub(super) fn response(&self) -> DriveResponse {
        DriveResponse {
            traction: self.traction.response(),
            steer: self.steer.response(),
            share: self.scale.share(),
            delay_s: self.delay_s,
        }
    }

    /// Returns the speed of the vehicle that something on the way to the traction motor passes on, m/s; infinite where
    /// commands are not scaled down.
    pub(super) fn passed_on_m_s(&self) -> f64 {
        match self.scale.is_scaled() {
            true => self.traction.speed_m_s.abs(),
            false => f64::INFINITY,
        }
    }

    /// Returns the limits of the motors as known now.
    pub(super) fn limits(&self, configured: &InputLimits) -> InputLimits {
        let share = self.scale.share();
        InputLimits {
            traction: self.traction.limits(&configured.traction, share),
            steer: self.steer.limits(&configured.steer, share),
            tread_speed_m_s: self.steer.gain.value().min(1.0) * configured.tread_speed_m_s,
        }
    }

    /// Returns the command that asks speeds of the motors.
    pub(super) fn command(&self, asked: MotorSpeeds) -> MotorSpeeds {
        MotorSpeeds {
            traction_m_s: asked.traction_m_s / self.traction.gain.value(),
            steer_m_s: asked.steer_m_s / self.steer.gain.value(),
        }
    }

    /// Returns the speeds that a command asks of the motors.
    pub(super) fn asked(&self, command: MotorSpeeds) -> MotorSpeeds {
        MotorSpeeds {
            traction_m_s: self.traction.gain.value() * command.traction_m_s,
            steer_m_s: self.steer.gain.value() * command.steer_m_s,
        }
    }

    /// Returns what the motors are known to follow of speeds asked of them.
    pub(super) fn followed(&self, asked: MotorSpeeds) -> MotorSpeeds {
        let share = self.scale.share();
        let followed =
            |motor: &Motor, asked_m_s: f64| motor.followed(share * asked_m_s, self.delay_s) / share;
        MotorSpeeds {
            traction_m_s: followed(&self.traction, asked.traction_m_s),
            steer_m_s: followed(&self.steer, asked.steer_m_s),
        }
    }

    /// Takes effective motor speeds read at `read_s` beside the commands that led to them.
    pub(super) fn observe(&mut self, speeds: MotorSpeeds, read_s: f64, issued: &IssuedCommands) {
        let Some(before_s) = self.read_s.replace(read_s) else {
            return;
        };
        let elapsed_s = read_s - before_s;
        if !(elapsed_s > 0.0 && elapsed_s < 1.0) {
            return;
        }
        if let Some(command) = issued.at(read_s - self.delay_s) {
            self.observe_motors(speeds, command, elapsed_s);
        }
        self.follow_delay(speeds, read_s, elapsed_s, issued);
    }

    /// Returns which reasons are known for speeds that differ from commands.
    fn why_short(&self) -> [bool; 5] {
        let limited = |motor: &Motor| motor.limit_m_s < motor.configured_m_s;
        let gain = |motor: &Motor| motor.gain.value() != 1.0;
        let (traction, steer) = (&self.traction, &self.steer);
        let scaled = self.scale.is_scaled();
        [
            limited(traction),
            limited(steer),
            gain(traction),
            gain(steer),
            scaled,
        ]
    }

    /// Takes speeds and the commands that act at their time.
    fn observe_motors(&mut self, speeds: MotorSpeeds, command: MotorSpeeds, elapsed_s: f64) {
        let (was_scaled, share) = (self.scale.is_scaled(), self.scale.share());
        let asked = self.asked(command);
        let gains = [self.traction.gain.value(), self.steer.gain.value()];
        let known = self.why_short();
        let seen = |motor: &mut Motor, speed_m_s: f64, asked_m_s: f64| {
            motor.observe(speed_m_s, share * asked_m_s, elapsed_s)
        };
        let traction = seen(&mut self.traction, speeds.traction_m_s, asked.traction_m_s);
        let steer = seen(&mut self.steer, speeds.steer_m_s, asked.steer_m_s);
        let faster = self.traction.is_faster() || self.steer.is_faster();
        let whole = traction.map(|(speed, followed)| (speed, followed / share));
        self.scale.observe(whole, faster, elapsed_s);
        self.traction.observe_gain(traction, elapsed_s);
        // While nothing but the motor itself keeps the steer motor from its commands.
        if self.traction.moves_as_commanded() {
            self.steer.observe_gain(steer, elapsed_s);
        }
        if self.scale.is_scaled() != was_scaled {
            self.steer.gain.doubt();
        }
        let found = self.scale.is_scaled() && !was_scaled;
        if self
            .why_short()
            .iter()
            .zip(known)
            .any(|(now, before)| *now && !before)
        {
            // Until then these speeds looked late.
            (self.misfits, self.delay_s) = ([0.0; DELAYS], self.told_delay_s);
        }
        let tries = |motor: &Motor, limited: bool| motor.is_short_at_lowest() && !limited;
        // Where more was asked for.
        let more = self.traction.asked_m_s > LOWEST_M_S;
        if found || more && tries(&self.traction, self.scale.is_limited()) {
            self.traction.release();
        }
        if found || tries(&self.steer, self.steer.gain.is_limited()) {
            self.steer.release();
        }
        // What is smoothed of commands is what they give as known now.
        let now = self.scale.share() / share;
        for (motor, before) in [&mut self.traction, &mut self.steer].into_iter().zip(gains) {
            motor.command_m_s *= now * motor.gain.value() / before;
        }
    }

    /// Compares speeds with commands at all delays and follows the one that fits best.
    fn follow_delay(
        &mut self,
        speeds: MotorSpeeds,
        read_s: f64,
        elapsed_s: f64,
        issued: &IssuedCommands,
    ) {
        let fade = (1.0 - elapsed_s / MEMORY_S).max(0.0);
        let share = self.scale.share();
        let within = |asked: f64, limit: f64| (share * asked).clamp(-limit, limit);
        let near = |motor: &Motor| f64::from(motor.is_near());
        let (traction_near, steer_near) = (near(&self.traction), near(&self.steer));
        for k in 0..DELAYS {
            let Some(command) = issued.at(read_s - DELAY_STEP_S * k as f64) else {
                return;
            };
            let asked = self.asked(command);
            let traction =
                speeds.traction_m_s - within(asked.traction_m_s, self.traction.limit_m_s);
            let steer = speeds.steer_m_s - within(asked.steer_m_s, self.steer.limit_m_s);
            let sum = traction_near * traction * traction + steer_near * steer * steer;
            self.misfits[k] = fade * self.misfits[k] + sum;
        }
        let told_delay_s = self.told_delay_s;
        let cost = |k: usize| {
            let beside_s = DELAY_STEP_S * k as f64 - told_delay_s;
            self.misfits[k] + TOLD_WEIGHT * beside_s * beside_s
        };
        let best = (0..DELAYS).min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
        let Some(best) = best else { return };
        let mut place = best as f64;
        if best > 0 && best + 1 < DELAYS {
            // The vertex of the parabola through three costs.
            let (low, mid, high) = (cost(best - 1), cost(best), cost(best + 1));
            let bend = low - 2.0 * mid + high;
            if bend > 0.0 {
                place += (0.5 * (low - high) / bend).clamp(-0.5, 0.5);
            }
        }
        let gain = (elapsed_s / FOLLOW_S).min(1.0);
        self.delay_s += gain * (DELAY_STEP_S * place - self.delay_s);
    }
}

#[cfg(test)]
mod tests;
