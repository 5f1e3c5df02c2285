//! The emergency stop as its publishers send it: a rover repeats that it is not pressed, while an operator
//! sends one message when pressing it.

use ros2_client::Gid;
use sidehill_bridge::safety::StopCause;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Longest wait for the first message of a new publisher. What Fast DDS sends before RustDDS has matched it
/// arrives 3 to 5 s late, together with what it sends meanwhile.
const FIRST_MESSAGE: Duration = Duration::from_secs(6);
/// How long a vehicle drives on without the first message of a new publisher.
const FIRST_MESSAGE_DRIVING: Duration = Duration::from_millis(250);

/// The last message of a publisher.
#[derive(Debug, Clone, Copy)]
struct LastMessage {
    /// Its number among the publisher's.
    sequence: i64,
    pressed: bool,
    at: Instant,
    /// The publisher has left the graph since.
    lost: bool,
}

/// The last message of each publisher. The stop is pressed while any of them says so. If the publisher that
/// pressed it leaves, the stop holds until a new publisher sends false. A publisher that leaves before its
/// first message has arrived counts as having pressed it, as `ros2 topic pub --once` may have.
#[derive(Debug, Default)]
pub(crate) struct EmergencyStopMonitor {
    last: BTreeMap<Gid, LastMessage>,
    /// Publishers without a message so far, and when they were discovered.
    silent: BTreeMap<Gid, Instant>,
    /// Publishers that have left, until all earlier messages have been taken.
    lost: Vec<Gid>,
}

impl EmergencyStopMonitor {
    /// Takes that a publisher was discovered.
    pub(crate) fn publisher_discovered(&mut self, publisher: Gid, now: Instant) {
        if !self.last.contains_key(&publisher) {
            self.silent.entry(publisher).or_insert(now);
        }
    }

    /// Returns whether the first message of a new publisher, which may press the stop, is still awaited. A
    /// moving vehicle continues for a moment.
    pub(crate) fn awaits_first_message(&self, now: Instant, driving: bool) -> bool {
        let grace = if driving {
            FIRST_MESSAGE_DRIVING
        } else {
            Duration::ZERO
        };
        let waited = |since: &Instant| now.duration_since(*since);
        self.silent
            .values()
            .any(|since| (grace..FIRST_MESSAGE).contains(&waited(since)))
    }

    /// Takes a message, which is the publisher's by number. More than one subscription hears it: only what is
    /// newer than the last counts.
    pub(crate) fn received(
        &mut self,
        (publisher, sequence): (Gid, i64),
        pressed: bool,
        at: Instant,
    ) {
        self.silent.remove(&publisher);
        let last = self.last.get(&publisher);
        if last.is_some_and(|last| last.sequence >= sequence) {
            return;
        }
        let message = LastMessage {
            sequence,
            pressed,
            at,
            lost: false,
        };
        // A publisher that was there before does not release what another has pressed.
        let is_new = self.last.insert(publisher, message).is_none();
        if is_new && !pressed {
            self.last.retain(|_, message| !message.lost);
        }
    }

    /// Takes that a publisher has left, or all publishers of a participant, whose GUID ends in zeros.
    pub(crate) fn publisher_lost(&mut self, lost: Gid) {
        self.lost.push(lost);
    }

    /// Removes the publishers that have left; to be called when all messages that have arrived are taken.
    pub(crate) fn process_lost(&mut self, now: Instant) {
        for lost in std::mem::take(&mut self.lost) {
            let lost = lost.to_bytes16();
            let whole_participant = lost[12..] == [0; 4];
            let is_lost = |publisher: &Gid| {
                let publisher = publisher.to_bytes16();
                publisher == lost || (whole_participant && publisher[..12] == lost[..12])
            };
            let last = &mut self.last;
            self.silent.retain(|publisher, since| {
                if is_lost(publisher) && now.duration_since(*since) < FIRST_MESSAGE {
                    let pressed = LastMessage {
                        sequence: i64::MIN,
                        pressed: true,
                        at: now,
                        lost: true,
                    };
                    last.insert(*publisher, pressed);
                }
                !is_lost(publisher)
            });
            last.retain(|publisher, message| {
                message.lost |= is_lost(publisher);
                message.pressed || !message.lost
            });
        }
    }

    /// Returns whether it is pressed, or no publisher has sent anything for `timeout`; a zero timeout is
    /// none.
    pub(crate) fn cause(&self, timeout: Duration) -> Option<StopCause> {
        if self.last.values().any(|message| message.pressed) {
            return Some(StopCause::EmergencyStop);
        }
        let expired = |message: &LastMessage| message.at.elapsed() > timeout;
        let silent = !timeout.is_zero() && self.last.values().all(expired);
        silent.then_some(StopCause::EmergencyStopSilent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn publisher(participant: u8, entity: u8) -> Gid {
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
    fn a_publisher_does_not_release_what_another_has_pressed() {
        let (rover, operator) = (publisher(1, 1), publisher(2, 1));
        let mut stop = EmergencyStopMonitor::default();
        assert_eq!(stop.cause(Duration::ZERO), None);
        for (message, pressed, expected) in [
            ((rover, 1), false, false),
            ((operator, 1), true, true),
            ((rover, 2), false, true),
            ((operator, 2), false, false),
        ] {
            stop.received(message, pressed, Instant::now());
            assert_eq!(stop.cause(Duration::ZERO).is_some(), expected);
        }
    }

    /// Of a reliable publisher the best-effort subscription may hear a message before the reliable one hears those
    /// before it.
    #[test]
    fn the_newest_message_counts_whichever_subscription_hears_it_first() {
        let mut stop = EmergencyStopMonitor::default();
        for (sequence, pressed) in [(1, false), (3, true), (1, false), (2, false), (3, true)] {
            stop.received((publisher(1, 1), sequence), pressed, Instant::now());
        }
        assert_eq!(stop.cause(Duration::ZERO), PRESSED);
        stop.received((publisher(1, 1), 4), false, Instant::now());
        assert_eq!(stop.cause(Duration::ZERO), None);
    }

    #[test]
    fn a_stop_outlives_its_publisher_until_a_new_one_releases_it() {
        for gone in [publisher(2, 1), participant(2)] {
            let mut stop = EmergencyStopMonitor::default();
            stop.received((publisher(1, 1), 1), false, Instant::now());
            stop.received((publisher(2, 1), 1), true, Instant::now());
            stop.publisher_lost(gone);
            stop.process_lost(Instant::now());
            stop.received((publisher(1, 1), 2), false, Instant::now());
            assert_eq!(stop.cause(Duration::ZERO), PRESSED);
            stop.received((publisher(3, 1), 1), false, Instant::now());
            assert_eq!(stop.cause(Duration::ZERO), None);
        }
    }

    #[test]
    fn the_first_word_of_a_writer_awaits_first_message_for_a_time() {
        let now = Instant::now();
        let mut stop = EmergencyStopMonitor::default();
        assert!(!stop.awaits_first_message(now, false));
        let newcomer = publisher(3, 1);
        stop.publisher_discovered(newcomer, now);
        assert!(stop.awaits_first_message(now, false) && !stop.awaits_first_message(now, true));
        assert!(stop.awaits_first_message(now + FIRST_MESSAGE_DRIVING, true));
        // A second discovery does not restart the wait.
        stop.publisher_discovered(newcomer, now + FIRST_MESSAGE / 2);
        assert!(stop.awaits_first_message(now + FIRST_MESSAGE * 9 / 10, false));
        assert!(!stop.awaits_first_message(now + FIRST_MESSAGE, false));
        assert!(!stop.awaits_first_message(now + FIRST_MESSAGE, true));
        stop.received((newcomer, 1), false, now);
        stop.publisher_discovered(newcomer, now);
        assert!(!stop.awaits_first_message(now, false));
    }

    #[test]
    fn a_publisher_that_leaves_before_its_first_message_counts_as_pressed() {
        let now = Instant::now();
        for gone in [publisher(2, 1), participant(2)] {
            let mut stop = EmergencyStopMonitor::default();
            stop.publisher_discovered(publisher(2, 1), now);
            stop.publisher_lost(gone);
            stop.process_lost(now + FIRST_MESSAGE / 2);
            assert_eq!(stop.cause(Duration::ZERO), PRESSED);
            stop.received((publisher(3, 1), 1), false, now);
            assert_eq!(stop.cause(Duration::ZERO), None);
            // A publisher that was there for long has sent nothing; one that was received counts as received.
            stop.publisher_discovered(publisher(2, 1), now);
            stop.publisher_lost(gone);
            stop.process_lost(now + FIRST_MESSAGE);
            assert_eq!(stop.cause(Duration::ZERO), None);
            stop.publisher_discovered(publisher(2, 1), now);
            stop.publisher_lost(gone);
            stop.received((publisher(2, 1), 1), false, now);
            stop.process_lost(now);
            assert_eq!(stop.cause(Duration::ZERO), None);
        }
    }

    #[test]
    fn silence_counts_with_a_timeout() {
        let timeout = Duration::from_millis(20);
        let mut stop = EmergencyStopMonitor::default();
        // Nothing has been published yet.
        assert_eq!(stop.cause(timeout), SILENT);
        stop.received((publisher(1, 1), 1), false, Instant::now());
        assert_eq!(stop.cause(timeout), None);
        std::thread::sleep(Duration::from_millis(30));
        assert_eq!(stop.cause(timeout), SILENT);
        assert_eq!(stop.cause(Duration::ZERO), None);
    }
}
