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
    let learns = run.rows.iter().any(|row| row.contact.is_some());
    let has = |column: &&Column| run.rows.iter().any(|row| (column.1)(row).is_some());
    let extra: Vec<&Column> = EXTRAS.iter().filter(has).collect();
    // Written here, so that a run without rows has a header as well.
    let own = COLUMNS.iter().map(|(name, _)| (*name).to_owned());
    let learned = learned_columns().filter(|_| learns);
    let names = extra.iter().map(|(name, _)| (*name).to_owned());
    table.write_record(own.chain(learned).chain(names))?;
    for row in &run.rows {
        let mut cells: Vec<Option<CsvCell>> = COLUMNS.iter().map(|(_, cell)| cell(row)).collect();
        if learns {
            cells.extend(learned_cells(row));
        }
        cells.extend(extra.iter().map(|(_, cell)| cell(row)));
        table.serialize(cells)?;
    }
    table.flush()?;
    Ok(())
}

/// A value of a table; none is an empty cell.
#[derive(Serialize)]
#[serde(untagged)]
enum CsvCell {
    Number(f64),
    Count(u32),
    Text(String),
}

/// Name and value of a column.
type Column = (&'static str, fn(&Row) -> Option<CsvCell>);

fn number(value: f64) -> Option<CsvCell> {
    Some(CsvCell::Number(value))
}

fn learned_columns() -> impl Iterator<Item = String> {
    Parameter::ALL
        .into_iter()
        .flat_map(|parameter| {
            ["", "_low", "_high"].map(|end| format!("learned_{}{end}", parameter.key()))
        })
        .chain(["learned_unobserved".to_owned()])
}

fn learned_cells(row: &Row) -> impl Iterator<Item = Option<CsvCell>> {
    let values = Parameter::ALL.into_iter().flat_map(|parameter| {
        row.contact.map_or([None, None, None], |contact| {
            let (value, (low, high)) = contact.interval(parameter);
            [value, low, high].map(number)
        })
    });
    let unobserved: Vec<_> = row.contact.map_or_else(Vec::new, |contact| {
        let all = Parameter::ALL.into_iter();
        all.filter(|p| !contact.observed(*p))
            .map(Parameter::key)
            .collect()
    });
    values.chain([Some(CsvCell::Text(unobserved.join(" ")))])
}

/// The columns that every run has.
const COLUMNS: [Column; 30] = [
    ("time_s", |row| number(row.time_s)),
    ("x_m", |row| number(row.pose.x_m)),
    ("y_m", |row| number(row.pose.y_m)),
    ("z_m", |row| number(row.pose.z_m)),
    ("yaw_rad", |row| number(row.pose.yaw_rad)),
    ("roll_rad", |row| number(row.attitude.roll_rad)),
    ("pitch_rad", |row| number(row.attitude.pitch_rad)),
    ("estimate_x_m", |row| number(row.estimate?.x_m)),
    ("estimate_y_m", |row| number(row.estimate?.y_m)),
    ("estimate_yaw_rad", |row| number(row.estimate?.yaw_rad)),
    ("reference_x_m", |row| number(row.reference.x_m)),
    ("reference_y_m", |row| number(row.reference.y_m)),
    ("reference_yaw_rad", |row| number(row.reference.yaw_rad)),
    ("cross_track_m", |row| number(row.cross_track_m)),
    ("along_track_m", |row| number(row.along_track_m)),
    ("heading_error_rad", |row| number(row.heading_error_rad)),
    ("command_traction_m_s", |row| {
        number(row.command.traction_m_s)
    }),
    ("command_steer_m_s", |row| number(row.command.steer_m_s)),
    ("motor_traction_m_s", |row| number(row.motors.traction_m_s)),
    ("motor_steer_m_s", |row| number(row.motors.steer_m_s)),
    ("icr_left_m", |row| number(row.icrs.left_m)),
    ("icr_right_m", |row| number(row.icrs.right_m)),
    ("icr_forward_m", |row| number(row.icrs.forward_m)),
    ("status", |row| {
        Some(CsvCell::Text(status_words(row.status).0.to_owned()))
    }),
    ("reason", |row| {
        Some(CsvCell::Text(status_words(row.status).1))
    }),
    ("qp_iterations", |row| {
        Some(CsvCell::Count(row.qp_iterations))
    }),
    ("solve_us", |row| number(row.solve_us)),
    ("cycle_us", |row| number(row.cycle_us)),
    ("v_left_m_s", |row| number(row.tread_speeds.left_m_s)),
    ("v_right_m_s", |row| number(row.tread_speeds.right_m_s)),
];

/// The columns that only some runs have, after the others.
const EXTRAS: [Column; 8] = [
    ("cross_track_bound_m", |row| {
        number(row.cross_track_bound_m?)
    }),
    ("cross_track_ahead_m", |row| {
        number(row.ahead?.cross_track_m)
    }),
    ("cross_track_ahead_bound_m", |row| {
        number(row.ahead?.bound_m)
    }),
    ("rollover_margin", |row| number(row.slope?.margins.rollover)),
    ("friction_use", |row| {
        number(row.slope?.margins.friction_use)
    }),
    ("speed_share", |row| number(row.slope?.speed_share)),
    ("tracked_x_m", |row| number(row.tracked?[0])),
    ("tracked_y_m", |row| number(row.tracked?[1])),
];
