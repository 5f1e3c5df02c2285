//! How the server comes into being: what it subscribes to, serves and publishes.

use super::{ControllerServer, ServerLinks};
use crate::node::peers::Peers;
use crate::node::services::NodeServices;
use crate::node::{NodeError, RosNode, qos};
use crate::server::action_topic::ActionTopic;
use crate::server::follow_path::action_server;
use crate::server::goal_handler::GoalHandler;
use crate::server::goal_session::PivotSettings;
use crate::server::live_parameters;
use crate::server::obstacles::{CostmapReader, ObstacleSettings, StoppingSettings};
use crate::server::parameters::ServerParameters;
use crate::server::route::RouteSettings;
use crate::server::telemetry::Telemetry;
use ros2_client::dds::rustdds::mio1::{Interest, Poll, Token};
use sidehill_bridge::ros2::message::Path;
use sidehill_bridge::ros2::settings::server::Ros2Config;
use sidehill_bridge::safety::Geofence;
use sidehill_plant::vehicle::Vehicle;

impl ControllerServer {
    /// Creates the server on a node.
    ///
    /// # Errors
    /// [`NodeError`].
    pub(crate) fn new(
        mut node: RosNode,
        config: Ros2Config,
        route: RouteSettings,
        vehicle: &Vehicle,
        (period_s, stopping, geofence): (f64, StoppingSettings, Option<Geofence>),
        links: ServerLinks,
    ) -> Result<Self, NodeError> {
        let poll = Poll::new()?;
        let (registry, token) = (poll.registry(), Token(0));
        let action = action_server(&mut node, &config.follow_path, (registry, token))?;
        let mut path = match config.inputs.path.as_str() {
            "" => None,
            topic => Some(node.subscription::<Path>(topic, &qos::LATCHED)?),
        };
        if let Some(path) = &mut path {
            registry.register(path, token, Interest::READABLE)?;
        }
        let mut speed_limit = node.subscription(&config.inputs.speed_limit, &qos::RELIABLE_10)?;
        registry.register(&mut speed_limit, token, Interest::READABLE)?;
        let costmap = match config.costmap.clone() {
            Some(costmap) => {
                let settings = ObstacleSettings::new(costmap, stopping, vehicle);
                Some(CostmapReader::new(&mut node, settings, (registry, token))?)
            }
            None => None,
        };
        let mut discovery = node.context().domain_participant().status_listener();
        registry.register(&mut discovery, token, Interest::READABLE)?;
        let parameters = ServerParameters::new(&config.follow_path);
        let declared = parameters.declare(&config, period_s, route.limits.speed_max_m_s);
        let services = NodeServices::new(&mut node, (registry, token), declared, config.autostart)?;
        if let Some(owner) = &links.live {
            owner.publish(live_parameters::values(&services.parameters));
        }
        let telemetry = Telemetry::new(&mut node, vehicle, &config)?;
        let actions = ActionTopic::new(&mut node, (registry, token))?;
        let action_name = node.names().resolve(&config.follow_path.action)?;
        let emergency_stop = node.names().resolve(&config.inputs.emergency_stop)?;
        let pivots = PivotSettings {
            at_start: config.follow_path.turn_at_start,
            at_goal: config.follow_path.turn_at_goal,
        };
        Ok(Self {
            handler: GoalHandler::new(route, pivots, &config.frames.odometry, vehicle)
                .within(geofence),
            emergency_stop_topic: format!("rt{emergency_stop}"),
            result_topic: format!("rr{action_name}/_action/get_resultReply"),
            logger: node.inner().logging_handle(),
            config,
            parameters,
            links,
            action,
            path,
            speed_limit,
            costmap,
            services,
            telemetry,
            actions,
            joins_route: false,
            moves: false,
            discovery,
            peers: Peers::default(),
            accepted_goals: 0,
            last_end: None,
            clock_jumps: 0,
            poses_left_out: false,
            feedback_s: f64::NEG_INFINITY,
            obstacles_s: f64::NEG_INFINITY,
            poll,
            node,
        })
    }
}
