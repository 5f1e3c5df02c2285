//! The topic of the actions that a vehicle passes on its route.

use crate::node::subscription::take_all;
use crate::node::{NodeError, RosNode, qos};
use crate::port::shared_inputs::SharedInputs;
use ros2_client::dds::rustdds::mio1::{Interest, Registry, Token};
use ros2_client::{Gid, Publisher, Subscription};
use sidehill_bridge::ros2::ROUTE_ACTION;
use sidehill_bridge::ros2::message::Text;
use sidehill_controller::path::RouteAction;

/// Longest text of another program that is written to the log, characters.
const TEXT_MAX: usize = 200;

/// Publishes actions, and hears those that other programs publish, as `drive-route` does.
pub(crate) struct ActionTopic {
    publisher: Publisher<Text>,
    subscription: Subscription<Text>,
    /// Who the publisher is.
    own: Gid,
}

impl ActionTopic {
    pub(crate) fn new(node: &mut RosNode, poll: (&Registry, Token)) -> Result<Self, NodeError> {
        let publisher = node.publisher(ROUTE_ACTION, &qos::RELIABLE_10)?;
        let mut subscription = node.subscription(ROUTE_ACTION, &qos::RELIABLE_10)?;
        let (registry, token) = poll;
        registry.register(&mut subscription, token, Interest::READABLE)?;
        Ok(Self {
            own: publisher.guid().into(),
            publisher,
            subscription,
        })
    }

    /// Writes actions to the log and publishes them.
    pub(crate) fn publish(&self, inputs: &SharedInputs, actions: &[RouteAction]) {
        for RouteAction { text, .. } in actions {
            inputs.note("action", text.clone());
            // A full queue drops it: the log has it.
            let _ = self.publisher.publish(Text { data: text.clone() });
        }
    }

    /// Writes the actions that other programs have published to the log.
    pub(crate) fn hear(&self, inputs: &SharedInputs) {
        take_all(&self.subscription, |Text { data }, info| {
            if info.publisher_gid() != self.own {
                inputs.note("action", data.chars().take(TEXT_MAX).collect());
            }
        });
    }
}
