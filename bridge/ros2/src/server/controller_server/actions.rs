//! Actions along routes: those of the configuration's route, and those that other programs publish.

use super::ControllerServer;
use crate::node::subscription::take_all;
use crate::node::{NodeError, RosNode, qos};
use crate::port::shared_inputs::SharedInputs;
use ros2_client::dds::rustdds::mio1::{Interest, Registry, Token};
use ros2_client::{Gid, Publisher, Subscription};
use sidehill_bridge::ros2::ROUTE_ACTION;
use sidehill_bridge::ros2::message::Text;
use sidehill_controller::controller::Decision;
use sidehill_controller::path::RouteAction;

/// Longest text of another program that is written to the log, characters.
const TEXT_MAX: usize = 200;

/// The topic of actions.
pub(super) struct ActionTopic {
    publisher: Publisher<Text>,
    subscription: Subscription<Text>,
    /// Who the publisher is.
    own: Gid,
    /// Whether the route of the configuration was begun and the vehicle has not driven on it since.
    pub(super) joins: bool,
    /// Whether the vehicle has driven on it since then.
    drives: bool,
}

impl ActionTopic {
    pub(super) fn new(node: &mut RosNode, poll: (&Registry, Token)) -> Result<Self, NodeError> {
        let publisher = node.publisher(ROUTE_ACTION, &qos::RELIABLE_10)?;
        let mut subscription = node.subscription(ROUTE_ACTION, &qos::RELIABLE_10)?;
        poll.0
            .register(&mut subscription, poll.1, Interest::READABLE)?;
        Ok(Self {
            own: publisher.guid().into(),
            publisher,
            subscription,
            joins: false,
            drives: false,
        })
    }
}

impl ControllerServer {
    /// Publishes the actions of the route that the vehicle has passed.
    pub(super) fn pass_actions(&mut self, decision: Option<&Decision>) {
        let Some(route) = &mut self.links.configured_route else {
            return;
        };
        let left_m = decision.and_then(|decision| self.handler.left_on_route_m(decision));
        let Some(left_m) = left_m else {
            return;
        };
        let arc_length_m = (route.path.length_m(0) - left_m).max(0.0);
        if std::mem::take(&mut self.actions.joins) {
            route.actions.join(arc_length_m);
        }
        self.actions.drives = true;
        for action in route.actions.pass(arc_length_m) {
            publish(&self.actions, &self.links.inputs, action);
        }
    }

    /// Publishes what is left where the route was driven to its end.
    pub(super) fn finish_actions(&mut self) {
        let Some(route) = &mut self.links.configured_route else {
            return;
        };
        if std::mem::take(&mut self.actions.drives) {
            for action in route.actions.finish() {
                publish(&self.actions, &self.links.inputs, action);
            }
        }
    }

    /// Notes the actions that other programs publish, as `drive-route` does.
    pub(super) fn hear_actions(&self) {
        take_all(&self.actions.subscription, |Text { data }, info| {
            if info.publisher_gid() != self.actions.own {
                let text = data.chars().take(TEXT_MAX);
                self.links.inputs.note("action", text.collect());
            }
        });
    }
}

/// Writes an action to the log and publishes it.
fn publish(topic: &ActionTopic, inputs: &SharedInputs, action: &RouteAction) {
    let data = action.text.clone();
    inputs.note("action", data.clone());
    // A full queue drops it: the log has it.
    let _ = topic.publisher.publish(Text { data });
}
