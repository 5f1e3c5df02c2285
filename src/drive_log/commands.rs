//! Commands and measured speeds of the drives from bags and recordings.

use super::choice::Chosen;
use super::interpolation::seconds;
use super::series::{self, Series};
use super::topics::{StampSource, TopicMap};
use crate::bag::{Bag, BagError, RecordedMessage};
use anyhow::{Result, bail, ensure};
use sidehill_bridge::ros2::conversions::nanoseconds;
use sidehill_bridge::ros2::message::{Twist, TwistStamped};
use sidehill_plant::log::as_counted;
use sidehill_plant::log::{DriveRecord, TimedSpeeds};
use sidehill_plant::speeds::{EncoderScale, MeasuredTreadSpeeds, MotorSpeeds};
use sidehill_recording::{Recording, Topic};
use std::path::Path;

const TWIST: &str = "geometry_msgs/msg/Twist";
const TWIST_STAMPED: &str = "geometry_msgs/msg/TwistStamped";

/// Returns the record of a bag, or of a recording of this program, and notes about what was left out.
///
/// # Errors
/// Names the file and the topic or key at fault.
pub(super) fn record(
    path: &Path,
    map: Option<&(String, TopicMap)>,
    max_bytes: Option<u64>,
    scale: &EncoderScale,
) -> Result<(DriveRecord, Vec<String>)> {
    let bag = Bag::open(path, max_bytes)?;
    let find = |name: &str| {
        bag.topics()
            .map(|(topic, _)| topic)
            .find(|topic| topic.name == name)
    };
    if find(Topic::ControllerCycle.name()).is_some() {
        return of_recording(path, scale);
    }
    let Some((name, command)) = map.and_then(|(name, map)| Some((name, map.commands.as_ref()?)))
    else {
        bail!(
            "{}: which topic has the commands? Name it in a topic map (--topics): \
             `commands: {{topic: /cmd_vel, track_width_m: 0.6}}`",
            path.display()
        );
    };
    let Some(topic) = find(&command.topic) else {
        bail!(
            "{name}: commands.topic: there is no topic {} in {}",
            command.topic,
            path.display()
        );
    };
    let mut chosen = Chosen::of(&bag, map)?;
    let stamped = match topic.message_type.as_str() {
        TWIST => {
            // A Twist has no stamp, so the time of recording counts for both.
            chosen.time = StampSource::Received;
            false
        }
        TWIST_STAMPED => true,
        other => bail!(
            "{name}: commands.topic: {} is a {other}, must be {TWIST} or {TWIST_STAMPED}",
            command.topic
        ),
    };
    let mut commands = Vec::new();
    let mut number = 0;
    bag.read(&mut |message| {
        if message.topic.name != command.topic {
            return Ok(());
        }
        number += 1;
        let twist = twist(&message, stamped, chosen.time);
        let (time_ns, twist) = twist.map_err(|error| BagError::Message {
            bag: path.to_owned(),
            topic: command.topic.clone(),
            number,
            reason: format!("{error:#}"),
        })?;
        let speeds = MotorSpeeds {
            traction_m_s: twist.linear.x,
            steer_m_s: 0.5 * command.track_width_m * twist.angular.z,
        };
        commands.push((time_ns, speeds));
        Ok(())
    })?;
    commands.sort_by_key(|(time_ns, _)| *time_ns);
    let Series { sources, notes } = series::read(&bag, &chosen)?;
    let all = bag.notes().iter().chain(&chosen.notes).cloned();
    let notes = all.chain(notes).collect();
    let measured = sources.tread_speeds;
    let begin_ns = measured.first().map_or(0, |(time_ns, _)| *time_ns);
    let timed = |time_ns: i64, speeds| TimedSpeeds {
        time_s: seconds(begin_ns, time_ns),
        speeds,
    };
    let measured = measured.into_iter();
    let record = DriveRecord {
        commands: commands
            .into_iter()
            .map(|(ns, speeds)| timed(ns, speeds))
            .collect(),
        measured: measured
            .map(|(ns, treads)| timed(ns, as_counted(treads)))
            .collect(),
    };
    Ok((record, notes))
}

fn twist(message: &RecordedMessage<'_>, stamped: bool, time: StampSource) -> Result<(i64, Twist)> {
    if !stamped {
        return Ok((message.received_ns, series::decode(message)?));
    }
    let command: TwistStamped = series::decode(message)?;
    let time_ns = match time {
        StampSource::Received => message.received_ns,
        StampSource::Stamp => nanoseconds(command.header.stamp)?,
    };
    Ok((time_ns, command.twist))
}

/// Returns the record of a recording: what the controller commanded while it was in charge, zero otherwise.
fn of_recording(path: &Path, scale: &EncoderScale) -> Result<(DriveRecord, Vec<String>)> {
    let recording = Recording::read(path)?;
    let damaged = recording.damaged.iter();
    let notes = damaged
        .map(|reason| format!("it was interrupted ({reason}); what precedes is used"))
        .collect();
    let mut record = DriveRecord::default();
    let mut newest_s = f64::NEG_INFINITY;
    for cycle in &recording.cycles {
        let mut speeds = MotorSpeeds {
            traction_m_s: cycle.traction_m_s,
            steer_m_s: cycle.steer_m_s,
        };
        if !cycle.engaged {
            speeds = MotorSpeeds::STOP;
        }
        let time_s = cycle.time_s;
        record.commands.push(TimedSpeeds { time_s, speeds });
        if cycle.has_tread_speeds && cycle.tread_speeds_time_s > newest_s {
            newest_s = cycle.tread_speeds_time_s;
            let treads = scale.apply(MeasuredTreadSpeeds {
                left_m_s: cycle.left_m_s,
                right_m_s: cycle.right_m_s,
            });
            record.measured.push(TimedSpeeds {
                time_s: newest_s,
                speeds: treads.into(),
            });
        }
    }
    ensure!(
        record
            .commands
            .iter()
            .chain(&record.measured)
            .all(|timed| timed.speeds.is_finite()),
        "{}: a command or speed is not finite",
        path.display()
    );
    Ok((record, notes))
}
