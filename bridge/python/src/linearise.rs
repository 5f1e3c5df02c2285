//! The prediction models with their derivatives, for arrays of states.

use crate::arguments::{number, object, shown};
use crate::errors::{failed, guarded, invalid};
use crate::vehicle::Vehicle;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sidehill::icr::IcrInput;
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::mpc::Model;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::prediction::rate_on_plane;
use sidehill_plant::speeds::{MotorSpeeds, TreadSpeeds};

/// Names of what [`linearise`] gives, three numbers an element each.
const COLUMNS: [&str; 9] = [
    "change",
    "by_yaw",
    "by_traction",
    "by_steer",
    "velocity",
    "velocity_by_roll",
    "velocity_by_pitch",
    "velocity_by_traction",
    "velocity_by_steer",
];

/// Evaluates a model at each index of arrays of one length; `sidehill.linearise` broadcasts for it.
///
/// `change` is the rate of (x, y, yaw), or with a step its increment.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "columns")]
pub fn linearise<'py>(
    py: Python<'py>,
    vehicle: &Bound<'py, PyAny>,
    model: &Bound<'py, PyAny>,
    yaw_rad: PyReadonlyArray1<'py, f64>,
    traction_m_s: PyReadonlyArray1<'py, f64>,
    steer_m_s: PyReadonlyArray1<'py, f64>,
    roll_rad: PyReadonlyArray1<'py, f64>,
    pitch_rad: PyReadonlyArray1<'py, f64>,
    step_s: Option<&Bound<'py, PyAny>>,
    smoothing_m_s: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let vehicle = &object::<Vehicle>("vehicle", vehicle)?.get().0;
    let within = |name: &'static str, low: f64, high: f64, unit, value: &Bound<'_, PyAny>| {
        let bounds = Bounds::new(low, high, unit);
        bounds.check(name, number(name, value)?).map_err(invalid)
    };
    let step_s = step_s
        .map(|value| within("step_s", 1e-4, 10.0, "s", value))
        .transpose()?;
    let smoothing_m_s = smoothing_m_s
        .map_or(Ok(ControllerConfig::default().smoothing_m_s), |value| {
            within("smoothing_m_s", 0.0, 1.0, "m/s", value)
        })?;
    let mut model = Model::of_kind(kind(model)?, vehicle, smoothing_m_s)
        .map_err(failed)?
        .ok_or_else(|| invalid("model: it does not predict"))?;
    let arrays = [&yaw_rad, &traction_m_s, &steer_m_s, &roll_rad, &pitch_rad];
    let mut slices = [&[][..]; 5];
    for (slice, array) in slices.iter_mut().zip(arrays) {
        *slice = array.as_slice()?;
    }
    let columns = guarded(py, || {
        let [yaw, traction, steer, roll, pitch] = slices;
        let mut columns: [Vec<f64>; 9] = std::array::from_fn(|_| Vec::with_capacity(3 * yaw.len()));
        for i in 0..yaw.len() {
            let motors = MotorSpeeds {
                traction_m_s: traction[i],
                steer_m_s: steer[i],
            };
            let treads = TreadSpeeds::from(motors);
            let input = IcrInput {
                roll_rad: roll[i],
                pitch_rad: pitch[i],
                v_left_m_s: treads.left_m_s,
                v_right_m_s: treads.right_m_s,
            };
            let (attitude, _) = input
                .checked()
                .map_err(|error| invalid(format!("{error}, at index {i}")))?;
            let normal = attitude.plane_normal(yaw[i]);
            let body = model.body_velocity(attitude, motors);
            let world = match step_s {
                None => {
                    let rate = rate_on_plane(&normal, yaw[i], |_| body);
                    [rate.rate, rate.by_yaw, rate.by_traction, rate.by_steer]
                }
                Some(step_s) => {
                    let step = model.step_on_plane(&normal, yaw[i], motors, step_s);
                    [step.increment, step.by_yaw, step.by_traction, step.by_steer]
                }
            };
            let own = [
                body.velocity.vector(),
                body.by_roll,
                body.by_pitch,
                body.by_traction,
                body.by_steer,
            ];
            for (column, vector) in columns.iter_mut().zip(world.into_iter().chain(own)) {
                column.extend_from_slice(vector.as_slice());
            }
        }
        Ok(columns)
    })?;
    let out = PyDict::new(py);
    for (name, column) in COLUMNS.into_iter().zip(columns) {
        out.set_item(name, PyArray1::from_vec(py, column))?;
    }
    Ok(out)
}

/// Returns the MPC that predicts with the model of that name.
fn kind(model: &Bound<'_, PyAny>) -> PyResult<ControllerKind> {
    let name: Option<String> = model.extract().ok();
    match name.as_deref() {
        Some("icrik") => Ok(ControllerKind::IcrikMpc),
        Some("icrhk") => Ok(ControllerKind::IcrhkMpc),
        Some("contact") => Ok(ControllerKind::ContactMpc),
        _ => Err(invalid(format!(
            "model: {} is not a model, they are icrik, icrhk, contact",
            shown(model)
        ))),
    }
}
