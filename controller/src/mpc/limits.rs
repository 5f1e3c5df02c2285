//! Bounds on the two motor speeds and on how fast they may change.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::speeds::MotorSpeeds;

/// Limits of one motor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorLimits {
    /// Largest absolute speed.
    pub speed_m_s: f64,
    /// Largest acceleration away from standstill.
    pub acceleration_m_s2: f64,
    /// Largest deceleration towards standstill.
    pub deceleration_m_s2: f64,
}

impl MotorLimits {
    /// Returns the largest fall and rise of a motor's speed within `time_s` from `speed_m_s`.
    ///
    /// Moving towards standstill is a deceleration; what is left of the time after it has been
    /// reached is an acceleration to the other side.
    pub fn change(&self, speed_m_s: f64, time_s: f64) -> Change {
        let away = self.acceleration_m_s2 * time_s;
        let speed = speed_m_s.abs();
        let time_to_stop = speed / self.deceleration_m_s2;
        let towards = if time_to_stop >= time_s {
            self.deceleration_m_s2 * time_s
        } else {
            speed + self.acceleration_m_s2 * (time_s - time_to_stop)
        };
        if speed_m_s >= 0.0 {
            Change {
                fall: towards,
                rise: away,
            }
        } else {
            Change {
                fall: away,
                rise: towards,
            }
        }
    }

    /// Returns the speed nearest to `wanted_m_s` that the motor can have `time_s` after `from_m_s`.
    pub fn project(&self, wanted_m_s: f64, from_m_s: f64, time_s: f64) -> f64 {
        let change = self.change(from_m_s, time_s);
        wanted_m_s.clamp(from_m_s - change.fall, from_m_s + change.rise)
    }
}

/// How far a speed may fall and rise, m/s, both positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Largest fall, m/s.
    pub fall: f64,
    /// Largest rise, m/s.
    pub rise: f64,
}

/// Limits of the vehicle's inputs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputLimits {
    /// [Traction motor](#motor-limits).
    pub traction: MotorLimits,
    /// [Steer motor](#motor-limits).
    pub steer: MotorLimits,
    /// Largest absolute speed of a tread.
    pub tread_speed_m_s: f64,
}

impl InputLimits {
    /// Checks that every limit is finite and positive.
    ///
    /// # Errors
    /// [`RangeError`] with the key of the first limit that is not.
    pub fn validate(&self) -> Result<(), RangeError> {
        let check = |key, value| Bounds::new(1e-3, 100.0, "").check(key, value).map(|_| ());
        check("limits.traction.speed_m_s", self.traction.speed_m_s)?;
        check(
            "limits.traction.acceleration_m_s2",
            self.traction.acceleration_m_s2,
        )?;
        check(
            "limits.traction.deceleration_m_s2",
            self.traction.deceleration_m_s2,
        )?;
        check("limits.steer.speed_m_s", self.steer.speed_m_s)?;
        check(
            "limits.steer.acceleration_m_s2",
            self.steer.acceleration_m_s2,
        )?;
        check(
            "limits.steer.deceleration_m_s2",
            self.steer.deceleration_m_s2,
        )?;
        check("limits.tread_speed_m_s", self.tread_speed_m_s)
    }

    /// Returns whether the motors' own limits already keep each tread within its limit.
    pub fn treads_follow_from_motors(&self) -> bool {
        self.traction.speed_m_s + self.steer.speed_m_s <= self.tread_speed_m_s
    }

    /// Returns the speeds nearest to `wanted` within the motors' and treads' bounds.
    ///
    /// Where a tread would be too fast the traction gives way: steering keeps the path.
    pub fn within_bounds(&self, wanted: MotorSpeeds) -> MotorSpeeds {
        let steer_max = self.steer.speed_m_s.min(self.tread_speed_m_s);
        let steer_m_s = wanted.steer_m_s.clamp(-steer_max, steer_max);
        let traction_max = self
            .traction
            .speed_m_s
            .min(self.tread_speed_m_s - steer_m_s.abs());
        MotorSpeeds {
            traction_m_s: wanted.traction_m_s.clamp(-traction_max, traction_max),
            steer_m_s,
        }
    }

    /// Returns the speeds nearest to `wanted` within bounds and rates, `time_s` after `from`.
    ///
    /// Rates come last, so that no motor gets a step command. From within the bounds both hold:
    /// where a tread would be too fast because traction cannot give way so quickly, steer waits.
    pub fn project(&self, wanted: MotorSpeeds, from: MotorSpeeds, time_s: f64) -> MotorSpeeds {
        let bounded = self.within_bounds(wanted);
        let within = |speed: f64, room: f64| speed.clamp(-room.max(0.0), room.max(0.0));
        let slowest = self.traction.project(0.0, from.traction_m_s, time_s);
        let steer_room = self.tread_speed_m_s - slowest.abs();
        let steer_m_s = self.steer.project(
            within(bounded.steer_m_s, steer_room),
            from.steer_m_s,
            time_s,
        );
        let traction_room = self.tread_speed_m_s - steer_m_s.abs();
        MotorSpeeds {
            traction_m_s: self.traction.project(
                within(bounded.traction_m_s, traction_room),
                from.traction_m_s,
                time_s,
            ),
            steer_m_s,
        }
    }

    /// Returns the next speeds of a stop at the configured decelerations.
    pub fn stop_step(&self, from: MotorSpeeds, time_s: f64) -> MotorSpeeds {
        let towards_zero = |speed: f64, deceleration: f64| {
            speed.signum() * (speed.abs() - deceleration * time_s).max(0.0)
        };
        MotorSpeeds {
            traction_m_s: towards_zero(from.traction_m_s, self.traction.deceleration_m_s2),
            steer_m_s: towards_zero(from.steer_m_s, self.steer.deceleration_m_s2),
        }
    }
}
