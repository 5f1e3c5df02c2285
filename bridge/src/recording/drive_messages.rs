//! From the values of a drive to messages.

use super::mcap_file::RecordingStatus;
use super::messages::{ControllerCycle, LogLine, LoopCycle, PathCommand, Topic};
use super::scene::{BASE, Marker, SceneParts, WORLD};
use super::sink::MessageSink;
use super::tap::{PathRecord, PlanView, StepRecord};
use crate::control_loop::record::CycleRow;
use crate::drives::LinkState;
use crate::ros2::node::conversions::{stamp, to_pose, to_transform};
use crate::ros2::node::message::cdr::to_cdr;
use crate::ros2::node::message::{
    DiagnosticArray, DiagnosticStatus, Header, JointState, KeyValue, Path, PoseStamped, TfMessage,
    Time, TransformStamped,
};
use crate::ros2::port::convert::world_from_base_link;
use crate::safety::SafetyState;
use sidehill_controller::controller::{Decision, Status};
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_plant::simulation::TrueState;
use sidehill_plant::vehicle::Vehicle;

/// Time between two plans, s: they would be most of what is written.
const PLAN_PERIOD_S: f64 = 0.5;
/// Time between two pictures of slide and ICRs, s.
const SCENE_PERIOD_S: f64 = 0.2;
/// Distance between the points of a path that is shown, m.
const PATH_STEP_M: f64 = 0.1;
/// Points of a path that is shown, at most.
const PATH_POINTS: f64 = 5000.0;

/// Returns a time, s, as ns; 0 for one before.
pub fn unix_ns(time_s: f64) -> u64 {
    (time_s * 1e9).round().max(0.0) as u64
}

/// What is known besides the cycles.
#[derive(Debug, Clone, Default)]
pub struct GeneralState<'a> {
    /// How the recording fares; none without one.
    pub recording: Option<&'a RecordingStatus>,
    /// Records that found no place in their rings.
    pub lost: u64,
}

/// Makes messages of what happens in a drive and gives them to a sink. Times are s on the clock of the
/// cycles; `zero_s` is what they count from, s since 1970, 0 for simulated time.
pub struct DriveMessages {
    zero_s: f64,
    scene: SceneParts,
    /// Newest height of the vehicle, m: the estimate has none.
    height_m: f64,
    plan_s: f64,
    scene_s: f64,
    newest: Option<(Decision, f64)>,
    state: Option<(SafetyState, LinkState)>,
}

impl DriveMessages {
    /// Returns messages about a vehicle.
    pub fn new(vehicle: &Vehicle, zero_s: f64) -> Self {
        Self {
            zero_s,
            scene: SceneParts::new(vehicle),
            height_m: 0.0,
            plan_s: f64::NEG_INFINITY,
            scene_s: f64::NEG_INFINITY,
            newest: None,
            state: None,
        }
    }

    /// Gives the markers that stay: the vehicle, and ground where there is any.
    pub fn begin(&self, time_s: f64, ground: &[Marker], sink: &mut impl MessageSink) {
        let mut markers = self.scene.vehicle();
        markers.extend_from_slice(ground);
        let header = self.header(time_s, WORLD);
        self.put(
            Topic::Scene,
            time_s,
            &self.scene.stamped(markers, &header),
            sink,
        );
    }

    /// Gives a step of the controller.
    pub fn step(&mut self, step: &StepRecord, sink: &mut impl MessageSink) {
        let (sample, decision) = (&step.sample, &step.decision);
        let time_s = sample.time_s;
        self.put(
            Topic::ControllerCycle,
            time_s,
            &controller_cycle(step),
            sink,
        );
        if let Some(pose) = sample.pose.filter(|pose| pose.value.z_m.is_finite()) {
            self.height_m = pose.value.z_m;
        }
        if let Some(speeds) = &sample.tread_speeds {
            let speeds = [speeds.value.left_m_s, speeds.value.right_m_s];
            let message = self.joints(time_s, &["left_tread", "right_tread"], &speeds);
            self.put(Topic::Treads, time_s, &message, sink);
        }
        if let Some(estimate) = &decision.estimate {
            self.pose(
                Topic::Pose,
                time_s,
                &self.lifted(&estimate.pose),
                &estimate.attitude,
                sink,
            );
            if is_due(&mut self.scene_s, time_s, SCENE_PERIOD_S) {
                let markers = self.scene.motion(estimate.attitude, estimate.treads);
                let header = self.header(time_s, BASE);
                self.put(
                    Topic::Scene,
                    time_s,
                    &self.scene.stamped(markers, &header),
                    sink,
                );
            }
        }
        if let Some(progress) = &decision.progress {
            let pose = self.stamped_pose(
                time_s,
                &self.lifted(&progress.point.pose()),
                &Attitude::LEVEL,
            );
            self.put(Topic::ReferencePose, time_s, &pose, sink);
        }
        let before = self.newest.map(|(decision, _)| decision.status);
        if before.map(name) != Some(name(decision.status)) {
            let text = format!("controller: {}", decision.status);
            let level = match decision.status {
                Status::Stopping(_) | Status::Fallback { .. } => LogLine::WARN,
                Status::Waiting | Status::Tracking | Status::Finished => LogLine::INFO,
            };
            self.event(time_s, level, "controller", &text, sink);
        }
        self.newest = Some((*decision, time_s));
    }

    /// Gives what is true in a simulation.
    pub fn truth(&mut self, state: &TrueState, sink: &mut impl MessageSink) {
        let time_s = state.time_s;
        self.height_m = state.pose.z_m;
        let pose = self.stamped_pose(time_s, &state.pose, &state.attitude);
        self.put(Topic::TruePose, time_s, &pose, sink);
    }

    /// Gives the true state of a vehicle whose controller runs elsewhere.
    pub fn vehicle(&mut self, state: &TrueState, sink: &mut impl MessageSink) {
        let time_s = state.time_s;
        self.pose(Topic::Pose, time_s, &state.pose, &state.attitude, sink);
        let message = self.joints(
            time_s,
            &["left_tread", "right_tread", "traction_motor", "steer_motor"],
            &[
                state.treads.left_m_s,
                state.treads.right_m_s,
                state.motors.traction_m_s,
                state.motors.steer_m_s,
            ],
        );
        self.put(Topic::Treads, time_s, &message, sink);
        if is_due(&mut self.scene_s, time_s, SCENE_PERIOD_S) {
            let markers = self.scene.motion(state.attitude, state.treads);
            let header = self.header(time_s, BASE);
            self.put(
                Topic::Scene,
                time_s,
                &self.scene.stamped(markers, &header),
                sink,
            );
        }
    }

    /// Gives the newest plan, at most twice a second.
    pub fn plan(&mut self, view: &PlanView, sink: &mut impl MessageSink) {
        if view.plan.is_empty() || !is_due(&mut self.plan_s, view.time_s, PLAN_PERIOD_S) {
            return;
        }
        for (topic, poses) in [
            (Topic::PredictedPath, &view.plan),
            (Topic::ReferencePath, &view.reference),
        ] {
            let message = self.path_message(view.time_s, poses.iter().copied());
            self.put(topic, view.time_s, &message, sink);
        }
    }

    /// Gives a path as the controller got it, and as it is looked at.
    pub fn path(&self, time_s: f64, record: &PathRecord, sink: &mut impl MessageSink) {
        let mut message = PathCommand {
            serial: record.serial,
            ..PathCommand::default()
        };
        if let Some(path) = &record.path {
            message.present = true;
            message.number = path.number;
            message.laps = path.laps;
            message.joined = path.from_m.is_some();
            message.from_m = path.from_m.unwrap_or(0.0);
            message.trajectory = to_cdr(&path.trajectory).unwrap_or_default();
        }
        self.put(Topic::PathCommand, time_s, &message, sink);
        let path = record.path.as_ref().and_then(|path| path.trajectory.path());
        let poses = path.map_or_else(Vec::new, |path| {
            let count = (path.length_m() / PATH_STEP_M)
                .ceil()
                .clamp(1.0, PATH_POINTS);
            (0..=count as usize)
                .map(|i| path.at(path.length_m() * i as f64 / count))
                .map(|point| PlanarPose {
                    x_m: point.position.x_m,
                    y_m: point.position.y_m,
                    yaw_rad: point.heading_rad,
                })
                .collect()
        });
        let message = self.path_message(time_s, poses.into_iter());
        self.put(Topic::Path, time_s, &message, sink);
    }

    /// Gives a cycle of the control loop.
    pub fn loop_cycle(&mut self, row: &CycleRow, sink: &mut impl MessageSink) {
        self.state = Some((row.state, row.bus));
        let message = LoopCycle {
            time_s: row.time_s,
            lateness_s: row.lateness_s,
            slack_s: row.slack_s,
            state: format!("{:?}", row.state).to_lowercase(),
            enable: row.enable,
            traction_m_s: row.traction_m_s,
            steer_m_s: row.steer_m_s,
            sent: row.sent,
            feedback_traction_m_s: row.feedback_traction_m_s,
            feedback_steer_m_s: row.feedback_steer_m_s,
            feedback_age_s: row.feedback_age_s,
            link: format!("{:?}", row.bus).to_lowercase(),
            refused: row.refused,
            skipped: row.skipped,
        };
        self.put(Topic::LoopCycle, row.time_s, &message, sink);
    }

    /// Gives something that happened.
    pub fn event(
        &self,
        time_s: f64,
        level: u8,
        name: &str,
        text: &str,
        sink: &mut impl MessageSink,
    ) {
        let message = LogLine {
            stamp: self.stamp(time_s),
            level,
            name: name.to_owned(),
            msg: text.to_owned(),
            ..LogLine::default()
        };
        self.put(Topic::Events, time_s, &message, sink);
    }

    /// Gives the states of controller, safety and recording.
    pub fn diagnostics(
        &self,
        time_s: f64,
        general: &GeneralState<'_>,
        sink: &mut impl MessageSink,
    ) {
        let mut status = Vec::new();
        if let Some((decision, _)) = &self.newest {
            let level = match decision.status {
                Status::Tracking | Status::Finished => 0,
                Status::Fallback { .. } | Status::Stopping(_) => 1,
                Status::Waiting => 3,
            };
            let estimate = decision.estimate.as_ref();
            let values = [
                (
                    "model_error_m_s",
                    estimate.map(|estimate| estimate.model_error_m_s),
                ),
                ("pose_age_s", estimate.map(|estimate| estimate.pose_age_s)),
                (
                    "cross_track_m",
                    decision.progress.map(|progress| progress.cross_track_m),
                ),
                (
                    "solve_us",
                    decision.solve.map(|solve| 1e6 * solve.solve_time_s),
                ),
            ]
            .map(|(key, value)| (key, value.unwrap_or(f64::NAN).to_string()));
            status.push(part(
                level,
                "controller",
                &decision.status.to_string(),
                &values,
            ));
        }
        if let Some((state, link)) = self.state {
            let values = [("link", format!("{link:?}").to_lowercase())];
            let text = format!("{state:?}").to_lowercase();
            status.push(part(u8::from(!link.carries()), "safety", &text, &values));
        }
        if let Some(recording) = general.recording {
            let text = recording.ended.as_deref().unwrap_or("records");
            let level = if recording.ended.is_some() {
                2
            } else {
                u8::from(general.lost > 0)
            };
            let values = [
                ("file", recording.file.display().to_string()),
                ("bytes", recording.bytes.to_string()),
                ("lost", general.lost.to_string()),
            ];
            status.push(part(level, "recording", text, &values));
        }
        let header = self.header(time_s, "");
        self.put(
            Topic::Diagnostics,
            time_s,
            &DiagnosticArray { header, status },
            sink,
        );
    }

    fn pose(
        &self,
        topic: Topic,
        time_s: f64,
        pose: &Pose,
        attitude: &Attitude,
        sink: &mut impl MessageSink,
    ) {
        self.put(
            topic,
            time_s,
            &self.stamped_pose(time_s, pose, attitude),
            sink,
        );
        let transform = TransformStamped {
            header: self.header(time_s, WORLD),
            child_frame_id: BASE.to_owned(),
            transform: to_transform(&world_from_base_link(pose, attitude)),
        };
        let transforms = TfMessage {
            transforms: vec![transform],
        };
        self.put(Topic::Transforms, time_s, &transforms, sink);
    }

    fn stamped_pose(&self, time_s: f64, pose: &Pose, attitude: &Attitude) -> PoseStamped {
        PoseStamped {
            header: self.header(time_s, WORLD),
            pose: to_pose(&world_from_base_link(pose, attitude)),
        }
    }

    fn path_message(&self, time_s: f64, poses: impl Iterator<Item = PlanarPose>) -> Path {
        let poses = poses.map(|pose| PoseStamped {
            // The header of the path is the one that is used.
            header: Header::default(),
            pose: to_pose(&world_from_base_link(&self.lifted(&pose), &Attitude::LEVEL)),
        });
        Path {
            header: self.header(time_s, WORLD),
            poses: poses.collect(),
        }
    }

    fn joints(&self, time_s: f64, names: &[&str], speeds_m_s: &[f64]) -> JointState {
        JointState {
            header: self.header(time_s, BASE),
            name: names.iter().map(|&name| name.to_owned()).collect(),
            velocity: speeds_m_s.to_vec(),
            ..JointState::default()
        }
    }

    fn lifted(&self, pose: &PlanarPose) -> Pose {
        Pose {
            x_m: pose.x_m,
            y_m: pose.y_m,
            z_m: self.height_m,
            yaw_rad: pose.yaw_rad,
        }
    }

    fn header(&self, time_s: f64, frame: &str) -> Header {
        Header {
            stamp: self.stamp(time_s),
            frame_id: frame.to_owned(),
        }
    }

    fn stamp(&self, time_s: f64) -> Time {
        stamp(unix_ns(self.zero_s + time_s) as i64)
    }

    fn put<M: serde::Serialize>(
        &self,
        topic: Topic,
        time_s: f64,
        message: &M,
        sink: &mut impl MessageSink,
    ) {
        // A message of plain values always has a form in CDR.
        if let Ok(bytes) = to_cdr(message) {
            sink.put(topic, unix_ns(self.zero_s + time_s), &bytes);
        }
    }
}

fn part(level: u8, name: &str, message: &str, values: &[(&str, String)]) -> DiagnosticStatus {
    let values = values.iter().map(|(key, value)| KeyValue {
        key: (*key).to_owned(),
        value: value.clone(),
    });
    DiagnosticStatus {
        level,
        name: format!("sidehill: {name}"),
        message: message.to_owned(),
        hardware_id: String::new(),
        values: values.collect(),
    }
}

/// Returns whether a period has passed since `last_s`, which then is now; also where time has gone back.
fn is_due(last_s: &mut f64, now_s: f64, period_s: f64) -> bool {
    let due = !(0.0..period_s).contains(&(now_s - *last_s));
    if due {
        *last_s = now_s;
    }
    due
}

fn name(status: Status) -> std::mem::Discriminant<Status> {
    std::mem::discriminant(&status)
}

fn controller_cycle(step: &StepRecord) -> ControllerCycle {
    let (sample, decision) = (&step.sample, &step.decision);
    let (speeds, attitude, pose) = (&sample.tread_speeds, &sample.attitude, &sample.pose);
    let estimate = decision.estimate.as_ref();
    let progress = decision.progress.as_ref();
    let solve = decision.solve.as_ref();
    let nan = f64::NAN;
    ControllerCycle {
        index: step.index,
        time_s: sample.time_s,
        engaged: step.engaged,
        path: step.path,
        cut: step.cut_at.is_some(),
        cut_at: step.cut_at.unwrap_or(0),
        has_tread_speeds: speeds.is_some(),
        tread_speeds_time_s: speeds.map_or(nan, |speeds| speeds.time_s),
        left_m_s: speeds.map_or(nan, |speeds| speeds.value.left_m_s),
        right_m_s: speeds.map_or(nan, |speeds| speeds.value.right_m_s),
        has_attitude: attitude.is_some(),
        attitude_time_s: attitude.map_or(nan, |attitude| attitude.time_s),
        roll_rad: attitude.map_or(nan, |attitude| attitude.value.roll_rad),
        pitch_rad: attitude.map_or(nan, |attitude| attitude.value.pitch_rad),
        has_pose: pose.is_some(),
        pose_time_s: pose.map_or(nan, |pose| pose.time_s),
        x_m: pose.map_or(nan, |pose| pose.value.x_m),
        y_m: pose.map_or(nan, |pose| pose.value.y_m),
        z_m: pose.map_or(nan, |pose| pose.value.z_m),
        yaw_rad: pose.map_or(nan, |pose| pose.value.yaw_rad),
        traction_m_s: decision.command_effective.traction_m_s,
        steer_m_s: decision.command_effective.steer_m_s,
        status: decision.status.to_string(),
        reference: decision.reference,
        estimated_x_m: estimate.map_or(nan, |estimate| estimate.pose.x_m),
        estimated_y_m: estimate.map_or(nan, |estimate| estimate.pose.y_m),
        estimated_yaw_rad: estimate.map_or(nan, |estimate| estimate.pose.yaw_rad),
        estimated_roll_rad: estimate.map_or(nan, |estimate| estimate.attitude.roll_rad),
        estimated_pitch_rad: estimate.map_or(nan, |estimate| estimate.attitude.pitch_rad),
        model_error_m_s: estimate.map_or(nan, |estimate| estimate.model_error_m_s),
        pose_age_s: estimate.map_or(nan, |estimate| estimate.pose_age_s),
        cross_track_m: progress.map_or(nan, |progress| progress.cross_track_m),
        arc_length_m: progress.map_or(nan, |progress| progress.arc_length_m),
        solver_iterations: solve.map_or(0, |solve| solve.iterations),
        solver_path: solve.map_or_else(String::new, |solve| format!("{:?}", solve.path)),
        solve_us: solve.map_or(nan, |solve| 1e6 * solve.solve_time_s),
    }
}
