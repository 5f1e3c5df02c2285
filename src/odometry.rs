//! `sidehill odometry`: Table II for a log.

mod report;

use crate::config::ConfigFile;
use crate::console;
use crate::drive_log::{LogArgs, LogReader};
use crate::output;
use crate::simulate::Format;
use anyhow::{Context, Result, bail};
use serde::Serialize;
use serde_json::Value;
use sidehill_plant::log::DriveLog;
use sidehill_plant::odometry::{Comparison, KinematicModel, MeanSquaredErrors, compare};
use sidehill_plant::statistics::median;
use sidehill_plant::vehicle::Vehicle;
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `sidehill odometry`.
#[derive(Debug, Clone, clap::Args)]
pub struct OdometryArgs {
    /// Log with tread speeds, attitude and poses, CSV or a bag of ROS 2; with --live the configuration of
    /// the node.
    #[arg(required_unless_present = "live")]
    pub log: Option<PathBuf>,
    /// Vehicle that drove.
    #[arg(long, value_name = "FILE", required_unless_present = "live")]
    pub vehicle: Option<PathBuf>,
    /// Run as a ROS 2 node that publishes odometry from tread speeds and attitude, until a signal
    /// arrives.
    #[arg(long)]
    pub live: bool,
    /// What the columns or topics of the log mean.
    #[command(flatten)]
    pub maps: LogArgs,
    /// How the errors are printed.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
    /// HTML file for a report with map, plots and conclusions.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Overwrite --report where it exists.
    #[arg(long)]
    pub force: bool,
}

/// The models compared, with their names in tables and in JSON.
const MODELS: [(KinematicModel, &str); 4] = [
    (KinematicModel::Icrhk, "icrhk"),
    (KinematicModel::Icrik, "icrik"),
    (KinematicModel::Extended, "extended"),
    (KinematicModel::DifferentialDrive, "diff_drive"),
];

const NAMES: [&str; MODELS.len()] = {
    let [(_, a), (_, b), (_, c), (_, d)] = MODELS;
    [a, b, c, d]
};

/// One model's errors, as printed in JSON.
#[derive(Debug, Serialize)]
struct OdometryFigures {
    mse_x: f64,
    mse_y: f64,
    mse_z: f64,
    mse_yaw: f64,
    j_over_n: f64,
}

impl From<MeanSquaredErrors> for OdometryFigures {
    fn from(errors: MeanSquaredErrors) -> Self {
        Self {
            mse_x: errors.x_m2,
            mse_y: errors.y_m2,
            mse_z: errors.z_m2,
            mse_yaw: errors.yaw_rad2,
            j_over_n: errors.fitness(),
        }
    }
}

/// Prints the mean squared errors of each model's dead reckoning against the log's poses.
///
/// # Errors
/// Names the file, row and column at fault.
pub fn run(args: &OdometryArgs) -> Result<()> {
    if let Some(path) = &args.report {
        output::check_writable(path, args.force)?;
        output::check_apart(path, &args.log)?;
    }
    let (Some(path), Some(vehicle)) = (&args.log, &args.vehicle) else {
        bail!("a log and --vehicle FILE are needed");
    };
    let vehicle: Vehicle = ConfigFile::read(vehicle)?.parse()?;
    let log = LogReader::new(&args.maps)?.read(path, console::complain)?;
    let log_name = path.display().to_string();
    let comparisons = comparisons(&log, &vehicle).with_context(|| log_name.clone())?;
    match args.format {
        Format::Table => console::text(table(&comparisons)),
        Format::Json => console::line(serde_json::to_string(&json(&comparisons)?)?),
    }
    if let Some(path) = &args.report {
        let page = report::html(
            &log_name,
            &vehicle,
            &NAMES,
            &comparisons,
            slope(&log, &vehicle),
        );
        output::write(path, page.as_bytes(), args.force)?;
    }
    Ok(())
}

/// Returns what `odometry --format json` prints.
///
/// # Errors
/// Names what the log lacks.
pub fn figures(log: &DriveLog, vehicle: &Vehicle) -> Result<serde_json::Map<String, Value>> {
    json(&comparisons(log, vehicle)?)
}

fn slope(log: &DriveLog, vehicle: &Vehicle) -> report::Slope {
    let tilts = log.rows().iter().map(|row| {
        let attitude = &row.attitude;
        attitude.roll_rad.hypot(attitude.pitch_rad).to_degrees()
    });
    let slide = &vehicle.slide;
    report::Slope {
        tilt_deg: median(tilts.collect()).unwrap_or(0.0),
        slides: slide.shift_s_per_rad > 0.0 || slide.aggravated_s_per_rad > 0.0,
    }
}

/// Compares the poses of each model with those of the log.
fn comparisons(log: &DriveLog, vehicle: &Vehicle) -> Result<Vec<Vec<Comparison>>> {
    let comparisons = MODELS.map(|(model, _)| compare(log, vehicle, model));
    Ok(comparisons.into_iter().collect::<Result<_, _>>()?)
}

fn table(comparisons: &[Vec<Comparison>]) -> String {
    let mut out = String::new();
    let samples = comparisons.first().map_or(0, Vec::len);
    let _ = writeln!(out, "mean squared errors over {samples} poses");
    let _ = writeln!(
        out,
        "{:12} {:>10} {:>10} {:>10} {:>10} {:>10}",
        "model", "x m^2", "y m^2", "z m^2", "yaw rad^2", "J/N"
    );
    for ((_, name), comparisons) in MODELS.iter().zip(comparisons) {
        let errors = MeanSquaredErrors::of(comparisons);
        let _ = writeln!(
            out,
            "{name:12} {:10.4} {:10.4} {:10.4} {:10.4} {:10.4}",
            errors.x_m2,
            errors.y_m2,
            errors.z_m2,
            errors.yaw_rad2,
            errors.fitness()
        );
    }
    out
}

fn json(comparisons: &[Vec<Comparison>]) -> Result<serde_json::Map<String, Value>> {
    let mut object = serde_json::Map::new();
    let samples = comparisons.first().map_or(0, Vec::len);
    object.insert("samples".into(), samples.into());
    for ((_, name), comparisons) in MODELS.iter().zip(comparisons) {
        let figures = OdometryFigures::from(MeanSquaredErrors::of(comparisons));
        object.insert((*name).into(), serde_json::to_value(figures)?);
    }
    Ok(object)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::page::COLOURS;
    use sidehill_plant::frames::Pose;

    fn off_by(x_m: f64) -> Vec<Comparison> {
        vec![Comparison {
            time_s: 0.1,
            measured: Pose::default(),
            estimated: Pose {
                x_m,
                ..Pose::default()
            },
        }]
    }

    #[test]
    fn json_has_the_contracts_fields() {
        let value = json(&[off_by(2.0), off_by(0.5), off_by(0.25), off_by(3.0)]).unwrap();
        assert_eq!(value["samples"], 1);
        assert_eq!(value["icrhk"]["mse_x"], 4.0);
        assert_eq!(value["icrik"]["j_over_n"], 0.25);
        assert_eq!(value["extended"]["mse_x"], 0.0625);
        for key in ["mse_x", "mse_y", "mse_z", "mse_yaw", "j_over_n"] {
            assert!(value["diff_drive"][key].is_f64(), "{key}");
        }
    }

    #[test]
    fn a_model_has_one_colour_in_legend_and_map() {
        let page = report::html(
            "log",
            &Vehicle::j8(),
            &["icrhk", "icrik"],
            &[off_by(2.0), off_by(0.5)],
            report::Slope {
                tilt_deg: 0.0,
                slides: true,
            },
        );
        for (name, colour) in [("icrhk", COLOURS[0]), ("icrik", COLOURS[1])] {
            let run = format!("{{\"name\":\"{name}\",\"colour\":\"{colour}\"");
            assert!(page.contains(&run), "{run}");
            let (_, after) = page
                .split_once(&format!("data-colour=\"{colour}\""))
                .unwrap();
            let (_, text) = after.split_once("</svg>").unwrap();
            assert!(text.starts_with(name), "{name}");
        }
    }
}
