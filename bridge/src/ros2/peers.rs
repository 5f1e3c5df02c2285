//! Who else is on the graph, as far as services need it: whether a client hears its answers yet, and
//! which have left.
//!
//! A client's request may arrive before this side has discovered the reader of its replies; an
//! answer sent then is lost, and the client waits for ever. So requests are held until that reader
//! is matched, or for a second.

use ros2_client::dds::rustdds::{DomainParticipantStatusEvent as Event, GUID};
use ros2_client::error::ReadResult;
use ros2_client::request_id::RmwRequestId;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::{Duration, Instant};

/// The part of an endpoint's name that its participant and a request of it share, whatever the
/// middleware: Cyclone's requests name the rest differently.
pub(super) type Participant = [u8; 8];

/// Longest time for which a request is held.
const HELD: Duration = Duration::from_secs(1);
/// Messages that cannot be read, passed over at once.
const UNREADABLE_MAX: usize = 100;

/// Returns the participant that a request comes from.
pub(super) fn participant(request: &RmwRequestId) -> Participant {
    let bytes = request.writer_gid.to_bytes16();
    std::array::from_fn(|index| bytes[index])
}

fn participant_of(guid: &GUID) -> Participant {
    let bytes = guid.to_bytes();
    std::array::from_fn(|index| bytes[index])
}

/// Readers of others that this side's writers have matched.
#[derive(Debug, Default)]
pub(super) struct Peers {
    /// Topics of the readers that have been discovered.
    readers: BTreeMap<GUID, String>,
    matched: BTreeSet<GUID>,
}

impl Peers {
    /// Takes an event of the participant, and returns who has left, if somebody has: the topic of a
    /// reader, or none for a whole participant.
    pub(super) fn take(&mut self, event: Event) -> Option<(Participant, Option<String>)> {
        match event {
            Event::ReaderDetected { reader } => {
                self.readers.insert(reader.guid, reader.topic_name);
                None
            }
            Event::RemoteReaderMatched { remote_reader, .. } => {
                self.matched.insert(remote_reader);
                None
            }
            Event::ReaderLost { guid, .. } => {
                self.matched.remove(&guid);
                let topic = self.readers.remove(&guid)?;
                Some((participant_of(&guid), Some(topic)))
            }
            Event::ParticipantLost { id, .. } => {
                let left = |guid: &GUID| guid.prefix == id;
                self.matched.retain(|guid| !left(guid));
                self.readers.retain(|guid, _| !left(guid));
                let bytes: &[u8] = id.as_ref();
                Some((std::array::from_fn(|index| bytes[index]), None))
            }
            _ => None,
        }
    }

    /// Returns whether a client hears what is written to a topic.
    fn hears(&self, client: Participant, topic: &str) -> bool {
        self.matched.iter().any(|guid| {
            participant_of(guid) == client
                && self.readers.get(guid).is_some_and(|name| name == topic)
        })
    }
}

/// Requests of one service on their way to it.
pub(super) struct Requests<Q> {
    reply_topic: String,
    held: VecDeque<(Instant, RmwRequestId, Q)>,
}

impl<Q> Requests<Q> {
    /// Returns the requests of the service of this whole name.
    pub(super) fn of(service: &str) -> Self {
        Self {
            reply_topic: format!("rr{service}Reply"),
            held: VecDeque::new(),
        }
    }

    /// Takes what `receive` has, and returns a request whose client hears the answer.
    pub(super) fn next(
        &mut self,
        peers: &Peers,
        mut receive: impl FnMut() -> ReadResult<Option<(RmwRequestId, Q)>>,
    ) -> Option<(RmwRequestId, Q)> {
        let mut unreadable = 0;
        loop {
            match receive() {
                Ok(Some((id, request))) => self.held.push_back((Instant::now(), id, request)),
                Ok(None) => break,
                // A message of another type or version; those after it are still there.
                Err(_) if unreadable < UNREADABLE_MAX => unreadable += 1,
                Err(_) => break,
            }
        }
        let index = self.held.iter().position(|(since, id, _)| {
            since.elapsed() >= HELD || peers.hears(participant(id), &self.reply_topic)
        })?;
        self.held
            .remove(index)
            .map(|(_, id, request)| (id, request))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_client::Gid;

    fn guid(participant: u8, entity: u8) -> GUID {
        let mut bytes = [participant; 16];
        bytes[15] = entity;
        GUID::from_bytes(bytes)
    }

    fn request(participant: u8) -> RmwRequestId {
        RmwRequestId {
            writer_gid: Gid::from(guid(participant, 3)),
            sequence_number: 1,
        }
    }

    fn matched(peers: &mut Peers, participant: u8, topic: &str) {
        let remote_reader = guid(participant, 7);
        peers.readers.insert(remote_reader, topic.to_owned());
        let local_writer = guid(0, 1);
        peers.take(Event::RemoteReaderMatched {
            local_writer,
            remote_reader,
        });
    }

    #[test]
    fn a_request_waits_for_the_reader_of_its_own_client() {
        let mut peers = Peers::default();
        let mut requests = Requests::of("/add");
        let mut incoming = vec![(request(1), "one"), (request(2), "two")];
        let mut next = |peers: &Peers| {
            requests
                .next(peers, || Ok(incoming.pop()))
                .map(|(_, request)| request)
        };
        assert_eq!(next(&peers), None);
        matched(&mut peers, 1, "rr/otherReply");
        assert_eq!(next(&peers), None);
        matched(&mut peers, 2, "rr/addReply");
        assert_eq!(next(&peers), Some("two"));
        assert_eq!(next(&peers), None);
        std::thread::sleep(HELD);
        assert_eq!(next(&peers), Some("one"), "held for no longer than that");
    }

    #[test]
    fn who_leaves_is_named() {
        let mut peers = Peers::default();
        matched(&mut peers, 5, "rr/addReply");
        assert!(peers.hears([5; 8], "rr/addReply"));
        let reason = ros2_client::dds::rustdds::LostReason::Disposed;
        let left = peers.take(Event::ReaderLost {
            guid: guid(5, 7),
            reason: reason.clone(),
        });
        assert_eq!(left, Some(([5; 8], Some("rr/addReply".to_owned()))));
        assert!(!peers.hears([5; 8], "rr/addReply"));
        let id = guid(6, 0).prefix;
        let left = peers.take(Event::ParticipantLost { id, reason });
        assert_eq!(left, Some(([6; 8], None)));
    }
}
