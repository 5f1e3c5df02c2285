//! The values of the chosen topics of a bag, each over its own times.

use super::choice::{
    Attitudes, Chosen, IMU, JOINT_STATE, NAV_SAT_FIX, ODOMETRY, Poses, TF_MESSAGE, TreadSpeeds,
};
use super::fixes::Fixes;
use super::interpolation::Timed;
use super::joints::{Joints, WheelJoints};
use super::topics::StampSource;
use super::transform_poses::TransformPoses;
use crate::bag::{Bag, BagError, Message};
use anyhow::{Context, Result, bail};
use nalgebra::UnitQuaternion;
use serde::de::DeserializeOwned;
use sidehill_bridge::ros2::node::conversions::{
    from_pose, from_quaternion, from_transform, nanoseconds,
};
use sidehill_bridge::ros2::node::message::cdr::from_cdr;
use sidehill_bridge::ros2::node::message::{
    Header, Imu, JointState, NavSatFix, Odometry, TfMessage,
};
use sidehill_bridge::ros2::port::convert::pose_and_attitude;
use sidehill_plant::frames::{Attitude, Pose, paper_attitude};
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use std::collections::BTreeMap;

/// The sources of a log, each in the order of its times, without two values at one time.
#[derive(Debug, Default)]
pub(super) struct Series {
    pub(super) tread_speeds: Timed<MeasuredTreadSpeeds>,
    /// None if the ground was level.
    pub(super) attitudes: Option<Timed<Attitude>>,
    pub(super) poses: Timed<Pose>,
    pub(super) notes: Vec<String>,
}

/// Collects values in one pass over the bag.
pub(super) struct Collected<'a> {
    bag: &'a Bag,
    chosen: &'a Chosen,
    /// Messages seen of each topic.
    counts: BTreeMap<String, usize>,
    joints: Joints,
    tread_speeds: Timed<MeasuredTreadSpeeds>,
    /// world_from_sensor by the topic of the Imu, with the frame of its first message.
    imus: BTreeMap<String, (String, Timed<UnitQuaternion<f64>>)>,
    attitudes: Timed<Attitude>,
    pub(super) poses: Timed<Pose>,
    pub(super) fixes: Fixes,
    transforms: TransformPoses,
}

/// Reads the chosen topics.
pub(super) fn read(bag: &Bag, chosen: &Chosen) -> Result<Series> {
    let mut collected = Collected::new(bag, chosen);
    bag.read(&mut |message| collected.take(message))?;
    collected.series()
}

impl<'a> Collected<'a> {
    pub(super) fn new(bag: &'a Bag, chosen: &'a Chosen) -> Self {
        let frame = match &chosen.pose {
            Poses::Tf { frame } => Some(frame.clone()),
            _ => None,
        };
        Self {
            bag,
            chosen,
            counts: BTreeMap::new(),
            joints: Joints::default(),
            tread_speeds: Vec::new(),
            imus: BTreeMap::new(),
            attitudes: Vec::new(),
            poses: Vec::new(),
            fixes: Fixes::default(),
            transforms: TransformPoses::new(frame, &chosen.base_frame),
        }
    }

    pub(super) fn take(&mut self, message: Message<'_>) -> Result<(), BagError> {
        let count = match self.counts.get_mut(&message.topic.name) {
            Some(count) => count,
            None => self.counts.entry(message.topic.name.clone()).or_default(),
        };
        *count += 1;
        let number = *count;
        let taken = match message.topic.message_type.as_str() {
            JOINT_STATE => self.joint_state(&message),
            IMU => self.imu(&message),
            ODOMETRY => self.odometry(&message),
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

    fn time_ns(&self, message: &Message<'_>, header: &Header) -> Result<i64> {
        Ok(match self.chosen.time {
            StampSource::Received => message.received_ns,
            StampSource::Stamp => match nanoseconds(header.stamp)? {
                0 => bail!(
                    "its stamp is 0; with `time: received` in the topic map the time of recording counts"
                ),
                stamp_ns => stamp_ns,
            },
        })
    }

    fn wheel_joints(&self) -> Option<WheelJoints<'a>> {
        match &self.chosen.tread_speeds {
            TreadSpeeds::JointStates {
                topic,
                left,
                right,
                radius_m,
            } => Some(WheelJoints {
                topic,
                left,
                right,
                radius_m: *radius_m,
            }),
            TreadSpeeds::Odometry { .. } => None,
        }
    }

    fn joint_state(&mut self, message: &Message<'_>) -> Result<()> {
        let Some(wheels) = self.wheel_joints() else {
            return Ok(());
        };
        if wheels.topic != message.topic.name {
            return Ok(());
        }
        let state: JointState = decode(message)?;
        let scale = wheels.radius_m.unwrap_or(1.0);
        let left_rad_s = self.joints.mean_velocity(&state, wheels.left, "left")?;
        let right_rad_s = self.joints.mean_velocity(&state, wheels.right, "right")?;
        // Other joints, such as an arm's, may have their own messages.
        if let (Some(left_rad_s), Some(right_rad_s)) = (left_rad_s, right_rad_s) {
            let speeds = MeasuredTreadSpeeds {
                left_m_s: scale * left_rad_s,
                right_m_s: scale * right_rad_s,
            };
            let time_ns = self.time_ns(message, &state.header)?;
            self.tread_speeds.push((time_ns, speeds));
        }
        Ok(())
    }

    fn imu(&mut self, message: &Message<'_>) -> Result<()> {
        let name = &message.topic.name;
        let for_attitude = matches!(&self.chosen.attitude, Attitudes::Imu(topic) if topic == name);
        let for_heading = matches!(&self.chosen.pose,
            Poses::Navsat { heading_topic, .. } if heading_topic == name);
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
        let rotation = from_quaternion(&imu.orientation)?;
        let time_ns = self.time_ns(message, &imu.header)?;
        let series = self.imus.entry(name.clone());
        let (_, rotations) = series.or_insert_with(|| (imu.header.frame_id, Vec::new()));
        rotations.push((time_ns, rotation));
        Ok(())
    }

    fn odometry(&mut self, message: &Message<'_>) -> Result<()> {
        let name = &message.topic.name;
        let width_m = match &self.chosen.tread_speeds {
            TreadSpeeds::Odometry {
                topic,
                track_width_m,
            } if topic == name => Some(*track_width_m),
            _ => None,
        };
        let for_attitude =
            matches!(&self.chosen.attitude, Attitudes::Odometry(topic) if topic == name);
        let for_pose = matches!(&self.chosen.pose, Poses::Odometry(topic) if topic == name);
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
            let (pose, attitude) = pose_and_attitude(&from_pose(&odometry.pose.pose)?);
            if for_attitude {
                self.attitudes.push((time_ns, attitude));
            }
            if for_pose {
                self.poses.push((time_ns, pose));
            }
        }
        Ok(())
    }

    fn fix(&mut self, message: &Message<'_>) -> Result<()> {
        match &self.chosen.pose {
            Poses::Navsat { topic, .. } if *topic == message.topic.name => {}
            _ => return Ok(()),
        }
        let fix: NavSatFix = decode(message)?;
        let time_ns = self.time_ns(message, &fix.header);
        self.fixes.take(time_ns, &fix)
    }

    fn transform(&mut self, message: &Message<'_>) -> Result<()> {
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
            let pose = from_transform(&transform.transform)
                .with_context(|| format!("transform of {}", transform.child_frame_id))?;
            let (parent, child) = (&transform.header.frame_id, &transform.child_frame_id);
            let found = self.transforms.take(parent, child, time_ns, pose, fixed);
            if let Some(world_from_base_link) = found {
                let (pose, _) = pose_and_attitude(&world_from_base_link);
                self.poses.push((time_ns, pose));
            }
        }
        Ok(())
    }

    fn series(mut self) -> Result<Series> {
        let mut notes = Vec::new();
        if let Some(wheels) = self.wheel_joints() {
            let has_speeds = !self.tread_speeds.is_empty();
            self.joints.check(self.bag.path(), &wheels, has_speeds)?;
        }
        let attitudes = match &self.chosen.attitude {
            Attitudes::Imu(topic) => {
                let rotations = self.vehicle_rotations(topic, &mut notes);
                let attitude =
                    |(time_ns, rotation): &(i64, _)| (*time_ns, paper_attitude(rotation).0);
                Some(in_order(rotations.iter().map(attitude).collect()))
            }
            Attitudes::Odometry(_) => Some(in_order(std::mem::take(&mut self.attitudes))),
            Attitudes::Level => None,
        };
        if let Poses::Navsat {
            heading_topic,
            antenna_m,
            ..
        } = &self.chosen.pose
        {
            notes.extend(self.fixes.note());
            let rotations = in_order(self.vehicle_rotations(heading_topic, &mut Vec::new()));
            self.poses = self.fixes.poses(&rotations, antenna_m);
        }
        if let (Poses::Tf { frame }, true) = (&self.chosen.pose, self.poses.is_empty()) {
            bail!(
                "{}: the transforms do not connect {} to {frame}; they are: {}. The keys `pose.frame` and \
                 `base_frame` of the topic map name these frames",
                self.bag.path().display(),
                self.chosen.base_frame,
                self.transforms.frames()
            );
        }
        Ok(Series {
            tread_speeds: in_order(self.tread_speeds),
            attitudes,
            poses: in_order(self.poses),
            notes,
        })
    }

    /// Returns world_from_base_link of an Imu, turned by how it is mounted where /tf_static says so.
    fn vehicle_rotations(
        &self,
        topic: &str,
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
            .map(|(time_ns, rotation)| (*time_ns, rotation * sensor_from_base));
        turned.collect()
    }
}

pub(super) fn decode<T: DeserializeOwned>(message: &Message<'_>) -> Result<T> {
    if message.topic.encoding != "cdr" {
        bail!("its encoding is {:?}, must be cdr", message.topic.encoding);
    }
    Ok(from_cdr(message.data)?)
}

/// Returns the values ordered by time; of two at the same time, the later in the bag.
fn in_order<T>(mut values: Timed<T>) -> Timed<T> {
    values.reverse();
    values.sort_by_key(|(time_ns, _)| *time_ns);
    values.dedup_by_key(|(time_ns, _)| *time_ns);
    values
}
