//! What is heard on the graph for the cycle: poses, attitude, tread speeds, the emergency stop, the
//! clock, and transforms.

use super::config::{AttitudeSource, Frames, InputsConfig, SpeedSource};
use super::convert::{
    MessageFault, TwistMapping, from_pose, from_quaternion, from_transform, nanoseconds,
    pose_and_attitude,
};
use super::emergency_stop::EmergencyStop;
use super::message::{Bool, Clock, Header, Imu, JointState, Odometry, TfMessage};
use super::node::{NodeError, RosNode};
use super::qos;
use super::time::RosTime;
use super::transform::Transforms;
use super::worker::Worker;
use crate::control_loop::channel::{HaltSwitch, SharedCause};
use crate::drives::MeasuredMotorSpeeds;
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use ros2_client::{Gid, Subscription};
use sidehill_plant::frames::{Attitude, Pose, paper_attitude};
use sidehill_plant::sample::Stamped;
use sidehill_plant::vehicle::RangeError;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use triple_buffer::{Input, Output, triple_buffer};

/// How far ahead of the clock a stamp may be, s.
const AHEAD_S: f64 = 0.1;
/// A step of /clock that is a jump, s; any step back is one.
const CLOCK_JUMP_S: f64 = 2.0;

/// The newest of everything, for the cycle.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Heard {
    pub(super) pose: Option<Stamped<Pose>>,
    pub(super) attitude: Option<Stamped<Attitude>>,
    pub(super) motors: Option<Stamped<MeasuredMotorSpeeds>>,
}

/// What more than one thread looks at.
#[derive(Default)]
pub(super) struct Shared {
    transforms: Mutex<Transforms>,
    last_refusal: Mutex<String>,
    pub(super) refused: AtomicU64,
    pub(super) emergency_stop: SharedCause,
    words: Mutex<EmergencyStop>,
    pub(super) clock_jumps: AtomicU64,
    /// Bits of the speed, m/s, and the yaw rate, rad/s, below which odometry says 0.
    thresholds: [AtomicU64; 2],
}

impl Shared {
    pub(super) fn set_thresholds(&self, thresholds: [f64; 2]) {
        for (slot, value) in self.thresholds.iter().zip(thresholds) {
            slot.store(value.to_bits(), Ordering::Relaxed);
        }
    }

    /// Who has said what of the emergency stop.
    pub(super) fn words(&self) -> MutexGuard<'_, EmergencyStop> {
        self.words.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn thresholds(&self) -> [f64; 2] {
        let [speed, yaw_rate] = &self.thresholds;
        [speed, yaw_rate].map(|slot| f64::from_bits(slot.load(Ordering::Relaxed)))
    }

    pub(super) fn transforms(&self) -> MutexGuard<'_, Transforms> {
        self.transforms
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn last_refusal(&self) -> MutexGuard<'_, String> {
        self.last_refusal
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn refuse(&self, topic: &str, why: &Refusal) {
        self.refused.fetch_add(1, Ordering::Relaxed);
        *self.last_refusal() = format!("{topic}: {why}");
    }
}

/// Why a message is not believed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
enum Refusal {
    #[error(transparent)]
    Message(#[from] MessageFault),
    #[error("it is in {found}, must be in {wanted}")]
    Frame { found: String, wanted: String },
    #[error("its stamp is {ahead_s:.3} s ahead of the clock")]
    Ahead { ahead_s: f64 },
    #[error(transparent)]
    Transform(#[from] super::transform::TransformError),
}

/// What the threads of a node have in common.
#[derive(Clone)]
pub(super) struct Common {
    pub(super) frames: Frames,
    pub(super) mapping: TwistMapping,
    pub(super) time: RosTime,
    pub(super) shared: Arc<Shared>,
}

/// Settings of the listening thread.
pub(super) struct Ears {
    pub(super) config: InputsConfig,
    pub(super) common: Common,
    pub(super) brake: HaltSwitch,
    /// Whether the vehicle is listened to, or only what concerns paths.
    pub(super) drives: bool,
}

/// Why there is no thread.
#[derive(Debug, thiserror::Error)]
pub enum ListenError {
    /// No subscription.
    #[error(transparent)]
    Node(#[from] NodeError),
    /// No thread or poll.
    #[error("ROS 2: {0}")]
    System(#[from] std::io::Error),
    /// A setting out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
}

struct Subscriptions {
    odometry: Option<Subscription<Odometry>>,
    imu: Option<Subscription<Imu>>,
    joints: Option<Subscription<JointState>>,
    /// A reader that wants what was said before it does not match a writer that keeps nothing: so
    /// there are two.
    emergency_stop: [Subscription<Bool>; 2],
    clock: Option<Subscription<Clock>>,
    tf: Subscription<TfMessage>,
    tf_static: Subscription<TfMessage>,
}

impl Ears {
    /// Starts to listen.
    pub(super) fn listen(self, node: &mut RosNode) -> Result<(Worker, Output<Heard>), ListenError> {
        let config = &self.config;
        let mut subscriptions = Subscriptions {
            odometry: match self.drives {
                true => Some(node.subscription(&config.odometry, &qos::NEWEST)?),
                false => None,
            },
            imu: match config.attitude {
                AttitudeSource::Imu if self.drives => {
                    Some(node.subscription(&config.imu, &qos::NEWEST)?)
                }
                _ => None,
            },
            joints: match config.speeds {
                SpeedSource::JointStates if self.drives => {
                    Some(node.subscription(&config.joint_states, &qos::NEWEST)?)
                }
                _ => None,
            },
            emergency_stop: [
                node.subscription(&config.emergency_stop, &qos::RELIABLE_10)?,
                node.subscription(&config.emergency_stop, &qos::LATCHED)?,
            ],
            clock: match self.common.time.told_clock() {
                Some(_) => Some(node.subscription("/clock", &qos::NEWEST)?),
                None => None,
            },
            tf: node.subscription("/tf", &qos::RELIABLE_10)?,
            tf_static: node.subscription("/tf_static", &qos::LATCHED_ALL)?,
        };
        let mut poll = Poll::new()?;
        subscriptions.register(&poll)?;
        let (slot, heard) = triple_buffer(&Heard::default());
        let worker = Worker::start("ros2 inputs", move |end| {
            let mut listener = Listener {
                ears: self,
                subscriptions,
                heard: Heard::default(),
                slot,
                clock_s: None,
            };
            let mut events = Events::with_capacity(64);
            while !end.load(Ordering::Relaxed) {
                // A poll that fails is a poll that has not waited.
                if poll
                    .poll(&mut events, Some(Duration::from_millis(50)))
                    .is_err()
                {
                    std::thread::sleep(Duration::from_millis(1));
                }
                listener.hear();
            }
        })?;
        Ok((worker, heard))
    }
}

impl Subscriptions {
    fn register(&mut self, poll: &Poll) -> std::io::Result<()> {
        let (registry, token, readable) = (poll.registry(), Token(0), Interest::READABLE);
        if let Some(odometry) = &mut self.odometry {
            registry.register(odometry, token, readable)?;
        }
        if let Some(imu) = &mut self.imu {
            registry.register(imu, token, readable)?;
        }
        if let Some(joints) = &mut self.joints {
            registry.register(joints, token, readable)?;
        }
        for subscription in &mut self.emergency_stop {
            registry.register(subscription, token, readable)?;
        }
        if let Some(clock) = &mut self.clock {
            registry.register(clock, token, readable)?;
        }
        registry.register(&mut self.tf, token, readable)?;
        registry.register(&mut self.tf_static, token, readable)
    }
}

struct Listener {
    ears: Ears,
    subscriptions: Subscriptions,
    heard: Heard,
    slot: Input<Heard>,
    clock_s: Option<f64>,
}

impl Listener {
    fn hear(&mut self) {
        let ears = &self.ears;
        let (shared, config) = (&ears.common.shared, &ears.config);
        let mut words = shared.words();
        for subscription in &self.subscriptions.emergency_stop {
            drain_from(subscription, |Bool { data }, writer| {
                words.take(writer, data, Instant::now());
            });
        }
        words.settle(Instant::now());
        let timeout = Duration::from_secs_f64(config.emergency_stop_timeout_s);
        let stop = words.cause(timeout);
        ears.brake.set(stop);
        shared.emergency_stop.set(stop);
        // Who awaits a word sees what came of it.
        drop(words);

        if let (Some(subscription), Some(clock)) =
            (&self.subscriptions.clock, ears.common.time.told_clock())
        {
            let (mut clock_s, mut jumped) = (self.clock_s, false);
            drain(subscription, |message: Clock| {
                let Ok(now_ns) = nanoseconds(message.clock) else {
                    return;
                };
                let now_s = ears.common.time.cycle_s(now_ns);
                jumped |= clock_s
                    .is_some_and(|before_s| !(0.0..=CLOCK_JUMP_S).contains(&(now_s - before_s)));
                clock_s = Some(now_s);
                clock.tell(now_s);
            });
            self.clock_s = clock_s;
            if jumped {
                shared.transforms().forget();
                self.heard = Heard::default();
                shared.clock_jumps.fetch_add(1, Ordering::Relaxed);
            }
        }
        for (subscription, fixed) in [
            (&self.subscriptions.tf, false),
            (&self.subscriptions.tf_static, true),
        ] {
            drain(subscription, |message: TfMessage| {
                if let Err(why) = take_transforms(ears, &message, fixed) {
                    shared.refuse("tf", &why);
                }
            });
        }
        let heard = &mut self.heard;
        if let Some(odometry) = &self.subscriptions.odometry {
            drain(odometry, |message| {
                if let Err(why) = take_odometry(ears, &message, heard) {
                    shared.refuse(&config.odometry, &why);
                }
            });
        }
        if let Some(imu) = &self.subscriptions.imu {
            drain(imu, |message| match attitude(ears, &message) {
                Ok(attitude) => heard.attitude = Some(attitude),
                Err(why) => shared.refuse(&config.imu, &why),
            });
        }
        if let Some(joints) = &self.subscriptions.joints {
            drain(joints, |message| match motors(ears, &message) {
                Ok(motors) => heard.motors = Some(motors),
                // Joints of other parts come on the same topic.
                Err(Refusal::Message(MessageFault::Joint { .. })) => {}
                Err(why) => shared.refuse(&config.joint_states, &why),
            });
        }
        self.slot.write(self.heard);
    }
}

/// Passes all that has come to `take`.
pub(super) fn drain<M>(subscription: &Subscription<M>, mut take: impl FnMut(M))
where
    M: 'static + serde::de::DeserializeOwned,
{
    drain_from(subscription, |message, _| take(message));
}

/// Passes all that has come to `take`, with who wrote it.
fn drain_from<M>(subscription: &Subscription<M>, mut take: impl FnMut(M, Gid))
where
    M: 'static + serde::de::DeserializeOwned,
{
    // What cannot be read is passed over, but not for ever.
    let mut unreadable = 0;
    while unreadable < 100 {
        match subscription.take() {
            Ok(Some((message, info))) => take(message, info.publisher_gid()),
            Ok(None) => return,
            Err(_) => unreadable += 1,
        }
    }
}

/// Returns the instant of a stamp; a stamp of zero is one that was not set.
fn instant(ears: &Ears, header: &Header) -> Result<f64, Refusal> {
    let (stamp_ns, now_s) = (nanoseconds(header.stamp)?, ears.common.time.now_s());
    if stamp_ns == 0 && ears.common.time.told_clock().is_none() {
        return Ok(now_s);
    }
    let time_s = ears.common.time.cycle_s(stamp_ns);
    let ahead_s = time_s - now_s;
    if ahead_s > AHEAD_S {
        return Err(Refusal::Ahead { ahead_s });
    }
    Ok(time_s.min(now_s))
}

fn in_frame(found: &str, wanted: &str) -> Result<(), Refusal> {
    let plain = |frame: &str| frame.trim_start_matches('/').to_owned();
    let (found, wanted) = (plain(found), plain(wanted));
    if found == wanted {
        Ok(())
    } else {
        Err(Refusal::Frame { found, wanted })
    }
}

fn take_odometry(ears: &Ears, message: &Odometry, heard: &mut Heard) -> Result<(), Refusal> {
    in_frame(&message.header.frame_id, &ears.common.frames.odometry)?;
    in_frame(&message.child_frame_id, &ears.common.frames.base)?;
    let time_s = instant(ears, &message.header)?;
    let (pose, attitude) = pose_and_attitude(&from_pose(&message.pose.pose)?);
    let mut twist = message.twist.twist.clone();
    let [speed_m_s, yaw_rate_rad_s] = ears.common.shared.thresholds();
    for (value, threshold) in [
        (&mut twist.linear.x, speed_m_s),
        (&mut twist.angular.z, yaw_rate_rad_s),
    ] {
        if value.abs() < threshold {
            *value = 0.0;
        }
    }
    let motors = ears.common.mapping.motors(&twist)?;
    heard.pose = Some(Stamped {
        time_s,
        value: pose,
    });
    if ears.config.attitude == AttitudeSource::Odometry {
        heard.attitude = Some(Stamped {
            time_s,
            value: attitude,
        });
    }
    if ears.config.speeds == SpeedSource::Odometry {
        heard.motors = Some(Stamped {
            time_s,
            value: motors,
        });
    }
    Ok(())
}

fn attitude(ears: &Ears, message: &Imu) -> Result<Stamped<Attitude>, Refusal> {
    let time_s = instant(ears, &message.header)?;
    let world_from_imu = from_quaternion(&message.orientation)?;
    let (imu, base) = (&message.header.frame_id, &ears.common.frames.base);
    let world_from_base = match in_frame(imu, base) {
        Ok(()) => world_from_imu,
        Err(_) => {
            // How it is mounted.
            let known = ears.common.shared.transforms();
            world_from_imu * known.look_up(imu, base, time_s, 0.0)?.rotation
        }
    };
    Ok(Stamped {
        time_s,
        value: paper_attitude(&world_from_base).0,
    })
}

fn motors(ears: &Ears, message: &JointState) -> Result<Stamped<MeasuredMotorSpeeds>, Refusal> {
    let value = ears.config.joints.treads(message)?.into();
    let time_s = instant(ears, &message.header)?;
    Ok(Stamped { time_s, value })
}

fn take_transforms(ears: &Ears, message: &TfMessage, fixed: bool) -> Result<(), Refusal> {
    let mut known = ears.common.shared.transforms();
    for stamped in &message.transforms {
        let time_s = ears.common.time.cycle_s(nanoseconds(stamped.header.stamp)?);
        let pose = from_transform(&stamped.transform)?;
        let (parent, child) = (&stamped.header.frame_id, &stamped.child_frame_id);
        known.take(parent, child, time_s, pose, fixed);
    }
    Ok(())
}
