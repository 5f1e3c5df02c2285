//! What a control cycle decides.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use sidehill_controller::controller::{Controller, Decision as Decided, Status};
use sidehill_controller::estimator::Estimate as Estimated;
use sidehill_plant::vehicle::Vehicle;
use std::time::Duration;

/// What a control cycle decides, and what it is based on.
#[pyclass(frozen, module = "sidehill")]
pub struct Decision {
    decided: Decided,
    drive_traction_m_s: f64,
    drive_steer_m_s: f64,
    /// (x, y, yaw) of the plan, row by row.
    plan: Option<Vec<f64>>,
    cycle: Duration,
}

impl Decision {
    /// Returns a decision with what belongs to it from the controller that has just made it.
    pub fn of(
        decided: Decided,
        controller: &Controller,
        vehicle: &Vehicle,
        cycle: Duration,
    ) -> Self {
        let drives = decided.command_for_drives(vehicle);
        let plan = controller.plan().map(|plan| {
            let states = plan.states.iter();
            states
                .flat_map(|state| [state.x, state.y, state.z])
                .collect()
        });
        Self {
            decided,
            drive_traction_m_s: drives.traction_m_s,
            drive_steer_m_s: drives.steer_m_s,
            plan,
            cycle,
        }
    }
}

#[pymethods]
impl Decision {
    /// Instant of the cycle, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.decided.time_s
    }

    /// Effective traction (V_r + V_l)/2 until the next cycle, m/s: what the treads shall do on the ground.
    #[getter]
    fn traction_m_s(&self) -> f64 {
        self.decided.command_effective.traction_m_s
    }

    /// Effective steer (V_r - V_l)/2, m/s, counter-clockwise positive.
    #[getter]
    fn steer_m_s(&self) -> f64 {
        self.decided.command_effective.steer_m_s
    }

    /// Traction that the drives are told, in the speeds that their own encoders count, m/s: equation (11)
    /// solved for them.
    #[getter]
    fn drive_traction_m_s(&self) -> f64 {
        self.drive_traction_m_s
    }

    /// Steer that the drives are told, m/s. The left drive gets traction - steer, the right traction + steer.
    #[getter]
    fn drive_steer_m_s(&self) -> f64 {
        self.drive_steer_m_s
    }

    /// What the command is worth: waiting (no attitude and pose yet), tracking, fallback (on the previous
    /// plan), stopping, or finished.
    #[getter]
    fn status(&self) -> &'static str {
        match self.decided.status {
            Status::Waiting => "waiting",
            Status::Tracking => "tracking",
            Status::Fallback { .. } => "fallback",
            Status::Stopping(_) => "stopping",
            Status::Finished => "finished",
        }
    }

    /// Why the controller falls back or stops the vehicle; None otherwise.
    #[getter]
    fn reason(&self) -> Option<String> {
        match self.decided.status {
            Status::Fallback { reason, .. } => Some(reason.to_string()),
            Status::Stopping(reason) => Some(reason.to_string()),
            Status::Waiting | Status::Tracking | Status::Finished => None,
        }
    }

    /// Whether the reference has been followed to its end.
    #[getter]
    fn finished(&self) -> bool {
        self.decided.status == Status::Finished
    }

    /// Estimated distance from the path, m, left of travel positive; None before there is an estimate.
    #[getter]
    fn cross_track_m(&self) -> Option<f64> {
        self.decided.progress.map(|progress| progress.cross_track_m)
    }

    /// Arc length of the nearest point of the path, m; None before there is an estimate.
    #[getter]
    fn arc_length_m(&self) -> Option<f64> {
        self.decided.progress.map(|progress| progress.arc_length_m)
    }

    /// Pose (x_m, y_m, yaw_rad) of the reference; None before there is an estimate.
    #[getter]
    fn reference_pose(&self) -> Option<(f64, f64, f64)> {
        let pose = self.decided.progress?.point.pose();
        Some((pose.x_m, pose.y_m, pose.yaw_rad))
    }

    /// Time within the QP solver, us; 0 without a QP.
    #[getter]
    fn solve_us(&self) -> f64 {
        self.decided
            .solve
            .map_or(0.0, |solve| 1e6 * solve.solve_time_s)
    }

    /// Interior-point iterations; 0 where no inequality binds, and without a QP.
    #[getter]
    fn iterations(&self) -> u32 {
        self.decided.solve.map_or(0, |solve| solve.iterations)
    }

    /// Time of the whole cycle in the controller, from readings to command, us.
    #[getter]
    fn cycle_us(&self) -> f64 {
        1e6 * self.cycle.as_secs_f64()
    }

    /// The state that the command is based on; None before there is one.
    #[getter]
    fn estimate(&self) -> Option<Estimate> {
        self.decided.estimate.map(Estimate)
    }

    /// Planned (x_m, y_m, yaw_rad) at the stages' ends, the present first: array of shape (N + 1, 3); None
    /// where the law makes no plan.
    #[getter]
    fn plan<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let Some(plan) = &self.plan else {
            return Ok(None);
        };
        let flat = PyArray1::from_slice(py, plan);
        flat.reshape([plan.len() / 3, 3]).map(Some)
    }

    fn __repr__(&self) -> String {
        format!(
            "<sidehill.Decision {} at {} s: traction {} m/s, steer {} m/s>",
            self.status(),
            self.time_s(),
            self.traction_m_s(),
            self.steer_m_s()
        )
    }
}

/// The estimated state of the vehicle at the time of a cycle.
#[pyclass(frozen, module = "sidehill")]
pub struct Estimate(Estimated);

#[pymethods]
impl Estimate {
    /// Instant it holds for, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.0.time_s
    }

    /// Position, m.
    #[getter]
    fn x_m(&self) -> f64 {
        self.0.pose.x_m
    }

    /// Position, m.
    #[getter]
    fn y_m(&self) -> f64 {
        self.0.pose.y_m
    }

    /// Heading of the forward axis, rad, counter-clockwise from Y_g.
    #[getter]
    fn yaw_rad(&self) -> f64 {
        self.0.pose.yaw_rad
    }

    /// Roll, rad, right side down positive.
    #[getter]
    fn roll_rad(&self) -> f64 {
        self.0.attitude.roll_rad
    }

    /// Pitch, rad, nose up positive.
    #[getter]
    fn pitch_rad(&self) -> f64 {
        self.0.attitude.pitch_rad
    }

    /// Covariance of (x, y, yaw): array of shape (3, 3) in m^2, m rad and rad^2.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        // Symmetric: rows and columns are alike.
        PyArray1::from_slice(py, self.0.covariance.as_slice()).reshape([3, 3])
    }

    /// Effective tread speeds (left, right), m/s.
    #[getter]
    fn tread_speeds_m_s(&self) -> (f64, f64) {
        (self.0.treads.left_m_s, self.0.treads.right_m_s)
    }

    /// Root mean square error of the predicted velocity over the last seconds, m/s.
    #[getter]
    fn model_error_m_s(&self) -> f64 {
        self.0.model_error_m_s
    }

    /// Age of the newest pose that was believed, s.
    #[getter]
    fn pose_age_s(&self) -> f64 {
        self.0.pose_age_s
    }

    /// Poses refused as outliers since then.
    #[getter]
    fn poses_gated(&self) -> u32 {
        self.0.poses_gated
    }

    fn __repr__(&self) -> String {
        format!(
            "<sidehill.Estimate at {} s: x {} m, y {} m, yaw {} rad>",
            self.0.time_s, self.0.pose.x_m, self.0.pose.y_m, self.0.pose.yaw_rad
        )
    }
}
