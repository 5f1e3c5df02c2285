//! The rate at which a motor gains speed, where that is less than it is told to have.

/// Factor on the rate at which a motor is seen to gain speed that gives its limit, so that this does not sink with noise.
const MARGIN: f64 = 1.2;
/// Time for which a motor is far behind its command before that counts, s.
const BEHIND_S: f64 = 0.4;
/// Least rate that counts, m/s^2: a motor that gains less is at its largest speed, or held by friction.
const LEAST_M_S2: f64 = 0.1;
/// Time constant of the rate, s.
const SMOOTHING_S: f64 = 0.2;
/// Growth of that rate, m/s^3, from which on it is that of a lag, which has yet to come up to its largest.
const RISING_M_S3: f64 = 0.5;
/// Growth of a limit while the motor is near its command, 1/s.
const RECOVERY_PER_S: f64 = 0.05;

/// Largest rate at which a motor was seen to gain speed on a long way to its command.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rate {
    configured_m_s2: f64,
    limit_m_s2: f64,
    /// Smoothed rate at which it gains speed, m/s^2.
    gained_m_s2: f64,
    /// Time for which it has been far behind its command, s.
    behind_s: f64,
}

impl Rate {
    pub(super) fn new(configured_m_s2: f64) -> Self {
        Self {
            configured_m_s2,
            limit_m_s2: configured_m_s2,
            gained_m_s2: 0.0,
            behind_s: 0.0,
        }
    }

    /// Returns the largest rate as known now, m/s^2; at most the one configured.
    pub(super) fn limit_m_s2(&self) -> f64 {
        self.limit_m_s2
    }

    /// Returns whether it is less than the one configured.
    pub(super) fn is_learned(&self) -> bool {
        self.limit_m_s2 < self.configured_m_s2
    }

    /// Forgets what was learned.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.configured_m_s2);
    }

    /// Takes the rate at which a motor has gained speed, and whether it is far behind a command that asks for more.
    pub(super) fn observe(&mut self, gained_m_s2: f64, behind: bool, elapsed_s: f64) {
        let before_m_s2 = self.gained_m_s2;
        let gain = (elapsed_s / SMOOTHING_S).min(1.0);
        self.gained_m_s2 += gain * (gained_m_s2 - self.gained_m_s2);
        if !behind {
            self.behind_s = 0.0;
            self.limit_m_s2 *= 1.0 + RECOVERY_PER_S * elapsed_s;
        } else {
            self.behind_s += elapsed_s;
            let found_m_s2 = MARGIN * self.gained_m_s2;
            let rises = self.gained_m_s2 - before_m_s2 > RISING_M_S3 * elapsed_s;
            let gains = self.gained_m_s2 > LEAST_M_S2;
            if found_m_s2 > self.limit_m_s2 || (self.behind_s > BEHIND_S && gains && !rises) {
                self.limit_m_s2 = found_m_s2;
            }
        }
        self.limit_m_s2 = self.limit_m_s2.min(self.configured_m_s2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE_S: f64 = 0.05;
    const TOLD_M_S2: f64 = 2.0;

    /// Returns the limits, cycle by cycle, of a motor that gains speed as `gained_m_s2` has it, behind its command.
    fn limits_m_s2(rate: &mut Rate, gained_m_s2: impl Fn(f64) -> f64, duration_s: f64) -> Vec<f64> {
        let cycles = (duration_s / CYCLE_S).round() as u32;
        let limit_after = |cycle: u32| {
            rate.observe(gained_m_s2(CYCLE_S * f64::from(cycle)), true, CYCLE_S);
            rate.limit_m_s2()
        };
        (0..cycles).map(limit_after).collect()
    }

    #[test]
    fn a_motor_that_gains_speed_slower_than_told_has_a_limit_in_a_second() {
        for slow_m_s2 in [0.15, 0.4, 1.0] {
            let mut rate = Rate::new(TOLD_M_S2);
            let limits = limits_m_s2(&mut rate, |_| slow_m_s2, 2.0);
            // It counts once the motor has been behind for a while.
            assert!(limits[..8].iter().all(|limit| *limit == TOLD_M_S2));
            assert!((limits[20] / slow_m_s2 - 1.2).abs() < 0.05, "{limits:?}");
            assert!(rate.is_learned());
        }
    }

    #[test]
    fn a_motor_that_does_as_told_or_hardly_moves_has_no_limit() {
        for gained_m_s2 in [1.8, 2.0, 0.09, 0.0, -1.0] {
            let mut rate = Rate::new(TOLD_M_S2);
            limits_m_s2(&mut rate, |_| gained_m_s2, 3.0);
            assert!(!rate.is_learned(), "{gained_m_s2}");
        }
    }

    #[test]
    fn a_rate_that_rises_is_that_of_a_lag() {
        let mut rate = Rate::new(TOLD_M_S2);
        limits_m_s2(&mut rate, |time_s| 0.8 * time_s, 1.5);
        assert!(!rate.is_learned());
        limits_m_s2(&mut rate, |_| 1.2, 1.0);
        assert!((rate.limit_m_s2() - 1.44).abs() < 0.05, "{rate:?}");
    }

    #[test]
    fn a_limit_rises_with_the_rate_at_once_and_slowly_while_the_motor_obeys() {
        let mut rate = Rate::new(TOLD_M_S2);
        limits_m_s2(&mut rate, |_| 0.4, 2.0);
        let slow = rate;
        let limits = limits_m_s2(&mut rate, |_| 0.8, 0.6);
        assert!(limits.is_sorted() && limits[11] > 0.9, "{limits:?}");
        rate = slow;
        for _ in 0..200 {
            rate.observe(0.0, false, CYCLE_S);
        }
        let grown = rate.limit_m_s2() / slow.limit_m_s2();
        assert!((grown - 0.5_f64.exp()).abs() < 0.01, "{grown}");
        for _ in 0..2000 {
            rate.observe(0.0, false, CYCLE_S);
        }
        assert!(!rate.is_learned());
    }
}
