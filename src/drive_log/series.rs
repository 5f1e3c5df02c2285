//! What the chosen topics of a bag say, each over its own times.

use super::choice::{
    Attitudes, Chosen, IMU, JOINT_STATE, NAV_SAT_FIX, ODOMETRY, Poses, Search, TF_MESSAGE,
    TreadSpeeds,
};
use super::interpolation::at;
use super::topics::StampSource;
use super::transform_poses::TransformPoses;
use crate::bag::{Bag, BagError, Message};
use anyhow::{Context, Result, bail};
use nalgebra::{UnitQuaternion, Vector3};
use serde::de::DeserializeOwned;
use sidehill_bridge::ros2::node::conversions::{
    from_pose, from_quaternion, from_transform, nanoseconds,
};
use sidehill_bridge::ros2::node::message::cdr::from_cdr;
use sidehill_bridge::ros2::node::message::{
    Header, Imu, JointState, NavSatFix, Odometry, TfMessage,
};
use sidehill_bridge::ros2::port::convert::pose_and_attitude;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_plant::frames::{Attitude, Pose, paper_attitude};
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use std::collections::{BTreeMap, BTreeSet};

/// Values by their times, ns.
pub(super) type Timed<T> = Vec<(i64, T)>;

/// The sources of a log, each in the order of its times, without two values at one time.
#[derive(Debug, Default)]
pub(super) struct Series {
    pub(super) tread_speeds: Timed<MeasuredTreadSpeeds>,
    /// None: the ground was level.
    pub(super) attitudes: Option<Timed<Attitude>>,
    pub(super) poses: Timed<Pose>,
    pub(super) notes: Vec<String>,
}

/// What one pass over the bag collects.
struct Collected<'a> {
    bag: &'a Bag,
    chosen: &'a Chosen,
    /// Messages seen of each topic.
    counts: BTreeMap<String, usize>,
    joints: Joints,
    tread_speeds: Timed<MeasuredTreadSpeeds>,
    /// world_from_sensor by the topic of the Imu, with the frame of its first message.
    imus: BTreeMap<String, (String, Timed<UnitQuaternion<f64>>)>,
    attitudes: Timed<Attitude>,
    poses: Timed<Pose>,
    fixes: Timed<Fix>,
    fixes_without_position: usize,
    transforms: TransformPoses,
}

/// A fix with a position.
#[derive(Debug, Clone, Copy)]
struct Fix {
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_m: f64,
}

/// Names of joints that were asked for and met.
#[derive(Default)]
struct Joints {
    met: BTreeSet<String>,
    met_with_velocity: BTreeSet<String>,
}

/// Reads the chosen topics.
pub(super) fn read(bag: &Bag, chosen: &Chosen) -> Result<Series> {
    let mut collected = Collected::new(bag, chosen);
    bag.read(&mut |message| collected.take(message))?;
    collected.series()
}

/// Positions of a topic in the order of time, for a path.
#[derive(Debug, Clone, PartialEq)]
pub struct Positions {
    /// X_g east, Y_g north, Z_g up, m.
    pub points_m: Vec<[f64; 3]>,
    /// Where the world's origin is, for fixes of a satellite receiver.
    pub origin: Option<GeodeticOrigin>,
    /// What was chosen or left out without being asked for.
    pub notes: Vec<String>,
}

/// Returns the positions of a topic of type NavSatFix or Odometry; without a name those of the only such topic,
/// fixes before odometry.
///
/// # Errors
/// Lists the topics where none can be chosen; names the topic and message at fault.
pub fn positions(bag: &Bag, topic: Option<&str>) -> Result<Positions> {
    let key = "--topic";
    let mut search = Search {
        bag,
        map_name: None,
        notes: Vec::new(),
    };
    let named_type = topic.and_then(|name| {
        let mut topics = bag.topics().map(|(topic, _)| topic);
        topics
            .find(|topic| topic.name == name)
            .map(|topic| topic.message_type.clone())
    });
    let fixes = match named_type {
        Some(message_type) => message_type == NAV_SAT_FIX,
        None => !search.of_type(NAV_SAT_FIX).is_empty(),
    };
    let message_type = if fixes { NAV_SAT_FIX } else { ODOMETRY };
    let topic = search.topic(topic, message_type, key)?;
    let chosen = Chosen {
        tread_speeds: TreadSpeeds::Odometry {
            topic: String::new(),
            track_width_m: 1.0,
        },
        attitude: Attitudes::Level,
        pose: if fixes {
            Poses::Navsat {
                topic,
                heading_topic: String::new(),
                antenna_m: [0.0; 3],
            }
        } else {
            Poses::Odometry(topic)
        },
        time: StampSource::Received,
        base_frame: "base_link".to_owned(),
        notes: Vec::new(),
    };
    let mut collected = Collected::new(bag, &chosen);
    bag.read(&mut |message| collected.take(message))?;
    let mut notes = search.notes;
    let (points_m, origin) = if fixes {
        notes.extend(collected.fix_note());
        let origin = collected.origin();
        let point = |(_, fix): &(i64, Fix)| fix.position(&origin?);
        let points = collected.fixes.iter().filter_map(point).collect();
        (points, origin)
    } else {
        let point = |(_, pose): &(i64, Pose)| [pose.x_m, pose.y_m, pose.z_m];
        (collected.poses.iter().map(point).collect(), None)
    };
    Ok(Positions {
        points_m,
        origin,
        notes,
    })
}

impl Fix {
    /// Returns the position as a route's: on the ellipsoid, with heights as recorded from the first one.
    fn position(&self, origin: &GeodeticOrigin) -> Option<[f64; 3]> {
        let at = origin.project(self.latitude_deg, self.longitude_deg);
        Some([at.x_m, at.y_m, self.altitude_m - origin.elevation_m])
    }
}

impl<'a> Collected<'a> {
    fn new(bag: &'a Bag, chosen: &'a Chosen) -> Self {
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
            fixes: Vec::new(),
            fixes_without_position: 0,
            transforms: TransformPoses::new(frame, &chosen.base_frame),
        }
    }

    fn take(&mut self, message: Message<'_>) -> Result<(), BagError> {
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

    fn joint_state(&mut self, message: &Message<'_>) -> Result<()> {
        let TreadSpeeds::JointStates {
            topic,
            left,
            right,
            radius_m,
        } = &self.chosen.tread_speeds
        else {
            return Ok(());
        };
        if *topic != message.topic.name {
            return Ok(());
        }
        let state: JointState = decode(message)?;
        let scale = radius_m.unwrap_or(1.0);
        let left_rad_s = self.joints.mean_velocity(&state, left, "left")?;
        let right_rad_s = self.joints.mean_velocity(&state, right, "right")?;
        // Joints of an arm, say, come in messages of their own.
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
        // REP-145: -1 in the first element says that there is none.
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
        let fix_is_whole = [fix.latitude, fix.longitude, fix.altitude]
            .iter()
            .all(|value| value.is_finite());
        if fix.status.status < 0 || !fix_is_whole {
            self.fixes_without_position += 1;
            return Ok(());
        }
        if fix.latitude.abs() > 90.0 || fix.longitude.abs() > 180.0 {
            bail!(
                "latitude {} and longitude {} are no place on earth",
                fix.latitude,
                fix.longitude
            );
        }
        let time_ns = self.time_ns(message, &fix.header)?;
        let fix = Fix {
            latitude_deg: fix.latitude,
            longitude_deg: fix.longitude,
            altitude_m: fix.altitude,
        };
        self.fixes.push((time_ns, fix));
        Ok(())
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
        self.check_joints()?;
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
            notes.extend(self.fix_note());
            let rotations = in_order(self.vehicle_rotations(heading_topic, &mut Vec::new()));
            self.poses = self.poses_of_fixes(&rotations, antenna_m);
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

    fn check_joints(&self) -> Result<()> {
        let TreadSpeeds::JointStates {
            topic,
            left,
            right,
            radius_m,
        } = &self.chosen.tread_speeds
        else {
            return Ok(());
        };
        let bag = self.bag.path().display();
        let list = |names: &BTreeSet<String>| {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            names.join(", ")
        };
        let mut named = left.iter().chain(right);
        if let Some(joint) = named.find(|joint| !self.joints.met.contains(*joint)) {
            match radius_m {
                Some(_) => bail!(
                    "{bag}: {topic} has no joint {joint}; there are: {}. The keys `left` and `right` of \
                     `tread_speeds` in the topic map name the joints",
                    list(&self.joints.met)
                ),
                None => bail!(
                    "{bag}: which joints of {topic} are wheels, and of which radius? Write a topic map (--topics \
                     FILE) with `tread_speeds: {{kind: joint_states, left: [...], right: [...], radius_m: ...}}`; \
                     the joints are: {}",
                    list(&self.joints.met)
                ),
            }
        }
        if self.tread_speeds.is_empty() {
            let why = if self.joints.met_with_velocity.is_empty() {
                "its messages have no velocities"
            } else {
                "no message has joints of both sides"
            };
            bail!(
                "{bag}: {topic} gives no tread speeds: {why}; its joints are: {}. The keys `left` and `right` of \
                 `tread_speeds` in the topic map name the joints",
                list(&self.joints.met)
            );
        }
        Ok(())
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

    fn origin(&self) -> Option<GeodeticOrigin> {
        let (_, first) = self.fixes.first()?;
        Some(GeodeticOrigin {
            latitude_deg: first.latitude_deg,
            longitude_deg: first.longitude_deg,
            elevation_m: first.altitude_m,
        })
    }

    fn fix_note(&self) -> Option<String> {
        let without = self.fixes_without_position;
        (without > 0).then(|| format!("{without} fixes without a position are left out"))
    }

    /// Returns poses of the vehicle's origin at fixes during which its orientation is known.
    fn poses_of_fixes(
        &self,
        rotations: &[(i64, UnitQuaternion<f64>)],
        antenna_m: &[f64; 3],
    ) -> Timed<Pose> {
        let Some(origin) = self.origin() else {
            return Vec::new();
        };
        let pose = |(time_ns, fix): &(i64, Fix)| {
            let rotation = at(rotations, *time_ns, |a, b, share| a.slerp(b, share))?;
            let lever = rotation * Vector3::from(*antenna_m);
            let [x_m, y_m, z_m] = fix.position(&origin)?;
            let (_, yaw_rad) = paper_attitude(&rotation);
            let pose = Pose {
                x_m: x_m - lever.x,
                y_m: y_m - lever.y,
                z_m: z_m - lever.z,
                yaw_rad,
            };
            Some((*time_ns, pose))
        };
        self.fixes.iter().filter_map(pose).collect()
    }
}

impl Joints {
    /// Returns the mean velocity of the named joints, or of those with `side` in their names, in rad/s; nothing
    /// where the message has none of them.
    fn mean_velocity(
        &mut self,
        state: &JointState,
        names: &[String],
        side: &str,
    ) -> Result<Option<f64>> {
        let (mut sum, mut count) = (0.0, 0);
        for (index, name) in state.name.iter().enumerate() {
            if !self.met.contains(name) {
                self.met.insert(name.clone());
            }
            let meant = if names.is_empty() {
                name.to_lowercase().contains(side)
            } else {
                names.contains(name)
            };
            let Some(velocity) = state.velocity.get(index).filter(|_| meant) else {
                continue;
            };
            if !velocity.is_finite() {
                bail!("the velocity of joint {name} is {velocity}");
            }
            if !self.met_with_velocity.contains(name) {
                self.met_with_velocity.insert(name.clone());
            }
            sum += velocity;
            count += 1;
        }
        Ok((count > 0).then(|| sum / f64::from(count)))
    }
}

fn decode<T: DeserializeOwned>(message: &Message<'_>) -> Result<T> {
    if message.topic.encoding != "cdr" {
        bail!("its encoding is {:?}, must be cdr", message.topic.encoding);
    }
    Ok(from_cdr(message.data)?)
}

/// Returns the values in the order of time; of two at one time the later in the bag stays.
fn in_order<T>(mut values: Timed<T>) -> Timed<T> {
    values.reverse();
    values.sort_by_key(|(time_ns, _)| *time_ns);
    values.dedup_by_key(|(time_ns, _)| *time_ns);
    values
}
