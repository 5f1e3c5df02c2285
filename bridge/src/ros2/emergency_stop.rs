//! The emergency stop as all who may press it have it: a rover says at every report that it is not
//! pressed, while an operator presses it once.

use crate::safety::StopCause;
use ros2_client::Gid;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Longest wait for the first word of a writer. What Fast DDS says before RustDDS has matched it comes 3
/// to 5 s late, and what it says meanwhile with it.
const FIRST_WORD: Duration = Duration::from_secs(6);
/// Wait for the first word of a writer while the vehicle drives.
const FIRST_WORD_DRIVING: Duration = Duration::from_millis(250);

/// What a writer last said.
#[derive(Debug, Clone, Copy)]
struct Word {
    pressed: bool,
    at: Instant,
    /// Whether the writer has left the graph since.
    left: bool,
}

/// The last word of each writer. It is pressed as long as one of them says so; one that has pressed it
/// and left is answered for by whoever speaks first after it. One that comes and soon leaves without
/// having been heard is taken to have pressed it: `ros2 topic pub --once` is such a writer.
#[derive(Debug, Default)]
pub(super) struct EmergencyStop {
    words: BTreeMap<Gid, Word>,
    /// Writers that have not been heard, since when.
    awaited: BTreeMap<Gid, Instant>,
    /// Who has left, until all that came before has been taken.
    gone: Vec<Gid>,
}

impl EmergencyStop {
    /// Takes that there is a writer.
    pub(super) fn expect(&mut self, writer: Gid, now: Instant) {
        if !self.words.contains_key(&writer) {
            self.awaited.entry(writer).or_insert(now);
        }
    }

    /// Returns whether a writer may have pressed it whose first word is still on its way: none is armed
    /// for. A vehicle that drives goes on for a moment.
    pub(super) fn is_awaited(&self, now: Instant, driving: bool) -> bool {
        let at_least = if driving {
            FIRST_WORD_DRIVING
        } else {
            Duration::ZERO
        };
        let waited = |since: &Instant| now.duration_since(*since);
        self.awaited
            .values()
            .any(|since| (at_least..FIRST_WORD).contains(&waited(since)))
    }

    /// Takes a word.
    pub(super) fn take(&mut self, writer: Gid, pressed: bool, at: Instant) {
        self.awaited.remove(&writer);
        let word = Word {
            pressed,
            at,
            left: false,
        };
        // One that has spoken all the time does not release what another has pressed.
        let newcomer = self.words.insert(writer, word).is_none();
        if newcomer && !pressed {
            self.words.retain(|_, word| !word.left);
        }
    }

    /// Takes that a writer has left, or every writer of a participant, whose name ends in zeros.
    pub(super) fn leave(&mut self, gone: Gid) {
        self.gone.push(gone);
    }

    /// Says that all that had come has been taken.
    pub(super) fn settle(&mut self, now: Instant) {
        for gone in std::mem::take(&mut self.gone) {
            let gone = gone.to_bytes16();
            let whole_participant = gone[12..] == [0; 4];
            let left = |writer: &Gid| {
                let writer = writer.to_bytes16();
                writer == gone || (whole_participant && writer[..12] == gone[..12])
            };
            let words = &mut self.words;
            self.awaited.retain(|writer, since| {
                let unheard = left(writer) && now.duration_since(*since) < FIRST_WORD;
                if unheard {
                    let word = Word {
                        pressed: true,
                        at: now,
                        left: true,
                    };
                    words.insert(*writer, word);
                }
                !left(writer)
            });
            words.retain(|writer, word| {
                word.left |= left(writer);
                word.pressed || !word.left
            });
        }
    }

    /// Returns whether it is pressed, or nobody has said anything for `timeout`; a zero timeout is
    /// none.
    pub(super) fn cause(&self, timeout: Duration) -> Option<StopCause> {
        if self.words.values().any(|word| word.pressed) {
            return Some(StopCause::EmergencyStop);
        }
        let silent = || self.words.values().all(|word| word.at.elapsed() > timeout);
        (!timeout.is_zero() && silent()).then_some(StopCause::EmergencyStopSilent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn writer(participant: u8, entity: u8) -> Gid {
        let mut bytes = [participant; 16];
        bytes[12..].copy_from_slice(&[0, 0, entity, 3]);
        Gid::from(bytes)
    }

    fn participant(participant: u8) -> Gid {
        let mut bytes = [participant; 16];
        bytes[12..].copy_from_slice(&[0; 4]);
        Gid::from(bytes)
    }

    const PRESSED: Option<StopCause> = Some(StopCause::EmergencyStop);
    const SILENT: Option<StopCause> = Some(StopCause::EmergencyStopSilent);

    #[test]
    fn one_who_presses_is_not_overruled_by_another() {
        let (rover, operator) = (writer(1, 1), writer(2, 1));
        let mut stop = EmergencyStop::default();
        assert_eq!(stop.cause(Duration::ZERO), None);
        for (who, pressed, expected) in [
            (rover, false, false),
            (operator, true, true),
            (rover, false, true),
            (operator, false, false),
        ] {
            stop.take(who, pressed, Instant::now());
            assert_eq!(stop.cause(Duration::ZERO).is_some(), expected);
        }
    }

    #[test]
    fn a_stop_outlives_who_pressed_it_until_somebody_releases_it() {
        for gone in [writer(2, 1), participant(2)] {
            let mut stop = EmergencyStop::default();
            stop.take(writer(1, 1), false, Instant::now());
            stop.take(writer(2, 1), true, Instant::now());
            stop.leave(gone);
            stop.settle(Instant::now());
            stop.take(writer(1, 1), false, Instant::now());
            assert_eq!(stop.cause(Duration::ZERO), PRESSED);
            stop.take(writer(3, 1), false, Instant::now());
            assert_eq!(stop.cause(Duration::ZERO), None);
        }
    }

    #[test]
    fn the_first_word_of_a_writer_is_awaited_for_a_time() {
        let now = Instant::now();
        let mut stop = EmergencyStop::default();
        assert!(!stop.is_awaited(now, false));
        let newcomer = writer(3, 1);
        stop.expect(newcomer, now);
        assert!(stop.is_awaited(now, false) && !stop.is_awaited(now, true));
        assert!(stop.is_awaited(now + FIRST_WORD_DRIVING, true));
        // Told of it once more, it is not waited for anew.
        stop.expect(newcomer, now + FIRST_WORD / 2);
        assert!(stop.is_awaited(now + FIRST_WORD * 9 / 10, false));
        assert!(!stop.is_awaited(now + FIRST_WORD, false));
        assert!(!stop.is_awaited(now + FIRST_WORD, true));
        stop.take(newcomer, false, now);
        stop.expect(newcomer, now);
        assert!(!stop.is_awaited(now, false));
    }

    #[test]
    fn who_comes_and_leaves_without_being_heard_is_taken_to_have_pressed_it() {
        let now = Instant::now();
        for gone in [writer(2, 1), participant(2)] {
            let mut stop = EmergencyStop::default();
            stop.expect(writer(2, 1), now);
            stop.leave(gone);
            stop.settle(now + FIRST_WORD / 2);
            assert_eq!(stop.cause(Duration::ZERO), PRESSED);
            stop.take(writer(3, 1), false, now);
            assert_eq!(stop.cause(Duration::ZERO), None);
            // One that was there for long had said nothing, and one that was heard has said what it said.
            stop.expect(writer(2, 1), now);
            stop.leave(gone);
            stop.settle(now + FIRST_WORD);
            assert_eq!(stop.cause(Duration::ZERO), None);
            stop.expect(writer(2, 1), now);
            stop.leave(gone);
            stop.take(writer(2, 1), false, now);
            stop.settle(now);
            assert_eq!(stop.cause(Duration::ZERO), None);
        }
    }

    #[test]
    fn silence_counts_where_it_is_told_to() {
        let timeout = Duration::from_millis(20);
        let mut stop = EmergencyStop::default();
        // Nobody has said anything yet.
        assert_eq!(stop.cause(timeout), SILENT);
        stop.take(writer(1, 1), false, Instant::now());
        assert_eq!(stop.cause(timeout), None);
        std::thread::sleep(Duration::from_millis(30));
        assert_eq!(stop.cause(timeout), SILENT);
        assert_eq!(stop.cause(Duration::ZERO), None);
    }
}
