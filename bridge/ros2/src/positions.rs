//! A node that reads where a vehicle is, for recording: one topic, no drives, nothing published.

use super::node::subscription::take_all;
use super::node::{NodeError, RosNode, qos};
use super::port::graph_monitor::GraphMonitor;
use ros2_client::Subscription;
use ros2_client::dds::rustdds::{DomainParticipantStatusListener, RTPSEntity, StatusEvented};
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::message::{NavSatFix, Odometry, TopicMessage};
use sidehill_bridge::ros2::position::{AnyPosition, PositionTopic};

enum Messages {
    Odometry(Subscription<Odometry>),
    Fix(Subscription<NavSatFix>),
}

/// The running node. Dropped, it leaves the graph.
pub struct PositionNode {
    topic: PositionTopic,
    messages: Messages,
    graph: GraphMonitor,
    discovery: DomainParticipantStatusListener,
    // Dropped last, after all that it has created.
    _node: RosNode,
}

impl PositionNode {
    /// Starts a node called `name` unless an argument renames it.
    ///
    /// # Errors
    /// [`NodeError`]: an invalid name, or a network that cannot be used.
    pub fn start(
        name: &str,
        topic: PositionTopic,
        arguments: &RosArguments,
        environment: &RosEnvironment,
    ) -> Result<Self, NodeError> {
        let mut node = RosNode::start(name, arguments, environment)?;
        let participant = node.context().domain_participant();
        let discovery = participant.status_listener();
        let mut graph = GraphMonitor::default();
        graph.begin(environment.domain_id, participant.guid());
        let resolved = node.names().resolve(topic.name())?.to_string();
        let (messages, input, kind) = match &topic {
            PositionTopic::Odometry(name) => (
                Messages::Odometry(node.subscription(name, &qos::BURST)?),
                "odometry",
                ros_type::<Odometry>(),
            ),
            PositionTopic::Fix(name) => (
                Messages::Fix(node.subscription(name, &qos::BURST)?),
                "fixes",
                ros_type::<NavSatFix>(),
            ),
        };
        graph.wait_for(input, (topic.name(), resolved), kind, true);
        Ok(Self {
            topic,
            messages,
            graph,
            discovery,
            _node: node,
        })
    }

    /// Passes all messages that have arrived to `take`, in their order, which returns why it cannot use one.
    /// Does not wait.
    pub fn step(&mut self, mut take: impl FnMut(AnyPosition<'_>) -> Result<(), String>) {
        while let Some(event) = self.discovery.try_recv_status() {
            self.graph.discovered(&event);
        }
        let (graph, topic) = (&mut self.graph, self.topic.name());
        let mut judge = |message: AnyPosition<'_>| match take(message) {
            Ok(()) => graph.accepted(topic),
            Err(reason) => graph.rejected(topic, &reason),
        };
        let unreadable = match &self.messages {
            Messages::Odometry(messages) => take_all(messages, |message, _| {
                judge(AnyPosition::Odometry(&message));
            }),
            Messages::Fix(messages) => take_all(messages, |message, _| {
                judge(AnyPosition::Fix(&message));
            }),
        };
        if unreadable > 0 {
            graph.rejected(topic, "they cannot be read");
        }
    }

    /// Returns the topic and why nothing usable comes on it at present; none while messages come.
    pub fn missing(&self) -> Option<String> {
        let inputs = self.graph.inputs();
        inputs
            .into_iter()
            .find_map(|input| Some(format!("{}: {}", input.source, input.missing?)))
    }
}

fn ros_type<M: TopicMessage>() -> String {
    format!("{}/msg/{}", M::PACKAGE, M::TYPE)
}
