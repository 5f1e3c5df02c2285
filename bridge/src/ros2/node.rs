//! A node on the ROS 2 graph, made from arguments and environment.

use super::arguments::{RosArguments, RosEnvironment};
use super::message::TopicMessage;
use super::names::{NameFault, Names};
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::{
    Context, CreateError, Message, MessageTypeName, Node, NodeCreateError, NodeOptions, Publisher,
    QosProfile, Server, ServiceMapping, ServiceTypeName, Subscription,
};
use std::net::{IpAddr, Ipv4Addr};

/// Why there is no node, topic or service.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// A name that is not allowed.
    #[error(transparent)]
    Name(#[from] NameFault),
    /// The middleware refuses.
    #[error("ROS 2: {0}")]
    Create(#[from] CreateError),
    /// The node cannot be made.
    #[error("ROS 2 node: {0}")]
    Node(#[from] NodeCreateError),
}

/// A node with its names. While it lives it is on the graph; dropped with all that it made, it
/// leaves within a tenth of a second.
///
/// No `Spinner` runs: it would offer parameter services in one mapping only and listen to /clock
/// with a wrong type.
pub struct RosNode {
    // Before the context, which must be the last to go.
    node: Node,
    context: Context,
    names: Names,
    service_mapping: ServiceMapping,
}

impl RosNode {
    /// Returns a node called `name` where no argument says otherwise.
    ///
    /// # Errors
    /// [`NodeError`]: a name that is not allowed, or a network that cannot be used.
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
        let node = context.new_node(names.node().clone(), options)?;
        Ok(Self {
            node,
            context,
            names,
            service_mapping: environment.service_mapping,
        })
    }

    /// Returns the node's names.
    pub fn names(&self) -> &Names {
        &self.names
    }

    /// Returns how its services are mapped.
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
        let name = self.names.resolve(topic)?;
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
        let name = self.names.resolve(topic)?;
        let topic = self.node.create_topic(&name, type_name::<M>(), qos)?;
        Ok(self.node.create_subscription(&topic, Some(qos.clone()))?)
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
        let name = self.names.resolve(service)?;
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
