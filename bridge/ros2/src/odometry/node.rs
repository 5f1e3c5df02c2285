//! The node of the odometry.

use super::dead_reckoning::DeadReckoning;
use crate::node::time::RosTime;
use crate::node::worker::Worker;
use crate::node::{RosNode, qos};
use crate::port::inputs::InputSubscriber;
use crate::port::readings::{LatestInputs, PortContext};
use crate::server::StartError;
use ros2_client::Publisher;
use sidehill_bridge::control_loop::channel::command_channel;
use sidehill_bridge::drives::{Epoch, ExternalClock};
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::conversions::stamp;
use sidehill_bridge::ros2::convert::TwistMapping;
use sidehill_bridge::ros2::message::{Header, Odometry, TfMessage};
use sidehill_bridge::ros2::odometry::{odometry_message, transform_message};
use sidehill_bridge::ros2::settings::odometry::OdometryConfig;
use sidehill_plant::vehicle::Vehicle;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use triple_buffer::Output;

/// What the node is made of.
pub struct OdometrySetup<'a> {
    /// Topics, frames and times.
    pub config: OdometryConfig,
    /// Vehicle that drives.
    pub vehicle: &'a Vehicle,
    /// The arguments after `--ros-args`.
    pub arguments: &'a RosArguments,
    /// The environment variables of ROS.
    pub environment: &'a RosEnvironment,
    /// Zero of the local time.
    pub epoch: Epoch,
}

/// The running node. Dropped, it leaves the graph.
pub struct OdometryNode {
    frames: sidehill_bridge::ros2::settings::topics::Frames,
    timeout_s: f64,
    reckoning: DeadReckoning,
    latest: Output<LatestInputs>,
    context: PortContext,
    odometry: Publisher<Odometry>,
    transforms: Option<Publisher<TfMessage>>,
    clock_jumps: u64,
    published: u64,
    _inputs: Worker,
    // Dropped last, after all that it has created.
    _node: RosNode,
}

impl OdometryNode {
    /// Starts the node.
    ///
    /// # Errors
    /// [`StartError`] for a setting out of range, an invalid name or a network that cannot be used.
    pub fn start(setup: OdometrySetup<'_>) -> Result<Self, StartError> {
        let OdometrySetup {
            config,
            vehicle,
            epoch,
            ..
        } = setup;
        config.validate()?;
        let mapping = TwistMapping::new(config.track_width_m, vehicle)?;
        let mut node = RosNode::start(&config.node, setup.arguments, setup.environment)?;
        let clock = config.use_sim_time.then(ExternalClock::default);
        let time = match clock.clone() {
            Some(clock) => RosTime::simulated(move || clock.now_s().unwrap_or(0.0)),
            None => RosTime::system(move || epoch.elapsed_s()),
        };
        let context = PortContext {
            frames: config.frames.clone(),
            mapping,
            time,
            clock,
            shared: Arc::default(),
            fixes: None,
        };
        // No drives hang on this node: its halt switch halts nothing.
        let (commands, _, _) = command_channel(1);
        let subscriber = InputSubscriber {
            config: config.inputs(),
            context: context.clone(),
            halt: commands.halt_switch(),
            forwarded: None,
            sensors: true,
        };
        let (inputs, latest) = subscriber.start(&mut node)?;
        let transforms = match config.publish_transform {
            true => Some(node.publisher("/tf", &qos::STREAM)?),
            false => None,
        };
        Ok(Self {
            odometry: node.publisher(&config.topic, &qos::STREAM)?,
            transforms,
            reckoning: DeadReckoning::new(vehicle, config.timeout_s),
            frames: config.frames,
            timeout_s: config.timeout_s,
            latest,
            context,
            clock_jumps: 0,
            published: 0,
            _inputs: inputs,
            _node: node,
        })
    }

    /// Publishes the odometry of newer readings than the last, where there are any.
    pub fn step(&mut self) {
        let jumps = self.context.shared.clock_jumps.load(Ordering::Relaxed);
        if jumps != self.clock_jumps {
            self.clock_jumps = jumps;
            self.reckoning.forget();
        }
        let latest = *self.latest.read();
        let (Some(motors), Some(attitude)) = (latest.motors, latest.attitude) else {
            return;
        };
        // An attitude that has stopped does not hold for new speeds.
        if (motors.time_s - attitude.time_s).abs() > self.timeout_s {
            return;
        }
        let speeds = sidehill_plant::sample::Stamped {
            time_s: motors.time_s,
            value: motors.value.into(),
        };
        let Some(state) = self.reckoning.take(speeds, attitude.value) else {
            return;
        };
        let header = Header {
            stamp: stamp(self.context.time.stamp_ns(state.time_s)),
            frame_id: self.frames.odometry.clone(),
        };
        let base = &self.frames.base;
        if let Some(transforms) = &self.transforms {
            let transform = transform_message(&state, header.clone(), base);
            // A full queue drops a message: a later one is newer.
            let _ = transforms.publish(TfMessage {
                transforms: vec![transform],
            });
        }
        let _ = self
            .odometry
            .publish(odometry_message(&state, header, base));
        self.published += 1;
    }

    /// Returns how many messages were published.
    pub fn published(&self) -> u64 {
        self.published
    }

    /// Returns how often readings were missing for longer than the timeout.
    pub fn gaps(&self) -> u64 {
        self.reckoning.gaps()
    }

    /// Returns how many messages were rejected, with topic and reason of the last; empty before the first.
    pub fn rejected(&self) -> (u64, String) {
        let shared = &self.context.shared;
        (shared.rejected(), shared.last_rejection())
    }
}
