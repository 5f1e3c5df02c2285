//! The services of a managed node: parameters and lifecycle.

use super::inputs::ListenError;
use super::lifecycle::Lifecycle;
use super::message::lifecycle::{
    ChangeStateRequest, ChangeStateResponse, GetAvailableStatesRequest, GetAvailableStatesResponse,
    GetAvailableTransitionsRequest, GetAvailableTransitionsResponse, GetStateRequest,
    GetStateResponse, TransitionEvent,
};
use super::node::{NodeError, RosNode};
use super::parameters::Parameters;
use super::peers::{Peers, Requests};
use super::qos;
use ros2_client::dds::rustdds::mio1::{Interest, Registry, Token};
use ros2_client::parameters::{Parameter, ParameterValue, SetParametersResult};
use ros2_client::rcl_interfaces as rcl;
use ros2_client::{Message, Publisher, Server};
use std::time::{SystemTime, UNIX_EPOCH};

/// A service with its requests.
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
    ) -> Result<Self, ListenError> {
        let mut server = node.server(name, package, kind)?;
        registry.register(&mut server, token, Interest::READABLE)?;
        let whole = node.names().resolve(name).map_err(NodeError::from)?;
        Ok(Self {
            server,
            requests: Requests::of(&whole.to_string()),
        })
    }

    /// Answers what has come. What a full queue drops is as lost as on the way.
    fn answer(&mut self, peers: &Peers, mut answer: impl FnMut(Q) -> A) {
        while let Some((id, request)) = self.requests.next(peers, || self.server.receive_request())
        {
            let _ = self.server.send_response(id, answer(request));
        }
    }
}

/// What the services have changed.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Changes {
    pub(super) parameters: bool,
    pub(super) state: bool,
}

/// The services of parameters and lifecycle, and what they are about.
pub(super) struct Services {
    pub(super) parameters: Parameters,
    pub(super) lifecycle: Lifecycle,
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

impl Services {
    pub(super) fn new(
        node: &mut RosNode,
        poll: (&Registry, Token),
        parameters: Parameters,
        lifecycle: Lifecycle,
    ) -> Result<Self, ListenError> {
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
            lifecycle,
        };
        for Parameter { name, value } in services.parameters.all() {
            announce(node, &name, value);
        }
        Ok(services)
    }

    /// Answers all that has come, and returns what has changed.
    pub(super) fn answer(&mut self, node: &mut RosNode, peers: &Peers) -> Changes {
        let mut changes = Changes::default();
        let parameters = &mut self.parameters;
        self.get.answer(peers, |asked| rcl::GetParametersResponse {
            values: asked
                .names
                .iter()
                .map(|name| parameters.get(name).into())
                .collect(),
        });
        self.get_types
            .answer(peers, |asked| rcl::GetParameterTypesResponse {
                values: asked
                    .names
                    .iter()
                    .map(|name| ParameterValue::to_parameter_type_raw(&parameters.get(name)))
                    .collect(),
            });
        self.list.answer(peers, |asked| {
            let names = parameters.list(&asked.prefixes, asked.depth);
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
            .answer(peers, |asked| rcl::DescribeParametersResponse {
                values: asked
                    .names
                    .iter()
                    .map(|name| parameters.describe(name))
                    .collect(),
            });
        let mut set = |given: Vec<Parameter>| -> SetParametersResult {
            parameters.set_all(given.clone())?;
            for Parameter { name, value } in given {
                announce(node, &name, value);
            }
            changes.parameters = true;
            Ok(())
        };
        self.set.answer(peers, |asked| rcl::SetParametersResponse {
            results: asked
                .parameter
                .into_iter()
                .map(|parameter| set(vec![parameter.into()]).into())
                .collect(),
        });
        self.set_all
            .answer(peers, |asked| rcl::SetParametersAtomicallyResponse {
                result: set(asked.parameter.into_iter().map(Into::into).collect()).into(),
            });
        self.answer_lifecycle(peers, &mut changes);
        changes
    }

    fn answer_lifecycle(&mut self, peers: &Peers, changes: &mut Changes) {
        let (lifecycle, topic) = (&mut self.lifecycle, &self.transition_event);
        self.change_state.answer(peers, |asked| {
            let done = lifecycle.change(&asked.transition);
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

/// Tells /parameter_events of a value. The library's own store knows no ranges and no reasons: it
/// only follows.
fn announce(node: &mut RosNode, name: &str, value: ParameterValue) {
    let _ = node.inner().set_parameter(name, value);
}
