//! Whether a motor that stays short of its commands is at its largest speed, or something scales its commands down.
//!
//! Speeds at a limit are the same whatever is commanded; speeds that are scaled down are a share of the command. Both
//! are fitted by least squares to what was seen of the motor while it was short, and the better fit counts.

/// Share of a command, and part of it, m/s, by which a motor must stay below it to be short of it.
const SHORT_SHARE: f64 = 0.05;
pub(super) const SHORT_M_S: f64 = 0.02;
/// Time over which readings are remembered, s.
const MEMORY_S: f64 = 10.0;
/// Factor on the misfit of one explanation below which the other one counts.
const BETTER: f64 = 10.0;
/// Difference of speeds that always may be noise, m/s.
const NOISE_M_S: f64 = 0.005;
/// Share by which speeds differ from those that commands scaled down give where that has changed.
const CHANGED: f64 = 0.2;
/// Time for which they differ before that counts: a lag lets them differ for a moment, s.
const CHANGED_S: f64 = 0.5;
/// Time of readings below which none is remembered, s.
const FORGOTTEN_S: f64 = 0.02;

/// Returns whether a speed is less than commanded, both positive m/s.
pub(super) fn is_short(speed_m_s: f64, command_m_s: f64) -> bool {
    command_m_s * (1.0 - SHORT_SHARE) - SHORT_M_S > speed_m_s
}

/// What was seen of a motor that was short of its commands: integrals over time, which fade.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Scale {
    time_s: f64,
    /// Of speed, m, its square and its product with the command, m^2/s, and of the command's square, m^2/s.
    speed: f64,
    speed_speed: f64,
    speed_command: f64,
    command_command: f64,
    /// Time for which speeds differ from the share that was fitted, s.
    changed_s: f64,
    scaled: bool,
    limited: bool,
}

impl Scale {
    /// Returns whether commands are scaled down.
    pub(super) fn is_scaled(&self) -> bool {
        self.scaled
    }

    /// Returns whether the motor is at its largest speed: neither this nor a scale is known of commands that were all
    /// alike.
    pub(super) fn is_limited(&self) -> bool {
        self.limited
    }

    /// Returns the share of commands that the motor follows, where they are scaled down; otherwise 1.
    pub(super) fn share(&self) -> f64 {
        if self.scaled {
            self.fitted_share()
        } else {
            1.0
        }
    }

    fn fitted_share(&self) -> f64 {
        self.speed_command / self.command_command
    }

    /// Takes speed and command of a motor, positive m/s, where it had the time to follow, and whether any motor is faster
    /// than the share of its command that it follows.
    pub(super) fn observe(&mut self, seen: Option<(f64, f64)>, faster: bool, elapsed_s: f64) {
        let differs = faster
            || seen.is_some_and(|(speed, command)| {
                let expected = self.fitted_share() * command;
                (speed - expected).abs() > CHANGED * expected + 2.0 * NOISE_M_S
            });
        self.changed_s = if differs {
            self.changed_s + elapsed_s
        } else {
            0.0
        };
        if self.scaled && self.changed_s > CHANGED_S {
            *self = Self::default();
        }
        let short = seen.filter(|&(speed, command)| is_short(speed, command));
        let fade = (1.0 - elapsed_s / MEMORY_S).max(0.0);
        let (speed, command) = short.unwrap_or_default();
        let seen_s = if short.is_some() { elapsed_s } else { 0.0 };
        for (integral, value) in [
            (&mut self.time_s, 1.0),
            (&mut self.speed, speed),
            (&mut self.speed_speed, speed * speed),
            (&mut self.speed_command, speed * command),
            (&mut self.command_command, command * command),
        ] {
            *integral = fade * *integral + seen_s * value;
        }
        if self.time_s < FORGOTTEN_S {
            *self = Self::default();
            return;
        }
        let limited = self.speed_speed - self.speed * self.speed / self.time_s;
        let scaled = self.speed_speed - self.fitted_share() * self.speed_command;
        let noise = NOISE_M_S * NOISE_M_S * self.time_s;
        self.limited = scaled > BETTER * limited + noise;
        if limited > BETTER * scaled + noise {
            self.scaled = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE_S: f64 = 0.05;

    /// Takes commands, each for a second, and the speeds that are reached of them.
    fn observed(scale: &mut Scale, commands_m_s: &[f64], speed_of: impl Fn(f64) -> f64) {
        for &command in commands_m_s {
            for _ in 0..20 {
                scale.observe(Some((speed_of(command), command)), false, CYCLE_S);
            }
        }
    }

    #[test]
    fn the_better_explanation_counts_and_a_limit_where_neither_is() {
        for (commands_m_s, scaled) in [
            (&[0.8][..], false),
            (&[0.8, 0.8, 0.8, 0.8], false),
            (&[0.8, 0.79], false),
            (&[0.8, 0.7], true),
            (&[0.8, 0.4], true),
        ] {
            let mut scale = Scale::default();
            observed(&mut scale, commands_m_s, |command| 0.5 * command);
            assert_eq!(scale.is_scaled(), scaled, "{commands_m_s:?}");
            let share = if scaled { 0.5 } else { 1.0 };
            assert!((scale.share() - share).abs() < 1e-9, "{commands_m_s:?}");
            scale = Scale::default();
            observed(&mut scale, commands_m_s, |_| 0.3);
            assert!(!scale.is_scaled());
        }
    }

    #[test]
    fn a_scale_is_known_until_the_share_changes_or_the_motor_has_long_obeyed() {
        let mut scaled = Scale::default();
        observed(&mut scaled, &[0.8, 0.4], |command| 0.5 * command);
        let mut scale = scaled;
        observed(&mut scale, &[0.6; 120], |command| 0.5 * command);
        assert!(scale.is_scaled());
        for (share, stays) in [(0.42, true), (0.58, true), (0.3, false), (0.7, false)] {
            let mut scale = scaled;
            observed(&mut scale, &[0.8], |command| share * command);
            assert_eq!(scale.is_scaled(), stays, "{share}");
        }
        // At low speeds noise is more of them.
        observed(&mut scale, &[0.04], |command| 0.5 * command - 0.009);
        assert!(scale.is_scaled());
        for (obeys_s, stays) in [(30.0, true), (50.0, false)] {
            let mut scale = scaled;
            for _ in 0..(obeys_s / CYCLE_S).round() as u32 {
                scale.observe(None, false, CYCLE_S);
            }
            assert_eq!(scale.is_scaled(), stays, "{obeys_s}");
        }
    }

    #[test]
    fn what_is_seen_fades() {
        let mut scale = Scale::default();
        observed(&mut scale, &[0.8], |command| 0.5 * command);
        for _ in 0..800 {
            scale.observe(None, false, CYCLE_S);
        }
        observed(&mut scale, &[0.4], |command| 0.5 * command);
        assert!(!scale.is_scaled(), "{scale:?}");
    }
}
