//! Datagrams of RTPS, to a participant of the patched RustDDS that has matched another: it must take one after the
//! other, whatever is in them. The first byte of an input chooses the port; what follows are the submessages behind a
//! header of the peer, whose GUID prefix stands in them as twelve letters P, and the participant's own as twelve S.
#![no_main]
use libfuzzer_sys::fuzz_target;
use rustdds::no_key::{DataReader, DataWriter};
use rustdds::policy::{History, Reliability};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, Duration, QosPolicyBuilder, RTPSEntity, TopicKind,
};
use rustix::time::{ClockId, clock_gettime};
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::Mutex;

type Text = String;

/// A participant with an endpoint of each kind on a topic each way.
struct Participant {
    participant: DomainParticipant,
    reader: DataReader<Text>,
    writer: DataWriter<Text>,
}

impl Participant {
    fn new(domain: u16, reads: &str, writes: &str) -> Self {
        let built = DomainParticipantBuilder::new(domain)
            .with_only_networks([Ipv4Addr::LOCALHOST])
            .build();
        let participant = built.expect("a participant");
        let reliable = Reliability::Reliable {
            max_blocking_time: Duration::from_millis(100),
        };
        let qos = QosPolicyBuilder::new()
            .reliability(reliable)
            .history(History::KeepLast { depth: 10 })
            .build();
        let topic = |name: &str| {
            participant
                .create_topic(name.to_owned(), "Text".to_owned(), &qos, TopicKind::NoKey)
                .expect("a topic")
        };
        let subscriber = participant.create_subscriber(&qos).expect("a subscriber");
        let publisher = participant.create_publisher(&qos).expect("a publisher");
        let reader = subscriber
            .create_datareader_no_key_cdr(&topic(reads), None)
            .expect("a reader");
        let writer = publisher
            .create_datawriter_no_key_cdr(&topic(writes), None)
            .expect("a writer");
        Self {
            participant,
            reader,
            writer,
        }
    }

    fn prefix(&self) -> [u8; 12] {
        let bytes = self.participant.guid().to_bytes();
        bytes[..12].try_into().expect("a GUID has 16 bytes")
    }
}

struct Session {
    subject: Participant,
    peer: Participant,
    socket: UdpSocket,
    ports: [u16; 2],
    taken: u32,
}

/// Inputs after which both participants are made anew.
const INPUTS: u32 = 20_000;

impl Session {
    fn new() -> Self {
        // Workers beside each other have domains of their own.
        let domain = 40 + (std::process::id() % 60) as u16;
        let mut both = [("there", "back"), ("back", "there")]
            .map(|(reads, writes)| Participant::new(domain, reads, writes));
        let mut heard = [false; 2];
        let begun = std::time::Instant::now();
        while heard != [true; 2] {
            assert!(
                begun.elapsed().as_secs() < 30,
                "the participants have not found each other"
            );
            for (one, heard) in both.iter_mut().zip(&mut heard) {
                let _ = one.writer.write("hello".to_owned(), None);
                *heard |= one
                    .reader
                    .take_next_sample()
                    .is_ok_and(|sample| sample.is_some());
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        let [subject, peer] = both;
        let first = 7410 + 250 * domain + 2 * subject.participant.participant_id();
        Self {
            subject,
            peer,
            socket: UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket"),
            ports: [first, first + 1],
            taken: 0,
        }
    }

    fn send(&mut self, data: &[u8]) {
        let Some((port, submessages)) = data.split_first() else {
            return;
        };
        let mut datagram = b"RTPS\x02\x04\x01\x12".to_vec();
        datagram.extend(self.peer.prefix());
        datagram.extend(submessages);
        for (letters, prefix) in [
            (b"PPPPPPPPPPPP", self.peer.prefix()),
            (b"SSSSSSSSSSSS", self.subject.prefix()),
        ] {
            while let Some(at) = datagram.windows(12).position(|window| window == letters) {
                datagram[at..at + 12].copy_from_slice(&prefix);
            }
        }
        let port = self.ports[usize::from(port % 2)];
        let _ = self.socket.send_to(&datagram, (Ipv4Addr::LOCALHOST, port));
        if self.taken % 16 == 0 {
            // Makes both sides exchange heartbeats and acknowledgements in between.
            let text = "x".repeat(self.taken as usize % 3000);
            let _ = self.subject.writer.write(text.clone(), None);
            let _ = self.peer.writer.write(text, None);
        }
        self.taken += 1;
        self.wait();
    }

    /// Waits until the participant has taken what was sent; time that other programs take does not count.
    fn wait(&self) {
        let used_s = || {
            let now = clock_gettime(ClockId::ProcessCPUTime);
            now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
        };
        let begun_s = used_s();
        while any_waits(&self.ports) {
            assert!(used_s() - begun_s < 2.0, "datagrams are not taken any more");
            std::thread::yield_now();
        }
    }
}

/// Returns whether datagrams wait at one of two ports. To read the list takes half of the time of an input.
fn any_waits(ports: &[u16; 2]) -> bool {
    let sockets = std::fs::read_to_string("/proc/net/udp").expect("sockets");
    let ends = ports.map(|port| format!(":{port:04X}"));
    sockets.lines().any(|line| {
        let mut fields = line.split_ascii_whitespace().skip(1);
        let is_one = |local: &str| ends.iter().any(|end| local.ends_with(end));
        let here = fields.next().is_some_and(is_one);
        here && fields
            .nth(2)
            .is_some_and(|queues| !queues.ends_with(":00000000"))
    })
}

static SESSION: Mutex<Option<Session>> = Mutex::new(None);

fuzz_target!(|data: &[u8]| {
    let mut session = SESSION.lock().expect("no panic before");
    if session
        .as_ref()
        .is_some_and(|session| session.taken >= INPUTS)
    {
        *session = None;
    }
    session.get_or_insert_with(Session::new).send(data);
});
