//! What the controller tells of itself: where it thinks the vehicle is, what it plans, and how well.

use super::convert::{stamp, to_pose, world_from_base_link};
use super::goals::GoalEnd;
use super::message::{
    DiagnosticArray, DiagnosticStatus, Header, KeyValue, Path, PoseStamped, PoseWithCovariance,
    PoseWithCovarianceStamped,
};
use super::node::{NodeError, RosNode};
use super::qos;
use super::time::RosTime;
use crate::control_loop::channel::{ControllerStatus, LoopStatus};
use crate::safety::{Reason, SafetyState, StopCause};
use ros2_client::Publisher;
use sidehill_controller::controller::{Decision, Status};
use sidehill_controller::estimator::Estimate;
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_plant::vehicle::Vehicle;
use std::collections::VecDeque;
use std::fmt::Display;

/// Time between two predicted trajectories, s.
const PLAN_S: f64 = 0.1;
/// Time between two diagnostics, s.
const DIAGNOSTICS_S: f64 = 1.0;
/// Solves that percentiles are of: 20 s at 20 Hz.
const SOLVES: usize = 400;

/// Levels of diagnostic_msgs/DiagnosticStatus.
mod level {
    pub(super) const OK: u8 = 0;
    pub(super) const WARN: u8 = 1;
    pub(super) const ERROR: u8 = 2;
    pub(super) const STALE: u8 = 3;
}

/// What the server adds to the cycle's own account.
pub(super) struct Account<'a> {
    pub(super) lifecycle: &'a str,
    pub(super) refused: u64,
    pub(super) last_refusal: &'a str,
    /// Pressed or silent.
    pub(super) emergency_stop: Option<StopCause>,
    pub(super) goals: u64,
    /// How the last goal ended.
    pub(super) last_end: Option<(GoalEnd, &'a str)>,
}

/// Counts and quantiles of what was seen of the cycles.
#[derive(Debug, Default)]
struct Seen {
    newest_s: f64,
    solves_us: VecDeque<f64>,
    fallbacks: u64,
    deadlines: u64,
}

impl Seen {
    /// Takes a decision, once.
    fn take(&mut self, decision: &Decision) {
        if decision.time_s == self.newest_s {
            return;
        }
        self.newest_s = decision.time_s;
        if let Some(solve) = &decision.solve {
            if self.solves_us.len() == SOLVES {
                self.solves_us.pop_front();
            }
            self.solves_us.push_back(1e6 * solve.solve_time_s);
        }
        if let Status::Fallback { reason, .. } = decision.status {
            use sidehill_controller::mpc::QpFailure;
            self.fallbacks += 1;
            self.deadlines += u64::from(matches!(reason, QpFailure::Deadline { .. }));
        }
    }

    /// Returns the median, the 99 % quantile and the largest time in the solver, us.
    fn quantiles_us(&self) -> [f64; 3] {
        let mut sorted: Vec<f64> = self.solves_us.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        [0.5, 0.99, 1.0].map(|share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted
                .get(rank.saturating_sub(1))
                .copied()
                .unwrap_or(f64::NAN)
        })
    }
}

/// Publishes it, a few times a second.
pub(super) struct Telemetry {
    pose: Publisher<PoseWithCovarianceStamped>,
    plan: Publisher<Path>,
    reference: Publisher<Path>,
    diagnostics: Publisher<DiagnosticArray>,
    vehicle: Vehicle,
    node: String,
    frame: String,
    seen: Seen,
    plan_s: f64,
    diagnostics_s: f64,
}

impl Telemetry {
    pub(super) fn new(
        node: &mut RosNode,
        vehicle: &Vehicle,
        frame: &str,
    ) -> Result<Self, NodeError> {
        Ok(Self {
            pose: node.publisher("~/pose", &qos::STREAM)?,
            plan: node.publisher("optimal_trajectory", &qos::STREAM)?,
            reference: node.publisher("transformed_global_plan", &qos::STREAM)?,
            diagnostics: node.publisher("/diagnostics", &qos::RELIABLE_10)?,
            vehicle: vehicle.clone(),
            node: node.names().node().fully_qualified_name(),
            frame: frame.to_owned(),
            seen: Seen::default(),
            plan_s: f64::NEG_INFINITY,
            diagnostics_s: f64::NEG_INFINITY,
        })
    }

    /// Publishes what is due. A queue that is full drops it: a later one is newer.
    pub(super) fn tell(
        &mut self,
        now_s: f64,
        time: &RosTime,
        cycle: Option<&LoopStatus>,
        pilot: &ControllerStatus,
        account: &Account<'_>,
    ) {
        let Some(decision) = &pilot.decision else {
            return;
        };
        let new = decision.time_s != self.seen.newest_s;
        self.seen.take(decision);
        let header = |time_s: f64| Header {
            stamp: stamp(time.stamp_ns(time_s)),
            frame_id: self.frame.clone(),
        };
        if let Some(estimate) = decision.estimate.filter(|_| new) {
            let _ = self.pose.publish(PoseWithCovarianceStamped {
                header: header(estimate.time_s),
                pose: pose_with_covariance(&estimate),
            });
        }
        // Either may have jumped back with the clock.
        if !(0.0..PLAN_S).contains(&(now_s - self.plan_s)) {
            self.plan_s = now_s;
            let header = header(decision.time_s);
            for (topic, poses) in [
                (&self.plan, &pilot.plan),
                (&self.reference, &pilot.reference),
            ] {
                let _ = topic.publish(path(&header, poses));
            }
        }
        if let Some(cycle) = cycle
            && !(0.0..DIAGNOSTICS_S).contains(&(now_s - self.diagnostics_s))
        {
            self.diagnostics_s = now_s;
            let status = self.status(cycle, decision, account);
            let _ = self.diagnostics.publish(DiagnosticArray {
                header: header(now_s),
                status: vec![status],
            });
        }
    }

    fn status(
        &self,
        cycle: &LoopStatus,
        decision: &Decision,
        account: &Account<'_>,
    ) -> DiagnosticStatus {
        let (level, message) = judged(cycle, decision, account);
        let [solve_p50, solve_p99, solve_max] = self.seen.quantiles_us();
        let (row, timing) = (&cycle.row, &cycle.timing);
        let estimate = decision.estimate.as_ref();
        let number = |value: f64| format!("{value:.6}");
        let of = |field: fn(&Estimate) -> f64| number(estimate.map_or(f64::NAN, field));
        let slide = estimate.map(|estimate| {
            let sliding = self
                .vehicle
                .body_velocity(estimate.attitude, estimate.treads);
            let level = self.vehicle.icrhk().body_velocity(estimate.treads);
            [
                sliding.right_m_s - level.right_m_s,
                sliding.forward_m_s - level.forward_m_s,
            ]
        });
        let [slide_right, slide_forward] = slide.unwrap_or([f64::NAN; 2]);
        let last_end = account.last_end.map_or_else(String::new, |(end, why)| {
            format!("{end:?}: {why}").trim_end_matches(": ").to_owned()
        });
        let values = [
            ("lifecycle", account.lifecycle.to_owned()),
            ("safety", text(&row.state)),
            (
                "stopped_by",
                cycle
                    .stopped_by
                    .map_or_else(String::new, |reason| reason.to_string()),
            ),
            ("controller", decision.status.to_string()),
            (
                "emergency_stop",
                account.emergency_stop.is_some().to_string(),
            ),
            ("goals", account.goals.to_string()),
            ("last_goal", last_end),
            ("solve_p50_us", number(solve_p50)),
            ("solve_p99_us", number(solve_p99)),
            ("solve_max_us", number(solve_max)),
            ("fallbacks", self.seen.fallbacks.to_string()),
            ("deadline_misses", self.seen.deadlines.to_string()),
            ("cycles", timing.cycles.to_string()),
            ("cycles_skipped", timing.skipped.to_string()),
            ("commands_unsent", timing.unsent.to_string()),
            ("lateness_p99_s", number(timing.lateness_p99_s)),
            ("feedback_age_s", number(row.feedback_age_s)),
            ("pose_age_s", of(|estimate| estimate.pose_age_s)),
            ("attitude_age_s", of(|estimate| estimate.attitude_age_s)),
            (
                "poses_gated",
                estimate.map_or(0, |e| e.poses_gated).to_string(),
            ),
            ("refused", account.refused.to_string()),
            ("last_refusal", account.last_refusal.to_owned()),
            (
                "cross_track_m",
                number(decision.progress.map_or(f64::NAN, |p| p.cross_track_m)),
            ),
            ("slide_right_m_s", number(slide_right)),
            ("slide_forward_m_s", number(slide_forward)),
            ("model_error_m_s", of(|estimate| estimate.model_error_m_s)),
        ];
        DiagnosticStatus {
            level,
            name: format!("{}: path tracking", self.node),
            message,
            hardware_id: self.vehicle.name.clone(),
            values: values
                .into_iter()
                .map(|(key, value)| KeyValue {
                    key: key.to_owned(),
                    value,
                })
                .collect(),
        }
    }
}

/// Returns level and message.
fn judged(cycle: &LoopStatus, decision: &Decision, account: &Account<'_>) -> (u8, String) {
    let said = |level, message: &dyn Display| (level, message.to_string());
    if let Some(cause) = account.emergency_stop {
        return said(level::ERROR, &cause);
    }
    match (cycle.row.state, decision.status) {
        (_, Status::Waiting) => said(level::STALE, &"there is no attitude and no pose yet"),
        (SafetyState::Driving, Status::Fallback { reason, .. }) => said(level::WARN, &reason),
        (SafetyState::Driving, _) => said(level::OK, &"drives"),
        (SafetyState::Zeroing | SafetyState::Enabling, _) => said(level::OK, &"is being armed"),
        (SafetyState::Stopping, _) => said(level::WARN, &"stops"),
        (SafetyState::Disarmed, _) => said(level::OK, &"waits for a path"),
        (SafetyState::Latched, _) => match cycle.stopped_by {
            Some(reason) if is_fault(&reason) => said(level::ERROR, &reason),
            _ => said(level::OK, &"waits for a path"),
        },
    }
}

/// Returns whether a drive ended otherwise than it should.
fn is_fault(reason: &Reason) -> bool {
    match reason {
        Reason::Finished => false,
        Reason::Requested(cause) => cause.is_fault(),
        _ => true,
    }
}

/// Returns the name of a state as files spell it.
fn text(state: &SafetyState) -> String {
    format!("{state:?}").to_lowercase()
}

fn path(header: &Header, poses: &[PlanarPose]) -> Path {
    let poses = poses.iter().map(|pose| PoseStamped {
        header: header.clone(),
        pose: to_pose(&world_from_base_link(&upright(pose), &Attitude::LEVEL)),
    });
    Path {
        header: header.clone(),
        poses: poses.collect(),
    }
}

fn upright(pose: &PlanarPose) -> Pose {
    Pose {
        x_m: pose.x_m,
        y_m: pose.y_m,
        z_m: 0.0,
        yaw_rad: pose.yaw_rad,
    }
}

/// Returns the estimate as ROS has it; what is not estimated has no covariance.
fn pose_with_covariance(estimate: &Estimate) -> PoseWithCovariance {
    let mut covariance = [[0.0; 6]; 6];
    // x, y and the rotation about z.
    for (i, row) in [0, 1, 5].into_iter().enumerate() {
        for (j, column) in [0, 1, 5].into_iter().enumerate() {
            covariance[row][column] = estimate.covariance[(i, j)];
        }
    }
    PoseWithCovariance {
        pose: to_pose(&world_from_base_link(
            &upright(&estimate.pose),
            &estimate.attitude,
        )),
        covariance,
    }
}
