//! Feedback that no longer changes.

/// Detects a drive whose reported speed stays the same to the bit while its command changes.
///
/// The same value again and again is no fault in itself: at a constant speed a coarse encoder reports it for seconds.
/// It is one if the command has been more than [`FrozenWatch::CHANGE_M_S`] away for [`FrozenWatch::TIME_S`] from that at
/// which the speed changed last. So encoders may have steps of nearly that change, and drives may take nearly that time
/// to answer. A vehicle at standstill is not judged: its drives may not break away. Nor is a drive whose command is
/// beyond its speed: it may be at its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrozenWatch {
    /// Reported speed, and the command when it changed last, m/s.
    speed_m_s: f64,
    command_m_s: f64,
    /// Since when the command is away from that, s.
    away_since_s: Option<f64>,
}

impl FrozenWatch {
    /// Change of the command that must show in the reported speed, m/s.
    pub const CHANGE_M_S: f64 = 0.03;
    /// Time in which it must show, s.
    pub const TIME_S: f64 = 0.5;
    /// Speed up to which a drive may stand, m/s.
    const STANDSTILL_M_S: f64 = 0.02;

    /// Returns a watch that has seen nothing.
    pub fn new() -> Self {
        Self {
            speed_m_s: f64::NAN,
            command_m_s: 0.0,
            away_since_s: None,
        }
    }

    /// Takes the command and the newest reported speed of a drive that is on, m/s, and returns whether the report is
    /// frozen.
    pub fn is_frozen(&mut self, now_s: f64, command_m_s: f64, speed_m_s: f64) -> bool {
        let same = speed_m_s.to_bits() == self.speed_m_s.to_bits();
        if !same || speed_m_s.abs() <= Self::STANDSTILL_M_S {
            *self = Self {
                speed_m_s,
                command_m_s,
                away_since_s: None,
            };
            return false;
        }
        let beyond = command_m_s * speed_m_s > 0.0 && command_m_s.abs() > speed_m_s.abs();
        if beyond || (command_m_s - self.command_m_s).abs() <= Self::CHANGE_M_S {
            self.away_since_s = None;
            return false;
        }
        now_s - *self.away_since_s.get_or_insert(now_s) >= Self::TIME_S
    }
}

impl Default for FrozenWatch {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE_S: f64 = 0.05;

    /// Returns when a report is found frozen, s, if it is within 30 s.
    fn found_s(
        mut command: impl FnMut(f64) -> f64,
        mut speed: impl FnMut(f64) -> f64,
    ) -> Option<f64> {
        let mut watch = FrozenWatch::new();
        (0..600).find_map(|cycle| {
            let now_s = CYCLE_S * f64::from(cycle);
            let frozen = watch.is_frozen(now_s, command(now_s), speed(now_s));
            frozen.then_some(now_s)
        })
    }

    #[test]
    fn a_report_that_stays_while_the_command_changes_is_found_in_time() {
        for rate_m_s2 in [-2.0, -0.1, -0.05] {
            let command = |now_s: f64| 0.6 + rate_m_s2 * (now_s - 2.0).max(0.0);
            let found_s = found_s(command, |_| 0.6).unwrap();
            let limit_s = 2.0 + FrozenWatch::CHANGE_M_S / f64::abs(rate_m_s2) + FrozenWatch::TIME_S;
            assert!(
                (limit_s - CYCLE_S..limit_s + 2.0 * CYCLE_S).contains(&found_s),
                "{found_s}"
            );
        }
        // So is one that freezes in the middle of a curve.
        let curve = |now_s: f64| 0.3 + 0.1 * (0.4 * now_s).sin();
        let found_s = found_s(curve, |now_s| curve(now_s.min(5.0))).unwrap();
        // 0.03 m/s from sin(2) at 6.217 s.
        assert!((6.71..6.8).contains(&found_s), "{found_s}");
    }

    #[test]
    fn steady_speeds_coarse_encoders_slow_drives_and_standing_ones_are_not() {
        assert_eq!(found_s(|_| 0.65, |_| 0.65), None);
        // Jitter of the command that a coarse encoder does not show.
        let jitter = |now_s: f64| 0.65 + 0.02 * (7.0 * now_s).sin();
        assert_eq!(found_s(jitter, |_| 0.65), None);
        // Steps of 0.025 m/s, 0.3 s late.
        let curve = |now_s: f64| 0.3 + 0.2 * (0.3 * now_s).sin();
        let coarse = |now_s: f64| (curve(now_s - 0.3) / 0.025).round() * 0.025;
        assert_eq!(found_s(curve, coarse), None);
        // It is at its limit, or weak.
        assert_eq!(
            found_s(|now_s| 0.5 + 0.1 * (0.3 * now_s).sin().abs(), |_| 0.5),
            None
        );
        // It does not break away. That it differs from its command is judged by the safety.
        assert_eq!(found_s(|now_s| 0.02 * now_s, |_| 0.0), None);
    }
}
