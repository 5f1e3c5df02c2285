//! The emergency stop as all who may press it have it: a rover says at every report that it is not
//! pressed, while an operator presses it once.

use ros2_client::Gid;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

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
}

impl EmergencyStop {
    /// Takes a word.
    pub(super) fn take(&mut self, writer: Gid, pressed: bool, at: Instant) {
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
        self.words.retain(|writer, word| {
            let writer = writer.to_bytes16();
            let left = writer == gone || (whole_participant && writer[..12] == gone[..12]);
            word.left |= left;
            word.pressed || !word.left
        });
    }

    /// Returns whether it is pressed, or nobody has said anything for `timeout`; a zero timeout is
    /// none.
    pub(super) fn is_pressed(&self, timeout: Duration) -> bool {
        let silent = || self.words.values().all(|word| word.at.elapsed() > timeout);
        self.words.values().any(|word| word.pressed) || (!timeout.is_zero() && silent())
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

    #[test]
    fn one_who_presses_is_not_overruled_by_another() {
        let (rover, operator) = (writer(1, 1), writer(2, 1));
        let mut stop = EmergencyStop::default();
        assert!(!stop.is_pressed(Duration::ZERO));
        for (who, pressed, expected) in [
            (rover, false, false),
            (operator, true, true),
            (rover, false, true),
            (operator, false, false),
        ] {
            stop.take(who, pressed, Instant::now());
            assert_eq!(stop.is_pressed(Duration::ZERO), expected);
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
            assert!(stop.is_pressed(Duration::ZERO));
            stop.take(writer(3, 1), false, Instant::now());
            assert!(!stop.is_pressed(Duration::ZERO));
        }
    }

    #[test]
    fn silence_counts_where_it_is_told_to() {
        let timeout = Duration::from_millis(20);
        let mut stop = EmergencyStop::default();
        assert!(stop.is_pressed(timeout), "nobody has said anything yet");
        stop.take(writer(1, 1), false, Instant::now());
        assert!(!stop.is_pressed(timeout));
        std::thread::sleep(Duration::from_millis(30));
        assert!(stop.is_pressed(timeout));
        assert!(!stop.is_pressed(Duration::ZERO));
    }
}
