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

/// Who has sent a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClientId {
    participant: Participant,
    /// The reader of the replies, by which Fast DDS names a client. Cyclone identifies it by its own number.
    reply_reader: Option<GUID>,
}

/// Who has left the graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Left {
    /// A reader of a topic.
    Reader(GUID, String),
    /// All that begins with this.
    Participant([u8; 12]),
}

impl ClientId {
    /// Returns a client of which only the participant is known.
    pub const fn of_participant(participant: Participant) -> Self {
        Self {
            participant,
            reply_reader: None,
        }
    }

    /// Returns whether the client is among those that have left. Where it is not known by its own reader, it
    /// is when its participant loses a reader of `topic`, which every client has.
    pub fn has_left(&self, left: &Left, topic: &str) -> bool {
        match (left, self.reply_reader) {
            (Left::Reader(guid, _), Some(own)) => *guid == own,
            (Left::Reader(guid, lost), None) => {
                participant_of(guid) == self.participant && lost == topic
            }
            (Left::Participant(prefix), Some(own)) => own.to_bytes().starts_with(prefix),
            (Left::Participant(prefix), None) => prefix.starts_with(&self.participant),
        }
    }
}

/// Returns the participant that has sent a request.
fn participant(request: &RmwRequestId) -> Participant {
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
    /// Takes a discovery event, and returns the peer that has left, if any.
    pub fn take(&mut self, event: Event) -> Option<Left> {
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
                Some(Left::Reader(guid, topic))
            }
            Event::ParticipantLost { id, .. } => {
                let left = |guid: &GUID| guid.prefix == id;
                self.matched.retain(|guid| !left(guid));
                self.readers.retain(|guid, _| !left(guid));
                let bytes: &[u8] = id.as_ref();
                let prefix = std::array::from_fn(|index| bytes[index]);
                Some(Left::Participant(prefix))
            }
            _ => None,
        }
    }

    /// Returns the sender of a request.
    pub fn client(&self, request: &RmwRequestId) -> ClientId {
        let named = GUID::from(request.writer_gid);
        ClientId {
            participant: participant(request),
            reply_reader: self.readers.contains_key(&named).then_some(named),
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
    unreadable: bool,
}

impl<Q> Requests<Q> {
    /// Returns the requests of the service of this fully qualified name.
    pub fn of(service: &str) -> Self {
        Self {
            reply_topic: format!("rr{service}Reply"),
            held: VecDeque::new(),
            unreadable: false,
        }
    }

    /// Returns whether a request could not be read since the last call.
    pub fn take_unreadable(&mut self) -> bool {
        std::mem::take(&mut self.unreadable)
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
        self.unreadable |= unreadable > 0;
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
        assert!(!requests.take_unreadable());
        let mut once = Some(ros2_client::error::ReadError::Deserialization {
            reason: "it is of another type".to_owned(),
        });
        let none: Option<(RmwRequestId, &str)> =
            requests.next(&peers, || once.take().map_or(Ok(None), Err));
        assert!(none.is_none() && requests.take_unreadable() && !requests.take_unreadable());
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
        assert_eq!(
            left,
            Some(Left::Reader(guid(5, 7), "rr/addReply".to_owned()))
        );
        assert!(!peers.matches([5; 8], "rr/addReply"));
        let id = guid(6, 0).prefix;
        let left = peers.take(Event::ParticipantLost { id, reason });
        assert_eq!(left, Some(Left::Participant([6; 12])));
    }

    #[test]
    fn a_client_is_told_from_another_of_its_participant_by_its_reader() {
        let mut peers = Peers::default();
        matched(&mut peers, 5, "rr/addReply");
        let named_by = |entity| RmwRequestId {
            writer_gid: Gid::from(guid(5, entity)),
            sequence_number: 1,
        };
        // Fast DDS names the reader, Cyclone does not.
        let (by_reader, by_number) = (peers.client(&named_by(7)), peers.client(&named_by(3)));
        let other = Left::Reader(guid(5, 8), "rr/addReply".to_owned());
        assert!(!by_reader.has_left(&other, "rr/addReply"));
        assert!(by_number.has_left(&other, "rr/addReply"));
        assert!(!by_number.has_left(&other, "rr/otherReply"));
        let own = Left::Reader(guid(5, 7), "rr/addReply".to_owned());
        assert!(by_reader.has_left(&own, "rr/otherReply"));
        let mut prefix = [5; 12];
        assert!(by_reader.has_left(&Left::Participant(prefix), ""));
        // Another participant of the same process begins alike.
        prefix[11] = 6;
        assert!(!by_reader.has_left(&Left::Participant(prefix), ""));
        assert!(by_number.has_left(&Left::Participant(prefix), ""));
    }
}
