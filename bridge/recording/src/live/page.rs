//! The page of the live view, and what it shows: the last ten minutes as JSON.
//!
//! All is made from the messages that the Foxglove protocol sends, five times a second.

use super::outgoing::TopicMessage;
use crate::messages::{ControllerCycle, FixState, GuardState, LogLine, LoopCycle, Topic};
use crate::scene::{CUBE, MarkerArray, SLIDE_SCALE_S};
use serde_json::{Value, json};
use sidehill_bridge::ros2::message::cdr::from_cdr;
use sidehill_bridge::ros2::message::{self, DiagnosticArray, JointState, Path, PoseStamped};
use sidehill_controller::path::GeodeticOrigin;
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write as _;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Name of the protocol that the page offers.
pub(super) const PROTOCOL: &str = "sidehill.page.v1";

/// The page.
pub(super) const HTML: &str = concat!(
    include_str!("page/head.html"),
    "<style>\n",
    include_str!("page/uplot/uPlot.min.css"),
    include_str!("page/page.css"),
    "</style>\n",
    include_str!("page/top.html"),
    include_str!("page/map.html"),
    include_str!("page/drive.html"),
    include_str!("page/words.html"),
    include_str!("page/foot.html"),
    "<script>\n",
    include_str!("page/uplot/uPlot.iife.min.js"),
    "</script>\n<script>\n",
    include_str!("page/plot.js"),
    include_str!("page/view.js"),
    include_str!("page/drive.js"),
    include_str!("page/page.js"),
    "</script>\n"
);

/// What of a drive is kept.
#[derive(Clone, Copy)]
pub(super) struct Kept {
    /// Time between two frames, ns.
    pub(super) frame_ns: u64,
    /// Frames.
    pub(super) frames: usize,
    /// Events.
    pub(super) events: usize,
    /// Time between two views of the obstacles, ns, and views. The first after a change of state is kept as well.
    pub(super) obstacles_ns: u64,
    pub(super) obstacles: usize,
}

/// What the live page keeps: ten minutes.
const LIVE: Kept = Kept {
    frame_ns: 200_000_000,
    frames: 3000,
    events: 200,
    obstacles_ns: 0,
    obstacles: 1,
};
/// Age from which on a message is not shown as the present, ns.
pub(super) const OLD_NS: u64 = 1_000_000_000;

/// What a frame holds, in this order; not a number where it is not known. Units: s, m, rad, m/s; `state` counts
/// [`STATES`].
const COLUMNS: [&str; 30] = [
    "t",
    "state",
    "x",
    "y",
    "heading",
    "downhill_x",
    "downhill_y",
    "cross_track",
    "arc_length",
    "traction",
    "traction_command",
    "steer",
    "steer_command",
    "pose_age",
    "fix_status",
    "fix_sigma",
    "tip_over_margin",
    "friction_use",
    "friction",
    "speed_share",
    "slide_x",
    "slide_y",
    "icr_x",
    "icr_left",
    "icr_right",
    "ellipse_x",
    "ellipse_y",
    "ellipse_along",
    "ellipse_across",
    "ellipse_heading",
];

/// States of safety, as [`LoopCycle`] names them.
pub(super) const STATES: [&str; 6] = [
    "disarmed", "zeroing", "enabling", "driving", "stopping", "latched",
];

/// What pages show.
pub(super) struct Page {
    kept: Kept,
    /// Newest message of each topic.
    newest: BTreeMap<Topic, TopicMessage>,
    newest_ns: u64,
    next_ns: u64,
    /// Names what frames and events are numbered from: another after each start, and where time goes back.
    run: String,
    runs: u64,
    frames: History,
    events: History,
    obstacles: History,
    next_obstacles_ns: u64,
    /// Places where the vehicle has dug in, x, y, m.
    dug_in: Vec<f64>,
    /// What was known of obstacles last.
    newest_obstacles: String,
    /// Newest of what replaces what was before, with its version.
    parts: BTreeMap<&'static str, (u64, Arc<str>)>,
    version: u64,
    /// Why the state of safety changed last, and which inputs are missing.
    reason: String,
    waits_for: String,
}

/// The newest of numbered texts.
struct History {
    texts: VecDeque<Arc<str>>,
    /// Number of the first.
    first: u64,
    length: usize,
}

impl History {
    fn new(length: usize) -> Self {
        Self {
            texts: VecDeque::new(),
            first: 0,
            length,
        }
    }

    fn push(&mut self, text: String) {
        if self.texts.len() == self.length {
            self.texts.pop_front();
            self.first += 1;
        }
        self.texts.push_back(text.into());
    }

    /// Returns the number of the next.
    fn end(&self) -> u64 {
        self.first + self.texts.len() as u64
    }

    fn get(&self, number: u64) -> Option<&str> {
        let index = usize::try_from(number.checked_sub(self.first)?).ok()?;
        self.texts.get(index).map(|text| &**text)
    }

    /// Returns those of these numbers that are kept as the entries of a JSON array.
    fn list(&self, numbers: impl Iterator<Item = u64>) -> String {
        let texts: Vec<&str> = numbers.filter_map(|number| self.get(number)).collect();
        texts.join(",")
    }
}

impl Page {
    pub(super) fn new() -> Self {
        Self::keeping(LIVE)
    }

    pub(super) fn keeping(kept: Kept) -> Self {
        Self::begun(kept, 1)
    }

    fn begun(kept: Kept, runs: u64) -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let started = now.map_or(0, |now| now.as_nanos());
        Self {
            kept,
            newest: BTreeMap::new(),
            newest_ns: 0,
            next_ns: 0,
            run: format!("{started:x}.{runs}"),
            runs,
            frames: History::new(kept.frames),
            events: History::new(kept.events),
            obstacles: History::new(kept.obstacles),
            next_obstacles_ns: 0,
            dug_in: Vec::new(),
            newest_obstacles: String::new(),
            parts: BTreeMap::new(),
            version: 0,
            reason: String::new(),
            waits_for: String::new(),
        }
    }

    /// Says where on earth the plane of the drive is.
    pub(super) fn place(&mut self, datum: &GeodeticOrigin) {
        self.set("earth", json!(datum.expansion()).to_string());
    }

    /// Begins from nothing but vehicle and place on earth.
    fn begin(&mut self) {
        let mut parts = std::mem::take(&mut self.parts);
        parts.retain(|name, _| ["vehicle", "earth"].contains(name));
        *self = Self {
            parts,
            version: self.version,
            ..Self::begun(self.kept, self.runs + 1)
        };
    }

    /// Takes a message of a drive.
    pub(super) fn take(&mut self, message: &TopicMessage) {
        let time_ns = message.time_ns;
        if time_ns + OLD_NS < self.newest_ns {
            // A player has gone back.
            self.begin();
        }
        self.newest_ns = time_ns;
        if time_ns >= self.next_ns {
            self.frame(time_ns);
            let frame_ns = self.kept.frame_ns;
            self.next_ns = (time_ns / frame_ns + 1) * frame_ns;
        }
        let bytes = &message.message;
        match message.topic {
            Topic::Path => self.path("path", bytes),
            Topic::PredictedPath => self.path("plan", bytes),
            Topic::Diagnostics => self.diagnostics(bytes),
            Topic::Events => self.event(time_ns, bytes),
            Topic::Scene => {
                if let Ok(scene) = from_cdr::<MarkerArray>(bytes) {
                    if let Some(obstacles) = obstacles(&scene) {
                        // It tells nothing of the vehicle's motion.
                        return self.obstacles(time_ns, obstacles);
                    }
                    if self.dug_in(&scene) {
                        return;
                    }
                    if let Some(vehicle) = vehicle(&scene) {
                        self.set("vehicle", vehicle.to_string());
                    }
                    if let Some(ground) = ground(&scene) {
                        self.set("ground", ground.to_string());
                    }
                }
            }
            _ => {}
        }
        self.newest.insert(message.topic, message.clone());
    }

    /// Returns all that is kept as JSON: `columns`, `states`, `frames`, `events`, `obstacles` and `parts`.
    pub(super) fn json(&self) -> String {
        let all = |history: &History| history.list(history.first..history.end());
        let parts = self.parts.iter();
        let parts = parts.map(|(name, (_, part))| format!("\"{name}\":{part}"));
        format!(
            "{{\"columns\":{},\"states\":{},\"frames\":[{}],\"events\":[{}],\"obstacles\":[{}],\"parts\":{{{}}}}}",
            json!(COLUMNS),
            json!(STATES),
            all(&self.frames),
            all(&self.events),
            all(&self.obstacles),
            parts.collect::<Vec<_>>().join(","),
        )
    }

    fn set(&mut self, name: &'static str, text: String) {
        if self.parts.get(name).is_some_and(|(_, now)| **now == *text) {
            return;
        }
        self.version += 1;
        self.parts.insert(name, (self.version, text.into()));
    }

    /// Returns the newest message of a topic unless it is old.
    fn present<M: serde::de::DeserializeOwned>(&self, topic: Topic, time_ns: u64) -> Option<M> {
        let message = self.newest.get(&topic)?;
        let fresh = time_ns.saturating_sub(message.time_ns) <= OLD_NS;
        fresh.then(|| from_cdr(&message.message).ok())?
    }

    /// Makes a frame of what is known.
    fn frame(&mut self, time_ns: u64) {
        let cycle: Option<ControllerCycle> = self.present(Topic::ControllerCycle, time_ns);
        let row: Option<LoopCycle> = self.present(Topic::LoopCycle, time_ns);
        let pose: Option<PoseStamped> = self.present(Topic::Pose, time_ns);
        if cycle.is_none() && row.is_none() && pose.is_none() {
            return;
        }
        let mut frame = PageFrame::default();
        frame.set("t", time_ns as f64 / 1e9);
        if let Some(joints) = self.present::<JointState>(Topic::Treads, time_ns)
            && let [left, right, ..] = joints.velocity[..]
        {
            frame.set("traction", 0.5 * (right + left));
            frame.set("steer", 0.5 * (right - left));
        }
        if let Some(cycle) = &cycle {
            frame.set("cross_track", cycle.cross_track_m);
            frame.set("arc_length", cycle.arc_length_m);
            frame.set("pose_age", cycle.pose_age_s);
            frame.set("traction_command", cycle.traction_m_s);
            frame.set("steer_command", cycle.steer_m_s);
        }
        if let Some(row) = &row {
            let state = STATES.iter().position(|state| *state == row.state);
            frame.set("state", state.map_or(f64::NAN, |state| state as f64));
            frame.set("traction_command", row.traction_m_s);
            frame.set("steer_command", row.steer_m_s);
            if row.feedback_traction_m_s.is_finite() {
                frame.set("traction", row.feedback_traction_m_s);
                frame.set("steer", row.feedback_steer_m_s);
            }
        }
        if let Some(PoseStamped { pose, .. }) = &pose {
            let [downhill_x, downhill_y] = downhill(&pose.orientation);
            frame.set("x", pose.position.x);
            frame.set("y", pose.position.y);
            frame.set("heading", heading_rad(pose));
            frame.set("downhill_x", downhill_x);
            frame.set("downhill_y", downhill_y);
        }
        if let Some(guard) = self.present::<GuardState>(Topic::Guard, time_ns) {
            frame.set("tip_over_margin", guard.rollover_margin);
            frame.set("friction_use", guard.friction_use);
            frame.set("friction", guard.friction);
            frame.set("speed_share", guard.speed_share);
        }
        if let Some(fix) = self.present::<FixState>(Topic::Fix, time_ns) {
            frame.set("fix_status", f64::from(fix.status));
            frame.set("fix_sigma", fix.sigma_m);
        }
        if let Some(scene) = self.present::<MarkerArray>(Topic::Scene, time_ns) {
            frame.scene(&scene);
        }
        self.frames.push(frame.text());
        let status = json!({
            "state": row.map(|row| row.state),
            "controller": cycle.map(|cycle| cycle.status),
            "reason": self.reason,
            "waits_for": self.waits_for,
        });
        self.set("status", status.to_string());
    }

    fn path(&mut self, name: &'static str, bytes: &[u8]) {
        if let Ok(path) = from_cdr::<Path>(bytes) {
            self.set(name, points(&path));
        }
    }

    fn diagnostics(&mut self, bytes: &[u8]) {
        let Ok(array) = from_cdr::<DiagnosticArray>(bytes) else {
            return;
        };
        let all = array.status.into_iter().map(|status| {
            let values = status.values.into_iter();
            let values = values.map(|entry| (entry.key, Value::String(entry.value)));
            let name = status.name.trim_start_matches("sidehill: ").to_owned();
            let values: serde_json::Map<_, _> = values.collect();
            (
                name,
                json!({ "level": status.level, "message": status.message, "values": values }),
            )
        });
        let all: serde_json::Map<_, _> = all.collect();
        self.set("diagnostics", Value::Object(all).to_string());
    }

    /// Keeps what is known of obstacles, where it has changed, with its time.
    fn obstacles(&mut self, time_ns: u64, obstacles: String) {
        if time_ns < self.next_obstacles_ns || obstacles == self.newest_obstacles {
            return;
        }
        self.next_obstacles_ns = time_ns + self.kept.obstacles_ns;
        let time_s = time_ns as f64 / 1e9;
        let view = format!("[{time_s:.1}{obstacles}]");
        self.set("obstacles", view.clone());
        self.obstacles.push(view);
        self.newest_obstacles = obstacles;
    }

    /// Keeps the places where the vehicle has dug in; returns whether the scene tells of one.
    fn dug_in(&mut self, scene: &MarkerArray) -> bool {
        let Some(marker) = scene.markers.iter().find(|marker| marker.ns == "dug_in") else {
            return false;
        };
        let at = &marker.pose.position;
        self.dug_in.extend([at.x, at.y]);
        self.set("dug_in", list(&self.dug_in));
        true
    }

    fn event(&mut self, time_ns: u64, bytes: &[u8]) {
        let Ok(line) = from_cdr::<LogLine>(bytes) else {
            return;
        };
        if line.name == "state" {
            self.next_obstacles_ns = 0;
        }
        match line.name.as_str() {
            // The end of the ramp is not why the vehicle stopped.
            "state" if !line.msg.starts_with("Stopping -> Latched") => {
                let reason = line.msg.split_once(": ").map_or("", |(_, reason)| reason);
                reason.clone_into(&mut self.reason);
            }
            "waits_for" => self.waits_for.clone_from(&line.msg),
            "inputs" => self.waits_for.clear(),
            _ => {}
        }
        let event = json!([time_ns as f64 / 1e9, line.level, line.name, line.msg]);
        self.events.push(event.to_string());
    }
}

/// One entry for each of [`COLUMNS`].
struct PageFrame([f64; COLUMNS.len()]);

impl Default for PageFrame {
    fn default() -> Self {
        Self([f64::NAN; COLUMNS.len()])
    }
}

impl PageFrame {
    fn set(&mut self, column: &str, value: f64) {
        if let Some(index) = COLUMNS.iter().position(|name| *name == column) {
            self.0[index] = value;
        }
    }

    /// Takes slide, ICRs and uncertainty.
    fn scene(&mut self, scene: &MarkerArray) {
        for marker in &scene.markers {
            let at = &marker.pose.position;
            match (marker.ns.as_str(), marker.id) {
                ("slide", _) => {
                    if let [from, to] = &marker.points[..] {
                        self.set("slide_x", (to.x - from.x) / SLIDE_SCALE_S);
                        self.set("slide_y", (to.y - from.y) / SLIDE_SCALE_S);
                    }
                }
                ("icr", 0) => {
                    self.set("icr_x", at.x);
                    self.set("icr_left", at.y);
                }
                ("icr", _) => self.set("icr_right", at.y),
                ("uncertainty", _) => {
                    self.set("ellipse_x", at.x);
                    self.set("ellipse_y", at.y);
                    self.set("ellipse_along", 0.5 * marker.scale.x);
                    self.set("ellipse_across", 0.5 * marker.scale.y);
                    self.set("ellipse_heading", heading_rad(&marker.pose));
                }
                _ => {}
            }
        }
    }

    /// Returns the frame as a JSON array, rounded to 0.1 mm or mrad.
    fn text(&self) -> String {
        let mut text = String::from("[");
        for (i, value) in self.0.iter().enumerate() {
            if i > 0 {
                text.push(',');
            }
            number(&mut text, *value, 4);
        }
        text.push(']');
        text
    }
}

/// Appends a number with at most so many digits behind the point.
fn number(text: &mut String, value: f64, digits: usize) {
    if !value.is_finite() {
        text.push_str("null");
        return;
    }
    let begin = text.len();
    // Writing to a text does not fail.
    let _ = write!(text, "{value:.digits$}");
    if digits > 0 {
        let kept = text.trim_end_matches('0').trim_end_matches('.').len();
        text.truncate(kept);
    }
    if text[begin..] == *"-0" {
        text.replace_range(begin.., "0");
    }
}

/// Returns the horizontal part of a vehicle's upward unit vector: it points downhill, and its length is the sine of
/// the slope.
fn downhill(rotation: &message::Quaternion) -> [f64; 2] {
    let message::Quaternion { x, y, z, w } = *rotation;
    [2.0 * (x * z + y * w), 2.0 * (y * z - x * w)]
}

/// Returns the direction of a pose's x axis in the plane, rad.
fn heading_rad(pose: &message::Pose) -> f64 {
    let message::Quaternion { x, y, z, w } = pose.orientation;
    (2.0 * (x * y + w * z)).atan2(1.0 - 2.0 * (y * y + z * z))
}

/// Change of direction, rad, and distance, m, after which a point of a path is shown.
const TURN_SHOWN_RAD: f64 = 0.03;
const STEP_SHOWN_M: f64 = 5.0;

/// Returns a path as x, y, x, y ..., without points that its neighbours tell.
fn points(path: &Path) -> String {
    let poses: Vec<_> = path.poses.iter().map(|stamped| &stamped.pose).collect();
    let mut places = Vec::new();
    let mut shown: Option<&message::Pose> = None;
    for (i, pose) in poses.iter().enumerate() {
        let at = &pose.position;
        let due = shown.is_none_or(|shown| {
            let turn = heading_rad(pose) - heading_rad(shown);
            let turn = turn.sin().atan2(turn.cos());
            let step_m = (at.x - shown.position.x).hypot(at.y - shown.position.y);
            turn.abs() > TURN_SHOWN_RAD || step_m > STEP_SHOWN_M
        });
        if due || i + 1 == poses.len() {
            places.extend([at.x, at.y]);
            shown = Some(pose);
        }
    }
    list(&places)
}

/// Returns places as a JSON array, m, rounded to 1 cm.
fn list(places_m: &[f64]) -> String {
    let mut text = String::from("[");
    for (i, value) in places_m.iter().enumerate() {
        if i > 0 {
            text.push(',');
        }
        number(&mut text, *value, 2);
    }
    text.push(']');
    text
}

/// Returns body and wheels of the scene's vehicle, in its frame; none where it has none.
fn vehicle(scene: &MarkerArray) -> Option<Value> {
    let parts = scene.markers.iter().filter(|marker| marker.ns == "vehicle");
    let (body, wheels): (Vec<_>, Vec<_>) = parts.partition(|part| part.kind == CUBE);
    let body = body.first()?;
    let wheels = wheels.into_iter().map(|wheel| {
        let at = &wheel.pose.position;
        json!([at.x, at.y, wheel.scale.x, wheel.scale.z])
    });
    let wheels: Vec<Value> = wheels.collect();
    Some(json!({ "body": [body.scale.x, body.scale.y], "wheels": wheels }))
}

/// Returns the scene's obstacles after a comma each: the side of a cell, and x, y, x, y of both ends of each row; none
/// where the scene does not tell of obstacles.
fn obstacles(scene: &MarkerArray) -> Option<String> {
    let marker = scene
        .markers
        .iter()
        .find(|marker| marker.ns == "obstacles")?;
    let places = marker.points.iter().flat_map(|point| [point.x, point.y]);
    let mut text = String::new();
    for value in std::iter::once(marker.scale.x).chain(places) {
        text.push(',');
        number(&mut text, value, 2);
    }
    Some(text)
}

/// Nodes of the ground along an axis, at most.
const NODES_MAX: usize = 500;

/// Returns the heights of the scene's ground at the nodes of its grid, row by row along x; none where it has no ground.
fn ground(scene: &MarkerArray) -> Option<Value> {
    let points = &scene
        .markers
        .iter()
        .find(|marker| marker.ns == "ground")?
        .points;
    let [(left, step_x, columns), (low, step_y, rows)] = [
        nodes(points.iter().map(|point| point.x))?,
        nodes(points.iter().map(|point| point.y))?,
    ];
    let mut heights = vec![None; columns * rows];
    for point in points {
        let column = ((point.x - left) / step_x).round() as usize;
        let row = ((point.y - low) / step_y).round() as usize;
        heights[row * columns + column] = Some((point.z * 1e3).round() / 1e3);
    }
    let size = [step_x * (columns - 1) as f64, step_y * (rows - 1) as f64];
    Some(
        json!({ "corner": [left, low], "size": size, "nodes": [columns, rows], "heights": heights }),
    )
}

/// Returns the first of evenly spaced places, their distance and their count.
fn nodes(places: impl Iterator<Item = f64>) -> Option<(f64, f64, usize)> {
    let mut places: Vec<f64> = places.filter(|place| place.is_finite()).collect();
    places.sort_by(f64::total_cmp);
    let (first, last) = (*places.first()?, *places.last()?);
    let apart = places.windows(2).map(|pair| pair[1] - pair[0]);
    let step = apart.filter(|apart| *apart > 1e-6).min_by(f64::total_cmp)?;
    let count = ((last - first) / step).round() as usize + 1;
    (count <= NODES_MAX).then_some((first, step, count))
}

/// New frames in a message at most: what a slow link cannot carry is left out.
const LIVE_MAX: u64 = 5;
/// Earlier frames in a message at most; of long times every fifth is sent.
const EARLIER_MAX: u64 = 60;

/// What a page has, and what it is to get.
pub(super) struct Reader {
    run: String,
    /// Number of the next new frame.
    next: u64,
    /// Numbers of earlier frames that it lacks: from, to.
    earlier: [u64; 2],
    event: u64,
    versions: BTreeMap<&'static str, u64>,
}

impl Reader {
    /// Returns the reader of a page that has what a connection before it has brought: `RUN-FRAME-EVENT`.
    pub(super) fn new(since: Option<&str>) -> Self {
        let mut parts = since.unwrap_or_default().split('-');
        let run = parts.next().unwrap_or_default().to_owned();
        let mut count = || parts.next()?.parse().ok();
        let frame: Option<u64> = count();
        let event: Option<u64> = count();
        Self {
            run,
            next: 0,
            earlier: [frame.unwrap_or(0), 0],
            event: event.unwrap_or(0),
            versions: BTreeMap::new(),
        }
    }

    /// Returns what the page is to get next; none where there is nothing new.
    pub(super) fn next(&mut self, page: &Page) -> Option<String> {
        let (frames, events) = (&page.frames, &page.events);
        let mut text = String::new();
        let begins = self.versions.is_empty() || self.run != page.run;
        if begins {
            if self.run != page.run {
                (self.earlier, self.event) = ([0, 0], 0);
                self.versions.clear();
            }
            page.run.clone_into(&mut self.run);
            let newest = frames.end().saturating_sub(1);
            self.earlier = [
                self.earlier[0].clamp(frames.first, newest.max(frames.first)),
                newest,
            ];
            self.next = newest;
            let hello = json!({ "run": page.run, "columns": COLUMNS, "states": STATES });
            let _ = write!(text, ",\"hello\":{hello}");
        }
        let new = frames.end() - self.next;
        if new > 0 {
            // The newest, and evenly of those before it.
            let count = new.min(LIVE_MAX);
            let chosen = (1..=count).map(|i| self.next + new * i / count - 1);
            let _ = write!(text, ",\"frames\":[{}]", frames.list(chosen));
            self.next = frames.end();
        }
        if events.end() > self.event {
            let list = events.list(self.event.max(events.first)..events.end());
            let _ = write!(text, ",\"events\":[{list}]");
            self.event = events.end();
        }
        let mut parts = Vec::new();
        for (name, (version, part)) in &page.parts {
            if self.versions.insert(name, *version) != Some(*version) {
                parts.push(format!("\"{name}\":{part}"));
            }
        }
        if !parts.is_empty() {
            let _ = write!(text, ",\"parts\":{{{}}}", parts.join(","));
        }
        let [from, to] = self.earlier;
        if !begins && to > from {
            let step = ((to - from) / EARLIER_MAX).clamp(1, LIVE_MAX);
            let count = (to - from).div_ceil(step).min(EARLIER_MAX);
            let begin = to.saturating_sub(count * step).max(from);
            let chosen = (begin..to).step_by(step as usize);
            let _ = write!(text, ",\"earlier\":[{}]", frames.list(chosen));
            self.earlier = [from, begin];
        }
        if text.is_empty() {
            return None;
        }
        // Until all earlier frames are sent, a page that comes again begins with them again.
        let [from, to] = self.earlier;
        let frame = if to > from { from } else { self.next };
        let _ = write!(text, ",\"have\":\"{}-{frame}-{}\"", self.run, self.event);
        Some(format!("{{{}}}", &text[1..]))
    }
}

#[cfg(test)]
mod tests;
