//! The values of the chosen topics of a bag, each over its own times.

use super::choice::{
    Attitudes, Chosen, IMU, JOINT_STATE, NAV_SAT_FIX, ODOMETRY, POSE_STAMPED, POSE_WITH_COVARIANCE,
    PoseSource, TF_MESSAGE, TreadSpeedSource,
};
use super::fixes::{Fixes, one_publisher};
use super::interpolation::{Timed, in_order, seconds};
use super::joints::{Joints, WheelJoints};
use super::topics::{ImuAxes, StampSource};
use super::transform_poses::TransformPoses;
use crate::bag::{Bag, BagError, RecordedMessage};
use anyhow::{Context, Result, anyhow, bail};
use nalgebra::{Unit, UnitQuaternion, Vector3};
use serde::de::DeserializeOwned;
use sidehill_bridge::ros2::conversions::{from_pose, from_quaternion, from_transform, nanoseconds};
use sidehill_bridge::ros2::convert::pose_and_attitude;
use sidehill_bridge::ros2::message::cdr::from_cdr;
use sidehill_bridge::ros2::message::{
    self, Header, Imu, JointState, NavSatFix, Odometry, PoseStamped, PoseWithCovarianceStamped,
    TfMessage,
};
use sidehill_plant::frames::{Attitude, Pose, paper_attitude};
use sidehill_plant::log::ROWS_MAX;
use sidehill_plant::log::sources::Sources;
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::statistics::median;
use std::collections::BTreeMap;

/// How far the clocks of two sources may be apart, s: recorders are busy, and stamps precede them by less.
const CLOCKS_APART_MAX_S: f64 = 1.0;

/// The sources of a log.
#[derive(Debug)]
pub(super) struct Series {
    pub(super) sources: Sources<i64>,
    pub(super) notes: Vec<String>,
}

/// Collects values in one pass over the bag.
pub(super) struct Collected<'a> {
    bag: &'a Bag,
    chosen: &'a Chosen,
    /// Messages of each topic.
    topics: BTreeMap<String, TopicSeries>,
    joints: Joints,
    tread_speeds: Timed<MeasuredTreadSpeeds>,
    /// world_from_sensor by the topic of the Imu, with the frame of its first message.
    imus: BTreeMap<String, (String, Timed<UnitQuaternion<f64>>)>,
    attitudes: Timed<Attitude>,
    pub(super) poses: Timed<Pose>,
    pub(super) fixes: Fixes,
    transforms: TransformPoses,
}

/// What was taken of a topic.
#[derive(Default)]
struct TopicSeries {
    count: usize,
    /// Messages without a usable value, and why the first one has none.
    unusable: Option<(usize, String)>,
    /// Stamp less time of recording of each message, s; only where stamps count.
    ahead_s: Vec<f64>,
    /// Stamp of the message before, ns; likewise.
    stamp_ns: Option<i64>,
    /// Frame of the first pose.
    frame: Option<String>,
}

/// Reads the chosen topics.
pub(super) fn read(bag: &Bag, chosen: &Chosen) -> Result<Series> {
    let mut collected = Collected::new(bag, chosen);
    bag.read(&mut |message| collected.take(message))?;
    collected.series()
}

impl<'a> Collected<'a> {
    pub(super) fn new(bag: &'a Bag, chosen: &'a Chosen) -> Self {
        let frame = match (&chosen.pose, &chosen.attitude) {
            (PoseSource::Tf { frame }, _) | (_, Attitudes::Tf { frame }) => Some(frame.clone()),
            _ => None,
        };
        Self {
            bag,
            chosen,
            topics: BTreeMap::new(),
            joints: Joints::default(),
            tread_speeds: Vec::new(),
            imus: BTreeMap::new(),
            attitudes: Vec::new(),
            poses: Vec::new(),
            fixes: Fixes::default(),
            transforms: TransformPoses::new(frame, &chosen.base_frame),
        }
    }

    pub(super) fn take(&mut self, message: RecordedMessage<'_>) -> Result<(), BagError> {
        if !self.topics.contains_key(&message.topic.name) {
            self.topics
                .insert(message.topic.name.clone(), TopicSeries::default());
        }
        let number = self.topics.get_mut(&message.topic.name).map_or(0, |taken| {
            taken.count += 1;
            taken.count
        });
        let taken = match message.topic.message_type.as_str() {
            _ if number > ROWS_MAX => Err(anyhow!(
                "the topic has more than {ROWS_MAX} messages; cut the bag"
            )),
            JOINT_STATE => self.joint_state(&message),
            IMU => self.imu(&message),
            ODOMETRY => self.odometry(&message),
            POSE_STAMPED | POSE_WITH_COVARIANCE => self.pose_stamped(&message),
            NAV_SAT_FIX => self.fix(&message),
            TF_MESSAGE => self.transform(&message),
            _ => Ok(()),
        };
        taken.map_err(|error| BagError::Message {
            bag: self.bag.path().to_owned(),
            topic: message.topic.name.clone(),
            number,
            reason: format!("{error:#}"),
        })
    }

    /// Notes that a message has no value that can be used.
    fn unusable(&mut self, message: &RecordedMessage<'_>, reason: impl std::fmt::Display) {
        if let Some(taken) = self.topics.get_mut(&message.topic.name) {
            let (count, _) = taken
                .unusable
                .get_or_insert_with(|| (0, reason.to_string()));
            *count += 1;
        }
    }

    fn time_ns(&mut self, message: &RecordedMessage<'_>, header: &Header) -> Result<i64> {
        Ok(match self.chosen.time {
            StampSource::Received => message.received_ns,
            StampSource::Stamp => match nanoseconds(header.stamp)? {
                0 => bail!(
                    "its stamp is 0; with `time: received` in the topic map the time of recording counts"
                ),
                stamp_ns => {
                    if let Some(taken) = self.topics.get_mut(&message.topic.name) {
                        taken.ahead_s.push(seconds(message.received_ns, stamp_ns));
                        let before_ns = taken.stamp_ns.replace(stamp_ns).unwrap_or(stamp_ns);
                        let back_s = seconds(stamp_ns, before_ns);
                        // Transforms come from many, of which some look ahead.
                        if back_s > CLOCKS_APART_MAX_S && message.topic.message_type != TF_MESSAGE {
                            bail!(
                                "its stamp is {back_s:.2} s before that of the message before: the clock was set; cut the bag \
                                 there, or write `time: received` in the topic map (--topics): then the time of recording counts"
                            );
                        }
                    }
                    stamp_ns
                }
            },
        })
    }

    fn wheel_joints(&self) -> Option<WheelJoints<'a>> {
        match &self.chosen.tread_speeds {
            TreadSpeedSource::JointStates {
                topic,
                left,
                right,
                radius_m,
                reversed,
            } => Some(WheelJoints {
                topic,
                left,
                right,
                radius_m: *radius_m,
                reversed: *reversed,
            }),
            TreadSpeedSource::Odometry { .. } => None,
        }
    }

    fn joint_state(&mut self, message: &RecordedMessage<'_>) -> Result<()> {
        let Some(wheels) = self.wheel_joints() else {
            return Ok(());
        };
        if wheels.topic != message.topic.name {
            return Ok(());
        }
        let state: JointState = decode(message)?;
        let time_ns = self.time_ns(message, &state.header)?;
        self.joints.take(time_ns, &state);
        Ok(())
    }

    fn imu(&mut self, message: &RecordedMessage<'_>) -> Result<()> {
        let name = &message.topic.name;
        let for_attitude =
            matches!(&self.chosen.attitude, Attitudes::Imu { topic, .. } if topic == name);
        let for_heading = matches!(&self.chosen.pose,
            PoseSource::Navsat { heading_topic, .. } if heading_topic == name);
        if !for_attitude && !for_heading {
            return Ok(());
        }
        let imu: Imu = decode(message)?;
        // REP-145: -1 in the first element means that there is no orientation.
        if imu.orientation_covariance[0] == -1.0 {
            bail!(
                "it has no orientation (orientation_covariance[0] is -1): an AHRS's topic is needed"
            );
        }
        let rotation = match from_quaternion(&imu.orientation) {
            Ok(rotation) => rotation,
            Err(reason) => {
                self.unusable(message, reason);
                return Ok(());
            }
        };
        let time_ns = self.time_ns(message, &imu.header)?;
        let series = self.imus.entry(name.clone());
        let (_, rotations) = series.or_insert_with(|| (imu.header.frame_id, Vec::new()));
        rotations.push((time_ns, rotation));
        Ok(())
    }

    fn odometry(&mut self, message: &RecordedMessage<'_>) -> Result<()> {
        let name = &message.topic.name;
        let width_m = match &self.chosen.tread_speeds {
            TreadSpeedSource::Odometry {
                topic,
                track_width_m,
            } if topic == name => Some(*track_width_m),
            _ => None,
        };
        let for_attitude =
            matches!(&self.chosen.attitude, Attitudes::Odometry(topic) if topic == name);
        let for_pose = matches!(&self.chosen.pose, PoseSource::Odometry(topic) if topic == name);
        if width_m.is_none() && !for_attitude && !for_pose {
            return Ok(());
        }
        let odometry: Odometry = decode(message)?;
        let time_ns = self.time_ns(message, &odometry.header)?;
        if let Some(width_m) = width_m {
            let twist = &odometry.twist.twist;
            let steer_m_s = 0.5 * width_m * twist.angular.z;
            let speeds = MeasuredTreadSpeeds {
                left_m_s: twist.linear.x - steer_m_s,
                right_m_s: twist.linear.x + steer_m_s,
            };
            self.tread_speeds.push((time_ns, speeds));
        }
        if for_attitude || for_pose {
            let found = (&odometry.header, &odometry.pose.pose);
            self.pose(message, time_ns, found, [for_attitude, for_pose])?;
        }
        Ok(())
    }

    fn pose_stamped(&mut self, message: &RecordedMessage<'_>) -> Result<()> {
        let name = &message.topic.name;
        let for_attitude =
            matches!(&self.chosen.attitude, Attitudes::PoseStamped(topic) if topic == name);
        let for_pose = matches!(&self.chosen.pose, PoseSource::PoseStamped(topic) if topic == name);
        if !for_attitude && !for_pose {
            return Ok(());
        }
        let (header, pose) = if message.topic.message_type == POSE_WITH_COVARIANCE {
            let found: PoseWithCovarianceStamped = decode(message)?;
            (found.header, found.pose.pose)
        } else {
            let found: PoseStamped = decode(message)?;
            (found.header, found.pose)
        };
        let time_ns = self.time_ns(message, &header)?;
        self.pose(message, time_ns, (&header, &pose), [for_attitude, for_pose])
    }

    /// Takes a pose of a message for the attitude, the pose or both.
    fn pose(
        &mut self,
        message: &RecordedMessage<'_>,
        time_ns: i64,
        (header, pose): (&Header, &message::Pose),
        [for_attitude, for_pose]: [bool; 2],
    ) -> Result<()> {
        if let Some(taken) = self.topics.get_mut(&message.topic.name) {
            let first = taken.frame.get_or_insert_with(|| header.frame_id.clone());
            if *first != header.frame_id {
                bail!(
                    "its frame is {:?}, that of the messages before {first:?}: poses of two frames are no drive; cut the bag \
                     there, or record each on a topic of its own",
                    header.frame_id
                );
            }
        }
        match from_pose(pose) {
            Ok(pose) => {
                let (pose, attitude) = pose_and_attitude(&pose);
                if for_attitude {
                    self.attitudes.push((time_ns, attitude));
                }
                if for_pose {
                    self.poses.push((time_ns, pose));
                }
            }
            Err(reason) => self.unusable(message, reason),
        }
        Ok(())
    }

    fn fix(&mut self, message: &RecordedMessage<'_>) -> Result<()> {
        match &self.chosen.pose {
            PoseSource::Navsat { topic, .. } if *topic == message.topic.name => {}
            _ => return Ok(()),
        }
        let fix: NavSatFix = decode(message)?;
        let time_ns = self.time_ns(message, &fix.header);
        self.fixes.take(time_ns, &fix)
    }

    fn transform(&mut self, message: &RecordedMessage<'_>) -> Result<()> {
        let fixed = message.topic.name.ends_with("tf_static");
        if !fixed && !self.transforms.wants_moving() {
            return Ok(());
        }
        let transforms: TfMessage = decode(message)?;
        for transform in transforms.transforms {
            let time_ns = match (fixed, self.chosen.time) {
                (true, _) => nanoseconds(transform.header.stamp)?,
                (false, _) => self.time_ns(message, &transform.header)?,
            };
            let pose = match from_transform(&transform.transform) {
                Ok(pose) => pose,
                Err(reason) => {
                    self.unusable(
                        message,
                        format_args!("{}: {reason}", transform.child_frame_id),
                    );
                    continue;
                }
            };
            let (parent, child) = (&transform.header.frame_id, &transform.child_frame_id);
            let found = self.transforms.take(parent, child, time_ns, pose, fixed);
            if let Some(world_from_base_link) = found {
                let (pose, attitude) = pose_and_attitude(&world_from_base_link);
                if matches!(self.chosen.pose, PoseSource::Tf { .. }) {
                    self.poses.push((time_ns, pose));
                }
                if matches!(self.chosen.attitude, Attitudes::Tf { .. }) {
                    self.attitudes.push((time_ns, attitude));
                }
            }
        }
        Ok(())
    }

    fn series(mut self) -> Result<Series> {
        let mut notes = self.unusable_notes()?;
        if let Some(wheels) = self.wheel_joints() {
            let joints = std::mem::take(&mut self.joints);
            let (speeds, told) = joints.tread_speeds(self.bag.path(), &wheels)?;
            self.tread_speeds = speeds;
            notes.extend(told);
        }
        self.check_clocks()?;
        let attitudes = match &self.chosen.attitude {
            Attitudes::Imu { topic, axes } => {
                let rotations = in_order(self.vehicle_rotations(topic, *axes, &mut notes));
                if *axes == ImuAxes::Enu {
                    self.check_axes(topic, &rotations)?;
                }
                let attitude =
                    |(time_ns, rotation): &(i64, _)| (*time_ns, paper_attitude(rotation).0);
                Some(rotations.iter().map(attitude).collect())
            }
            Attitudes::Odometry(_) | Attitudes::PoseStamped(_) | Attitudes::Tf { .. } => {
                Some(in_order(std::mem::take(&mut self.attitudes)))
            }
            Attitudes::Level => None,
        };
        if let PoseSource::Navsat {
            heading_topic,
            antenna_m,
            ..
        } = &self.chosen.pose
        {
            notes.extend(self.fixes.notes()?);
            let axes = match &self.chosen.attitude {
                Attitudes::Imu { topic, axes } if topic == heading_topic => *axes,
                _ => ImuAxes::Enu,
            };
            let rotations = in_order(self.vehicle_rotations(heading_topic, axes, &mut Vec::new()));
            self.poses = self.fixes.poses(&rotations, antenna_m);
        }
        let unconnected = match (&self.chosen.pose, &self.chosen.attitude, &attitudes) {
            (PoseSource::Tf { frame }, _, _) if self.poses.is_empty() => Some(("pose", frame)),
            (_, Attitudes::Tf { frame }, Some(none)) if none.is_empty() => {
                Some(("attitude", frame))
            }
            _ => None,
        };
        if let Some((key, frame)) = unconnected {
            bail!(
                "{}: the transforms do not connect {} to {frame}; they are: {}. The keys `{key}.frame` and \
                 `base_frame` of the topic map name these frames",
                self.bag.path().display(),
                self.chosen.base_frame,
                self.transforms.frames()
            );
        }
        for (_, pose) in &mut self.poses {
            pose.yaw_rad += self.chosen.heading_offset_rad;
        }
        let poses = in_order(self.poses);
        let place = |(time_ns, pose): &(i64, Pose)| (*time_ns, [pose.x_m, pose.y_m, pose.z_m]);
        let places: Timed<[f64; 3]> = poses.iter().map(place).collect();
        one_publisher(&places).with_context(|| format!("{}: poses", self.bag.path().display()))?;
        Ok(Series {
            sources: Sources {
                tread_speeds: in_order(self.tread_speeds),
                attitudes,
                poses,
            },
            notes,
        })
    }

    /// Returns a note for each topic of which messages are left out.
    ///
    /// # Errors
    /// A topic of which all are.
    pub(super) fn unusable_notes(&self) -> Result<Vec<String>> {
        let mut notes = Vec::new();
        for (name, taken) in &self.topics {
            let Some((count, reason)) = &taken.unusable else {
                continue;
            };
            if *count == taken.count {
                bail!(
                    "{}, topic {name}: none of its {count} messages can be used; of the first {reason}; a topic map (--topics) names \
                     other sources",
                    self.bag.path().display()
                );
            }
            notes.push(format!(
                "{name}: {count} of {} messages are left out; of the first {reason}",
                taken.count
            ));
        }
        Ok(notes)
    }

    /// Checks that the stamps of all sources come from one clock, by the times at which they were recorded.
    fn check_clocks(&self) -> Result<()> {
        let ahead = |(name, taken): (&String, &TopicSeries)| {
            Some((median(taken.ahead_s.clone())?, name.clone()))
        };
        let mut ahead: Vec<(f64, String)> = self.topics.iter().filter_map(ahead).collect();
        ahead.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (Some(least), Some(most)) = (ahead.first(), ahead.last()) else {
            return Ok(());
        };
        if most.0 - least.0 > CLOCKS_APART_MAX_S {
            bail!(
                "{}: the stamps of {} and {} come from two clocks, which are {:.2} s apart by the times at which the \
                 messages were recorded; with `time: received` in the topic map (--topics) those times count",
                self.bag.path().display(),
                most.1,
                least.1,
                most.0 - least.0
            );
        }
        Ok(())
    }

    /// Checks that the vehicle does not stand on its head, which an Imu with other axes makes it do.
    fn check_axes(&self, topic: &str, rotations: &[(i64, UnitQuaternion<f64>)]) -> Result<()> {
        let up = rotations
            .iter()
            .map(|(_, rotation)| (rotation * Vector3::z()).z);
        if median(up.collect()).is_some_and(|up| up < 0.0) {
            bail!(
                "{}: by {topic} the vehicle drives on its back: the Imu hangs upside down, or its axes are those of \
                 aviation (NED); write `attitude: {{kind: imu, topic: {topic}, axes: upside_down}}` or `axes: ned` in \
                 the topic map (--topics), or record /tf_static, which says how it is mounted",
                self.bag.path().display()
            );
        }
        Ok(())
    }

    /// Returns world_from_base_link of an Imu, turned by how it is mounted where /tf_static says so.
    fn vehicle_rotations(
        &self,
        topic: &str,
        axes: ImuAxes,
        notes: &mut Vec<String>,
    ) -> Timed<UnitQuaternion<f64>> {
        let Some((frame, rotations)) = self.imus.get(topic) else {
            return Vec::new();
        };
        let base_from_sensor = self
            .transforms
            .fixed_rotation(&self.chosen.base_frame, frame);
        if base_from_sensor.is_none() {
            notes.push(format!(
                "{topic}: /tf_static does not connect its frame {frame:?} to {}: its axes are taken for the vehicle's",
                self.chosen.base_frame
            ));
        }
        let sensor_from_base = base_from_sensor.unwrap_or_default().inverse();
        let turned = rotations
            .iter()
            .map(|(time_ns, rotation)| (*time_ns, upright(axes, rotation) * sensor_from_base));
        turned.collect()
    }
}

pub(super) fn decode<T: DeserializeOwned>(message: &RecordedMessage<'_>) -> Result<T> {
    if message.topic.encoding != "cdr" {
        bail!("its encoding is {:?}, must be cdr", message.topic.encoding);
    }
    Ok(from_cdr(message.data)?)
}

/// Returns an Imu's orientation in the axes of REP-103.
fn upright(axes: ImuAxes, rotation: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    match axes {
        ImuAxes::Enu => *rotation,
        ImuAxes::UpsideDown => rotation * over,
        // North, east, down from east, north, up: the axes x and y change places, and z its sign.
        ImuAxes::Ned => {
            let diagonal = Unit::new_normalize(Vector3::new(1.0, 1.0, 0.0));
            let enu_from_ned = UnitQuaternion::from_axis_angle(&diagonal, std::f64::consts::PI);
            enu_from_ned * rotation * over
        }
    }
}
