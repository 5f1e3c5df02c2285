//! The emergency stop as all who may press it have it: a rover says at every report that it is not
//! pressed, while an operator presses it once.

use crate::safety::StopCause;
use ros2_client::Gid;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Longest wait for the first word of a writer. RustDDS gets what Fast DDS said earlier after 3 to 5 s.
const FIRST_WORD: Duration = Duration::from_secs(6);

/// What a writer last said.
#[derive(Debug, Clone, Copy)]
struct Word {
    pressed: bool,
    at: Instant,
    /// Whether the writer has left the graph since.
    left: bool,
}

/// The last word of each writer. It is pressed as long as one of them says so; one that has pressed it
/// and left is answered for by whoever speaks first after it.
#[derive(Debug, Default)]
pub(super) struct EmergencyStop {
    words: BTreeMap<Gid, Word>,
    /// Writers that keep their last word for newcomers and have not been heard, since when.
    awaited: BTreeMap<Gid, Instant>,
}

impl EmergencyStop {
    /// Takes that there is a writer which keeps its last word for newcomers.
    pub(super) fn expect(&mut self, writer: Gid, now: Instant) {
        if !self.words.contains_key(&writer) {
            self.awaited.entry(writer).or_insert(now);
        }
    }

    /// Returns whether a writer may have pressed it whose first word is still on its way.
    pub(super) fn is_awaited(&self, now: Instant) -> bool {
        self.awaited
            .values()
            .any(|since| now.duration_since(*since) < FIRST_WORD)
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
        let gone = gone.to_bytes16();
        let whole_participant = gone[12..] == [0; 4];
        let left = |writer: &Gid| {
            let writer = writer.to_bytes16();
            writer == gone || (whole_participant && writer[..12] == gone[..12])
        };
        self.awaited.retain(|writer, _| !left(writer));
        self.words.retain(|writer, word| {
            word.left |= left(writer);
            word.pressed || !word.left
        });
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
            stop.take(writer(1, 1), false, Instant::now());
            assert_eq!(stop.cause(Duration::ZERO), PRESSED);
            stop.take(writer(3, 1), false, Instant::now());
            assert_eq!(stop.cause(Duration::ZERO), None);
        }
    }

    #[test]
    fn the_first_word_of_a_latched_writer_is_awaited_for_a_time() {
        let now = Instant::now();
        let mut stop = EmergencyStop::default();
        assert!(!stop.is_awaited(now));
        for (who, gone) in [(writer(1, 1), writer(1, 1)), (writer(2, 1), participant(2))] {
            stop.expect(who, now);
            assert!(stop.is_awaited(now));
            stop.leave(gone);
            assert!(!stop.is_awaited(now));
        }
        let latched = writer(3, 1);
        stop.expect(latched, now);
        // Told of it once more, it is not waited for anew.
        stop.expect(latched, now + FIRST_WORD / 2);
        assert!(stop.is_awaited(now + FIRST_WORD * 9 / 10));
        assert!(!stop.is_awaited(now + FIRST_WORD));
        stop.take(latched, false, now);
        stop.expect(latched, now);
        assert!(!stop.is_awaited(now));
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
