//! How much faster or slower than commanded a motor is at all speeds: a base that was told another wheel separation, or
//! a scale of commands that is wrong.
//!
//! A motor at its largest speed is slower than commanded as well. Both are compared over all readings of a motor that
//! had the time to follow: speeds that are a share of the command, and speeds that are the command or, where the motor
//! is short of it, all the same.

use super::scale::is_short;

/// Time over which readings are remembered, s.
const MEMORY_S: f64 = 20.0;
/// Factors on the misfit of a gain below which it counts, and above which it counts no more.
const BETTER: f64 = 4.0;
const NO_BETTER: f64 = 2.0;
/// Difference of speeds that always may be noise, m/s, and time of which that much must be explained, s.
const NOISE_M_S: f64 = 0.005;
const EVIDENCE_S: f64 = 4.0;
/// Weight of readings from before what slows commands down has changed.
const DOUBTED: f64 = 0.1;
/// Gains that are believed.
const GAIN_MIN: f64 = 0.4;
const GAIN_MAX: f64 = 2.5;

/// What was seen of a motor beside its commands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gain {
    /// Least gain that is believed.
    least: f64,
    sums: Integrals,
    known: bool,
}

/// Integrals over time, which fade.
#[derive(Debug, Clone, Copy, Default)]
struct Integrals {
    time_s: f64,
    /// Of the squares of speed and command and of their product, m^2/s.
    speed_speed: f64,
    command_command: f64,
    speed_command: f64,
    /// Of the square of what the speed of a motor that is not short differs from its command, m^2/s.
    differs: f64,
    /// Time, speed, m, and its square, m^2/s, of a motor that is short.
    short_s: f64,
    short_speed: f64,
    short_speed_speed: f64,
}

impl Integrals {
    /// Returns these integrals less what fades, and `seen`.
    fn with(&self, share: f64, seen: &Self) -> Self {
        Self {
            time_s: share * self.time_s + seen.time_s,
            speed_speed: share * self.speed_speed + seen.speed_speed,
            command_command: share * self.command_command + seen.command_command,
            speed_command: share * self.speed_command + seen.speed_command,
            differs: share * self.differs + seen.differs,
            short_s: share * self.short_s + seen.short_s,
            short_speed: share * self.short_speed + seen.short_speed,
            short_speed_speed: share * self.short_speed_speed + seen.short_speed_speed,
        }
    }

    /// Returns the integrals of one reading.
    fn of(speed: f64, command: f64, time_s: f64) -> Self {
        let all = Self {
            time_s,
            speed_speed: time_s * speed * speed,
            command_command: time_s * command * command,
            speed_command: time_s * speed * command,
            ..Self::default()
        };
        if is_short(speed, command) {
            Self {
                short_s: time_s,
                short_speed: time_s * speed,
                short_speed_speed: time_s * speed * speed,
                ..all
            }
        } else {
            Self {
                differs: time_s * (speed - command).powi(2),
                ..all
            }
        }
    }

    fn gain(&self) -> f64 {
        self.speed_command / self.command_command
    }

    /// Returns what noise may leave unexplained, m^2/s.
    fn noise(&self) -> f64 {
        NOISE_M_S * NOISE_M_S * (self.time_s + EVIDENCE_S)
    }

    /// Returns what a gain leaves unexplained, m^2/s.
    fn misfit_of_gain(&self) -> f64 {
        self.speed_speed - self.gain() * self.speed_command
    }

    /// Returns what a largest speed leaves unexplained, m^2/s.
    fn misfit_of_limit(&self) -> f64 {
        let at_limit = match self.short_s > 0.0 {
            true => self.short_speed_speed - self.short_speed.powi(2) / self.short_s,
            false => 0.0,
        };
        self.differs + at_limit
    }
}

impl Default for Gain {
    fn default() -> Self {
        Self::at_least(GAIN_MIN)
    }
}

impl Gain {
    /// Returns a gain that is 1 until more is known, and is never less than `least`.
    pub(super) fn at_least(least: f64) -> Self {
        Self {
            least,
            sums: Integrals::default(),
            known: false,
        }
    }

    /// Returns speed over command, where it is known to differ from 1.
    pub(super) fn value(&self) -> f64 {
        if self.known {
            self.sums.gain().clamp(self.least, GAIN_MAX)
        } else {
            1.0
        }
    }

    /// Returns whether the motor is known to be at its largest speed.
    pub(super) fn is_limited(&self) -> bool {
        let (gain, limit) = (self.sums.misfit_of_gain(), self.sums.misfit_of_limit());
        gain > BETTER * limit + self.sums.noise()
    }

    /// Lets what was seen until now count little.
    pub(super) fn doubt(&mut self) {
        self.sums = self.sums.with(DOUBTED, &Integrals::default());
    }

    /// Takes speed and command of a motor that had the time to follow, positive m/s.
    pub(super) fn observe(&mut self, speed: f64, command: f64, elapsed_s: f64) {
        let fade = (1.0 - elapsed_s / MEMORY_S).max(0.0);
        self.sums = self
            .sums
            .with(fade, &Integrals::of(speed, command, elapsed_s));
        let (gain, limit) = (self.sums.misfit_of_gain(), self.sums.misfit_of_limit());
        if limit > BETTER * gain + self.sums.noise() {
            self.known = true;
        } else if limit < NO_BETTER * gain {
            self.known = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE_S: f64 = 0.05;

    /// Takes speeds and commands, each for a time.
    fn observed(gain: &mut Gain, seen: &[(f64, f64)], duration_s: f64) {
        for &(speed, command) in seen {
            for _ in 0..(duration_s / CYCLE_S).round() as u32 {
                gain.observe(speed, command, CYCLE_S);
            }
        }
    }

    #[test]
    fn the_better_explanation_counts_and_neither_of_commands_that_were_all_alike() {
        for (seen, value, limited) in [
            (&[(0.2, 0.4)][..], 1.0, false),
            (&[(0.2, 0.4), (0.1, 0.2)], 0.5, false),
            (&[(0.2, 0.4), (0.2, 0.6)], 1.0, true),
            (&[(0.2, 0.4), (0.2, 0.2)], 1.0, true),
            // More than is commanded is no limit.
            (&[(0.3, 0.2)], 1.5, false),
            // A gain that noise explains, too.
            (&[(0.21, 0.2), (0.11, 0.1)], 1.0, false),
            (&[(0.9, 0.3)], GAIN_MAX, false),
            (&[(0.04, 0.4), (0.06, 0.6)], GAIN_MIN, false),
        ] {
            let mut gain = Gain::default();
            observed(&mut gain, seen, 1.0);
            assert!((gain.value() - value).abs() < 0.01, "{seen:?}: {gain:?}");
            assert_eq!(gain.is_limited(), limited, "{seen:?}");
        }
        let mut faster = Gain::at_least(1.0);
        observed(&mut faster, &[(0.2, 0.4), (0.1, 0.2)], 1.0);
        assert_eq!(faster.value(), 1.0);
    }

    #[test]
    fn a_single_reading_tells_nothing() {
        for (speed, command) in [(0.05, 0.09), (0.09, 0.05)] {
            let mut gain = Gain::default();
            gain.observe(speed, command, CYCLE_S);
            assert_eq!((gain.value(), gain.is_limited()), (1.0, false));
        }
    }

    #[test]
    fn a_gain_is_known_until_a_largest_speed_explains_half_as_much() {
        let mut gain = Gain::default();
        observed(&mut gain, &[(0.2, 0.4), (0.1, 0.2)], 4.0);
        observed(&mut gain, &[(0.28, 0.4)], 1.0);
        assert!((0.5..0.6).contains(&gain.value()), "{gain:?}");
        observed(&mut gain, &[(0.4, 0.4), (0.2, 0.2)], 20.0);
        assert_eq!(gain.value(), 1.0);
    }

    #[test]
    fn what_was_seen_before_counts_little_once_it_is_doubted() {
        for (doubted, least, most) in [(false, 0.72, 0.78), (true, 0.52, 0.58)] {
            let mut gain = Gain::default();
            observed(&mut gain, &[(0.6, 0.6), (0.3, 0.3)], 2.0);
            if doubted {
                gain.doubt();
            }
            observed(&mut gain, &[(0.3, 0.6), (0.15, 0.3)], 2.0);
            let share = gain.sums.gain();
            assert!((least..most).contains(&share), "{doubted}: {share}");
        }
    }
}
