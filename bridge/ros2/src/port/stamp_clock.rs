//! The clock by which a publisher stamps its messages, which may be set while the vehicle drives.

use ros2_client::Gid;

/// How far a stamp may be ahead of the clock without meaning anything, s.
pub(crate) const AHEAD_S: f64 = 0.1;
/// A step of system time that is a jump, s; a smaller one is followed.
pub(crate) const SYSTEM_JUMP_S: f64 = 0.5;
/// Largest step of a publisher's clock that is made up for, s.
pub(crate) const STEP_MAX_S: f64 = 0.5;

/// Finds steps of the clock by which the publisher of a topic stamps its messages.
///
/// A clock that is ahead shows in stamps from the future. A clock that is set back shows in a stamp before that of
/// the message before, although the message comes after it: a message that was held up has a later stamp.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct StampClock {
    publisher: Option<Gid>,
    /// Stamp and arrival of the last message, s.
    last_s: Option<(f64, f64)>,
    /// What is added to its stamps, s.
    offset_s: f64,
}

/// A stamp in the time of this computer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corrected {
    /// The time, no later than now, s.
    pub(crate) time_s: f64,
    /// What is added to stamps from now on, where that has changed, s.
    pub(crate) changed_to_s: Option<f64>,
}

impl StampClock {
    /// Returns the time of a stamp in a message that arrives at `now_s`.
    ///
    /// # Errors
    /// By how much the stamp is ahead of the clock, s, where that is too much.
    pub(crate) fn correct(
        &mut self,
        publisher: Gid,
        stamp_s: f64,
        now_s: f64,
    ) -> Result<Corrected, f64> {
        let mut next = match self.publisher == Some(publisher) {
            true => *self,
            false => Self {
                publisher: Some(publisher),
                ..Self::default()
            },
        };
        if let Some((last_stamp_s, last_now_s)) = next.last_s {
            let step_s = (last_stamp_s - stamp_s) + (now_s - last_now_s);
            if stamp_s < last_stamp_s && (AHEAD_S..=STEP_MAX_S).contains(&step_s) {
                next.offset_s += step_s;
            }
        }
        let ahead_s = stamp_s + next.offset_s - now_s;
        if ahead_s > AHEAD_S {
            next.offset_s -= ahead_s;
        }
        if next.offset_s < -STEP_MAX_S {
            return Err(ahead_s);
        }
        next.offset_s = next.offset_s.min(STEP_MAX_S);
        next.last_s = Some((stamp_s, now_s));
        let changed = (next.offset_s - self.offset_s).abs() >= AHEAD_S;
        *self = next;
        Ok(Corrected {
            time_s: (stamp_s + next.offset_s).min(now_s),
            changed_to_s: changed.then_some(next.offset_s),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ages of messages every 50 ms whose stamps are 5 ms old and `step_s` off in the messages 20 to 39.
    fn ages(step_s: f64) -> Vec<Option<f64>> {
        let mut clock = StampClock::default();
        (0..60)
            .map(|index| {
                let now_s = 0.05 * f64::from(index);
                let step_s = if (20..40).contains(&index) {
                    step_s
                } else {
                    0.0
                };
                let corrected = clock.correct(Gid::from([1; 16]), now_s - 0.005 + step_s, now_s);
                corrected.ok().map(|corrected| now_s - corrected.time_s)
            })
            .collect()
    }

    #[test]
    fn a_step_of_up_to_half_a_second_ages_nothing() {
        for step_s in [-0.45, -0.3, -0.15, 0.15, 0.3, 0.45] {
            for (index, age_s) in ages(step_s).into_iter().enumerate() {
                let age_s = age_s.unwrap();
                assert!((0.0..0.06).contains(&age_s), "{step_s}, {index}: {age_s}");
            }
        }
    }

    #[test]
    fn a_longer_step_is_seen_while_it_lasts() {
        let back = ages(-3.0);
        assert!(back[20..40].iter().all(|age_s| age_s.unwrap() > 2.9));
        let ahead = ages(3.0);
        assert!(ahead[20..40].iter().all(Option::is_none));
        for ages in [back, ahead] {
            assert!(ages[40..].iter().all(|age_s| age_s.unwrap() < 0.06));
        }
    }

    #[test]
    fn messages_that_are_held_up_are_as_old_as_they_are() {
        let mut clock = StampClock::default();
        for index in 0..60 {
            let stamp_s = 0.05 * f64::from(index);
            let delay_s = if index < 20 { 0.01 } else { 0.4 };
            let corrected = clock.correct(Gid::from([1; 16]), stamp_s, stamp_s + delay_s);
            assert!((corrected.unwrap().time_s - stamp_s).abs() < 1e-12);
        }
        // So are those of a second publisher.
        for index in 60..100 {
            let now_s = 0.05 * f64::from(index);
            for (publisher, delay_s) in [(1, 0.01), (2, 0.3)] {
                let stamp_s = now_s - delay_s;
                let corrected = clock.correct(Gid::from([publisher; 16]), stamp_s, now_s);
                assert!((corrected.unwrap().time_s - stamp_s).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn one_stamp_that_is_wrong_leaves_no_trace() {
        for wrong_s in [-0.4, -0.2, 0.2, 0.4, 3.0, -3.0] {
            let mut clock = StampClock::default();
            for index in 0..40 {
                let now_s = 0.05 * f64::from(index);
                let off_s = if index == 20 { wrong_s } else { 0.0 };
                let corrected = clock.correct(Gid::from([1; 16]), now_s + off_s, now_s);
                if index > 20 {
                    let age_s = now_s - corrected.unwrap().time_s;
                    assert!((0.0..0.06).contains(&age_s), "{wrong_s}, {index}: {age_s}");
                }
            }
        }
    }
}
