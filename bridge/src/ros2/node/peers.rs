//! The clients of services: whether one can receive its answer yet, and which have left the graph.
//!
//! A request may arrive before this node has discovered the client's reply reader; an answer sent then is
//! lost, and the client waits for ever. So a request is held until that reader is matched, for at most a
//! second.

use ros2_client::dds::rustdds::{DomainParticipantStatusEvent as Event, GUID};
use ros2_client::error::ReadResult;
use ros2_client::request_id::RmwRequestId;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::{Duration, Instant};

/// The part of a GUID that a participant shares with its requests under every middleware; Cyclone fills the
/// rest of a request's GUID differently.
pub type Participant = [u8; 8];

/// Longest time a request is held.
const HELD: Duration = Duration::from_secs(1);
/// Messages that cannot be read and are skipped in one call.
const UNREADABLE_MAX: usize = 100;

/// Returns the participant that has sent a request.
pub fn participant(request: &RmwRequestId) -> Participant {
    let bytes = request.writer_gid.to_bytes16();
    std::array::from_fn(|index| bytes[index])
}

fn participant_of(guid: &GUID) -> Participant {
    let bytes = guid.to_bytes();
    std::array::from_fn(|index| bytes[index])
}

/// The remote readers that this node's writers have matched.
#[derive(Debug, Default)]
pub struct Peers {
    /// Topics of the discovered readers.
    readers: BTreeMap<GUID, String>,
    matched: BTreeSet<GUID>,
}

impl Peers {
    /// Takes a discovery event, and returns who has left, if anybody: a reader with its topic, or a whole
    /// participant without one.
    pub fn take(&mut self, event: Event) -> Option<(Participant, Option<String>)> {
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

    /// Returns whether a client receives what is written to a topic.
    fn matches(&self, client: Participant, topic: &str) -> bool {
        self.matched.iter().any(|guid| {
            participant_of(guid) == client
                && self.readers.get(guid).is_some_and(|name| name == topic)
        })
    }
}

/// The requests of a service, held until their client can receive the answer.
pub struct Requests<Q> {
    reply_topic: String,
    held: VecDeque<(Instant, RmwRequestId, Q)>,
}

impl<Q> Requests<Q> {
    /// Returns the requests of the service of this fully qualified name.
    pub fn of(service: &str) -> Self {
        Self {
            reply_topic: format!("rr{service}Reply"),
            held: VecDeque::new(),
        }
    }

    /// Takes what `receive` returns, and returns a request whose client can receive the answer.
    pub fn next(
        &mut self,
        peers: &Peers,
        mut receive: impl FnMut() -> ReadResult<Option<(RmwRequestId, Q)>>,
    ) -> Option<(RmwRequestId, Q)> {
        let mut unreadable = 0;
        loop {
            match receive() {
                Ok(Some((id, request))) => self.held.push_back((Instant::now(), id, request)),
                Ok(None) => break,
                // A message of another type or version; skip it.
                Err(_) if unreadable < UNREADABLE_MAX => unreadable += 1,
                Err(_) => break,
            }
        }
        let index = self.held.iter().position(|(since, id, _)| {
            since.elapsed() >= HELD || peers.matches(participant(id), &self.reply_topic)
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
    fn a_request_is_held_until_its_client_has_a_reader() {
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
        assert_eq!(next(&peers), Some("one"), "held no longer than this");
    }

    #[test]
    fn a_peer_that_leaves_is_reported() {
        let mut peers = Peers::default();
        matched(&mut peers, 5, "rr/addReply");
        assert!(peers.matches([5; 8], "rr/addReply"));
        let reason = ros2_client::dds::rustdds::LostReason::Disposed;
        let left = peers.take(Event::ReaderLost {
            guid: guid(5, 7),
            reason: reason.clone(),
        });
        assert_eq!(left, Some(([5; 8], Some("rr/addReply".to_owned()))));
        assert!(!peers.matches([5; 8], "rr/addReply"));
        let id = guid(6, 0).prefix;
        let left = peers.take(Event::ParticipantLost { id, reason });
        assert_eq!(left, Some(([6; 8], None)));
    }
}
