//! From commanded to actual motor speeds: transport delay, limits and lag of the two motors.

use crate::bounds::{Bounds, RangeError};
use crate::speeds::MotorSpeeds;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Limits, lag and delay of both motors; `{}` is an ideal drive train.
///
/// As YAML: `traction` and `steer`, each with `speed_max_m_s`, `acceleration_max_m_s2` (away from
/// zero speed), `deceleration_max_m_s2` (towards it) and `time_constant_s`; `delay_s`, and
/// `tread_speed_max_m_s` for the faster tread. What is absent does not act.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "RawDriveTrain")]
pub struct DriveTrainConfig {
    traction: MotorConfig,
    steer: MotorConfig,
    delay_s: f64,
    tread_speed_max_m_s: Option<f64>,
}

/// What keeps one motor from following its command; everything absent is ideal.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct MotorConfig {
    /// Largest speed in either direction, m/s.
    speed_max_m_s: Option<f64>,
    /// Largest rate of change away from zero speed, m/s^2.
    acceleration_max_m_s2: Option<f64>,
    /// Largest rate of change towards zero speed, m/s^2.
    deceleration_max_m_s2: Option<f64>,
    /// Time constant of the first-order lag, s.
    time_constant_s: Option<f64>,
}

/// The two motors between a command and the treads, advanced in fixed steps.
#[derive(Debug, Clone)]
pub struct DriveTrain {
    traction: Motor,
    steer: Motor,
    tread_speed_max_m_s: f64,
    /// Commands on their way, the oldest in front; its length is the delay in steps.
    in_flight: VecDeque<MotorSpeeds>,
}

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
            traction: Motor::new(&config.traction, dt_s),
            steer: Motor::new(&config.steer, dt_s),
            tread_speed_max_m_s: config.tread_speed_max_m_s.unwrap_or(f64::INFINITY),
            in_flight,
        }
    }

    /// Returns the effective motor speeds at the end of the next step, while which `command` is
    /// given.
    ///
    /// In this order: the command waits for the delay, is cut to each motor's speed and, by one
    /// factor for both, to the treads' speed; each motor follows with its lag within its rates. The
    /// treads' limit then holds for the result too, even at the price of a rate.
    pub fn step(&mut self, command: MotorSpeeds) -> MotorSpeeds {
        self.in_flight.push_back(command);
        let arrived = self.in_flight.pop_front().unwrap_or(command);
        let wanted = self.within_treads(MotorSpeeds {
            traction_m_s: self.traction.within_speed(arrived.traction_m_s),
            steer_m_s: self.steer.within_speed(arrived.steer_m_s),
        });
        let reached = self.within_treads(MotorSpeeds {
            traction_m_s: self.traction.toward(wanted.traction_m_s),
            steer_m_s: self.steer.toward(wanted.steer_m_s),
        });
        self.traction.speed_m_s = reached.traction_m_s;
        self.steer.speed_m_s = reached.steer_m_s;
        reached
    }

    /// The faster tread moves at |tau| + |sigma|.
    fn within_treads(&self, speeds: MotorSpeeds) -> MotorSpeeds {
        let faster_m_s = speeds.traction_m_s.abs() + speeds.steer_m_s.abs();
        if faster_m_s <= self.tread_speed_max_m_s {
            return speeds;
        }
        let share = self.tread_speed_max_m_s / faster_m_s;
        MotorSpeeds {
            traction_m_s: share * speeds.traction_m_s,
            steer_m_s: share * speeds.steer_m_s,
        }
    }
}

#[derive(Debug, Clone)]
struct Motor {
    speed_m_s: f64,
    dt_s: f64,
    speed_max_m_s: f64,
    acceleration_max_m_s2: f64,
    deceleration_max_m_s2: f64,
    /// exp(-dt/T): what is left of a difference after a step, 0 without lag.
    remainder: f64,
}

impl Motor {
    fn new(config: &MotorConfig, dt_s: f64) -> Self {
        Self {
            speed_m_s: 0.0,
            dt_s,
            speed_max_m_s: config.speed_max_m_s.unwrap_or(f64::INFINITY),
            acceleration_max_m_s2: config.acceleration_max_m_s2.unwrap_or(f64::INFINITY),
            deceleration_max_m_s2: config.deceleration_max_m_s2.unwrap_or(f64::INFINITY),
            remainder: config.time_constant_s.map_or(0.0, |t| (-dt_s / t).exp()),
        }
    }

    fn within_speed(&self, wanted_m_s: f64) -> f64 {
        wanted_m_s.clamp(-self.speed_max_m_s, self.speed_max_m_s)
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

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RawDriveTrain {
    traction: MotorConfig,
    steer: MotorConfig,
    delay_s: f64,
    tread_speed_max_m_s: Option<f64>,
}

impl TryFrom<RawDriveTrain> for DriveTrainConfig {
    type Error = RangeError;

    fn try_from(raw: RawDriveTrain) -> Result<Self, RangeError> {
        let speed = |key, value| check_optional(Bounds::new(1e-3, 100.0, "m/s"), key, value);
        let rate = |key, value| check_optional(Bounds::new(1e-3, 1e3, "m/s^2"), key, value);
        let lag = |key, value| check_optional(Bounds::new(1e-3, 60.0, "s"), key, value);
        speed("traction.speed_max_m_s", raw.traction.speed_max_m_s)?;
        speed("steer.speed_max_m_s", raw.steer.speed_max_m_s)?;
        speed("tread_speed_max_m_s", raw.tread_speed_max_m_s)?;
        rate(
            "traction.acceleration_max_m_s2",
            raw.traction.acceleration_max_m_s2,
        )?;
        rate(
            "traction.deceleration_max_m_s2",
            raw.traction.deceleration_max_m_s2,
        )?;
        rate(
            "steer.acceleration_max_m_s2",
            raw.steer.acceleration_max_m_s2,
        )?;
        rate(
            "steer.deceleration_max_m_s2",
            raw.steer.deceleration_max_m_s2,
        )?;
        lag("traction.time_constant_s", raw.traction.time_constant_s)?;
        lag("steer.time_constant_s", raw.steer.time_constant_s)?;
        Bounds::new(0.0, 10.0, "s").check("delay_s", raw.delay_s)?;
        Ok(Self {
            traction: raw.traction,
            steer: raw.steer,
            delay_s: raw.delay_s,
            tread_speed_max_m_s: raw.tread_speed_max_m_s,
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
