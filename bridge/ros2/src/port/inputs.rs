//! The subscriptions of the vehicle and the thread that reads them.

use super::readings::{LatestInputs, NewestReadings, PortContext};
use crate::node::subscription::take_all;
use crate::node::worker::Worker;
use crate::node::{NodeError, RosNode, qos};
use crate::port::readings::{CLOCK, TF};
use ros2_client::Subscription;
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use sidehill_bridge::control_loop::channel::HaltSwitch;
use sidehill_bridge::ros2::message::TopicMessage;
use sidehill_bridge::ros2::message::{
    Bool, Clock, Imu, JointState, NavSatFix, Odometry, PoseWithCovarianceStamped,
    QuaternionStamped, TfMessage, Twist, TwistStamped,
};
use sidehill_bridge::ros2::names::NameError;
use sidehill_bridge::ros2::settings::topics::{AttitudeSource, SpeedSource, YawRateSource};
use sidehill_bridge::ros2::settings::topics::{
    HeadingConfig, InputsConfig, OrientationMessage, PoseConfig, PoseMessage, TwistConfig,
};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use triple_buffer::{Input, Output, triple_buffer};

/// Longest wait for a message before the emergency stop is checked for silence.
const TICK: Duration = Duration::from_millis(50);

/// Settings of the thread that reads the subscriptions.
pub(crate) struct InputSubscriber {
    pub(crate) config: InputsConfig,
    pub(crate) context: PortContext,
    pub(crate) halt: HaltSwitch,
    /// The command that reaches the drives, where another node sends it.
    pub(crate) forwarded: Option<TwistConfig>,
    /// Whether sensors are read, or only the emergency stop, the clock and transforms.
    pub(crate) sensors: bool,
}

impl InputSubscriber {
    /// Starts the thread, and returns it with the newest readings.
    pub(crate) fn start(
        self,
        node: &mut RosNode,
    ) -> Result<(Worker, Output<LatestInputs>), NodeError> {
        let mut subscriptions = Subscriptions::new(node, &self)?;
        let mut poll = Poll::new()?;
        subscriptions.register(&poll)?;
        let (slot, latest) = triple_buffer(&LatestInputs::default());
        let worker = Worker::start("ros2 inputs", move |end| {
            let mut reader = InputReader {
                readings: NewestReadings::new(self.config.clone(), self.context.clone()),
                subscriber: self,
                subscriptions,
                slot,
            };
            let mut events = Events::with_capacity(64);
            while !end.load(Ordering::Relaxed) {
                if poll.poll(&mut events, Some(TICK)).is_err() {
                    // A poll that failed has not waited.
                    std::thread::sleep(Duration::from_millis(1));
                }
                reader.read();
            }
        })?;
        Ok((worker, latest))
    }
}

/// A command that another node sends to the drives.
enum Forwarded {
    Plain(Subscription<Twist>),
    Stamped(Subscription<TwistStamped>),
}

/// Poses from another topic than the odometry.
enum Poses {
    Odometry(Subscription<Odometry>),
    Stamped(Subscription<PoseWithCovarianceStamped>),
    Fix(Subscription<NavSatFix>),
}

/// Headings beside fixes.
enum Headings {
    Imu(Subscription<Imu>),
    Quaternion(Subscription<QuaternionStamped>),
}

struct Subscriptions {
    poses: Option<Poses>,
    headings: Option<Headings>,
    odometry: Option<Subscription<Odometry>>,
    imu: Option<Subscription<Imu>>,
    joint_states: Option<Subscription<JointState>>,
    /// Best effort, reliable, and transient local: the first matches every publisher, the others lose nothing of
    /// those that offer it.
    emergency_stop: [Subscription<Bool>; 3],
    clock: Option<Subscription<Clock>>,
    forwarded: Option<Forwarded>,
    tf: Subscription<TfMessage>,
    tf_static: Subscription<TfMessage>,
}

impl Subscriptions {
    fn new(node: &mut RosNode, subscriber: &InputSubscriber) -> Result<Self, NodeError> {
        let (config, sensors) = (&subscriber.config, subscriber.sensors);
        let attitude_of_imu = config.attitude == AttitudeSource::Imu;
        let yaw_rate_of_imu = config.yaw_rate == YawRateSource::Imu;
        let imu = sensors && (attitude_of_imu || yaw_rate_of_imu);
        let pose = config.pose.as_ref().filter(|_| sensors);
        let odometry = sensors && (pose.is_none() || config.speeds == SpeedSource::Odometry);
        let joint_states = sensors && config.speeds == SpeedSource::JointStates;
        let clock = subscriber.context.clock.is_some();
        let wait = Waits { node, subscriber };
        if clock {
            wait.for_topic::<Clock>("clock", CLOCK, true)?;
        }
        if let Some(PoseConfig { topic, message, .. }) = pose {
            match message {
                PoseMessage::Odometry => wait.for_topic::<Odometry>("poses", topic, true)?,
                PoseMessage::PoseWithCovarianceStamped => {
                    wait.for_topic::<PoseWithCovarianceStamped>("poses", topic, true)?;
                }
                PoseMessage::Transform => wait.for_topic::<TfMessage>("poses", TF, true)?,
                PoseMessage::NavSatFix => wait.for_topic::<NavSatFix>("fixes", topic, true)?,
            }
        }
        let heading = pose.and_then(|pose| pose.heading.as_ref());
        if let Some(HeadingConfig { topic, message, .. }) = heading {
            match message {
                OrientationMessage::Imu => wait.for_topic::<Imu>("headings", topic, true)?,
                OrientationMessage::QuaternionStamped => {
                    wait.for_topic::<QuaternionStamped>("headings", topic, true)?;
                }
            }
        }
        if odometry {
            wait.for_topic::<Odometry>("odometry", &config.odometry, true)?;
        }
        if imu {
            // Without a yaw rate the vehicle still drives.
            wait.for_topic::<Imu>("imu", &config.imu, attitude_of_imu)?;
        }
        if joint_states {
            wait.for_topic::<JointState>("joint states", &config.joint_states, true)?;
        }
        let repeated = config.emergency_stop_timeout_s > 0.0;
        wait.for_topic::<Bool>("emergency stop", &config.emergency_stop, repeated)?;
        let shared = &subscriber.context.shared;
        shared.graph().need_every_publisher(&config.emergency_stop);
        Ok(Self {
            poses: match pose {
                None => None,
                Some(PoseConfig { topic, message, .. }) => match message {
                    PoseMessage::Odometry => {
                        Some(Poses::Odometry(node.subscription(topic, &qos::NEWEST)?))
                    }
                    PoseMessage::PoseWithCovarianceStamped => {
                        Some(Poses::Stamped(node.subscription(topic, &qos::NEWEST)?))
                    }
                    PoseMessage::NavSatFix => {
                        Some(Poses::Fix(node.subscription(topic, &qos::BURST)?))
                    }
                    PoseMessage::Transform => None,
                },
            },
            headings: match heading {
                None => None,
                Some(HeadingConfig { topic, message, .. }) => Some(match message {
                    OrientationMessage::Imu => {
                        Headings::Imu(node.subscription(topic, &qos::BURST)?)
                    }
                    OrientationMessage::QuaternionStamped => {
                        Headings::Quaternion(node.subscription(topic, &qos::BURST)?)
                    }
                }),
            },
            odometry: match odometry {
                true => Some(node.subscription(&config.odometry, &qos::NEWEST)?),
                false => None,
            },
            imu: match imu {
                true => Some(node.subscription(&config.imu, &qos::NEWEST)?),
                false => None,
            },
            joint_states: match joint_states {
                true => Some(node.subscription(&config.joint_states, &qos::NEWEST)?),
                false => None,
            },
            emergency_stop: [
                node.subscription(&config.emergency_stop, &qos::BURST)?,
                node.subscription(&config.emergency_stop, &qos::RELIABLE_10)?,
                node.subscription(&config.emergency_stop, &qos::LATCHED)?,
            ],
            clock: match clock {
                true => Some(node.subscription(CLOCK, &qos::NEWEST)?),
                false => None,
            },
            forwarded: match &subscriber.forwarded {
                Some(twist) if twist.stamped => Some(Forwarded::Stamped(
                    node.subscription(&twist.topic, &qos::NEWEST)?,
                )),
                Some(twist) => Some(Forwarded::Plain(
                    node.subscription(&twist.topic, &qos::NEWEST)?,
                )),
                None => None,
            },
            tf: node.subscription("/tf", &qos::BURST)?,
            tf_static: node.subscription("/tf_static", &qos::LATCHED_ALL)?,
        })
    }

    fn register(&mut self, poll: &Poll) -> std::io::Result<()> {
        let (registry, token, readable) = (poll.registry(), Token(0), Interest::READABLE);
        match &mut self.poses {
            Some(Poses::Odometry(poses)) => registry.register(poses, token, readable)?,
            Some(Poses::Stamped(poses)) => registry.register(poses, token, readable)?,
            Some(Poses::Fix(fixes)) => registry.register(fixes, token, readable)?,
            None => {}
        }
        match &mut self.headings {
            Some(Headings::Imu(headings)) => registry.register(headings, token, readable)?,
            Some(Headings::Quaternion(headings)) => registry.register(headings, token, readable)?,
            None => {}
        }
        if let Some(odometry) = &mut self.odometry {
            registry.register(odometry, token, readable)?;
        }
        if let Some(imu) = &mut self.imu {
            registry.register(imu, token, readable)?;
        }
        if let Some(joint_states) = &mut self.joint_states {
            registry.register(joint_states, token, readable)?;
        }
        for subscription in &mut self.emergency_stop {
            registry.register(subscription, token, readable)?;
        }
        if let Some(clock) = &mut self.clock {
            registry.register(clock, token, readable)?;
        }
        match &mut self.forwarded {
            Some(Forwarded::Plain(twist)) => registry.register(twist, token, readable)?,
            Some(Forwarded::Stamped(twist)) => registry.register(twist, token, readable)?,
            None => {}
        }
        registry.register(&mut self.tf, token, readable)?;
        registry.register(&mut self.tf_static, token, readable)
    }
}

/// Where topics are entered that are waited for.
struct Waits<'a> {
    node: &'a RosNode,
    subscriber: &'a InputSubscriber,
}

impl Waits<'_> {
    fn for_topic<M: TopicMessage>(
        &self,
        input: &'static str,
        topic: &str,
        needed: bool,
    ) -> Result<(), NameError> {
        let name = self.node.names().resolve(topic)?.to_string();
        let kind = format!("{}/msg/{}", M::PACKAGE, M::TYPE);
        let mut graph = self.subscriber.context.shared.graph();
        graph.wait_for(input, (topic, name), kind, needed);
        Ok(())
    }
}

struct InputReader {
    subscriber: InputSubscriber,
    subscriptions: Subscriptions,
    readings: NewestReadings,
    slot: Input<LatestInputs>,
}

impl InputReader {
    /// Reads all messages that have arrived: the emergency stop first, then the clocks, then the rest.
    fn read(&mut self) {
        self.read_emergency_stop();
        self.readings.follow_system_time();
        let (subscriptions, readings) = (&self.subscriptions, &mut self.readings);
        if let Some(clock) = &subscriptions.clock {
            take_all(clock, |message, _| readings.clock(&message));
        }
        take_all(&subscriptions.tf, |message, _| {
            readings.transforms(&message, false);
        });
        take_all(&subscriptions.tf_static, |message, _| {
            readings.transforms(&message, true);
        });
        match &subscriptions.poses {
            Some(Poses::Odometry(poses)) => {
                take_all(poses, |message, info| {
                    let Odometry {
                        header,
                        child_frame_id,
                        pose,
                        ..
                    } = &message;
                    let child_frame = Some(child_frame_id.as_str());
                    readings.pose(header, child_frame, &pose.pose, info.publisher_gid());
                });
            }
            Some(Poses::Stamped(poses)) => {
                take_all(poses, |message, info| {
                    let PoseWithCovarianceStamped { header, pose } = &message;
                    readings.pose(header, None, &pose.pose, info.publisher_gid());
                });
            }
            Some(Poses::Fix(fixes)) => {
                take_all(fixes, |message, info| {
                    readings.fix(&message, info.publisher_gid());
                });
            }
            None => {}
        }
        match &subscriptions.headings {
            Some(Headings::Imu(headings)) => {
                take_all(headings, |message, info| {
                    let Imu {
                        header,
                        orientation,
                        orientation_covariance,
                        ..
                    } = &message;
                    // -1 in the first place says that there is no orientation.
                    let variance = match orientation_covariance[0] {
                        -1.0 => -1.0,
                        _ => orientation_covariance[8],
                    };
                    readings.heading(header, orientation, Some(variance), info.publisher_gid());
                });
            }
            Some(Headings::Quaternion(headings)) => {
                take_all(headings, |message, info| {
                    let QuaternionStamped { header, quaternion } = &message;
                    readings.heading(header, quaternion, None, info.publisher_gid());
                });
            }
            None => {}
        }
        if let Some(odometry) = &subscriptions.odometry {
            take_all(odometry, |message, info| {
                readings.odometry(&message, info.publisher_gid());
            });
        }
        if let Some(imu) = &subscriptions.imu {
            take_all(imu, |message, info| {
                readings.imu(&message, info.publisher_gid());
            });
        }
        if let Some(TwistConfig { topic, .. }) = &self.subscriber.forwarded {
            match &subscriptions.forwarded {
                Some(Forwarded::Plain(twist)) => {
                    take_all(twist, |message, _| readings.forwarded(topic, &message));
                }
                Some(Forwarded::Stamped(twist)) => {
                    take_all(twist, |message, _| {
                        readings.forwarded(topic, &message.twist)
                    });
                }
                None => {}
            }
        }
        if let Some(joint_states) = &subscriptions.joint_states {
            take_all(joint_states, |message, info| {
                readings.joint_states(&message, info.publisher_gid());
            });
        }
        self.slot.write(readings.latest());
    }

    fn read_emergency_stop(&self) {
        let shared = &self.subscriber.context.shared;
        let mut publishers = shared.estop_publishers();
        for subscription in &self.subscriptions.emergency_stop {
            take_all(subscription, |Bool { data }, info| {
                let message = (info.publisher_gid(), info.sequence_number());
                publishers.received(message, data, Instant::now());
                shared
                    .graph()
                    .accepted(&self.subscriber.config.emergency_stop);
            });
        }
        publishers.process_lost(Instant::now());
        let timeout_s = self.subscriber.config.emergency_stop_timeout_s;
        let cause = publishers.cause(Duration::from_secs_f64(timeout_s));
        // The halt is set before the lock is released: a thread that waits for a publisher sees its effect.
        self.subscriber.halt.set(cause);
        shared.emergency_stop.set(cause);
    }
}

#[cfg(test)]
mod tests;
