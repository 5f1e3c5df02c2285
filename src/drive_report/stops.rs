//! When and why a vehicle stopped.

use super::input::DecodedRecording;
use super::place::PlaceInTime;
use serde::Serialize;
use sidehill_bridge::safety::{Reason, StopCause};

/// Who or what stopped the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum StopKind {
    /// The path was followed to its end.
    Arrived,
    /// An operator or a client asked for it, or the time of the run was over.
    Asked,
    /// Something else.
    Fault,
}

/// A stop.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Stop {
    pub(super) kind: StopKind,
    /// Why, as it was said.
    pub(super) cause: String,
    /// What was missing or short just before.
    pub(super) before: Vec<String>,
    /// Time until it drove again, s; none where it did not.
    pub(super) stood_s: Option<f64>,
    #[serde(flatten)]
    pub(super) place: PlaceInTime,
}

/// Events up to so long before a stop are told with it, s.
const BEFORE_S: f64 = 5.0;

/// Returns all stops in order: of the state machine of `run`, or else of the controller.
pub(super) fn stops(input: &DecodedRecording) -> Vec<Stop> {
    let by_safety = input.events.iter().any(|(_, event)| event.name == "state");
    let mut stops: Vec<Stop> = Vec::new();
    let mut driving = false;
    for (time_s, event) in &input.events {
        let change = match (event.name.as_str(), by_safety) {
            ("state", true) => of_safety(&event.msg),
            ("controller", false) => of_controller(&event.msg),
            _ => None,
        };
        match change {
            Some(StateChange::Drives) => {
                if let Some(last) = stops.last_mut().filter(|_| !driving) {
                    last.stood_s = last.stood_s.or(Some(time_s - last.place.time_s));
                }
                driving = true;
            }
            Some(StateChange::Stops(cause)) if driving => {
                driving = false;
                stops.push(Stop {
                    kind: kind(&cause),
                    before: before(input, *time_s),
                    cause,
                    stood_s: None,
                    place: PlaceInTime::at(input, *time_s),
                });
            }
            _ => {}
        }
    }
    stops
}

enum StateChange {
    Drives,
    Stops(String),
}

/// Returns what a change of state is, told as `Driving -> Stopping: reason`.
fn of_safety(text: &str) -> Option<StateChange> {
    let (states, reason) = text.split_once(": ")?;
    let (from, to) = states.split_once(" -> ")?;
    match (from, to) {
        (_, "Driving") => Some(StateChange::Drives),
        ("Driving", _) => Some(StateChange::Stops(reason.to_owned())),
        _ => None,
    }
}

/// Returns what a status is, told as `controller: stopping: reason`.
fn of_controller(text: &str) -> Option<StateChange> {
    let status = text.strip_prefix("controller: ")?;
    if status == "finished" {
        return Some(StateChange::Stops(Reason::Finished.to_string()));
    }
    match status.strip_prefix("stopping: ") {
        Some(reason) => Some(StateChange::Stops(reason.to_owned())),
        None => (status == "tracking").then_some(StateChange::Drives),
    }
}

fn kind(cause: &str) -> StopKind {
    if cause == Reason::Finished.to_string() {
        return StopKind::Arrived;
    }
    let asked = StopCause::ALL
        .iter()
        .any(|known| !known.is_fault() && known.to_string() == cause);
    if asked {
        StopKind::Asked
    } else {
        StopKind::Fault
    }
}

/// Returns what was said just before a time of inputs that were missing and motors that fell short.
fn before(input: &DecodedRecording, time_s: f64) -> Vec<String> {
    let recent = input
        .events
        .iter()
        .filter(|(at_s, _)| (time_s - BEFORE_S..=time_s).contains(at_s));
    let told = recent.filter(|(_, event)| ["waits_for", "drives"].contains(&event.name.as_str()));
    told.map(|(_, event)| event.msg.clone()).collect()
}
