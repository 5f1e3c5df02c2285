//! A publisher of what costs more to make and send than to leave out.

use super::{NodeError, RosNode};
use ros2_client::{Publisher, QosProfile};
use sidehill_bridge::ros2::message::TopicMessage;
use std::collections::BTreeSet;

/// A publisher whose messages are made only while another node subscribes to the topic.
pub struct DemandedPublisher<M: TopicMessage> {
    publisher: Publisher<M>,
    name: String,
    demanded: bool,
}

impl<M: TopicMessage> DemandedPublisher<M> {
    /// Returns a publisher on a topic, whose name is resolved. Nothing is published before
    /// [`DemandedPublisher::look`].
    ///
    /// # Errors
    /// [`NodeError`].
    pub fn new(node: &mut RosNode, topic: &str, qos: &QosProfile) -> Result<Self, NodeError> {
        Ok(Self {
            publisher: node.publisher(topic, qos)?,
            name: node.names().resolve(topic)?.to_string(),
            demanded: false,
        })
    }

    /// Takes the topics that other nodes subscribe to.
    pub fn look(&mut self, subscribed: &BTreeSet<String>) {
        self.demanded = subscribed.contains(&self.name);
    }

    /// Publishes a message if there is a subscription. A full queue drops it: a later one is newer.
    pub fn publish(&self, message: impl FnOnce() -> M) {
        if self.demanded {
            let _ = self.publisher.publish(message());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::qos;
    use sidehill_bridge::ros2::arguments::ServiceMapping;
    use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
    use sidehill_bridge::ros2::message::Bool;
    use std::cell::Cell;
    use std::time::{Duration, Instant};

    /// Longest wait on a busy machine: a limit for liveness, not a measurement.
    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn messages_are_made_only_while_another_node_subscribes() {
        let environment = RosEnvironment {
            domain_id: 1 + (7 * std::process::id() % 200) as u16,
            service_mapping: ServiceMapping::Enhanced,
            loopback_only: true,
        };
        let arguments = RosArguments::default();
        let start = |name| RosNode::start(name, &arguments, &environment).unwrap();
        let (mut node, mut other) = (start("talker"), start("listener"));
        let mut topic = DemandedPublisher::new(&mut node, "~/said", &qos::STREAM).unwrap();
        let made = Cell::new(0);
        let publish = |topic: &DemandedPublisher<Bool>| {
            topic.publish(|| {
                made.set(made.get() + 1);
                Bool { data: true }
            });
        };
        topic.look(&node.subscribed_topics());
        publish(&topic);
        assert_eq!(made.get(), 0);
        let subscription = other
            .subscription::<Bool>("/talker/said", &qos::NEWEST)
            .unwrap();
        let until = Instant::now() + PATIENCE;
        let mut came = None;
        while came.is_none() {
            assert!(Instant::now() < until, "nothing was published");
            topic.look(&node.subscribed_topics());
            publish(&topic);
            std::thread::sleep(Duration::from_millis(10));
            came = subscription.take().unwrap();
        }
        drop((subscription, other));
        while topic.demanded {
            assert!(Instant::now() < until, "the subscription has not left");
            topic.look(&node.subscribed_topics());
            std::thread::sleep(Duration::from_millis(10));
        }
        let before = made.get();
        publish(&topic);
        assert_eq!(made.get(), before);
    }
}
