//! From commanded to actual motor speeds: what slows a command down on its way, and the two motors.

use crate::bounds::{Bounds, RangeError};
use crate::speeds::MotorSpeeds;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Everything between a command and the treads; `{}` is an ideal drive train.
///
/// As YAML: `traction` and `steer`, each with `speed_max_m_s`, `acceleration_max_m_s2` (away from
/// zero speed), `deceleration_max_m_s2` (towards it), `time_constant_s`, `gain`, `dead_band_m_s` and
/// `breakaway_m_s`; `delay_s`, `tread_speed_max_m_s` for the faster tread, `brakes`,
/// `battery_fall_per_s`, `schedule`, `smoother` and `collision_monitor`. What is absent does not act.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "RawDriveTrain")]
pub struct DriveTrainConfig {
    /// [Motor](#motor) that drives both treads alike.
    traction: MotorConfig,
    /// [Motor](#motor) that drives them against each other.
    steer: MotorConfig,
    /// Time from a command to its arrival at the motors.
    delay_s: f64,
    /// Largest speed of a tread. None: no limit.
    tread_speed_max_m_s: Option<f64>,
    /// Whether brakes hold treads that stand, so that a parked vehicle of the contact plant does not creep downhill.
    brakes: bool,
    /// Share of the largest speeds that is lost each second, until a fifth of them is left.
    battery_fall_per_s: f64,
    /// [Changes of the motors](#change-of-the-motors) during a run, in ascending order of time.
    schedule: Vec<ScheduledChange>,
    /// [Smoother](#smoother) of the commands.
    smoother: Option<SmootherConfig>,
    /// [Slowdowns](#slowdown) of the commands by a collision monitor.
    collision_monitor: Vec<Slowdown>,
}

/// What keeps one motor from following its command; everything absent is ideal.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct MotorConfig {
    /// Largest speed in either direction. None: no limit.
    speed_max_m_s: Option<f64>,
    /// Largest rate of change away from zero. None: no limit.
    acceleration_max_m_s2: Option<f64>,
    /// Largest rate of change towards zero. None: no limit.
    deceleration_max_m_s2: Option<f64>,
    /// Time constant of a first-order lag. None: no lag.
    time_constant_s: Option<f64>,
    /// Speed over commanded speed. None: 1.
    gain: Option<f64>,
    /// Commanded speed below which the motor stands.
    dead_band_m_s: Option<f64>,
    /// Commanded speed below which a standing motor does not start.
    breakaway_m_s: Option<f64>,
}

/// Keys of the motors that change during a run; those that are not named stay.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScheduledChange {
    /// Time from which the new values hold.
    from_s: f64,
    /// [Motor](#motor): the keys that change.
    #[serde(default)]
    traction: MotorConfig,
    /// [Motor](#motor): the keys that change.
    #[serde(default)]
    steer: MotorConfig,
}

/// What makes commands smooth before they reach the drives, as Nav2's `velocity_smoother` does in open loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SmootherConfig {
    /// Largest rate of change of traction and steer commands.
    acceleration_m_s2: f64,
    /// Speed below which the smoother sends zero.
    #[serde(default)]
    dead_band_m_s: f64,
}

/// A time in which a collision monitor scales commands down.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Slowdown {
    /// Begin.
    from_s: f64,
    /// End.
    to_s: f64,
    /// Factor on commands; 0 stops.
    slowdown_ratio: f64,
}

/// The two motors between a command and the treads, advanced in fixed steps.
#[derive(Debug, Clone)]
pub struct DriveTrain {
    dt_s: f64,
    steps: u64,
    smoother: Option<SmootherConfig>,
    /// Command that the smoother gave last, before its dead band.
    smoothed: MotorSpeeds,
    collision_monitor: Vec<Slowdown>,
    traction: SimulatedMotor,
    steer: SimulatedMotor,
    tread_speed_max_m_s: f64,
    battery_fall_per_s: f64,
    /// Changes that are still to come, in their order.
    schedule: VecDeque<ScheduledChange>,
    brakes: bool,
    braked: bool,
    /// Commands on their way, the oldest in front; its length is the delay in steps.
    in_flight: VecDeque<MotorSpeeds>,
}

/// Speed below which a motor stands, m/s.
const STANDING_M_S: f64 = 1e-3;
/// Share of its largest speed that a motor keeps on an empty battery.
const EMPTY_BATTERY: f64 = 0.2;

impl DriveTrain {
    /// Returns a standing drive train for steps of `dt_s`, s, which must be positive.
    ///
    /// The delay is rounded to whole steps.
    pub fn new(config: &DriveTrainConfig, dt_s: f64) -> Self {
        let delay_steps = (config.delay_s / dt_s).round() as usize;
        // One more than is in flight: the newest enters before the oldest leaves.
        let mut in_flight = VecDeque::with_capacity(delay_steps + 1);
        in_flight.resize(delay_steps, MotorSpeeds::STOP);
        Self {
            dt_s,
            steps: 0,
            smoother: config.smoother,
            smoothed: MotorSpeeds::STOP,
            collision_monitor: config.collision_monitor.clone(),
            traction: SimulatedMotor::new(&config.traction, dt_s),
            steer: SimulatedMotor::new(&config.steer, dt_s),
            tread_speed_max_m_s: config.tread_speed_max_m_s.unwrap_or(f64::INFINITY),
            battery_fall_per_s: config.battery_fall_per_s,
            schedule: config.schedule.iter().copied().collect(),
            brakes: config.brakes,
            braked: config.brakes,
            in_flight,
        }
    }

    /// Returns the effective motor speeds at the end of the next step, while which `command` is
    /// given.
    ///
    /// In this order: smoother and collision monitor change the command; it waits for the delay; dead
    /// band and gain of each motor act on it; it is cut to each motor's speed and, by one factor for
    /// both, to the treads' speed; each motor follows with its lag within its rates. The
    /// treads' limit then holds for the result too, even at the price of a rate.
    pub fn step(&mut self, command: MotorSpeeds) -> MotorSpeeds {
        let time_s = self.steps as f64 * self.dt_s;
        self.steps += 1;
        while let Some(change) = self.schedule.front().filter(|c| c.from_s <= time_s) {
            self.traction.change(&change.traction);
            self.steer.change(&change.steer);
            self.schedule.pop_front();
        }
        let charge = (1.0 - self.battery_fall_per_s * time_s).max(EMPTY_BATTERY);
        let smoothed = self.smooth(command);
        let sent = self.slowed(smoothed, time_s);
        self.in_flight.push_back(sent);
        let arrived = self.in_flight.pop_front().unwrap_or(sent);
        let tread_speed_max_m_s = charge * self.tread_speed_max_m_s;
        let wanted = within_treads(
            MotorSpeeds {
                traction_m_s: self.traction.wanted(arrived.traction_m_s, charge),
                steer_m_s: self.steer.wanted(arrived.steer_m_s, charge),
            },
            tread_speed_max_m_s,
        );
        let mut reached = within_treads(
            MotorSpeeds {
                traction_m_s: self.traction.toward(wanted.traction_m_s),
                steer_m_s: self.steer.toward(wanted.steer_m_s),
            },
            tread_speed_max_m_s,
        );
        self.braked = self.brakes
            && wanted == MotorSpeeds::STOP
            && reached.traction_m_s.abs() + reached.steer_m_s.abs() < STANDING_M_S;
        if self.braked {
            reached = MotorSpeeds::STOP;
        }
        self.traction.speed_m_s = reached.traction_m_s;
        self.steer.speed_m_s = reached.steer_m_s;
        reached
    }

    /// Returns whether brakes hold the treads.
    pub fn is_braked(&self) -> bool {
        self.braked
    }

    fn smooth(&mut self, command: MotorSpeeds) -> MotorSpeeds {
        let Some(smoother) = &self.smoother else {
            return command;
        };
        let change_m_s = smoother.acceleration_m_s2 * self.dt_s;
        let toward = |from: f64, to: f64| from + (to - from).clamp(-change_m_s, change_m_s);
        self.smoothed = MotorSpeeds {
            traction_m_s: toward(self.smoothed.traction_m_s, command.traction_m_s),
            steer_m_s: toward(self.smoothed.steer_m_s, command.steer_m_s),
        };
        let sent = |speed_m_s: f64| {
            if speed_m_s.abs() < smoother.dead_band_m_s {
                0.0
            } else {
                speed_m_s
            }
        };
        MotorSpeeds {
            traction_m_s: sent(self.smoothed.traction_m_s),
            steer_m_s: sent(self.smoothed.steer_m_s),
        }
    }

    /// The slowest of the collision monitor's times holds where they overlap.
    fn slowed(&self, command: MotorSpeeds, time_s: f64) -> MotorSpeeds {
        let acting = self.collision_monitor.iter();
        let acting = acting.filter(|slow| (slow.from_s..slow.to_s).contains(&time_s));
        match acting.map(|slow| slow.slowdown_ratio).reduce(f64::min) {
            Some(ratio) => MotorSpeeds {
                traction_m_s: ratio * command.traction_m_s,
                steer_m_s: ratio * command.steer_m_s,
            },
            None => command,
        }
    }
}

/// The faster tread moves at |tau| + |sigma|.
fn within_treads(speeds: MotorSpeeds, speed_max_m_s: f64) -> MotorSpeeds {
    let faster_m_s = speeds.traction_m_s.abs() + speeds.steer_m_s.abs();
    if faster_m_s <= speed_max_m_s {
        return speeds;
    }
    let share = speed_max_m_s / faster_m_s;
    MotorSpeeds {
        traction_m_s: share * speeds.traction_m_s,
        steer_m_s: share * speeds.steer_m_s,
    }
}

#[derive(Debug, Clone)]
struct SimulatedMotor {
    config: MotorConfig,
    speed_m_s: f64,
    dt_s: f64,
    acceleration_max_m_s2: f64,
    deceleration_max_m_s2: f64,
    /// exp(-dt/T): what is left of a difference after a step, 0 without lag.
    remainder: f64,
}

impl SimulatedMotor {
    fn new(config: &MotorConfig, dt_s: f64) -> Self {
        Self {
            config: *config,
            speed_m_s: 0.0,
            dt_s,
            acceleration_max_m_s2: config.acceleration_max_m_s2.unwrap_or(f64::INFINITY),
            deceleration_max_m_s2: config.deceleration_max_m_s2.unwrap_or(f64::INFINITY),
            remainder: config.time_constant_s.map_or(0.0, |t| (-dt_s / t).exp()),
        }
    }

    /// Takes over the keys that `new` names, at the speed that the motor has.
    fn change(&mut self, new: &MotorConfig) {
        *self = Self {
            speed_m_s: self.speed_m_s,
            ..Self::new(&new.or(&self.config), self.dt_s)
        };
    }

    /// Speed that the motor aims at under a command, with that share of its largest speed.
    fn wanted(&self, command_m_s: f64, charge: f64) -> f64 {
        let config = &self.config;
        let stands = self.speed_m_s.abs() < STANDING_M_S;
        let starts_m_s = config.breakaway_m_s.filter(|_| stands).unwrap_or(0.0);
        if command_m_s.abs() < config.dead_band_m_s.unwrap_or(0.0).max(starts_m_s) {
            return 0.0;
        }
        let speed_max_m_s = charge * config.speed_max_m_s.unwrap_or(f64::INFINITY);
        (config.gain.unwrap_or(1.0) * command_m_s).clamp(-speed_max_m_s, speed_max_m_s)
    }

    /// Speed after a step towards `wanted_m_s`.
    fn toward(&self, wanted_m_s: f64) -> f64 {
        let lagged_m_s = wanted_m_s + self.remainder * (self.speed_m_s - wanted_m_s);
        let brake_m_s = self.deceleration_max_m_s2 * self.dt_s;
        // Seen in the direction of motion, so that both directions are one case.
        let sense = if self.speed_m_s < 0.0 { -1.0 } else { 1.0 };
        let (now, next) = (sense * self.speed_m_s, sense * lagged_m_s);
        let reached = if next >= now {
            next.min(now + self.acceleration_max_m_s2 * self.dt_s)
        } else if next >= 0.0 {
            next.max(now - brake_m_s)
        } else if brake_m_s <= now {
            now - brake_m_s
        } else {
            // Through zero: what is left of the step after braking accelerates backwards.
            let left_s = self.dt_s * (1.0 - now / brake_m_s);
            next.max(-self.acceleration_max_m_s2 * left_s)
        };
        sense * reached
    }
}

impl MotorConfig {
    /// Returns these keys, and those of `other` where they are absent.
    fn or(&self, other: &Self) -> Self {
        Self {
            speed_max_m_s: self.speed_max_m_s.or(other.speed_max_m_s),
            acceleration_max_m_s2: self.acceleration_max_m_s2.or(other.acceleration_max_m_s2),
            deceleration_max_m_s2: self.deceleration_max_m_s2.or(other.deceleration_max_m_s2),
            time_constant_s: self.time_constant_s.or(other.time_constant_s),
            gain: self.gain.or(other.gain),
            dead_band_m_s: self.dead_band_m_s.or(other.dead_band_m_s),
            breakaway_m_s: self.breakaway_m_s.or(other.breakaway_m_s),
        }
    }

    /// Checks the ranges of a motor whose keys are to be named by `keys`.
    fn check(&self, keys: &MotorKeys) -> Result<(), RangeError> {
        let speed = Bounds::new(1e-3, 100.0, "m/s");
        let rate = Bounds::new(1e-3, 1e3, "m/s^2");
        let band = Bounds::new(0.0, 10.0, "m/s");
        let all = [
            (speed, self.speed_max_m_s),
            (rate, self.acceleration_max_m_s2),
            (rate, self.deceleration_max_m_s2),
            (Bounds::new(1e-3, 60.0, "s"), self.time_constant_s),
            (Bounds::new(0.1, 10.0, ""), self.gain),
            (band, self.dead_band_m_s),
            (band, self.breakaway_m_s),
        ];
        for ((bounds, value), key) in all.into_iter().zip(keys) {
            check_optional(bounds, key, value)?;
        }
        Ok(())
    }
}

/// Names of a motor's keys in messages, in the order of its fields.
type MotorKeys = [&'static str; 7];

/// Returns the names of a motor's keys within a section.
macro_rules! motor_keys {
    ($section:literal) => {
        [
            concat!($section, ".speed_max_m_s"),
            concat!($section, ".acceleration_max_m_s2"),
            concat!($section, ".deceleration_max_m_s2"),
            concat!($section, ".time_constant_s"),
            concat!($section, ".gain"),
            concat!($section, ".dead_band_m_s"),
            concat!($section, ".breakaway_m_s"),
        ]
    };
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RawDriveTrain {
    traction: MotorConfig,
    steer: MotorConfig,
    delay_s: f64,
    tread_speed_max_m_s: Option<f64>,
    brakes: bool,
    battery_fall_per_s: f64,
    schedule: Vec<ScheduledChange>,
    smoother: Option<SmootherConfig>,
    collision_monitor: Vec<Slowdown>,
}

impl TryFrom<RawDriveTrain> for DriveTrainConfig {
    type Error = RangeError;

    fn try_from(raw: RawDriveTrain) -> Result<Self, RangeError> {
        let time = |least_s| Bounds::new(least_s, 1e6, "s");
        raw.traction.check(&motor_keys!("traction"))?;
        raw.steer.check(&motor_keys!("steer"))?;
        check_optional(
            Bounds::new(1e-3, 100.0, "m/s"),
            "tread_speed_max_m_s",
            raw.tread_speed_max_m_s,
        )?;
        Bounds::new(0.0, 10.0, "s").check("delay_s", raw.delay_s)?;
        Bounds::new(0.0, 0.1, "1/s").check("battery_fall_per_s", raw.battery_fall_per_s)?;
        let mut before_s = 0.0;
        for change in &raw.schedule {
            before_s = time(before_s)
                .with_note("in ascending order")
                .check("schedule: from_s", change.from_s)?;
            change.traction.check(&motor_keys!("schedule: traction"))?;
            change.steer.check(&motor_keys!("schedule: steer"))?;
        }
        if let Some(smoother) = &raw.smoother {
            Bounds::new(1e-3, 1e3, "m/s^2")
                .check("smoother.acceleration_m_s2", smoother.acceleration_m_s2)?;
            Bounds::new(0.0, 10.0, "m/s")
                .check("smoother.dead_band_m_s", smoother.dead_band_m_s)?;
        }
        for slow in &raw.collision_monitor {
            time(0.0).check("collision_monitor: from_s", slow.from_s)?;
            time(slow.from_s)
                .with_note("not before from_s")
                .check("collision_monitor: to_s", slow.to_s)?;
            Bounds::new(0.0, 1.0, "")
                .check("collision_monitor: slowdown_ratio", slow.slowdown_ratio)?;
        }
        Ok(Self {
            traction: raw.traction,
            steer: raw.steer,
            delay_s: raw.delay_s,
            tread_speed_max_m_s: raw.tread_speed_max_m_s,
            brakes: raw.brakes,
            battery_fall_per_s: raw.battery_fall_per_s,
            schedule: raw.schedule,
            smoother: raw.smoother,
            collision_monitor: raw.collision_monitor,
        })
    }
}

fn check_optional(bounds: Bounds, key: &'static str, value: Option<f64>) -> Result<(), RangeError> {
    value.map_or(Ok(()), |value| bounds.check(key, value).map(drop))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::motors;
    use proptest::prelude::*;

    const DT_S: f64 = 0.01;

    fn drive_train(yaml: &str) -> DriveTrain {
        DriveTrain::new(&serde_yaml::from_str(yaml).unwrap(), DT_S)
    }

    #[test]
    fn nothing_configured_follows_at_once() {
        let mut ideal = drive_train("{}");
        assert_eq!(ideal.step(motors(0.7, -2.0)), motors(0.7, -2.0));
        assert_eq!(ideal.step(MotorSpeeds::STOP), MotorSpeeds::STOP);
    }

    #[test]
    fn lag_reaches_its_share_exactly_whatever_the_step() {
        let mut lagging = drive_train("{steer: {time_constant_s: 0.2}}");
        let speeds = (0..20)
            .map(|_| lagging.step(motors(1.0, 1.0)))
            .last()
            .unwrap();
        assert_eq!(speeds.traction_m_s, 1.0);
        assert!((speeds.steer_m_s - (1.0 - (-1.0_f64).exp())).abs() < 1e-12);
    }

    #[test]
    fn a_command_takes_the_delay_and_no_step_more() {
        let mut late = drive_train("{delay_s: 0.05}");
        for step in 0..1000 {
            let speeds = late.step(motors(f64::from(step), 0.0));
            assert_eq!(speeds.traction_m_s, f64::from((step - 5).max(0)));
        }
        assert_eq!(late.in_flight.capacity(), 6);
    }

    #[test]
    fn braking_and_accelerating_have_their_own_rates_also_through_zero() {
        let mut slow =
            drive_train("{traction: {acceleration_max_m_s2: 1, deceleration_max_m_s2: 4}}");
        let after = |steps: u32, slow: &mut DriveTrain, wanted| {
            (0..steps)
                .map(|_| slow.step(motors(wanted, 0.0)).traction_m_s)
                .last()
                .unwrap()
        };
        assert!((after(50, &mut slow, 1.0) - 0.5).abs() < 1e-12);
        assert!((after(10, &mut slow, -1.0) - 0.1).abs() < 1e-12);
        // 2.5 steps to stand, then half a step and nine more the other way.
        assert!((after(12, &mut slow, -1.0) + 0.095).abs() < 1e-12);
        assert!((after(200, &mut slow, -1.0) + 1.0).abs() < 1e-12);
    }

    #[test]
    fn keys_out_of_range_or_unknown_are_named() {
        let error = |yaml| {
            serde_yaml::from_str::<DriveTrainConfig>(yaml)
                .unwrap_err()
                .to_string()
        };
        assert!(error("{steer: {time_constant_s: -1}}").contains("steer.time_constant_s"));
        assert!(error("{delay_s: 11}").contains("from 0 to 10 s"));
        assert!(error("{traction: {speed_max: 1}}").contains("speed_max"));
        assert!(error("{dealy_s: 1}").contains("dealy_s"));
        let late = error("{schedule: [{from_s: 2}, {from_s: 1}]}");
        assert!(
            late.contains("schedule: from_s") && late.contains("ascending"),
            "{late}"
        );
        let gain = error("{schedule: [{from_s: 2, steer: {gain: 0}}]}");
        assert!(gain.contains("schedule: steer.gain"), "{gain}");
        assert!(error("{smoother: {acceleration_m_s2: 0}}").contains("smoother.acceleration_m_s2"));
        let monitor = error("{collision_monitor: [{from_s: 2, to_s: 1, slowdown_ratio: 1}]}");
        assert!(monitor.contains("collision_monitor: to_s"), "{monitor}");
    }

    /// Traction after so many steps under one command.
    fn traction_after(steps: u32, drive_train: &mut DriveTrain, command_m_s: f64) -> f64 {
        (0..steps)
            .map(|_| drive_train.step(motors(command_m_s, 0.0)).traction_m_s)
            .last()
            .unwrap()
    }

    #[test]
    fn a_dead_band_stops_and_a_breakaway_only_keeps_standing() {
        let mut motor =
            drive_train("{traction: {dead_band_m_s: 0.05, breakaway_m_s: 0.1, gain: 0.9}}");
        assert_eq!(traction_after(1, &mut motor, 0.08), 0.0);
        assert!((traction_after(1, &mut motor, -0.1) + 0.09).abs() < 1e-12);
        assert!((traction_after(1, &mut motor, -0.06) + 0.054).abs() < 1e-12);
        assert_eq!(traction_after(1, &mut motor, -0.04), 0.0);
        assert_eq!(traction_after(1, &mut motor, -0.06), 0.0);
    }

    #[test]
    fn a_schedule_changes_what_it_names_from_its_time_on() {
        let mut motor = drive_train(
            "{traction: {speed_max_m_s: 0.5, gain: 0.8},
              schedule: [{from_s: 0.1, traction: {speed_max_m_s: 0.3}}, {from_s: 0.2, steer: {gain: 0.5}}]}",
        );
        assert_eq!(traction_after(10, &mut motor, 1.0), 0.5);
        assert_eq!(traction_after(1, &mut motor, 1.0), 0.3);
        assert_eq!(traction_after(9, &mut motor, 0.25), 0.2);
        assert_eq!(motor.step(motors(1.0, 1.0)), motors(0.3, 0.5));
    }

    #[test]
    fn a_battery_weakens_to_a_fifth_of_the_speed() {
        let mut motor = drive_train("{traction: {speed_max_m_s: 0.5}, battery_fall_per_s: 0.1}");
        assert_eq!(traction_after(1, &mut motor, 1.0), 0.5);
        assert!((traction_after(300, &mut motor, 1.0) - 0.35).abs() < 1e-12);
        assert!((traction_after(2000, &mut motor, 1.0) - 0.1).abs() < 1e-12);
        // A slow command is obeyed by a weak motor as well.
        assert_eq!(traction_after(1, &mut motor, 0.05), 0.05);
    }

    #[test]
    fn a_smoother_ramps_and_its_dead_band_hides_the_beginning_of_the_ramp() {
        let mut slow = drive_train("{smoother: {acceleration_m_s2: 2, dead_band_m_s: 0.05}}");
        assert_eq!(traction_after(2, &mut slow, 1.0), 0.0);
        assert!((traction_after(1, &mut slow, 1.0) - 0.06).abs() < 1e-12);
        assert!((traction_after(7, &mut slow, 1.0) - 0.2).abs() < 1e-12);
        assert!((traction_after(5, &mut slow, 0.0) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_collision_monitor_scales_both_within_its_times() {
        let mut slow = drive_train(
            "{collision_monitor: [{from_s: 0.02, to_s: 0.05, slowdown_ratio: 0.5},
                                  {from_s: 0.04, to_s: 0.06, slowdown_ratio: 0}]}",
        );
        let shares: Vec<_> = (0..7).map(|_| slow.step(motors(1.0, -0.4))).collect();
        let expected = [1.0, 1.0, 0.5, 0.5, 0.0, 0.0, 1.0].map(|share| motors(share, -0.4 * share));
        assert_eq!(shares, expected);
    }

    #[test]
    fn brakes_hold_what_stands_and_release_with_the_next_command() {
        let mut motor = drive_train("{traction: {time_constant_s: 0.1}, brakes: true}");
        assert_eq!(motor.step(MotorSpeeds::STOP), MotorSpeeds::STOP);
        assert!(motor.is_braked());
        assert!(traction_after(30, &mut motor, 0.5) > 0.4 && !motor.is_braked());
        // 0.5 e^-t/T is above 1 mm/s for 6.2 time constants, and never zero without brakes.
        assert!(traction_after(60, &mut motor, 0.0) > 0.0 && !motor.is_braked());
        assert_eq!(traction_after(10, &mut motor, 0.0), 0.0);
        assert!(motor.is_braked());
        assert!(!drive_train("{}").is_braked());
    }

    proptest! {
        #[test]
        fn limits_hold_for_any_commands(commands in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64), 1..80)) {
            let mut limited = drive_train(
                "{traction: {speed_max_m_s: 1, acceleration_max_m_s2: 20, deceleration_max_m_s2: 50, time_constant_s: 0.02},
                  steer: {speed_max_m_s: 0.8, acceleration_max_m_s2: 10}, tread_speed_max_m_s: 1.2}");
            let mut before = MotorSpeeds::STOP;
            for (traction, steer) in commands {
                let now = limited.step(motors(traction, steer));
                prop_assert!(now.traction_m_s.abs() <= 1.0 && now.steer_m_s.abs() <= 0.8);
                prop_assert!(now.traction_m_s.abs() + now.steer_m_s.abs() <= 1.2 + 1e-12);
                prop_assert!(now.steer_m_s.abs() - before.steer_m_s.abs() <= 0.1 + 1e-12);
                prop_assert!(now.traction_m_s.abs() - before.traction_m_s.abs() <= 0.2 + 1e-12);
                before = now;
            }
        }

        #[test]
        fn both_directions_are_alike(commands in prop::collection::vec((-2.0..2.0f64, -2.0..2.0f64), 1..50)) {
            let yaml = "{traction: {acceleration_max_m_s2: 5, time_constant_s: 0.1}, steer: {deceleration_max_m_s2: 7},
                         tread_speed_max_m_s: 1.5, delay_s: 0.02}";
            let (mut one, mut other) = (drive_train(yaml), drive_train(yaml));
            for (traction, steer) in commands {
                let (a, b) = (one.step(motors(traction, steer)), other.step(motors(-traction, -steer)));
                prop_assert_eq!((a.traction_m_s, a.steer_m_s), (-b.traction_m_s, -b.steer_m_s));
            }
        }
    }
}
