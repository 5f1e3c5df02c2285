//! Drives and sensors of a vehicle over topics, as a port of the control loop.

use super::readings::{LatestInputs, PortContext};
use super::shared_inputs::SharedInputs;
use crate::node::time::RosTime;
use crate::node::worker::Worker;
use crate::node::{NodeError, RosNode, qos};
use ros2_client::Publisher;
use sidehill_bridge::drives::{
    DriveCommand, DriveFeedback, DriveMode, LinkState, MeasuredMotorSpeeds, Port, PortInputs,
    SendError, newer,
};
use sidehill_bridge::ros2::conversions::stamp;
use sidehill_bridge::ros2::convert::TwistMapping;
use sidehill_bridge::ros2::joints::TreadJoints;
use sidehill_bridge::ros2::message::{Float64, Float64MultiArray, Header, Twist, TwistStamped};
use sidehill_bridge::ros2::settings::topics::{CommandsConfig, SpeedSource};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::vehicle::SpeedCorrection;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use thread_priority::ThreadId;
use triple_buffer::{Input, Output, triple_buffer};

/// Oldest command of another node that counts as the speed of the treads, s.
const COMMAND_S: f64 = 0.5;
/// Zeros that are published after the drives were disabled; then the topics are free for other publishers.
const LAST_ZEROS: u32 = 5;

/// The command of a control cycle.
#[derive(Debug, Clone, Copy, Default)]
struct TimedCommand {
    time_s: f64,
    motors: MeasuredMotorSpeeds,
    enable: bool,
}

/// A vehicle on the ROS 2 graph. ROS has no handshake to enable drives: they count as enabled or disabled as
/// commanded while their feedback is fresh.
pub struct Ros2Port {
    latest: Output<LatestInputs>,
    shared: Arc<SharedInputs>,
    correction: SpeedCorrection,
    mode: DriveMode,
    /// Whether commands count as the speeds of the treads, and the newest of this program.
    reaches_commands: bool,
    commanded: MeasuredMotorSpeeds,
    last_s: f64,
    /// Times of the tread speeds, attitude, yaw rate and pose delivered last, s.
    delivered_s: [f64; 4],
    command: Input<TimedCommand>,
    publisher: Worker,
    inputs: Worker,
}

impl Ros2Port {
    pub(crate) fn new(
        node: &mut RosNode,
        (config, speeds): (&CommandsConfig, SpeedSource),
        correction: SpeedCorrection,
        context: PortContext,
        (inputs, latest): (Worker, Output<LatestInputs>),
    ) -> Result<Self, NodeError> {
        let commands = CommandPublisher {
            twist: match &config.twist {
                Some(twist) if twist.stamped => {
                    TwistTopic::Stamped(node.publisher(&twist.topic, &qos::STREAM)?)
                }
                Some(twist) => TwistTopic::Plain(node.publisher(&twist.topic, &qos::STREAM)?),
                None => TwistTopic::None,
            },
            treads: match &config.treads {
                Some(treads) => {
                    let topic = node.publisher(&treads.topic, &qos::STREAM)?;
                    Some((topic, treads.joints.clone()))
                }
                None => None,
            },
            motors: match &config.motors {
                Some(motors) => Some([
                    node.publisher(&motors.traction, &qos::STREAM)?,
                    node.publisher(&motors.steer, &qos::STREAM)?,
                ]),
                None => None,
            },
            mapping: context.mapping,
            base_frame: context.frames.base,
            time: context.time,
        };
        let (command, mut newest) = triple_buffer(&TimedCommand::default());
        let publisher = Worker::start("ros2 commands", move |end| {
            // Nothing is published before the drives are first enabled.
            let mut zeros = LAST_ZEROS;
            loop {
                if newest.update() {
                    let command = *newest.output_buffer();
                    zeros = if command.enable {
                        0
                    } else {
                        zeros.saturating_add(1)
                    };
                    if zeros <= LAST_ZEROS {
                        commands.publish(&command);
                    }
                } else if end.load(Ordering::Relaxed) {
                    break;
                } else {
                    std::thread::park_timeout(Duration::from_millis(50));
                }
            }
        })?;
        Ok(Self {
            latest,
            shared: context.shared,
            correction,
            mode: DriveMode::Disabled,
            reaches_commands: speeds == SpeedSource::Commands,
            commanded: MeasuredMotorSpeeds::default(),
            last_s: f64::NEG_INFINITY,
            delivered_s: [f64::NEG_INFINITY; 4],
            command,
            publisher,
            inputs,
        })
    }
}

impl Port for Ros2Port {
    fn helper_threads(&self) -> Vec<ThreadId> {
        let workers = [&self.inputs, &self.publisher];
        workers.into_iter().filter_map(Worker::thread_id).collect()
    }

    fn receive(&mut self, now_s: f64) -> PortInputs {
        let mut latest = *self.latest.read();
        if self.reaches_commands {
            let forwarded = latest.forwarded;
            let reached = match forwarded.filter(|sent| now_s - sent.time_s <= COMMAND_S) {
                Some(sent) => sent.value,
                None => self.commanded,
            };
            latest.motors = Some(Stamped {
                time_s: now_s,
                value: reached,
            });
        }
        if now_s < self.last_s {
            // The clock was set back: older readings are new again.
            self.delivered_s = [f64::NEG_INFINITY; 4];
        }
        self.last_s = now_s;
        let [treads_s, attitude_s, yaw_rate_s, pose_s] = &mut self.delivered_s;
        let treads = latest.motors.map(|motors| Stamped {
            time_s: motors.time_s,
            value: motors.value.into(),
        });
        PortInputs {
            sample: Sample {
                time_s: now_s,
                tread_speeds: newer(treads, treads_s),
                attitude: newer(latest.attitude, attitude_s),
                yaw_rate: newer(latest.yaw_rate, yaw_rate_s),
                pose: newer(latest.pose, pose_s),
            },
            feedback: latest.motors.map(|motors| Stamped {
                time_s: motors.time_s,
                value: DriveFeedback {
                    speeds: motors.value.effective(&self.correction),
                    mode: self.mode,
                },
            }),
            forwarded: latest.forwarded.map(|forwarded| Stamped {
                time_s: forwarded.time_s,
                value: forwarded.value.effective(&self.correction),
            }),
            link: LinkState::Active,
            refused: self.shared.rejected(),
        }
    }

    fn send(&mut self, now_s: f64, command: &DriveCommand) -> Result<(), SendError> {
        let thread = self.publisher.thread().ok_or(SendError::ThreadEnded)?;
        self.mode = match command.enable {
            true => DriveMode::Enabled,
            false => DriveMode::Disabled,
        };
        let motors = MeasuredMotorSpeeds::reaching(command.speeds, &self.correction);
        self.commanded = match command.enable {
            true => motors,
            false => MeasuredMotorSpeeds::default(),
        };
        self.command.write(TimedCommand {
            time_s: now_s,
            motors,
            enable: command.enable,
        });
        thread.unpark();
        Ok(())
    }
}

enum TwistTopic {
    None,
    Plain(Publisher<Twist>),
    Stamped(Publisher<TwistStamped>),
}

/// Publishes commands. A full queue drops a command: the next one is newer.
struct CommandPublisher {
    twist: TwistTopic,
    treads: Option<(Publisher<Float64MultiArray>, TreadJoints)>,
    motors: Option<[Publisher<Float64>; 2]>,
    mapping: TwistMapping,
    base_frame: String,
    time: RosTime,
}

impl CommandPublisher {
    fn publish(&self, command: &TimedCommand) {
        let motors = if command.enable {
            command.motors
        } else {
            MeasuredMotorSpeeds::default()
        };
        let twist = self.mapping.twist(motors);
        match &self.twist {
            TwistTopic::None => {}
            TwistTopic::Plain(topic) => {
                let _ = topic.publish(twist);
            }
            TwistTopic::Stamped(topic) => {
                let header = Header {
                    stamp: stamp(self.time.stamp_ns(command.time_s)),
                    frame_id: self.base_frame.clone(),
                };
                let _ = topic.publish(TwistStamped { header, twist });
            }
        }
        if let Some((topic, joints)) = &self.treads {
            let _ = topic.publish(joints.command(motors.into()));
        }
        if let Some([traction, steer]) = &self.motors {
            let _ = traction.publish(Float64 {
                data: motors.traction_m_s,
            });
            let _ = steer.publish(Float64 {
                data: motors.steer_m_s,
            });
        }
    }
}
