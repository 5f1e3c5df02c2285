//! The services of a managed node: parameters and lifecycle states.

use super::lifecycle::Lifecycle;
use super::message::lifecycle::{
    ChangeStateRequest, ChangeStateResponse, GetAvailableStatesRequest, GetAvailableStatesResponse,
    GetAvailableTransitionsRequest, GetAvailableTransitionsResponse, GetStateRequest,
    GetStateResponse, TransitionEvent,
};
use super::parameters::Parameters;
use super::peers::{Peers, Requests};
use super::qos;
use super::{NodeError, RosNode};
use ros2_client::dds::rustdds::mio1::{Interest, Registry, Token};
use ros2_client::parameters::{Parameter, ParameterValue, SetParametersResult};
use ros2_client::rcl_interfaces as rcl;
use ros2_client::{Message, Publisher, Server};
use std::time::{SystemTime, UNIX_EPOCH};

/// A service server with its requests.
struct Service<Q, A>
where
    Q: Message,
    A: Message,
{
    server: Server<Q, A>,
    requests: Requests<Q>,
}

impl<Q, A> Service<Q, A>
where
    Q: Message + Clone + 'static,
    A: Message + 'static,
{
    fn new(
        node: &mut RosNode,
        (registry, token): (&Registry, Token),
        name: &str,
        package: &str,
        kind: &str,
    ) -> Result<Self, NodeError> {
        let mut server = node.server(name, package, kind)?;
        registry.register(&mut server, token, Interest::READABLE)?;
        let whole = node.names().resolve(name)?;
        Ok(Self {
            server,
            requests: Requests::of(&whole.to_string()),
        })
    }

    /// Answers all requests that have arrived. What a full queue drops is lost as on the network.
    fn answer(&mut self, peers: &Peers, mut answer: impl FnMut(Q) -> A) {
        while let Some((id, request)) = self.requests.next(peers, || self.server.receive_request())
        {
            let _ = self.server.send_response(id, answer(request));
        }
    }
}

/// What the requests have changed.
#[derive(Debug, Clone, Copy, Default)]
pub struct Changes {
    /// A parameter was set.
    pub parameters: bool,
    /// The lifecycle state is another.
    pub state: bool,
}

/// The parameters and the lifecycle of a node with their services.
pub struct NodeServices {
    /// The parameters.
    pub parameters: Parameters,
    /// The lifecycle.
    pub lifecycle: Lifecycle,
    get: Service<rcl::GetParametersRequest, rcl::GetParametersResponse>,
    get_types: Service<rcl::GetParameterTypesRequest, rcl::GetParameterTypesResponse>,
    set: Service<rcl::SetParametersRequest, rcl::SetParametersResponse>,
    set_all: Service<rcl::SetParametersRequest, rcl::SetParametersAtomicallyResponse>,
    list: Service<rcl::ListParametersRequest, rcl::ListParametersResponse>,
    describe: Service<rcl::DescribeParametersRequest, rcl::DescribeParametersResponse>,
    change_state: Service<ChangeStateRequest, ChangeStateResponse>,
    get_state: Service<GetStateRequest, GetStateResponse>,
    states: Service<GetAvailableStatesRequest, GetAvailableStatesResponse>,
    transitions: Service<GetAvailableTransitionsRequest, GetAvailableTransitionsResponse>,
    graph: Service<GetAvailableTransitionsRequest, GetAvailableTransitionsResponse>,
    transition_event: Publisher<TransitionEvent>,
}

impl NodeServices {
    /// Returns the services of a node that is active, or waits for a lifecycle manager; `poll` is woken when
    /// a request arrives.
    ///
    /// # Errors
    /// [`NodeError`].
    pub fn new(
        node: &mut RosNode,
        poll: (&Registry, Token),
        parameters: Parameters,
        active: bool,
    ) -> Result<Self, NodeError> {
        const RCL: &str = "rcl_interfaces";
        const LIFECYCLE: &str = "lifecycle_msgs";
        let services = Self {
            get: Service::new(node, poll, "~/get_parameters", RCL, "GetParameters")?,
            get_types: Service::new(
                node,
                poll,
                "~/get_parameter_types",
                RCL,
                "GetParameterTypes",
            )?,
            set: Service::new(node, poll, "~/set_parameters", RCL, "SetParameters")?,
            set_all: Service::new(
                node,
                poll,
                "~/set_parameters_atomically",
                RCL,
                "SetParametersAtomically",
            )?,
            list: Service::new(node, poll, "~/list_parameters", RCL, "ListParameters")?,
            describe: Service::new(
                node,
                poll,
                "~/describe_parameters",
                RCL,
                "DescribeParameters",
            )?,
            change_state: Service::new(node, poll, "~/change_state", LIFECYCLE, "ChangeState")?,
            get_state: Service::new(node, poll, "~/get_state", LIFECYCLE, "GetState")?,
            states: Service::new(
                node,
                poll,
                "~/get_available_states",
                LIFECYCLE,
                "GetAvailableStates",
            )?,
            transitions: Service::new(
                node,
                poll,
                "~/get_available_transitions",
                LIFECYCLE,
                "GetAvailableTransitions",
            )?,
            graph: Service::new(
                node,
                poll,
                "~/get_transition_graph",
                LIFECYCLE,
                "GetAvailableTransitions",
            )?,
            transition_event: node.publisher("~/transition_event", &qos::RELIABLE_10)?,
            parameters,
            lifecycle: Lifecycle::new(active),
        };
        for Parameter { name, value } in services.parameters.all() {
            announce(node, &name, value);
        }
        Ok(services)
    }

    /// Answers all requests that have arrived, and returns what they have changed.
    pub fn answer(&mut self, node: &mut RosNode, peers: &Peers) -> Changes {
        let mut changes = Changes::default();
        let parameters = &mut self.parameters;
        self.get
            .answer(peers, |request| rcl::GetParametersResponse {
                values: request
                    .names
                    .iter()
                    .map(|name| parameters.get(name).into())
                    .collect(),
            });
        self.get_types
            .answer(peers, |request| rcl::GetParameterTypesResponse {
                values: request
                    .names
                    .iter()
                    .map(|name| ParameterValue::to_parameter_type_raw(&parameters.get(name)))
                    .collect(),
            });
        self.list.answer(peers, |request| {
            let names = parameters.list(&request.prefixes, request.depth);
            let mut prefixes: Vec<String> = names
                .iter()
                .filter_map(|name| name.rsplit_once('.').map(|(group, _)| group.to_owned()))
                .collect();
            prefixes.dedup();
            rcl::ListParametersResponse {
                result: rcl::ListParametersResult { names, prefixes },
            }
        });
        self.describe
            .answer(peers, |request| rcl::DescribeParametersResponse {
                values: request
                    .names
                    .iter()
                    .map(|name| parameters.describe(name))
                    .collect(),
            });
        let mut set = |given| {
            let result = set_all(parameters, node, given);
            changes.parameters |= result.is_ok();
            result
        };
        self.set
            .answer(peers, |request| rcl::SetParametersResponse {
                results: request
                    .parameter
                    .into_iter()
                    .map(|parameter| set(vec![parameter.into()]).into())
                    .collect(),
            });
        self.set_all
            .answer(peers, |request| rcl::SetParametersAtomicallyResponse {
                result: set(request.parameter.into_iter().map(Into::into).collect()).into(),
            });
        self.answer_lifecycle(peers, &mut changes);
        changes
    }

    /// Sets parameters, all or none, as the services do.
    ///
    /// # Errors
    /// Why the first of those that may not be set cannot be.
    pub fn set(&mut self, node: &mut RosNode, given: Vec<Parameter>) -> SetParametersResult {
        set_all(&mut self.parameters, node, given)
    }

    fn answer_lifecycle(&mut self, peers: &Peers, changes: &mut Changes) {
        let (lifecycle, topic) = (&mut self.lifecycle, &self.transition_event);
        self.change_state.answer(peers, |request| {
            let done = lifecycle.change(&request.transition);
            let success = done.is_some();
            changes.state |= success;
            if let Some(done) = done {
                let since = SystemTime::now().duration_since(UNIX_EPOCH);
                let nanos = since.map_or(0, |since| since.as_nanos());
                let _ = topic.publish(TransitionEvent {
                    timestamp: u64::try_from(nanos).unwrap_or(u64::MAX),
                    transition: done.transition,
                    start_state: done.start_state,
                    goal_state: done.goal_state,
                });
            }
            ChangeStateResponse { success }
        });
        let lifecycle = &self.lifecycle;
        self.get_state.answer(peers, |_| GetStateResponse {
            current_state: lifecycle.state(),
        });
        self.states.answer(peers, |_| GetAvailableStatesResponse {
            available_states: Lifecycle::states(),
        });
        self.transitions
            .answer(peers, |_| GetAvailableTransitionsResponse {
                available_transitions: lifecycle.available(),
            });
        self.graph
            .answer(peers, |_| GetAvailableTransitionsResponse {
                available_transitions: Lifecycle::graph(),
            });
    }
}

fn set_all(
    parameters: &mut Parameters,
    node: &mut RosNode,
    given: Vec<Parameter>,
) -> SetParametersResult {
    parameters.set_all(given.clone())?;
    for Parameter { name, value } in given {
        announce(node, &name, value);
    }
    Ok(())
}

/// Publishes a value on `/parameter_events`. The client library has its own store without ranges and
/// reasons; it only follows.
fn announce(node: &mut RosNode, name: &str, value: ParameterValue) {
    let _ = node.inner().set_parameter(name, value);
}
