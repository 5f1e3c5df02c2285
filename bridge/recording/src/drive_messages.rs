//! From the values of a drive to messages.

use super::diagnostics::{GeneralState, controller_status, recording_status, safety_status};
use super::messages::{ControllerCycle, FixState, LogLine, Topic};
use super::records::{guard_state, loop_cycle, path_command, path_poses};
use super::scene::{self, BASE, Marker, Obstacles, SceneParts, WORLD};
use super::sink::MessageSink;
use sidehill_bridge::control_loop::record::CycleRow;
use sidehill_bridge::control_loop::tap::{PathRecord, PlanView, StepRecord};
use sidehill_bridge::drives::LinkState;
use sidehill_bridge::ros2::conversions::{stamp, to_pose, to_transform};
use sidehill_bridge::ros2::convert::world_from_base_link;
use sidehill_bridge::ros2::message::cdr::to_cdr;
use sidehill_bridge::ros2::message::{
    DiagnosticArray, Header, JointState, Path, PoseStamped, TfMessage, Time, TransformStamped,
};
use sidehill_bridge::safety::SafetyState;
use sidehill_controller::controller::{Decision, DriveResponse, Stall, Status, StopReason};
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_plant::simulation::TrueState;
use sidehill_plant::speeds::TreadSpeeds;
use sidehill_plant::vehicle::Vehicle;

/// Time between two plans, s: they would be most of what is written.
const PLAN_PERIOD_S: f64 = 0.5;
/// Time between two pictures of slide, ICRs and margins, s.
const SCENE_PERIOD_S: f64 = 0.2;

/// Returns a time, s, as ns; 0 for one before.
pub fn unix_ns(time_s: f64) -> u64 {
    (time_s * 1e9).round().max(0.0) as u64
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
    newest: Option<(Decision, DriveResponse)>,
    /// Number of places where the vehicle has dug in.
    dug_in: i32,
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
            dug_in: 0,
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
            &ControllerCycle::from(step),
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
            let (attitude, treads) = (estimate.attitude, estimate.treads);
            let pose = self.lifted(&estimate.pose);
            let more = |scene: &SceneParts| {
                let guard = decision.guard.as_ref();
                let mut more = guard.map_or_else(Vec::new, |guard| scene.margins(guard));
                more.push(scene.uncertainty(&pose, &estimate.covariance));
                more
            };
            self.motion(time_s, attitude, treads, more, sink);
        }
        if let Some(guard) = &decision.guard {
            let message = guard_state(time_s, guard);
            self.put(Topic::Guard, time_s, &message, sink);
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
            self.mark(decision, sink);
        }
        self.newest = Some((*decision, step.drives));
    }

    /// Marks the place of a vehicle that has been stopped because its treads dig in.
    fn mark(&mut self, decision: &Decision, sink: &mut impl MessageSink) {
        let (
            Status::Stopping(StopReason::Stalled {
                stall: Stall::Treads,
                ..
            }),
            Some(estimate),
        ) = (decision.status, &decision.estimate)
        else {
            return;
        };
        let (time_s, pose) = (decision.time_s, self.lifted(&estimate.pose));
        // Without the sign of a zero.
        let [x_m, y_m] =
            [pose.x_m, pose.y_m].map(|value_m| (100.0 * value_m).round() / 100.0 + 0.0);
        let text = format!("x {x_m:.2} m, y {y_m:.2} m");
        self.event(time_s, LogLine::WARN, "dug_in", &text, sink);
        let markers = vec![scene::dug_in(self.dug_in, &pose)];
        self.dug_in += 1;
        let markers = self.scene.stamped(markers, &self.header(time_s, WORLD));
        self.put(Topic::Scene, time_s, &markers, sink);
    }

    /// Adds the motion of the vehicle, and what `more` draws, to the scene when an update is due.
    fn motion(
        &mut self,
        time_s: f64,
        attitude: Attitude,
        treads: TreadSpeeds,
        more: impl FnOnce(&SceneParts) -> Vec<Marker>,
        sink: &mut impl MessageSink,
    ) {
        if is_due(&mut self.scene_s, time_s, SCENE_PERIOD_S) {
            let mut markers = self.scene.motion(attitude, treads);
            markers.extend(more(&self.scene));
            let header = self.header(time_s, BASE);
            self.put(
                Topic::Scene,
                time_s,
                &self.scene.stamped(markers, &header),
                sink,
            );
        }
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
        self.motion(time_s, state.attitude, state.treads, |_| Vec::new(), sink);
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
        self.put(Topic::PathCommand, time_s, &path_command(record), sink);
        let message = self.path_message(time_s, path_poses(record).into_iter());
        self.put(Topic::Path, time_s, &message, sink);
    }

    /// Gives a cycle of the control loop.
    pub fn loop_cycle(&mut self, row: &CycleRow, sink: &mut impl MessageSink) {
        self.state = Some((row.state, row.bus));
        self.put(Topic::LoopCycle, row.time_s, &loop_cycle(row), sink);
    }

    /// Gives a fix that came at `time_s`.
    pub fn fix(&self, time_s: f64, fix: &FixState, sink: &mut impl MessageSink) {
        self.put(Topic::Fix, time_s, fix, sink);
    }

    /// Gives the obstacles that are known.
    pub fn obstacles(&self, time_s: f64, obstacles: &Obstacles, sink: &mut impl MessageSink) {
        let marker = scene::obstacles(obstacles, self.height_m);
        let markers = self
            .scene
            .stamped(vec![marker], &self.header(time_s, WORLD));
        self.put(Topic::Scene, time_s, &markers, sink);
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
        let status = [
            self.newest
                .as_ref()
                .map(|(decision, drives)| controller_status(decision, drives)),
            self.state.map(|(state, link)| safety_status(state, link)),
            recording_status(general),
        ];
        let header = self.header(time_s, "");
        self.put(
            Topic::Diagnostics,
            time_s,
            &DiagnosticArray {
                header,
                status: status.into_iter().flatten().collect(),
            },
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

/// Returns whether a period has passed since `last_s`, which then is now; also if time has gone back.
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
