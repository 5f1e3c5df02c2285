//! Positions of a bag's topic, for a path.

use super::choice::{
    Attitudes, Chosen, NAV_SAT_FIX, ODOMETRY, PoseSource, TopicSearch, TreadSpeedSource,
};
use super::fixes;
use super::interpolation::Timed;
use super::series::Collected;
use super::topics::StampSource;
use crate::bag::Bag;
use anyhow::{Context, Result};
use sidehill_controller::path::GeodeticOrigin;
use sidehill_plant::frames::Pose;

/// Positions of a topic in the order of time, for a path.
#[derive(Debug, Clone, PartialEq)]
pub struct Positions {
    /// X_g east, Y_g north, Z_g up, m.
    pub points_m: Vec<[f64; 3]>,
    /// Where the world's origin is, for fixes of a satellite receiver.
    pub origin: Option<GeodeticOrigin>,
    /// Whether heights are known; without them they are 0.
    pub has_heights: bool,
    /// Notes about choices and positions left out.
    pub notes: Vec<String>,
}

/// Returns the positions of a topic of type NavSatFix or Odometry; without a name those of the only such topic,
/// fixes before odometry.
///
/// # Errors
/// Lists the topics where none can be chosen; names the topic and message at fault.
pub fn positions(bag: &Bag, topic: Option<&str>) -> Result<Positions> {
    let key = "--topic";
    let mut search = TopicSearch {
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
    let fixes_chosen = match named_type {
        Some(message_type) => message_type == NAV_SAT_FIX,
        None => !search.of_type(NAV_SAT_FIX).is_empty(),
    };
    let message_type = if fixes_chosen { NAV_SAT_FIX } else { ODOMETRY };
    let topic = search.topic(topic, message_type, key)?;
    let chosen = Chosen {
        tread_speeds: TreadSpeedSource::Odometry {
            topic: String::new(),
            track_width_m: 1.0,
        },
        attitude: Attitudes::Level,
        pose: if fixes_chosen {
            PoseSource::Navsat {
                topic,
                heading_topic: String::new(),
                antenna_m: [0.0; 3],
            }
        } else {
            PoseSource::Odometry(topic)
        },
        time: StampSource::Received,
        base_frame: "base_link".to_owned(),
        heading_offset_rad: 0.0,
        notes: Vec::new(),
    };
    let mut collected = Collected::new(bag, &chosen);
    bag.read(&mut |message| collected.take(message))?;
    let name = || bag.path().display().to_string();
    let mut notes = search.notes;
    notes.extend(collected.unusable_notes()?);
    let (points_m, origin) = if fixes_chosen {
        notes.extend(collected.fixes.notes().with_context(name)?);
        let origin = collected.fixes.origin();
        (collected.fixes.positions_m(), origin)
    } else {
        let point = |(time_ns, pose): &(i64, Pose)| (*time_ns, [pose.x_m, pose.y_m, pose.z_m]);
        let placed: Timed<[f64; 3]> = collected.poses.iter().map(point).collect();
        notes.extend(fixes::gap(&placed).with_context(name)?);
        (placed.into_iter().map(|(_, point)| point).collect(), None)
    };
    Ok(Positions {
        points_m,
        origin,
        has_heights: !fixes_chosen || collected.fixes.has_heights(),
        notes,
    })
}
