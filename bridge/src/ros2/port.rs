//! A vehicle on the ROS 2 graph.

use super::config::CommandsConfig;
use super::convert::{self, TreadJoints, TwistMapping};
use super::inputs::{Common, Heard, ListenError, Shared};
use super::message::{Float64, Float64MultiArray, Header, Twist, TwistStamped};
use super::node::RosNode;
use super::qos;
use super::time::RosTime;
use super::worker::Worker;
use crate::drives::{
    DriveCommand, DriveFeedback, DriveMode, LinkState, MeasuredMotorSpeeds, Port, PortInputs,
    SendError, newer,
};
use ros2_client::Publisher;
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::vehicle::SpeedCorrection;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use triple_buffer::{Input, Output, triple_buffer};

/// Zeros after the drives were switched off, before the topics are left to others, who may begin at once.
const LAST_ZEROS: u32 = 5;

/// What the drives are told in a cycle.
#[derive(Debug, Clone, Copy, Default)]
struct Told {
    time_s: f64,
    motors: MeasuredMotorSpeeds,
    enable: bool,
}

/// A vehicle on the ROS 2 graph. There is no handshake of drives in ROS: they are taken to be as they
/// were told while their feedback is fresh.
pub struct Ros2Port {
    heard: Output<Heard>,
    shared: Arc<Shared>,
    correction: SpeedCorrection,
    mode: DriveMode,
    last_s: f64,
    /// Instants of the tread speeds, attitude and pose delivered last, s.
    delivered_s: [f64; 3],
    told: Input<Told>,
    speaker: Worker,
    /// Kept for its thread.
    _listener: Worker,
}

impl Ros2Port {
    pub(super) fn new(
        node: &mut RosNode,
        config: &CommandsConfig,
        correction: SpeedCorrection,
        common: Common,
        (listener, heard): (Worker, Output<Heard>),
    ) -> Result<Self, ListenError> {
        let speaker = Speaker {
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
            mapping: common.mapping,
            base_frame: common.frames.base,
            time: common.time,
        };
        let (told, mut newest) = triple_buffer(&Told::default());
        let speaker = Worker::start("ros2 commands", move |end| {
            // Nothing is said before the drives are switched on first.
            let mut zeros = LAST_ZEROS;
            loop {
                if newest.update() {
                    let told = *newest.output_buffer();
                    zeros = if told.enable {
                        0
                    } else {
                        zeros.saturating_add(1)
                    };
                    if zeros <= LAST_ZEROS {
                        speaker.say(&told);
                    }
                } else if end.load(Ordering::Relaxed) {
                    break;
                } else {
                    std::thread::park_timeout(Duration::from_millis(50));
                }
            }
        })?;
        Ok(Self {
            heard,
            shared: common.shared,
            correction,
            mode: DriveMode::Disabled,
            last_s: f64::NEG_INFINITY,
            delivered_s: [f64::NEG_INFINITY; 3],
            told,
            speaker,
            _listener: listener,
        })
    }
}

impl Port for Ros2Port {
    fn receive(&mut self, now_s: f64) -> PortInputs {
        let heard = *self.heard.read();
        if now_s < self.last_s {
            // The clock was put back: what comes now is new.
            self.delivered_s = [f64::NEG_INFINITY; 3];
        }
        self.last_s = now_s;
        let [treads_s, attitude_s, pose_s] = &mut self.delivered_s;
        let treads = heard.motors.map(|motors| Stamped {
            time_s: motors.time_s,
            value: motors.value.into(),
        });
        PortInputs {
            sample: Sample {
                time_s: now_s,
                tread_speeds: newer(treads, treads_s),
                attitude: newer(heard.attitude, attitude_s),
                pose: newer(heard.pose, pose_s),
            },
            feedback: heard.motors.map(|motors| Stamped {
                time_s: motors.time_s,
                value: DriveFeedback {
                    speeds: motors.value.effective(&self.correction),
                    mode: self.mode,
                },
            }),
            link: LinkState::Active,
            refused: self.shared.refused.load(Ordering::Relaxed),
        }
    }

    fn send(&mut self, now_s: f64, order: &DriveCommand) -> Result<(), SendError> {
        let thread = self.speaker.thread().ok_or(SendError::Down)?;
        self.mode = match order.enable {
            true => DriveMode::Enabled,
            false => DriveMode::Disabled,
        };
        self.told.write(Told {
            time_s: now_s,
            motors: MeasuredMotorSpeeds::reaching(order.speeds, &self.correction),
            enable: order.enable,
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

/// Publishes commands. A queue that is full drops them: a later one is newer.
struct Speaker {
    twist: TwistTopic,
    treads: Option<(Publisher<Float64MultiArray>, TreadJoints)>,
    motors: Option<[Publisher<Float64>; 2]>,
    mapping: TwistMapping,
    base_frame: String,
    time: RosTime,
}

impl Speaker {
    fn say(&self, told: &Told) {
        let motors = if told.enable {
            told.motors
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
                    stamp: convert::stamp(self.time.stamp_ns(told.time_s)),
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
