//! Topics that the port waits for, their publishers, and why their messages do not arrive.

use ros2_client::dds::rustdds::{DomainParticipantStatusEvent as Event, GUID, QosPolicies};
use sidehill_bridge::drives::{Input, MISSING_AFTER_S};
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

/// Topics of the right type that are named as a hint, at most.
const HINTS_MAX: usize = 5;

/// Time after which all subscriptions of a topic have matched a publisher, or none will.
const MATCHING: Duration = Duration::from_millis(100);

/// What the identifiers of a participant's publishers begin with.
type SeenParticipant = [u8; 12];

/// A topic that is waited for.
#[derive(Debug)]
struct AwaitedTopic {
    /// What it carries.
    input: &'static str,
    /// As the configuration names it.
    configured: String,
    /// Its resolved name, such as `/odom`.
    name: String,
    /// Its type, such as `nav_msgs/msg/Odometry`.
    kind: String,
    /// Whether the vehicle cannot drive without.
    needed: bool,
    /// Whether each of its publishers has to be heard.
    every_publisher: bool,
    accepted: Option<Instant>,
    /// Why messages since the last that was accepted were rejected.
    rejection: Option<String>,
}

/// A publisher on the graph.
#[derive(Debug, Clone, PartialEq)]
struct Publisher {
    topic: String,
    kind: String,
    /// Why a subscription of this node does not match it.
    incompatible: Option<String>,
    matched: bool,
    discovered: Instant,
}

/// The topics that are waited for, and the publishers on the graph.
#[derive(Debug, Default)]
pub(crate) struct GraphMonitor {
    topics: Vec<AwaitedTopic>,
    publishers: BTreeMap<GUID, Publisher>,
    /// Other participants of the domain.
    others: BTreeSet<SeenParticipant>,
    domain: u16,
    own: Option<SeenParticipant>,
}

impl GraphMonitor {
    /// Restarts as the participant `own` of a domain.
    pub(crate) fn begin(&mut self, domain: u16, own: GUID) {
        self.domain = domain;
        self.own = Some(participant(&own));
    }

    /// Adds a topic: what it carries, its name in the configuration and on the graph, its type such as
    /// `nav_msgs/msg/Odometry`, and whether the vehicle cannot drive without.
    pub(crate) fn wait_for(
        &mut self,
        input: &'static str,
        (configured, name): (&str, String),
        kind: String,
        needed: bool,
    ) {
        self.topics.push(AwaitedTopic {
            input,
            configured: configured.to_owned(),
            name,
            kind,
            needed,
            every_publisher: false,
            accepted: None,
            rejection: None,
        });
    }

    /// Notes that each publisher of a topic has to be heard: one may say what no other does.
    pub(crate) fn need_every_publisher(&mut self, configured: &str) {
        for topic in self.topics(configured) {
            topic.every_publisher = true;
        }
    }

    /// Returns why a publisher cannot be heard on a topic of which each has to be.
    pub(crate) fn unheard_publisher(&self) -> Option<String> {
        let topics = self.topics.iter();
        topics
            .filter(|topic| topic.every_publisher)
            .find_map(|topic| Some(format!("{}: {}", topic.name, self.unheard(topic)?)))
    }

    fn unheard(&self, topic: &AwaitedTopic) -> Option<String> {
        let all = self.publishers.values();
        all.filter(|publisher| publisher.topic == topic.name)
            .find_map(|publisher| {
                if publisher.kind != topic.kind {
                    let (kind, needed) = (&publisher.kind, &topic.kind);
                    return Some(format!("it is published as {kind}, must be {needed}"));
                }
                let qos = publisher.incompatible.as_ref()?;
                let settled = publisher.discovered.elapsed() >= MATCHING;
                (settled && !publisher.matched).then(|| format!("incompatible QoS: {qos}"))
            })
    }

    /// Takes a message of a topic, by its name in the configuration, that was used.
    pub(crate) fn accepted(&mut self, configured: &str) {
        for topic in self.topics(configured) {
            topic.accepted = Some(Instant::now());
            topic.rejection = None;
        }
    }

    /// Takes a message of a topic that was rejected.
    pub(crate) fn rejected(&mut self, configured: &str, reason: &str) {
        for topic in self.topics(configured) {
            topic.rejection = Some(reason.to_owned());
        }
    }

    /// A topic may be more than one input: an IMU also of headings. One that is published as another type has no
    /// messages.
    fn topics<'a>(&'a mut self, configured: &'a str) -> impl Iterator<Item = &'a mut AwaitedTopic> {
        let publishers = &self.publishers;
        let published = move |topic: &AwaitedTopic, fits: bool| {
            publishers
                .values()
                .any(|other| other.topic == topic.name && (other.kind == topic.kind) == fits)
        };
        self.topics.iter_mut().filter(move |topic| {
            topic.configured == configured && (published(topic, true) || !published(topic, false))
        })
    }

    fn is_own(&self, guid: &GUID) -> bool {
        self.own == Some(participant(guid))
    }

    /// Takes an event of discovery.
    pub(crate) fn discovered(&mut self, event: &Event) {
        match event {
            Event::ParticipantDiscovered { dpd } if !self.is_own(&dpd.guid) => {
                self.others.insert(participant(&dpd.guid));
            }
            Event::ParticipantLost { id, .. } => {
                self.publishers.retain(|guid, _| guid.prefix != *id);
                let bytes: &[u8] = id.as_ref();
                self.others.retain(|other| other != bytes);
            }
            Event::WriterDetected { writer } if !self.is_own(&writer.guid) => {
                // A topic of ROS: others are services and actions.
                if let Some(topic) = writer.topic_name.strip_prefix("rt/") {
                    let publisher = self.publishers.entry(writer.guid);
                    publisher.or_insert_with(|| Publisher {
                        topic: format!("/{topic}"),
                        kind: ros_type(&writer.type_name),
                        incompatible: None,
                        matched: false,
                        discovered: Instant::now(),
                    });
                }
            }
            Event::WriterLost { guid, .. } => {
                self.publishers.remove(guid);
            }
            Event::RemoteWriterMatched { remote_writer, .. } => {
                if let Some(publisher) = self.publishers.get_mut(remote_writer) {
                    publisher.matched = true;
                }
            }
            Event::RemoteWriterQosIncompatible {
                remote_writer,
                requested_qos,
                offered_qos,
                ..
            } => {
                if let Some(publisher) = self.publishers.get_mut(remote_writer) {
                    publisher.incompatible = Some(incompatibility(requested_qos, offered_qos));
                }
            }
            _ => {}
        }
    }

    /// Returns the topics as they are now.
    pub(crate) fn inputs(&self) -> Vec<Input> {
        let topics = self.topics.iter();
        topics
            .map(|topic| Input {
                input: topic.input.to_owned(),
                source: format!("{} ({})", topic.name, topic.kind),
                missing: (self.unheard(topic).filter(|_| topic.every_publisher))
                    .or_else(|| self.missing(topic).filter(|_| topic.needed)),
            })
            .collect()
    }

    fn missing(&self, topic: &AwaitedTopic) -> Option<String> {
        let age_s = topic.accepted.map(|at| at.elapsed().as_secs_f64());
        if age_s.is_some_and(|age_s| age_s <= MISSING_AFTER_S) {
            return None;
        }
        let on_topic: Vec<&Publisher> = self
            .publishers
            .values()
            .filter(|publisher| publisher.topic == topic.name)
            .collect();
        let (fitting, others): (Vec<&Publisher>, _) = on_topic
            .into_iter()
            .partition(|publisher| publisher.kind == topic.kind);
        // Messages of another type may have been read as this one before their publisher was known.
        if fitting.is_empty()
            && let Some(other) = others.first()
        {
            return Some(format!("it is published as {}", other.kind));
        }
        if let Some(rejection) = &topic.rejection {
            return Some(format!("its messages are rejected: {rejection}"));
        }
        if let Some(qos) = fitting
            .iter()
            .filter(|publisher| !publisher.matched)
            .find_map(|publisher| publisher.incompatible.as_ref())
        {
            return Some(format!("incompatible QoS: {qos}"));
        }
        if !fitting.is_empty() {
            let since = age_s.map_or_else(
                || "but no message yet".to_owned(),
                |age_s| format!("but no message for {age_s:.0} s"),
            );
            return Some(format!("publishers: {}, {since}", fitting.len()));
        }
        Some(format!("no publisher{}", self.hint(topic)))
    }

    /// Returns where messages of this type are published instead.
    fn hint(&self, topic: &AwaitedTopic) -> String {
        let elsewhere: BTreeSet<&str> = self
            .publishers
            .values()
            .filter(|publisher| publisher.kind == topic.kind)
            .map(|publisher| publisher.topic.as_str())
            .collect();
        if !elsewhere.is_empty() {
            let names: Vec<&str> = elsewhere.into_iter().take(HINTS_MAX).collect();
            return format!("; this type is on {}", names.join(", "));
        }
        match self.others.len() {
            0 => format!(
                "; no other node is on ROS domain {} (ROS_DOMAIN_ID, network)",
                self.domain
            ),
            _ => "; nobody publishes this type".to_owned(),
        }
    }
}

fn participant(guid: &GUID) -> SeenParticipant {
    let bytes = guid.to_bytes();
    std::array::from_fn(|index| bytes[index])
}

/// Returns `nav_msgs/msg/Odometry` for `nav_msgs::msg::dds_::Odometry_`.
fn ros_type(dds_type: &str) -> String {
    dds_type
        .trim_end_matches('_')
        .replace("::dds_::", "::")
        .replace("::", "/")
}

/// Returns in words what a publisher does not offer.
fn incompatibility(requested: &QosPolicies, offered: &QosPolicies) -> String {
    if requested.is_reliable() && !offered.is_reliable() {
        return "the publisher is best effort, a reliable one is needed".to_owned();
    }
    if !requested.is_volatile() && offered.is_volatile() {
        return "the publisher is volatile, a transient-local one is needed".to_owned();
    }
    let policy = offered.compliance_failure_wrt(requested);
    policy.map_or_else(
        || "the publisher offers less than is needed".to_owned(),
        |policy| format!("the publisher's {policy:?} does not fit"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_client::dds::rustdds::LostReason;

    fn monitor() -> GraphMonitor {
        let mut monitor = GraphMonitor::default();
        monitor.begin(7, GUID::from_bytes([9; 16]));
        let kind = || "nav_msgs/msg/Odometry".to_owned();
        monitor.wait_for("odometry", ("odom", "/odom".to_owned()), kind(), true);
        monitor
    }

    fn publish(monitor: &mut GraphMonitor, number: u8, topic: &str, kind: &str) {
        let publisher = Publisher {
            topic: topic.to_owned(),
            kind: kind.to_owned(),
            incompatible: None,
            matched: false,
            discovered: Instant::now(),
        };
        monitor
            .publishers
            .insert(GUID::from_bytes([number; 16]), publisher);
    }

    fn reason(monitor: &GraphMonitor) -> String {
        monitor.inputs()[0].missing.clone().unwrap_or_default()
    }

    #[test]
    fn a_topic_that_nobody_publishes_names_where_its_type_is() {
        let mut monitor = monitor();
        assert!(reason(&monitor).contains("no other node is on ROS domain 7"));
        monitor.others.insert([1; 12]);
        assert!(reason(&monitor).contains("nobody publishes this type"));
        publish(&mut monitor, 1, "/wheels/odom", "nav_msgs/msg/Odometry");
        let said = reason(&monitor);
        assert!(
            said.contains("no publisher") && said.contains("/wheels/odom"),
            "{said}"
        );
        let whole = monitor.inputs()[0].to_string();
        assert!(whole.starts_with("odometry on /odom (nav_msgs/msg/Odometry): no publisher"));
    }

    #[test]
    fn another_type_qos_or_frame_is_named() {
        let mut monitor = monitor();
        publish(&mut monitor, 1, "/odom", "geometry_msgs/msg/PoseStamped");
        // A message of the other input of this name says nothing of this one.
        monitor.wait_for(
            "poses",
            ("odom", "/odom".to_owned()),
            "geometry_msgs/msg/PoseStamped".to_owned(),
            true,
        );
        monitor.accepted("odom");
        assert!(reason(&monitor).contains("published as geometry_msgs/msg/PoseStamped"));
        monitor.topics.pop();
        publish(&mut monitor, 2, "/odom", "nav_msgs/msg/Odometry");
        assert!(reason(&monitor).contains("publishers: 1, but no message yet"));
        let writer = GUID::from_bytes([2; 16]);
        let with = |reliable: bool| {
            let builder = QosPolicies::builder();
            match reliable {
                true => builder.reliable(ros2_client::dds::rustdds::Duration::ZERO),
                false => builder.best_effort(),
            }
            .build()
        };
        monitor.discovered(&Event::RemoteWriterQosIncompatible {
            local_reader: GUID::from_bytes([9; 16]),
            remote_writer: writer,
            requested_qos: Box::new(with(true)),
            offered_qos: Box::new(with(false)),
        });
        assert!(reason(&monitor).contains("incompatible QoS: the publisher is best effort"));
        monitor.rejected("odom", "it is in map, must be in odom");
        assert!(reason(&monitor).contains("rejected: it is in map, must be in odom"));
        let kind = "nav_msgs/msg/Odometry".to_owned();
        monitor.wait_for("headings", ("odom", "/odom".to_owned()), kind, true);
        monitor.accepted("odom");
        let inputs = monitor.inputs();
        assert!(inputs.len() == 2 && inputs.iter().all(|input| input.missing.is_none()));
        monitor.discovered(&Event::WriterLost {
            guid: writer,
            reason: LostReason::Disposed,
        });
        assert_eq!(monitor.publishers.len(), 1);
    }

    #[test]
    fn a_message_of_another_type_that_comes_before_its_publisher_is_known_does_not_hide_the_type() {
        let mut monitor = monitor();
        monitor.rejected("odom", "the norm of the orientation is inf, not 1");
        assert!(reason(&monitor).contains("rejected: the norm"));
        publish(&mut monitor, 1, "/odom", "sensor_msgs/msg/Imu");
        assert_eq!(reason(&monitor), "it is published as sensor_msgs/msg/Imu");
        publish(&mut monitor, 2, "/odom", "nav_msgs/msg/Odometry");
        assert!(reason(&monitor).contains("rejected: the norm"));
    }

    #[test]
    fn each_publisher_is_heard_where_that_is_needed() {
        let mut monitor = GraphMonitor::default();
        let kind = "std_msgs/msg/Bool";
        monitor.wait_for("stop", ("stop", "/stop".to_owned()), kind.to_owned(), false);
        publish(&mut monitor, 1, "/stop", kind);
        publish(&mut monitor, 2, "/stop", "std_msgs/msg/Int32");
        monitor.accepted("stop");
        assert_eq!(
            (monitor.unheard_publisher(), reason(&monitor)),
            (None, String::new())
        );
        monitor.need_every_publisher("stop");
        let said = monitor.unheard_publisher().unwrap();
        assert!(
            said.contains("/stop: it is published as std_msgs/msg/Int32"),
            "{said}"
        );
        assert!(said.contains("must be std_msgs/msg/Bool"), "{said}");
        assert!(said.ends_with(&reason(&monitor)));
        let lost = GUID::from_bytes([2; 16]);
        monitor.publishers.remove(&lost);
        assert_eq!(
            (monitor.unheard_publisher(), reason(&monitor)),
            (None, String::new())
        );
        // One that no subscription matches, once all have tried.
        let other = monitor
            .publishers
            .get_mut(&GUID::from_bytes([1; 16]))
            .unwrap();
        other.incompatible = Some("it is owned".to_owned());
        assert_eq!(monitor.unheard_publisher(), None);
        let other = monitor
            .publishers
            .get_mut(&GUID::from_bytes([1; 16]))
            .unwrap();
        other.discovered -= MATCHING;
        assert!(monitor.unheard_publisher().unwrap().contains("it is owned"));
        let other = monitor
            .publishers
            .get_mut(&GUID::from_bytes([1; 16]))
            .unwrap();
        other.matched = true;
        assert_eq!(monitor.unheard_publisher(), None);
    }

    #[test]
    fn types_of_dds_are_written_as_those_of_ros() {
        assert_eq!(
            ros_type("nav_msgs::msg::dds_::Odometry_"),
            "nav_msgs/msg/Odometry"
        );
    }
}
