//! Chooses the topics of a bag: those of the map or, if it names none, the only one of a type.

use super::topics::{AttitudeTopic, ImuAxes, PoseTopic, StampSource, TopicMap, TreadSpeedTopic};
use crate::bag::{Bag, BagTopic};
use anyhow::{Result, bail};
use sidehill_plant::log::Reversed;

pub(super) const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
pub(super) const IMU: &str = "sensor_msgs/msg/Imu";
pub(super) const ODOMETRY: &str = "nav_msgs/msg/Odometry";
pub(super) const POSE_STAMPED: &str = "geometry_msgs/msg/PoseStamped";
pub(super) const POSE_WITH_COVARIANCE: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";
pub(super) const NAV_SAT_FIX: &str = "sensor_msgs/msg/NavSatFix";
pub(super) const TF_MESSAGE: &str = "tf2_msgs/msg/TFMessage";

/// Joints of Sidehill's virtual vehicles: their velocity is the tread speed.
const OWN_JOINTS: [&str; 2] = ["left_tread_joint", "right_tread_joint"];
/// Topics of the recordings of `vehicle`, with the joints of the first: they are of the true state.
const OWN_TREADS: (&str, [&str; 2]) = ("/sidehill/treads", ["left_tread", "right_tread"]);
const OWN_POSE: &str = "/sidehill/pose";

/// The chosen topics of a bag; only names of joints may be open.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    pub(super) tread_speeds: TreadSpeedSource,
    pub(super) attitude: Attitudes,
    pub(super) pose: PoseSource,
    pub(super) time: StampSource,
    pub(super) base_frame: String,
    pub(super) heading_offset_rad: f64,
    /// Notes about choices that the map did not make.
    pub(super) notes: Vec<String>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum TreadSpeedSource {
    JointStates {
        topic: String,
        left: Vec<String>,
        right: Vec<String>,
        /// None only for the joints of Sidehill's virtual vehicles, whose radius is 1 m.
        radius_m: Option<f64>,
        reversed: Reversed,
    },
    Odometry {
        topic: String,
        track_width_m: f64,
    },
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Attitudes {
    Imu { topic: String, axes: ImuAxes },
    Odometry(String),
    PoseStamped(String),
    Tf { frame: String },
    Level,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum PoseSource {
    Odometry(String),
    PoseStamped(String),
    Tf {
        frame: String,
    },
    Navsat {
        topic: String,
        heading_topic: String,
        /// Forward, left, up, m.
        antenna_m: [f64; 3],
    },
    None,
}

impl Chosen {
    /// Chooses by `map`, which stands in the file of that name.
    ///
    /// # Errors
    /// Lists the topics of the bag and names the key of the map that decides.
    pub fn of(bag: &Bag, map: Option<&(String, TopicMap)>) -> Result<Self> {
        let mut search = TopicSearch {
            bag,
            map_name: map.map(|(name, _)| name.as_str()),
            notes: Vec::new(),
        };
        let map = map.map(|(_, map)| map);
        let tread_speeds = search.tread_speeds(map.map(|map| &map.tread_speeds))?;
        let attitude = search.attitude(map.and_then(|map| map.attitude.as_ref()))?;
        let pose = search.pose(map.and_then(|map| map.pose.as_ref()))?;
        Ok(Self {
            tread_speeds,
            attitude,
            pose,
            time: map.map_or_else(StampSource::default, |map| map.time),
            base_frame: map.map_or_else(|| "base_link".to_owned(), |map| map.base_frame.clone()),
            heading_offset_rad: map.map_or(0.0, |map| map.heading_offset_deg.to_radians()),
            notes: search.notes,
        })
    }
}

/// Searches a bag for topics and records its choices.
pub(super) struct TopicSearch<'a> {
    pub(super) bag: &'a Bag,
    pub(super) map_name: Option<&'a str>,
    pub(super) notes: Vec<String>,
}

impl TopicSearch<'_> {
    fn tread_speeds(&mut self, requested: Option<&TreadSpeedTopic>) -> Result<TreadSpeedSource> {
        let key = "tread_speeds";
        Ok(match requested {
            Some(TreadSpeedTopic::JointStates {
                topic,
                left,
                right,
                radius_m,
                reversed,
            }) => TreadSpeedSource::JointStates {
                topic: self.topic(topic.as_deref(), JOINT_STATE, key)?,
                left: left.clone(),
                right: right.clone(),
                radius_m: Some(*radius_m),
                reversed: *reversed,
            },
            Some(TreadSpeedTopic::Odometry {
                topic,
                track_width_m,
            }) => TreadSpeedSource::Odometry {
                topic: self.topic(topic.as_deref(), ODOMETRY, key)?,
                track_width_m: *track_width_m,
            },
            None => {
                let topic = self.topic(None, JOINT_STATE, key)?;
                let (own, joints) = OWN_TREADS;
                let [left, right] = if topic == own { joints } else { OWN_JOINTS };
                TreadSpeedSource::JointStates {
                    topic,
                    left: vec![left.to_owned()],
                    right: vec![right.to_owned()],
                    radius_m: None,
                    reversed: Reversed::None,
                }
            }
        })
    }

    fn attitude(&mut self, requested: Option<&AttitudeTopic>) -> Result<Attitudes> {
        let key = "attitude";
        Ok(match requested {
            Some(AttitudeTopic::Odometry { topic }) => {
                Attitudes::Odometry(self.topic(topic.as_deref(), ODOMETRY, key)?)
            }
            Some(AttitudeTopic::Level {}) => Attitudes::Level,
            Some(AttitudeTopic::PoseStamped { topic }) => {
                Attitudes::PoseStamped(self.pose_stamped(topic.as_deref(), key)?)
            }
            Some(AttitudeTopic::Tf { frame }) => Attitudes::Tf {
                frame: self.tf_frame(frame, key)?,
            },
            Some(AttitudeTopic::Imu { topic, axes }) => Attitudes::Imu {
                topic: self.topic(topic.as_deref(), IMU, key)?,
                axes: *axes,
            },
            None if self.is_own() => Attitudes::PoseStamped(OWN_POSE.to_owned()),
            None => Attitudes::Imu {
                topic: self.topic(None, IMU, key)?,
                axes: ImuAxes::Enu,
            },
        })
    }

    fn pose(&mut self, requested: Option<&PoseTopic>) -> Result<PoseSource> {
        let key = "pose";
        Ok(match requested {
            Some(PoseTopic::Odometry { topic }) => {
                PoseSource::Odometry(self.topic(topic.as_deref(), ODOMETRY, key)?)
            }
            Some(PoseTopic::PoseStamped { topic }) => {
                PoseSource::PoseStamped(self.pose_stamped(topic.as_deref(), key)?)
            }
            Some(PoseTopic::Tf { frame }) => PoseSource::Tf {
                frame: self.tf_frame(frame, key)?,
            },
            Some(PoseTopic::Navsat {
                topic,
                heading_topic,
                antenna_forward_m,
                antenna_left_m,
                antenna_up_m,
            }) => PoseSource::Navsat {
                topic: self.topic(topic.as_deref(), NAV_SAT_FIX, key)?,
                heading_topic: self.topic(heading_topic.as_deref(), IMU, key)?,
                antenna_m: [*antenna_forward_m, *antenna_left_m, *antenna_up_m],
            },
            Some(PoseTopic::None {}) => PoseSource::None,
            None if self.is_own() => PoseSource::PoseStamped(OWN_POSE.to_owned()),
            None if !self.of_type(ODOMETRY).is_empty() => {
                let topic = self.topic(None, ODOMETRY, key)?;
                self.notes.push(format!(
                    "{topic} must not be odometry of the wheels, which cannot judge them"
                ));
                PoseSource::Odometry(topic)
            }
            None if !self.of_type(NAV_SAT_FIX).is_empty() => PoseSource::Navsat {
                topic: self.topic(None, NAV_SAT_FIX, key)?,
                heading_topic: self.topic(None, IMU, key)?,
                antenna_m: [0.0; 3],
            },
            None if self.of_type(POSE_STAMPED).len() + self.of_type(POSE_WITH_COVARIANCE).len()
                == 1 =>
            {
                PoseSource::PoseStamped(self.pose_stamped(None, key)?)
            }
            None => {
                self.notes.push(format!(
                    "no poses: no topic has the type {ODOMETRY} or {NAV_SAT_FIX}, and not one alone the type \
                     {POSE_STAMPED}; for poses of /tf write \
                     `pose: {{kind: tf, frame: map}}` in a topic map (--topics)"
                ));
                PoseSource::None
            }
        })
    }

    /// Returns the topic of that name, or the only one, of a pose with a stamp.
    fn pose_stamped(&mut self, name: Option<&str>, key: &str) -> Result<String> {
        let with_covariance = match name {
            Some(name) => {
                let topics = self.of_type(POSE_WITH_COVARIANCE);
                topics.iter().any(|topic| topic.name == name)
            }
            None => self.of_type(POSE_STAMPED).is_empty(),
        };
        let message_type = if with_covariance {
            POSE_WITH_COVARIANCE
        } else {
            POSE_STAMPED
        };
        self.topic(name, message_type, key)
    }

    /// Returns whether the bag is a recording of `vehicle`.
    fn is_own(&self) -> bool {
        let poses = self.of_type(POSE_STAMPED);
        poses.iter().any(|topic| topic.name == OWN_POSE)
    }

    fn tf_frame(&self, frame: &str, key: &str) -> Result<String> {
        if self.of_type(TF_MESSAGE).is_empty() {
            bail!(self.complaint(format_args!("no topic has the type {TF_MESSAGE}"), key));
        }
        Ok(frame.to_owned())
    }

    pub(super) fn of_type(&self, message_type: &str) -> Vec<&BagTopic> {
        let topics = self.bag.topics();
        topics
            .filter(|(topic, count)| topic.message_type == message_type && *count > 0)
            .map(|(topic, _)| topic)
            .collect()
    }

    /// Returns the topic of that name, or the only one of the type.
    pub(super) fn topic(
        &mut self,
        name: Option<&str>,
        message_type: &str,
        key: &str,
    ) -> Result<String> {
        let Some(name) = name else {
            return self.only_one(message_type, key);
        };
        let mut same_name = self.bag.topics().filter(|(topic, _)| topic.name == name);
        let Some((topic, count)) = same_name.next() else {
            bail!(self.complaint(format_args!("there is no topic {name}"), key));
        };
        if topic.message_type != message_type {
            let found = &topic.message_type;
            bail!(self.complaint(
                format_args!("topic {name} has the type {found}, must be {message_type}"),
                key
            ));
        }
        if same_name.next().is_some() {
            bail!(self.complaint(format_args!("topic {name} has several types"), key));
        }
        if topic.encoding != "cdr" {
            let encoding = &topic.encoding;
            bail!(self.complaint(
                format_args!("topic {name} has the encoding {encoding:?}, must be cdr"),
                key
            ));
        }
        if count == 0 {
            bail!(self.complaint(format_args!("topic {name} is empty"), key));
        }
        Ok(name.to_owned())
    }

    fn only_one(&mut self, message_type: &str, key: &str) -> Result<String> {
        let found = self.of_type(message_type);
        let complaint = match found.as_slice() {
            [topic] => {
                let name = topic.name.clone();
                let name = self.topic(Some(&name), message_type, key)?;
                self.notes
                    .push(format!("{key}: {name}, the only {message_type}"));
                return Ok(name);
            }
            [] => format!("no topic with messages has the type {message_type}"),
            _ => format!("several topics have the type {message_type}"),
        };
        bail!(self.complaint(format_args!("{complaint}"), key))
    }

    /// Returns an error with the available topics and the key that decides.
    fn complaint(&self, what: std::fmt::Arguments<'_>, key: &str) -> String {
        let example = match key {
            "tread_speeds" => {
                "{kind: joint_states, topic: NAME, left: [JOINT], right: [JOINT], radius_m: RADIUS} or \
                 {kind: odometry, topic: NAME, track_width_m: WIDTH}"
            }
            "attitude" => {
                "{kind: imu, topic: NAME}, {kind: odometry, topic: NAME}, {kind: pose_stamped, topic: NAME}, {kind: tf, \
                 frame: map} or, on level ground, {kind: level}"
            }
            "pose" => {
                "{kind: odometry, topic: NAME}, {kind: pose_stamped, topic: NAME}, {kind: navsat, topic: NAME, heading_topic: NAME}, {kind: tf, \
                 frame: map} or {kind: none}"
            }
            _ => "NAME",
        };
        let place = match (key, self.map_name) {
            ("--topic", _) => "name one with --topic".to_owned(),
            (_, Some(file)) => format!("correct the key `{key}` in {file}: `{key}: {example}`"),
            (_, None) => format!("write a topic map (--topics FILE) with `{key}: {example}`"),
        };
        format!(
            "{}: {what}; {place}. The bag's topics:{}",
            self.bag.path().display(),
            self.bag.topic_list()
        )
    }
}
