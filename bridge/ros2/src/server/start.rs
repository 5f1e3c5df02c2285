//! Starting the ROS 2 side of a run.

use super::configured_route::ConfiguredRoute;
use super::controller_server::{ControllerServer, ServerLinks};
use super::obstacles::StoppingSettings;
use super::route::RouteSettings;
use crate::node::time::RosTime;
use crate::node::worker::Worker;
use crate::node::{NodeError, RosNode};
use crate::port::inputs::InputSubscriber;
use crate::port::readings::PortContext;
use crate::port::shared_inputs::SharedInputs;
use crate::port::{FixReading, FixSettings, InputEvent, Ros2Port};
use ros2_client::dds::rustdds::RTPSEntity;
use sidehill_bridge::control_loop::channel::{ControllerEnd, LoopEnd, command_channel};
use sidehill_bridge::control_loop::scheduling::{RealtimeConfig, RealtimeError};
use sidehill_bridge::control_loop::tap::PathLog;
use sidehill_bridge::drives::{Clock, Epoch, ExternalClock, Input, InputStatus};
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::convert::TwistMapping;
use sidehill_bridge::ros2::settings::server::Ros2Config;
use sidehill_bridge::ros2::settings::topics::SpeedSource;
use sidehill_bridge::safety::Geofence;
use sidehill_plant::vehicle::{RangeError, Vehicle};
use sidehill_recording::Obstacles;
use sidehill_recording::live::ParameterOwner;
use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

/// Why the ROS 2 side cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// No node, topic, service or thread.
    #[error(transparent)]
    Node(#[from] NodeError),
    /// A setting out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// A priority that the system refuses.
    #[error(transparent)]
    Realtime(#[from] RealtimeError),
}

/// What the ROS 2 side of a run is made of.
pub struct ServerSetup<'a> {
    /// The `ros2:` section.
    pub config: Ros2Config,
    /// Vehicle model of the controller.
    pub vehicle: &'a Vehicle,
    /// How paths become routes.
    pub route: RouteSettings,
    /// The arguments after `--ros-args`.
    pub arguments: &'a RosArguments,
    /// The environment variables of ROS.
    pub environment: &'a RosEnvironment,
    /// Zero of the control loop's time.
    pub epoch: Epoch,
    /// Whether the drives are commanded over ROS 2.
    pub drives: bool,
    /// How fixes of a satellite receiver become poses; none where poses come otherwise.
    pub fixes: Option<FixSettings>,
    /// Stages of the controller's horizon.
    pub stages: usize,
    /// Period of the control loop, s.
    pub period_s: f64,
    /// Takes the paths where the drive is recorded, and says why nothing is recorded any more.
    pub recording: Option<(PathLog, Arc<OnceLock<String>>)>,
    /// Where live clients see and set the parameters of the node; none without a live view.
    pub live: Option<ParameterOwner>,
    /// Priorities of the threads.
    pub realtime: RealtimeConfig,
    /// The route of the configuration, which the operator begins.
    pub configured_route: Option<ConfiguredRoute>,
    /// Area that the vehicle may not leave.
    pub geofence: Option<Geofence>,
    /// How the vehicle stops ahead of an obstacle.
    pub stopping: StoppingSettings,
}

/// The running server, and the ends of its channels. Dropped, it leaves the graph.
pub struct Ros2 {
    /// Clock of the control loop.
    pub clock: Clock,
    /// The control loop's end of the command channel.
    pub loop_end: LoopEnd,
    /// The controller's end of it.
    pub controller_end: ControllerEnd,
    /// The vehicle, where its drives are commanded over ROS 2.
    pub port: Option<Ros2Port>,
    /// What it listens to.
    pub inputs: Ros2Inputs,
    /// Resolved name of the action that takes goals.
    pub action: String,
    /// The threads.
    pub server: Ros2Server,
}

/// The topics that the ROS 2 side listens to, and what it notes.
#[derive(Clone)]
pub struct Ros2Inputs(Arc<SharedInputs>);

impl InputStatus for Ros2Inputs {
    fn inputs(&mut self, _now_s: f64) -> Vec<Input> {
        self.0.graph().inputs()
    }
}

impl Ros2Inputs {
    /// Returns what has happened to goals and clocks since the last call, for the screen and the log.
    pub fn take_notes(&self) -> VecDeque<InputEvent> {
        self.0.take_notes()
    }

    /// Returns the fixes of the satellite receiver since the last call, for the recording.
    pub fn take_fixes(&self) -> VecDeque<FixReading> {
        self.0.take_fixes()
    }

    /// Returns the obstacles and their time, s, once a second, for recording and live view.
    pub fn take_obstacles(&self) -> Option<(f64, Obstacles)> {
        self.0.take_obstacles()
    }
}

/// The threads of the server; dropped, it leaves the graph.
pub struct Ros2Server {
    _server: Worker,
    _inputs: Option<Worker>,
}

/// Starts the server and, where the drives are commanded over ROS 2, their port.
///
/// # Errors
/// [`StartError`] for a setting out of range, an invalid name or a network that cannot be used.
pub fn start(setup: ServerSetup<'_>) -> Result<Ros2, StartError> {
    let config = setup.config;
    config.validate()?;
    let mapping = TwistMapping::new(config.commands.track_width_m, setup.vehicle)?;
    // The middleware makes its threads with the node.
    let start = || RosNode::start(&config.node, setup.arguments, setup.environment);
    let mut node = match setup.drives {
        true => setup.realtime.create_helpers(start)??,
        false => start()?,
    };
    let epoch = setup.epoch;
    let external = config.use_sim_time.then(ExternalClock::default);
    let (clock, time) = match external.clone() {
        Some(clock) => {
            let time = clock.clone();
            let time = RosTime::simulated(move || time.now_s().unwrap_or(0.0));
            (Clock::External(clock), time)
        }
        None => (
            Clock::Real(epoch),
            RosTime::system(move || epoch.elapsed_s()),
        ),
    };
    let (mut commands, loop_end, controller_end) = command_channel(setup.stages);
    let recording = setup.recording.map(|(paths, ended)| {
        commands.log_paths(paths);
        ended
    });
    let context = PortContext {
        frames: config.frames.clone(),
        mapping,
        time: time.clone(),
        clock: external,
        shared: Arc::default(),
        fixes: setup.fixes,
    };
    let own = node.context().domain_participant().guid();
    let shared = Arc::clone(&context.shared);
    shared.graph().begin(setup.environment.domain_id, own);
    let action = node
        .names()
        .resolve(&config.follow_path.action)
        .map_err(NodeError::from)?;
    let links = ServerLinks {
        time,
        inputs: Arc::clone(&context.shared),
        commands,
        recording,
        live: setup.live,
        configured_route: setup.configured_route,
    };
    let subscriber = InputSubscriber {
        config: config.inputs.clone(),
        context: context.clone(),
        halt: links.commands.halt_switch(),
        forwarded: config.commands.forwarded.clone().filter(|_| setup.drives),
        sensors: setup.drives,
    };
    if setup.drives && config.inputs.speeds == SpeedSource::Commands {
        let message = "the speeds of the treads are those of the commands: drives that do not obey are not noticed, and \
                       slip counts as slide";
        shared.note("inputs", message.to_owned());
    }
    let (inputs, latest) = subscriber.start(&mut node)?;
    let (port, inputs) = if setup.drives {
        let scale = setup.vehicle.encoder_scale;
        let port = Ros2Port::new(
            &mut node,
            (&config.commands, config.inputs.speeds),
            scale,
            context,
            (inputs, latest),
        )?;
        (Some(port), None)
    } else {
        (None, Some(inputs))
    };
    let server = ControllerServer::new(
        node,
        config,
        setup.route,
        setup.vehicle,
        (setup.period_s, setup.stopping, setup.geofence),
        links,
    )?;
    Ok(Ros2 {
        clock,
        loop_end,
        controller_end,
        port,
        inputs: Ros2Inputs(shared),
        action: action.to_string(),
        server: Ros2Server {
            _server: server.start().map_err(NodeError::from)?,
            _inputs: inputs,
        },
    })
}
