//! The topics of a virtual vehicle.

use crate::node::{NodeError, RosNode, qos};
use nalgebra::Isometry3;
use ros2_client::{Publisher, Subscription};
use serde::de::DeserializeOwned;
use sidehill_bridge::drives::MeasuredMotorSpeeds;
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::conversions;
use sidehill_bridge::ros2::message::{
    Bool, Clock, Float64, Float64MultiArray, Header, Imu, JointState, NavSatFix, Odometry,
    TfMessage, TransformStamped, Twist, TwistStamped,
};
use sidehill_bridge::ros2::rover::{CommandKind, GNSS_FRAME, Report, RosVehicle, map_from_odom};

/// Fastest command that is no damaged message, m/s: drives limit what they are told, but a number may be any.
const COMMAND_MAX_M_S: f64 = 1e3;

/// A vehicle's node: sends reports and hears commands, and never waits for either.
pub struct VehicleNode {
    odometry: Publisher<Odometry>,
    fix: Option<Publisher<NavSatFix>>,
    imu: Publisher<Imu>,
    transforms: Publisher<TfMessage>,
    _fixed_transforms: Publisher<TfMessage>,
    joint_states: Publisher<JointState>,
    emergency_stop: Publisher<Bool>,
    /// What was said last of the emergency stop. Said at changes only: RustDDS keeps all that a
    /// latched topic has carried, and a late subscription gets it all.
    pressed: Option<bool>,
    clock: Option<Publisher<Clock>>,
    commands: Commands,
    refused: u64,
    unsent: u64,
    // Last to go, after all that it made.
    _node: RosNode,
}

enum Commands {
    Twist(Subscription<Twist>),
    TwistStamped(Subscription<TwistStamped>),
    TreadVelocities(Subscription<Float64MultiArray>),
    Motors(Box<MotorCommands>),
}

/// Two topics that make a command together.
struct MotorCommands {
    traction: Subscription<Float64>,
    steer: Subscription<Float64>,
    newest: [Option<f64>; 2],
}

impl VehicleNode {
    /// Returns the node of a vehicle, on the graph from now on.
    ///
    /// # Errors
    /// [`NodeError`]: a name that is not allowed, or a network that cannot be used.
    pub fn start(
        vehicle: &RosVehicle,
        origin_ns: i64,
        arguments: &RosArguments,
        environment: &RosEnvironment,
    ) -> Result<Self, NodeError> {
        let config = vehicle.config();
        let mut node = RosNode::start(&config.node, arguments, environment)?;
        let fixed_transforms = node.publisher("/tf_static", &qos::LATCHED)?;
        let frames = &config.frames;
        // Odometry of the wheels drifts: its frame has no fixed place in the map, but the antenna has one.
        let (parent, child, transform) = match &config.gnss {
            Some(gnss) => {
                let antenna = gnss.antenna.in_base();
                (
                    &frames.base,
                    GNSS_FRAME,
                    Isometry3::translation(antenna.x, antenna.y, antenna.z),
                )
            }
            None => (&frames.map, frames.odom.as_str(), map_from_odom(config)),
        };
        // It cannot be lost: a late subscriber gets it on joining.
        let _ = fixed_transforms.publish(TfMessage {
            transforms: vec![TransformStamped {
                header: Header {
                    stamp: conversions::stamp(origin_ns),
                    frame_id: parent.clone(),
                },
                child_frame_id: child.to_owned(),
                transform: conversions::to_transform(&transform),
            }],
        });
        let commands = match config.command {
            CommandKind::Twist => Commands::Twist(node.subscription("cmd_vel", &qos::NEWEST)?),
            CommandKind::TwistStamped => {
                Commands::TwistStamped(node.subscription("cmd_vel", &qos::NEWEST)?)
            }
            CommandKind::TreadVelocities => Commands::TreadVelocities(
                node.subscription("tread_velocities/commands", &qos::NEWEST)?,
            ),
            CommandKind::Motors => Commands::Motors(Box::new(MotorCommands {
                traction: node.subscription("traction/command", &qos::NEWEST)?,
                steer: node.subscription("steer/command", &qos::NEWEST)?,
                newest: [None; 2],
            })),
        };
        Ok(Self {
            odometry: node.publisher("odom", &qos::STREAM)?,
            fix: match config.gnss {
                Some(_) => Some(node.publisher("fix", &qos::STREAM)?),
                None => None,
            },
            imu: node.publisher("imu", &qos::STREAM)?,
            transforms: node.publisher("/tf", &qos::RELIABLE_10)?,
            _fixed_transforms: fixed_transforms,
            joint_states: node.publisher("joint_states", &qos::STREAM)?,
            emergency_stop: node.publisher("emergency_stop", &qos::LATCHED)?,
            pressed: None,
            clock: match config.clock_factor {
                Some(_) => Some(node.publisher("/clock", &qos::STREAM)?),
                None => None,
            },
            commands,
            refused: 0,
            unsent: 0,
            _node: node,
        })
    }

    /// Returns how many commands were refused, being no numbers or damaged.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Returns how many messages could not be sent.
    pub fn unsent(&self) -> u64 {
        self.unsent
    }

    /// Returns the newest command that has arrived since the last call, unless no vehicle can have been meant.
    pub fn command(&mut self, vehicle: &RosVehicle) -> Option<MeasuredMotorSpeeds> {
        let command = self.newest_command(vehicle)?;
        let fastest_m_s = command.traction_m_s.abs().max(command.steer_m_s.abs());
        if fastest_m_s > COMMAND_MAX_M_S {
            self.refused += 1;
            return None;
        }
        Some(command)
    }

    fn newest_command(&mut self, vehicle: &RosVehicle) -> Option<MeasuredMotorSpeeds> {
        let (twist, joints) = (vehicle.twist(), &vehicle.config().joints);
        let refused = &mut self.refused;
        match &mut self.commands {
            Commands::Twist(topic) => newest(topic, refused, |message| twist.motors(&message)),
            Commands::TwistStamped(topic) => {
                newest(topic, refused, |message| twist.motors(&message.twist))
            }
            Commands::TreadVelocities(topic) => newest(topic, refused, |message| {
                joints.commanded(&message).map(MeasuredMotorSpeeds::from)
            }),
            Commands::Motors(motors) => {
                let finite = |message: Float64| match message.data.is_finite() {
                    true => Ok(message.data),
                    false => Err(()),
                };
                let came = [
                    newest(&motors.traction, refused, finite),
                    newest(&motors.steer, refused, finite),
                ];
                // A command is complete when both have arrived.
                for (value, came) in motors.newest.iter_mut().zip(came) {
                    *value = came.or(*value);
                }
                let [Some(traction_m_s), Some(steer_m_s)] = motors.newest else {
                    return None;
                };
                motors.newest = [None; 2];
                Some(MeasuredMotorSpeeds {
                    traction_m_s,
                    steer_m_s,
                })
            }
        }
    }

    /// Publishes a report.
    pub fn publish(&mut self, report: Report) {
        let unsent = &mut self.unsent;
        let mut count = |lost: bool| *unsent += u64::from(lost);
        // The clock first, so that no stamp is from the future.
        if let Some((topic, clock)) = self.clock.as_ref().zip(report.clock) {
            count(topic.publish(Clock { clock }).is_err());
        }
        if let Some(message) = report.transforms {
            count(self.transforms.publish(message).is_err());
        }
        if let Some(message) = report.odometry {
            count(self.odometry.publish(message).is_err());
        }
        if let Some((topic, message)) = self.fix.as_ref().zip(report.fix) {
            count(topic.publish(message).is_err());
        }
        if let Some(message) = report.imu {
            count(self.imu.publish(message).is_err());
        }
        if let Some(message) = report.joint_states {
            count(self.joint_states.publish(message).is_err());
        }
        let data = report.emergency_stop;
        if self.pressed != Some(data) {
            // What is lost is said again with the next report.
            let said = self.emergency_stop.publish(Bool { data }).is_ok();
            self.pressed = said.then_some(data);
            count(!said);
        }
    }
}

/// Takes all messages that have arrived and returns the value of the newest.
fn newest<M: DeserializeOwned + 'static, T, E>(
    topic: &Subscription<M>,
    refused: &mut u64,
    read: impl Fn(M) -> Result<T, E>,
) -> Option<T> {
    let mut newest = None;
    loop {
        match topic.take() {
            Ok(None) => return newest,
            Ok(Some((message, _))) => match read(message) {
                Ok(value) => newest = Some(value),
                Err(_) => *refused += 1,
            },
            // A damaged message has been taken all the same.
            Err(_) => *refused += 1,
        }
    }
}
