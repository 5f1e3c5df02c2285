//! A publisher of what costs more to make and send than to leave out.

use super::message::TopicMessage;
use super::{NodeError, RosNode};
use ros2_client::{Publisher, QosProfile};
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
