//! What a control cycle decides.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sidehill_controller::controller::{Controller, Decision as Decided, Status};
use sidehill_controller::estimator::Estimate as Estimated;
use sidehill_plant::contact::Parameter;
use sidehill_plant::vehicle::Vehicle;
use std::time::Duration;

/// What a control cycle decides, and what it is based on.
#[pyclass(frozen, module = "sidehill")]
pub struct Decision {
    decided: Decided,
    drive_traction_m_s: f64,
    drive_steer_m_s: f64,
    plan: Option<Plan>,
    cycle: Duration,
}

/// The plan, row by row.
struct Plan {
    /// (x, y, yaw).
    states: Vec<f64>,
    /// (traction, steer).
    inputs: Vec<f64>,
    ends_s: Vec<f64>,
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
        let plan = controller.mpc().and_then(|mpc| {
            let plan = mpc.plan()?;
            let (states, inputs, times) = (&plan.states, &plan.inputs, mpc.stage_times());
            let ends = (0..inputs.len()).map(|k| times.end_s(k));
            Some(Plan {
                states: states.iter().flat_map(|x| [x.x, x.y, x.z]).collect(),
                inputs: inputs
                    .iter()
                    .flat_map(|u| [u.traction_m_s, u.steer_m_s])
                    .collect(),
                ends_s: std::iter::once(0.0).chain(ends).collect(),
            })
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

    /// Bound that the distance from the path keeps to `cross_track_m` with a probability of 95 %, m; None before there is an
    /// estimate.
    #[getter]
    fn cross_track_bound_m(&self) -> Option<f64> {
        self.decided.cross_track_bound_m()
    }

    /// Distance from the path that the plan has 2 s ahead, m, left of travel positive; None where nothing is planned along a
    /// path.
    #[getter]
    fn cross_track_ahead_m(&self) -> Option<f64> {
        self.decided.ahead.map(|ahead| ahead.cross_track_m)
    }

    /// Bound that the true distance from the path 2 s ahead keeps to `cross_track_ahead_m` with a probability of 95 %, m;
    /// None where that is.
    #[getter]
    fn cross_track_ahead_bound_m(&self) -> Option<f64> {
        self.decided.ahead.map(|ahead| ahead.bound_m)
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
        let flat = PyArray1::from_slice(py, &plan.states);
        flat.reshape([plan.states.len() / 3, 3]).map(Some)
    }

    /// Planned effective inputs (traction_m_s, steer_m_s) of the stages: array of shape (N, 2); None where the law makes
    /// no plan.
    #[getter]
    fn plan_inputs<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let Some(plan) = &self.plan else {
            return Ok(None);
        };
        let flat = PyArray1::from_slice(py, &plan.inputs);
        flat.reshape([plan.inputs.len() / 2, 2]).map(Some)
    }

    /// Ends of the stages after the plan's begin, s, 0 first: array of shape (N + 1,); None where the law makes no plan.
    #[getter]
    fn plan_times_s<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let plan = self.plan.as_ref()?;
        Some(PyArray1::from_slice(py, &plan.ends_s))
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

    /// Learned parameters of the vehicle on wheels, by the keys of a vehicle's `contact`: (value, low, high) with the ends
    /// of the 95 % interval, in the key's unit; None of a controller that does not learn them.
    #[getter]
    fn learned<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(contact) = &self.0.contact else {
            return Ok(None);
        };
        let learned = PyDict::new(py);
        for parameter in Parameter::ALL {
            let (value, (low, high)) = contact.interval(parameter);
            learned.set_item(parameter.key(), (value, low, high))?;
        }
        Ok(Some(learned))
    }

    /// Learned slip gains, zero where they are not what is learned: array of shape (3, 5), rows v_x,
    /// v_y, omega_z, columns sigma, |sigma| alpha, |sigma| phi, sigma alpha, sigma phi (docs/adaptation.md).
    #[getter]
    fn slip_gains<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let gains = &self.0.slip_gains;
        let rows = gains.row_iter();
        let values = rows.flat_map(|row| row.iter().copied().collect::<Vec<_>>());
        PyArray1::from_vec(py, values.collect()).reshape([gains.nrows(), gains.ncols()])
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

    /// Poses since then that came too late to have an effect.
    #[getter]
    fn poses_late(&self) -> u32 {
        self.0.poses_late
    }

    fn __repr__(&self) -> String {
        format!(
            "<sidehill.Estimate at {} s: x {} m, y {} m, yaw {} rad>",
            self.0.time_s, self.0.pose.x_m, self.0.pose.y_m, self.0.pose.yaw_rad
        )
    }
}
