//! A node on the ROS 2 graph, made from arguments and environment.

use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::{
    Context, CreateError, Message, MessageTypeName, Name, Node, NodeCreateError, NodeName,
    NodeOptions, Publisher, QosProfile, Server, ServiceMapping, ServiceTypeName, Subscription,
};
use sidehill_bridge::ros2::arguments;
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::message::TopicMessage;
use sidehill_bridge::ros2::names::{NameError, Names};
use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

/// Why a node, topic or service cannot be created.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// An invalid name.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The middleware refused.
    #[error("ROS 2: {0}")]
    Create(#[from] CreateError),
    /// The node cannot be created.
    #[error("ROS 2 node: {0}")]
    Node(#[from] NodeCreateError),
    /// A thread or a poll cannot be created.
    #[error("ROS 2: {0}")]
    System(#[from] std::io::Error),
}

/// Long enough for a thread to be scheduled on a busy machine.
const PARTING: Duration = Duration::from_millis(50);

/// A node with its names. It is on the graph while it lives; dropped with all that it created, it leaves
/// within 0.1 s.
///
/// No `Spinner` of `ros2-client` runs: it would offer parameter services in one service mapping only and
/// subscribe to `/clock` with the wrong type.
pub struct RosNode {
    // Dropped in this order: the node says that it leaves, gets the time for it, and the context is last.
    node: Node,
    _parting: Parting,
    context: Context,
    names: Names,
    service_mapping: ServiceMapping,
}

/// Time between a node's last message and the end of its participant.
///
/// RustDDS sends on a thread of its own, which ends with the participant and drops what it has not sent: other
/// nodes would see the node until its lease expires.
struct Parting;

impl Drop for Parting {
    fn drop(&mut self) {
        std::thread::sleep(PARTING);
    }
}

impl RosNode {
    /// Returns a node called `name` unless an argument renames it.
    ///
    /// # Errors
    /// [`NodeError`]: an invalid name, or a network that cannot be used.
    pub fn start(
        name: &str,
        arguments: &RosArguments,
        environment: &RosEnvironment,
    ) -> Result<Self, NodeError> {
        let names = Names::new(name, "/", &arguments.remaps)?;
        let mut participant = DomainParticipantBuilder::new(environment.domain_id);
        if environment.loopback_only {
            participant = participant.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let context =
            Context::from_domain_participant(participant.build().map_err(CreateError::from)?)?;
        let options = NodeOptions::new()
            .start_parameter_services(false)
            .allow_undeclared_parameters(true);
        let own = names.node();
        let own = NodeName::new(own.namespace(), own.base_name()).map_err(|error| NameError {
            name: own.fully_qualified_name(),
            reason: error.to_string(),
        })?;
        let node = context.new_node(own, options)?;
        Ok(Self {
            node,
            _parting: Parting,
            context,
            names,
            service_mapping: match environment.service_mapping {
                arguments::ServiceMapping::Enhanced => ServiceMapping::Enhanced,
                arguments::ServiceMapping::Cyclone => ServiceMapping::Cyclone,
            },
        })
    }

    /// Returns the node's names.
    pub fn names(&self) -> &Names {
        &self.names
    }

    /// Returns the name of a topic, service or action after remaps.
    ///
    /// # Errors
    /// [`NameError`] for an invalid name.
    pub fn resolve(&self, name: &str) -> Result<Name, NameError> {
        let name = self.names.resolve(name)?;
        Name::parse(&name).map_err(|error| NameError {
            name,
            reason: error.to_string(),
        })
    }

    /// Returns how services are mapped to topics.
    pub fn service_mapping(&self) -> ServiceMapping {
        self.service_mapping
    }

    /// Returns the node of the client library.
    pub fn inner(&mut self) -> &mut Node {
        &mut self.node
    }

    /// Returns the context of the client library. A clone that outlives the node keeps a ghost of it
    /// on the graph.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Returns a publisher on a topic, whose name is resolved.
    ///
    /// # Errors
    /// [`NodeError`].
    pub fn publisher<M: TopicMessage>(
        &mut self,
        topic: &str,
        qos: &QosProfile,
    ) -> Result<Publisher<M>, NodeError> {
        let name = self.resolve(topic)?;
        let topic = self.node.create_topic(&name, type_name::<M>(), qos)?;
        Ok(self.node.create_publisher(&topic, Some(qos.clone()))?)
    }

    /// Returns a subscription to a topic, whose name is resolved.
    ///
    /// # Errors
    /// [`NodeError`].
    pub fn subscription<M: TopicMessage + 'static>(
        &mut self,
        topic: &str,
        qos: &QosProfile,
    ) -> Result<Subscription<M>, NodeError> {
        let name = self.resolve(topic)?;
        let topic = self.node.create_topic(&name, type_name::<M>(), qos)?;
        Ok(self.node.create_subscription(&topic, Some(qos.clone()))?)
    }

    /// Returns the names of all topics that other nodes subscribe to, as they are known now.
    pub fn subscribed_topics(&self) -> BTreeSet<String> {
        let readers = self.context.domain_participant().discovered_readers();
        let topics = readers.iter().filter_map(|reader| {
            let name = reader.subscription_topic_data.topic_name();
            name.strip_prefix("rt").map(str::to_owned)
        });
        topics.collect()
    }

    /// Returns the server of a service, whose name is resolved, of type `package/kind`.
    ///
    /// # Errors
    /// [`NodeError`].
    pub fn server<Q, A>(
        &mut self,
        service: &str,
        package: &str,
        kind: &str,
    ) -> Result<Server<Q, A>, NodeError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        let name = self.resolve(service)?;
        let (mapping, qos) = (self.service_mapping, super::qos::SERVICE);
        let kind = ServiceTypeName::new(package, kind);
        Ok(self
            .node
            .create_server(mapping, &name, &kind, qos.clone(), qos)?)
    }
}

fn type_name<M: TopicMessage>() -> MessageTypeName {
    MessageTypeName::new(M::PACKAGE, M::TYPE)
}
