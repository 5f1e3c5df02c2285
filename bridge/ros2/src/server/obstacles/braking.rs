//! Stopping distance of the vehicle.

use sidehill_plant::frames::Attitude;

/// Gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.81;
/// Least deceleration that is counted on, m/s^2: where even less would be left, the vehicle creeps.
const DECELERATION_MIN_M_S2: f64 = 0.1;
/// Share of the deceleration that slowing down ahead of an obstacle uses; the stop has all of it.
const APPROACH_SHARE: f64 = 0.4;
/// Speed of the last stretch before the stop, m/s.
const CREEP_M_S: f64 = 0.05;

/// How the vehicle stops, from the rest of the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StoppingSettings {
    /// Deceleration of a controlled stop, m/s^2.
    pub deceleration_m_s2: f64,
    /// Time from an instant at which the costmap is checked until the treads obey a stop, s.
    pub reaction_s: f64,
}

impl StoppingSettings {
    /// Longest time between two checks of the costmap, s, with the wait for the thread that checks it.
    pub const CHECK_S: f64 = 0.08;
}

/// The deceleration that the slope leaves, and the time until it begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Braking {
    deceleration_m_s2: f64,
    reaction_s: f64,
}

impl Braking {
    /// Returns the braking of a vehicle that drives forward or in reverse at an attitude.
    ///
    /// Gravity pulls with g sin(pitch) along and g sin(roll) cos(pitch) across the vehicle. Of the friction
    /// mu g cos(slope) the ground can give, what holds the vehicle across and along the slope is not left
    /// for braking.
    pub(crate) fn on_slope(
        settings: &StoppingSettings,
        friction: f64,
        attitude: &Attitude,
        reverse: bool,
    ) -> Self {
        let (roll_sin, roll_cos) = attitude.roll_rad.sin_cos();
        let (pitch_sin, pitch_cos) = attitude.pitch_rad.sin_cos();
        // Weight over mass along the vehicle's right, forward and down axes, in units of g.
        let (across, ahead, normal) = (roll_sin, -pitch_sin * roll_cos, pitch_cos * roll_cos);
        let downhill = if reverse { -ahead } else { ahead };
        let grip = ((friction * normal).powi(2) - across.powi(2))
            .max(0.0)
            .sqrt();
        let left_m_s2 = GRAVITY_M_S2 * (grip - downhill);
        let deceleration_m_s2 = settings.deceleration_m_s2.min(left_m_s2);
        Self {
            deceleration_m_s2: deceleration_m_s2.max(DECELERATION_MIN_M_S2),
            reaction_s: settings.reaction_s,
        }
    }

    /// Returns the distance within which a vehicle stops from a speed, m.
    pub(crate) fn distance_m(&self, speed_m_s: f64) -> f64 {
        speed_m_s * self.reaction_s + speed_m_s.powi(2) / (2.0 * self.deceleration_m_s2)
    }

    /// Returns how the speed falls towards a stop.
    pub(crate) fn approach(&self) -> ApproachSpeed {
        ApproachSpeed {
            deceleration_m_s2: APPROACH_SHARE * self.deceleration_m_s2,
            reaction_s: self.reaction_s,
        }
    }
}

/// The speed with which a vehicle comes near the place where it has to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ApproachSpeed {
    deceleration_m_s2: f64,
    reaction_s: f64,
}

impl ApproachSpeed {
    /// Returns the largest speed at a distance from the stop, m/s, and at least that of creeping: the v of
    /// d = v t + v^2 / (2 a).
    pub(crate) fn at(&self, distance_m: f64) -> f64 {
        let (a, t) = (self.deceleration_m_s2, self.reaction_s);
        let speed_m_s = a * ((t * t + 2.0 * distance_m.max(0.0) / a).sqrt() - t);
        speed_m_s.max(CREEP_M_S)
    }

    /// Returns the distance from the stop at which a speed is allowed, m.
    pub(crate) fn distance_m(&self, speed_m_s: f64) -> f64 {
        speed_m_s * self.reaction_s + speed_m_s.powi(2) / (2.0 * self.deceleration_m_s2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: StoppingSettings = StoppingSettings {
        deceleration_m_s2: 2.0,
        reaction_s: 0.2,
    };

    fn attitude(roll_deg: f64, pitch_deg: f64) -> Attitude {
        Attitude {
            roll_rad: roll_deg.to_radians(),
            pitch_rad: pitch_deg.to_radians(),
        }
    }

    #[test]
    fn downhill_takes_longer_and_uphill_does_not() {
        let stop_m = |pitch_deg, roll_deg, reverse| {
            Braking::on_slope(&SETTINGS, 0.4, &attitude(roll_deg, pitch_deg), reverse)
                .distance_m(0.8)
        };
        let level_m = stop_m(0.0, 0.0, false);
        assert!((level_m - (0.16 + 0.16)).abs() < 1e-12, "{level_m}");
        // Nose down by 15 deg: 9.81 (0.4 cos - sin) = 1.25 m/s^2 are left.
        let down_m = stop_m(-15.0, 0.0, false);
        assert!((down_m - (0.16 + 0.32 / 1.251)).abs() < 1e-3, "{down_m}");
        assert_eq!(stop_m(15.0, 0.0, true), down_m, "nose up, in reverse");
        assert_eq!(stop_m(15.0, 0.0, false), level_m);
        // Across the slope holding the vehicle takes part of the grip.
        assert!(stop_m(0.0, 21.0, false) > level_m && stop_m(0.0, 15.0, false) == level_m);
        // Nothing is left: the distance is finite and long.
        assert!((stop_m(-30.0, 0.0, false) - 3.36).abs() < 1e-9);
    }

    #[test]
    fn the_approach_ends_creeping_and_leaves_room_for_the_stop() {
        let braking = Braking::on_slope(&SETTINGS, 0.5, &Attitude::LEVEL, false);
        let approach = braking.approach();
        assert_eq!([approach.at(0.0), approach.at(-1.0)], [CREEP_M_S; 2]);
        for speed_m_s in [0.2, 0.5, 0.8] {
            let distance_m = approach.distance_m(speed_m_s);
            assert!((approach.at(distance_m) - speed_m_s).abs() < 1e-12);
            assert!(distance_m > braking.distance_m(speed_m_s));
        }
    }
}
