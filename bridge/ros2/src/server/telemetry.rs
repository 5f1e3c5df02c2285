//! What the controller publishes of itself: its estimate, its plan, and diagnostics.

use super::diagnostics::{ServerStatus, SolveStats, diagnostic_status};
use super::goal_session::TrackingState;
use crate::node::demanded::DemandedPublisher;
use crate::node::time::RosTime;
use crate::node::{NodeError, RosNode, qos};
use ros2_client::Publisher;
use sidehill_bridge::control_loop::channel::{ControllerStatus, LoopStatus};
use sidehill_bridge::ros2::conversions::{stamp, to_pose};
use sidehill_bridge::ros2::convert::world_from_base_link;
use sidehill_bridge::ros2::message::{
    DiagnosticArray, Header, Odometry, Path, PoseStamped, PoseWithCovariance,
    PoseWithCovarianceStamped, TfMessage, TrackingFeedback,
};
use sidehill_bridge::ros2::odometry::{OdometryState, odometry_message, transform_message};
use sidehill_bridge::ros2::settings::server::Ros2Config;
use sidehill_controller::controller::Decision;
use sidehill_controller::estimator::Estimate;
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_plant::vehicle::Vehicle;
use std::cell::LazyCell;
use std::collections::BTreeSet;

/// Time between two predicted trajectories, s.
const PLAN_PERIOD_S: f64 = 0.1;
/// Least standard deviation of a velocity, m/s: that of the encoders.
const VELOCITY_STD_MIN_M_S: f64 = 0.01;
/// Time between two looks at who subscribes, s.
const LOOK_PERIOD_S: f64 = 1.0;
/// Time between two diagnostics, s.
const DIAGNOSTICS_PERIOD_S: f64 = 1.0;

/// The publishers of telemetry.
pub(crate) struct Telemetry {
    pose: DemandedPublisher<PoseWithCovarianceStamped>,
    odometry: DemandedPublisher<Odometry>,
    transforms: Option<Publisher<TfMessage>>,
    tracking: Option<Publisher<TrackingFeedback>>,
    plan: DemandedPublisher<Path>,
    reference: DemandedPublisher<Path>,
    diagnostics: Publisher<DiagnosticArray>,
    vehicle: Vehicle,
    node: String,
    frame: String,
    base: String,
    solves: SolveStats,
    look_s: f64,
    plan_s: f64,
    diagnostics_s: f64,
}

impl Telemetry {
    /// Creates the publishers; poses are in the frame of the odometry.
    pub(crate) fn new(
        node: &mut RosNode,
        vehicle: &Vehicle,
        config: &Ros2Config,
    ) -> Result<Self, NodeError> {
        Ok(Self {
            pose: DemandedPublisher::new(node, "~/pose", &qos::STREAM)?,
            odometry: DemandedPublisher::new(node, "~/odometry", &qos::STREAM)?,
            transforms: match config.publish_transform {
                true => Some(node.publisher("/tf", &qos::STREAM)?),
                false => None,
            },
            tracking: match config.tracking_feedback {
                true => Some(node.publisher("tracking_feedback", &qos::STREAM)?),
                false => None,
            },
            plan: DemandedPublisher::new(node, "optimal_trajectory", &qos::STREAM)?,
            reference: DemandedPublisher::new(node, "transformed_global_plan", &qos::STREAM)?,
            diagnostics: node.publisher("/diagnostics", &qos::RELIABLE_10)?,
            vehicle: vehicle.clone(),
            node: node.names().node().fully_qualified_name(),
            frame: config.frames.odometry.clone(),
            base: config.frames.base.clone(),
            solves: SolveStats::default(),
            look_s: f64::NEG_INFINITY,
            plan_s: f64::NEG_INFINITY,
            diagnostics_s: f64::NEG_INFINITY,
        })
    }

    /// Takes, once a second, the topics that other nodes subscribe to.
    pub(crate) fn look(&mut self, now_s: f64, subscribed: impl FnOnce() -> BTreeSet<String>) {
        if is_due(&mut self.look_s, now_s, LOOK_PERIOD_S) {
            let subscribed = subscribed();
            self.pose.look(&subscribed);
            self.odometry.look(&subscribed);
            self.plan.look(&subscribed);
            self.reference.look(&subscribed);
        }
    }

    /// Publishes the estimate of each decision, and the plan where it is due. A full queue drops a message: a
    /// later one is newer.
    pub(crate) fn publish(
        &mut self,
        now_s: f64,
        time: &RosTime,
        controller: &ControllerStatus,
        tracking: impl FnOnce(&Decision) -> Option<TrackingState>,
    ) {
        let Some(decision) = &controller.decision else {
            return;
        };
        let is_new = self.solves.take(decision);
        if let Some(estimate) = decision.estimate.filter(|_| is_new) {
            self.publish_estimate(&estimate, time, || tracking(decision));
        }
        if is_due(&mut self.plan_s, now_s, PLAN_PERIOD_S) {
            let header = self.header(time, decision.time_s);
            self.plan.publish(|| path(&header, &controller.view.plan));
            self.reference
                .publish(|| path(&header, &controller.view.reference));
        }
    }

    fn publish_estimate(
        &self,
        estimate: &Estimate,
        time: &RosTime,
        tracking: impl FnOnce() -> Option<TrackingState>,
    ) {
        let header = self.header(time, estimate.time_s);
        self.pose.publish(|| PoseWithCovarianceStamped {
            header: header.clone(),
            pose: pose_with_covariance(estimate),
        });
        let state = LazyCell::new(|| odometry_state(estimate, &self.vehicle));
        if let Some(transforms) = &self.transforms {
            let transform = transform_message(&state, header.clone(), &self.base);
            let _ = transforms.publish(TfMessage {
                transforms: vec![transform],
            });
        }
        if let Some(topic) = &self.tracking
            && let Some(tracking) = tracking()
        {
            let _ = topic.publish(tracking_feedback(&tracking, &header, &state));
        }
        self.odometry
            .publish(|| odometry_message(&state, header, &self.base));
    }

    /// Returns whether diagnostics are due; then they are to be published.
    pub(crate) fn diagnostics_are_due(&mut self, now_s: f64) -> bool {
        is_due(&mut self.diagnostics_s, now_s, DIAGNOSTICS_PERIOD_S)
    }

    /// Publishes diagnostics.
    pub(crate) fn publish_diagnostics(
        &self,
        now_s: f64,
        time: &RosTime,
        (status, decision): (&LoopStatus, &Decision),
        server: &ServerStatus<'_>,
    ) {
        let (node, vehicle, solves) = (&self.node, &self.vehicle, &self.solves);
        let status = diagnostic_status(node, vehicle, status, decision, solves, server);
        let _ = self.diagnostics.publish(DiagnosticArray {
            header: self.header(time, now_s),
            status: vec![status],
        });
    }

    fn header(&self, time: &RosTime, time_s: f64) -> Header {
        Header {
            stamp: stamp(time.stamp_ns(time_s)),
            frame_id: self.frame.clone(),
        }
    }
}

/// Returns whether a period has passed since `last_s`, which then is now; also where the clock has jumped
/// back.
fn is_due(last_s: &mut f64, now_s: f64, period_s: f64) -> bool {
    let due = !(0.0..period_s).contains(&(now_s - *last_s));
    if due {
        *last_s = now_s;
    }
    due
}

fn path(header: &Header, poses: &[PlanarPose]) -> Path {
    let poses = poses.iter().map(|pose| PoseStamped {
        header: header.clone(),
        pose: to_pose(&world_from_base_link(&level(pose), &Attitude::LEVEL)),
    });
    Path {
        header: header.clone(),
        poses: poses.collect(),
    }
}

fn level(pose: &PlanarPose) -> Pose {
    Pose {
        x_m: pose.x_m,
        y_m: pose.y_m,
        z_m: 0.0,
        yaw_rad: pose.yaw_rad,
    }
}

/// Returns the feedback of Nav2 on a path, signed as there: positive where the vehicle is to the left of the
/// path, and where its heading is turned to the right of the path's.
fn tracking_feedback(
    tracking: &TrackingState,
    header: &Header,
    state: &OdometryState,
) -> TrackingFeedback {
    TrackingFeedback {
        header: header.clone(),
        position_tracking_error: tracking.cross_track_m as f32,
        heading_tracking_error: -tracking.heading_error_rad as f32,
        current_path_index: u32::try_from(tracking.path_index).unwrap_or(u32::MAX),
        robot_pose: PoseStamped {
            header: header.clone(),
            pose: to_pose(&world_from_base_link(&state.pose, &state.attitude)),
        },
        distance_to_goal: tracking.distance_to_goal_m as f32,
        speed: state.velocity.forward_m_s.hypot(state.velocity.right_m_s) as f32,
        remaining_path_length: tracking.left_m as f32,
    }
}

/// Returns pose and velocity of an estimate. The velocity is that of the vehicle's model; how far off it was
/// in the last seconds is its standard deviation.
fn odometry_state(estimate: &Estimate, vehicle: &Vehicle) -> OdometryState {
    let std_m_s = estimate.model_error_m_s.max(VELOCITY_STD_MIN_M_S);
    let half_track_m = 0.5 * (vehicle.icrs.right_m - vehicle.icrs.left_m);
    OdometryState {
        time_s: estimate.time_s,
        pose: level(&estimate.pose),
        attitude: estimate.attitude,
        velocity: vehicle.extended_velocity(estimate.attitude, estimate.treads),
        covariance: estimate.covariance,
        velocity_std_m_s: std_m_s,
        yaw_rate_std_rad_s: std_m_s / half_track_m,
    }
}

/// Returns the estimate as a message; what is not estimated has no covariance.
fn pose_with_covariance(estimate: &Estimate) -> PoseWithCovariance {
    let mut covariance = [[0.0; 6]; 6];
    // x, y and the rotation about z.
    for (i, row) in [0, 1, 5].into_iter().enumerate() {
        for (j, column) in [0, 1, 5].into_iter().enumerate() {
            covariance[row][column] = estimate.covariance[(i, j)];
        }
    }
    let pose = world_from_base_link(&level(&estimate.pose), &estimate.attitude);
    PoseWithCovariance {
        pose: to_pose(&pose),
        covariance,
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_data::estimate;
    use super::*;
    use sidehill_bridge::ros2::conversions::from_pose;
    use sidehill_bridge::ros2::convert::pose_and_attitude;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_period_passes_and_a_clock_that_jumps_back_starts_over() {
        let mut last_s = f64::NEG_INFINITY;
        let due: Vec<bool> = [10.0, 10.0625, 10.125, 10.1875, 3.0, 3.0625]
            .into_iter()
            .map(|now_s| is_due(&mut last_s, now_s, 0.125))
            .collect();
        assert_eq!(due, [true, false, true, false, true, false]);
    }

    #[test]
    fn the_estimate_is_published_in_the_axes_of_ros() {
        let mut estimate = estimate(5.0, 1.0, 0.3);
        estimate.attitude = Attitude {
            roll_rad: 0.2,
            pitch_rad: -0.1,
        };
        estimate.covariance[(0, 0)] = 0.01;
        estimate.covariance[(1, 2)] = 0.002;
        let message = pose_with_covariance(&estimate);
        let (pose, attitude) = pose_and_attitude(&from_pose(&message.pose).unwrap());
        assert!((pose.x_m - 1.0).abs() < 1e-12 && (pose.yaw_rad - 0.3).abs() < 1e-9);
        assert!((attitude.roll_rad - 0.2).abs() < 1e-9);
        assert_eq!(message.covariance[0][0], 0.01);
        assert_eq!(message.covariance[1][5], 0.002);
    }

    #[test]
    fn a_path_has_one_header_and_level_poses() {
        let header = Header {
            frame_id: "odom".to_owned(),
            ..Header::default()
        };
        let pose = PlanarPose {
            x_m: 2.0,
            y_m: -1.0,
            yaw_rad: -FRAC_PI_2,
        };
        let path = path(&header, &[pose, pose]);
        assert_eq!(path.poses.len(), 2);
        assert_eq!(path.poses[1].header, header);
        // A heading of -90 deg looks along x, which is the identity rotation in ROS.
        let q = &path.poses[0].pose.orientation;
        assert!((q.w.abs() - 1.0).abs() < 1e-12, "{q:?}");
        assert_eq!(path.poses[0].pose.position.x, 2.0);
    }
}
