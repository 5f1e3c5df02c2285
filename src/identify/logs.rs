//! The logs to identify by: read from files, or driven in simulation.

use super::args::IdentifyArgs;
use super::found::Logs;
use crate::console;
use crate::drive_log::LogReader;
use anyhow::{Context, Result, bail};
use sidehill_plant::contact::{ContactModel, ContactVehicle};
use sidehill_plant::identification::{
    IdentificationSettings, Leg, LogNoise, Procedure, ProcedureDrive, Segmentation, drive,
    identify_level, identify_slope,
};
use sidehill_plant::log::DriveLog;
use sidehill_plant::speeds::EncoderScale;
use sidehill_plant::statistics::median;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;
use std::path::PathBuf;

/// Largest slope that counts as level ground, deg.
pub(super) const LEVEL_DEG: f64 = 3.0;

/// Returns what identification finds of `vehicle` where `contact` drives the paper's procedure in
/// simulation.
///
/// # Errors
/// Why the vehicle cannot drive it, or what its logs lack.
pub fn by_simulation(contact: &ContactVehicle, vehicle: &Vehicle, seed: u64) -> Result<Vehicle> {
    let settings = IdentificationSettings {
        segmentation: Segmentation::of_length(8.0)?,
        attitude_smoothing_s: 0.2,
    };
    let logs = simulated(contact, vehicle, seed)?;
    let (level, _) = identify_level(&logs.level, vehicle, &settings).context("level logs")?;
    let (slope, _) = identify_slope(&logs.slope, &level, &settings).context("slope logs")?;
    Ok(slope)
}

/// Returns the logs that the command line names.
///
/// # Errors
/// Names the file, row and column at fault, or a log without poses.
pub(super) fn recorded(args: &IdentifyArgs) -> Result<Logs> {
    let reader = LogReader::new(&args.maps)?;
    let read = |paths: &[PathBuf]| -> Result<Vec<DriveLog>> {
        let read = |path: &PathBuf| {
            let log = reader.read(path)?;
            if log.pose_count() == 0 {
                bail!(
                    "{}: the log has no poses, which identification needs: x_m, y_m, z_m and yaw_rad, or `pose` of \
                     --columns",
                    path.display()
                );
            }
            Ok(log)
        };
        paths.iter().map(read).collect()
    };
    let logs = Logs {
        level: read(&args.level)?,
        slope: read(&args.slope)?,
        across: Vec::new(),
    };
    check_exchanged(args, &logs)?;
    Ok(logs)
}

/// Checks that no log of `--level` is from steeper ground than one of `--slope`.
fn check_exchanged(args: &IdentifyArgs, logs: &Logs) -> Result<()> {
    let tilt_deg = |log: &DriveLog| {
        let tilts = log.rows().iter().map(|row| {
            let attitude = &row.attitude;
            attitude.roll_rad.hypot(attitude.pitch_rad).to_degrees()
        });
        median(tilts.collect()).unwrap_or(0.0)
    };
    let level = args.level.iter().zip(&logs.level);
    let steepest = level
        .map(|(path, log)| (tilt_deg(log), path))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let slope = args.slope.iter().zip(&logs.slope);
    let flattest = slope
        .map(|(path, log)| (tilt_deg(log), path))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((steepest_deg, level)) = steepest.filter(|(tilt_deg, _)| *tilt_deg > LEVEL_DEG) else {
        return Ok(());
    };
    match flattest {
        Some((flattest_deg, slope)) if flattest_deg < steepest_deg => bail!(
            "--level {} is from ground of {steepest_deg:.1} deg and --slope {} from ground of {flattest_deg:.1} deg: are they \
             exchanged?",
            level.display(),
            slope.display()
        ),
        _ => {
            console::complain(format_args!(
                "{}: warning: it is a log of --level, but from ground of {steepest_deg:.1} deg: on more than {LEVEL_DEG} deg \
                 slopes shift the level parameters; name it under --slope",
                level.display()
            ));
            Ok(())
        }
    }
}

/// Drives the paper's procedure with a contact vehicle whose encoders are off by `vehicle`'s factors.
pub(super) fn simulated(contact: &ContactVehicle, vehicle: &Vehicle, seed: u64) -> Result<Logs> {
    let procedure = Procedure::of_the_paper();
    let encoder_scale: EncoderScale = vehicle.encoder_scale;
    let log = |terrain: Terrain, legs: &[Leg], seed: u64| {
        let setup = ProcedureDrive {
            motion: Box::new(ContactModel::new(contact.clone())),
            encoder_scale,
            terrain,
            legs,
        };
        drive(setup, &LogNoise::usual(), seed)
    };
    Ok(Logs {
        level: vec![log(Terrain::Level, &procedure.level, seed)?],
        slope: vec![log(procedure.slope_terrain()?, &procedure.slope, seed + 1)?],
        across: vec![log(
            procedure.slope_terrain()?,
            &procedure.across,
            seed + 2,
        )?],
    })
}
