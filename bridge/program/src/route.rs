//! `sidehill route live`: positions of a running ROS 2 topic until a signal arrives.

use crate::interrupts::Interrupts;
use crate::ros2::environment;
use anyhow::{Result, bail};
use sidehill::console;
use sidehill::drive_log::{LivePositions, Positions};
use sidehill::route::RouteArgs;
use sidehill_bridge::ros2::arguments::RosArguments;
use sidehill_bridge::ros2::position::PositionTopic;
use sidehill_ros2::positions::PositionNode;
use std::time::{Duration, Instant};

/// Interval at which messages are polled.
const PERIOD: Duration = Duration::from_millis(5);
/// Longest wait for the first position: discovery without multicast takes 7 s.
const WAIT: Duration = Duration::from_secs(10);
/// Time without a position until a warning: some receivers send one fix per second.
const SILENCE: Duration = Duration::from_secs(5);
/// Largest number of positions, which bounds the memory: 27 hours at 50 Hz.
const POSITIONS_MAX: usize = 5_000_000;

/// Records a path and writes it.
///
/// # Errors
/// As [`sidehill::route::run_live`]; invalid ROS arguments, a network that cannot be used, or no position.
pub fn run(args: &RouteArgs, ros_arguments: &[String]) -> Result<()> {
    sidehill::route::run_live(args, |topic, end_after| {
        record(topic, end_after, ros_arguments)
    })
}

/// Returns the positions of a topic, from the first until SIGINT, SIGTERM or SIGHUP comes or `end_after` is over.
///
/// # Errors
/// Invalid ROS arguments, a network that cannot be used, or no position; names the topic and who publishes it.
fn record(
    topic: PositionTopic,
    end_after: Option<Duration>,
    ros_arguments: &[String],
) -> Result<Positions> {
    let arguments = RosArguments::parse(ros_arguments)?;
    let interrupts = Interrupts::watch()?;
    let name = topic.name().to_owned();
    let mut node = PositionNode::start("route_recorder", topic, &arguments, &environment()?)?;
    let started = Instant::now();
    let mut first: Option<Instant> = None;
    let (mut newest, mut silent) = (started, false);
    let mut positions = LivePositions::default();
    let mut rejected: Option<(u64, String)> = None;
    while !interrupts.ended() {
        if interrupts.take_resumed() {
            console::complain("the program was suspended: the recording ends here");
            break;
        }
        let before = positions.count();
        node.step(|message| {
            let taken = positions
                .take(message)
                .map_err(|error| format!("{error:#}"));
            if let Err(reason) = &taken {
                let count = rejected.as_ref().map_or(0, |(count, _)| *count);
                rejected = Some((count + 1, reason.clone()));
            }
            taken
        });
        if positions.count() > before {
            (newest, silent) = (Instant::now(), false);
        }
        match first {
            None if positions.count() > 0 => {
                first = Some(Instant::now());
                console::complain(format_args!(
                    "{name}: recording; the path is written at Ctrl-C{}",
                    end_after.map_or_else(String::new, |end| format!(
                        " or after {} s",
                        end.as_secs_f64()
                    ))
                ));
            }
            None if started.elapsed() >= WAIT => break,
            Some(first) if end_after.is_some_and(|end| first.elapsed() >= end) => break,
            _ => {}
        }
        if positions.count() >= POSITIONS_MAX {
            console::complain(format_args!(
                "{name}: {POSITIONS_MAX} positions: the recording ends here"
            ));
            break;
        }
        if first.is_some() && !silent && newest.elapsed() >= SILENCE {
            silent = true;
            let missing = node.missing().unwrap_or_else(|| name.clone());
            console::complain(format_args!("no position comes from {missing}"));
        }
        std::thread::sleep(PERIOD);
    }
    if first.is_none() {
        bail!(
            "no position within {:.0} s from {}",
            started.elapsed().as_secs_f64(),
            node.missing().unwrap_or(name)
        );
    }
    let mut positions = positions.finish();
    positions.notes.extend(
        rejected.map(|(count, reason)| {
            format!("messages left out: {count}; the last because {reason}")
        }),
    );
    Ok(positions)
}
