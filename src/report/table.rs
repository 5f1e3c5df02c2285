//! A run as CSV.

use crate::record::{Row, Run, status_words};
use serde::Serialize;
use sidehill_plant::contact::Parameter;
use std::io::Write;

/// Writes `run` as CSV with a header and one row per control cycle.
///
/// Units are in the columns' names, frames are those of [`Row`]: x, y, z and yaw in the world, yaw
/// counter-clockwise from Y_g; ICRs in the body, to the right and ahead of its origin. `estimate_*`
/// are empty where there is none. `status` is `waiting`, `tracking`, `fallback`, `stopping` or
/// `finished`, and `reason` says why for the two that need one. Floats are the shortest that read back
/// as the same bits; what is not finite is `NaN`, `inf` or `-inf`. Where another point than the origin is
/// tracked, `tracked_x_m` and `tracked_y_m` follow; with the steepness guard on, `rollover_margin`,
/// `friction_use` and `speed_share`.
///
/// Among the columns are those of a log (true pose and attitude, `v_left_m_s` and `v_right_m_s` as
/// encoders count them), so that `identify` and `odometry` read the file as it is.
///
/// The CSV of a controller that learns a contact vehicle has more columns: of each parameter `learned_KEY` with
/// the ends of its 95 % interval, `learned_KEY_low` and `learned_KEY_high`, and `learned_unobserved`, the
/// keys, with spaces between, that the drive has not excited so far, so that they are still at their priors.
///
/// # Errors
/// An error of `out`.
pub fn write_csv(run: &Run, out: impl Write) -> csv::Result<()> {
    let mut table = csv::WriterBuilder::new()
        .has_headers(false)
        .from_writer(out);
    // Written here, so that a run without rows has a header as well.
    let learns = run.rows.iter().any(|row| row.contact.is_some());
    let extra: Vec<&Extra> = EXTRAS.iter().filter(|extra| extra.is_in(run)).collect();
    let own = COLUMNS.iter().map(|name| (*name).to_owned());
    let learned = learned_columns().filter(|_| learns);
    let names = extra.iter().map(|extra| extra.name.to_owned());
    table.write_record(own.chain(learned).chain(names))?;
    for row in &run.rows {
        let extra: Vec<Option<f64>> = extra.iter().map(|extra| (extra.value)(row)).collect();
        if learns {
            table.serialize((Record::from(row), learned_values(row), extra))?;
        } else {
            table.serialize((Record::from(row), extra))?;
        }
    }
    table.flush()?;
    Ok(())
}

fn learned_columns() -> impl Iterator<Item = String> {
    Parameter::ALL
        .into_iter()
        .flat_map(|parameter| {
            ["", "_low", "_high"].map(|end| format!("learned_{}{end}", parameter.key()))
        })
        .chain(["learned_unobserved".to_owned()])
}

fn learned_values(row: &Row) -> (Vec<Option<f64>>, String) {
    let values = Parameter::ALL.into_iter().flat_map(|parameter| {
        row.contact.map_or([None; 3], |contact| {
            let (value, (low, high)) = contact.interval(parameter);
            [Some(value), Some(low), Some(high)]
        })
    });
    let unobserved = row.contact.map_or_else(Vec::new, |contact| {
        let all = Parameter::ALL.into_iter();
        all.filter(|p| !contact.observed(*p))
            .map(Parameter::key)
            .collect()
    });
    (values.collect(), unobserved.join(" "))
}

/// Names of the columns: the fields of [`Record`].
const COLUMNS: [&str; 30] = [
    "time_s",
    "x_m",
    "y_m",
    "z_m",
    "yaw_rad",
    "roll_rad",
    "pitch_rad",
    "estimate_x_m",
    "estimate_y_m",
    "estimate_yaw_rad",
    "reference_x_m",
    "reference_y_m",
    "reference_yaw_rad",
    "cross_track_m",
    "along_track_m",
    "heading_error_rad",
    "command_traction_m_s",
    "command_steer_m_s",
    "motor_traction_m_s",
    "motor_steer_m_s",
    "icr_left_m",
    "icr_right_m",
    "icr_forward_m",
    "status",
    "reason",
    "qp_iterations",
    "solve_us",
    "cycle_us",
    "v_left_m_s",
    "v_right_m_s",
];

/// A column that only some runs have, after the others.
struct Extra {
    name: &'static str,
    value: fn(&Row) -> Option<f64>,
}

impl Extra {
    fn is_in(&self, run: &Run) -> bool {
        run.rows.iter().any(|row| (self.value)(row).is_some())
    }
}

const EXTRAS: [Extra; 5] = [
    Extra {
        name: "rollover_margin",
        value: |row| row.slope.map(|slope| slope.margins.rollover),
    },
    Extra {
        name: "friction_use",
        value: |row| row.slope.map(|slope| slope.margins.friction_use),
    },
    Extra {
        name: "speed_share",
        value: |row| row.slope.map(|slope| slope.speed_share),
    },
    Extra {
        name: "tracked_x_m",
        value: |row| row.tracked.map(|point| point[0]),
    },
    Extra {
        name: "tracked_y_m",
        value: |row| row.tracked.map(|point| point[1]),
    },
];

#[derive(Serialize)]
struct Record {
    time_s: f64,
    x_m: f64,
    y_m: f64,
    z_m: f64,
    yaw_rad: f64,
    roll_rad: f64,
    pitch_rad: f64,
    estimate_x_m: Option<f64>,
    estimate_y_m: Option<f64>,
    estimate_yaw_rad: Option<f64>,
    reference_x_m: f64,
    reference_y_m: f64,
    reference_yaw_rad: f64,
    cross_track_m: f64,
    along_track_m: f64,
    heading_error_rad: f64,
    command_traction_m_s: f64,
    command_steer_m_s: f64,
    motor_traction_m_s: f64,
    motor_steer_m_s: f64,
    icr_left_m: f64,
    icr_right_m: f64,
    icr_forward_m: f64,
    status: String,
    reason: String,
    qp_iterations: u32,
    solve_us: f64,
    cycle_us: f64,
    v_left_m_s: f64,
    v_right_m_s: f64,
}

impl From<&Row> for Record {
    fn from(row: &Row) -> Self {
        let (status, reason) = status_words(row.status);
        Self {
            time_s: row.time_s,
            x_m: row.pose.x_m,
            y_m: row.pose.y_m,
            z_m: row.pose.z_m,
            yaw_rad: row.pose.yaw_rad,
            roll_rad: row.attitude.roll_rad,
            pitch_rad: row.attitude.pitch_rad,
            estimate_x_m: row.estimate.map(|pose| pose.x_m),
            estimate_y_m: row.estimate.map(|pose| pose.y_m),
            estimate_yaw_rad: row.estimate.map(|pose| pose.yaw_rad),
            reference_x_m: row.reference.x_m,
            reference_y_m: row.reference.y_m,
            reference_yaw_rad: row.reference.yaw_rad,
            cross_track_m: row.cross_track_m,
            along_track_m: row.along_track_m,
            heading_error_rad: row.heading_error_rad,
            command_traction_m_s: row.command.traction_m_s,
            command_steer_m_s: row.command.steer_m_s,
            motor_traction_m_s: row.motors.traction_m_s,
            motor_steer_m_s: row.motors.steer_m_s,
            icr_left_m: row.icrs.left_m,
            icr_right_m: row.icrs.right_m,
            icr_forward_m: row.icrs.forward_m,
            status: status.into(),
            reason,
            qp_iterations: row.qp_iterations,
            solve_us: row.solve_us,
            cycle_us: row.cycle_us,
            v_left_m_s: row.tread_speeds.left_m_s,
            v_right_m_s: row.tread_speeds.right_m_s,
        }
    }
}
