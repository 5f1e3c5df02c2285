//! The logs to identify by: read from files, or driven in simulation.

use super::args::IdentifyArgs;
use crate::console;
use crate::drive_log::LogReader;
use anyhow::{Context, Result, bail, ensure};
use sidehill_plant::contact::{ContactModel, ContactVehicle};
use sidehill_plant::identification::{
    IdentificationSettings, Leg, LogNoise, Procedure, ProcedureDrive, Segmentation, drive,
    drive_plant, identify_level, identify_slope,
};
use sidehill_plant::log::DriveLog;
use sidehill_plant::simulation::{Plant, TrueState};
use sidehill_plant::speeds::EncoderScale;
use sidehill_plant::statistics::median;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;
use std::path::PathBuf;

/// Largest slope that counts as level ground, deg.
pub(super) const LEVEL_DEG: f64 = 3.0;
/// By how much the ground of a procedure may be other than asked for, deg.
const OTHER_GROUND_DEG: f64 = 1.0;

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

/// A log with its name in messages.
pub type NamedLog = (String, DriveLog);

/// Logs of both stages.
pub struct Logs {
    pub(super) level: Vec<DriveLog>,
    pub(super) slope: Vec<DriveLog>,
    /// Further logs on the slope, for the terms beyond ICRIK.
    pub(super) across: Vec<DriveLog>,
}

impl Logs {
    /// Returns logs of level ground and of a slope; `note` gets which looks as if it were the other.
    ///
    /// # Errors
    /// Names a log without poses, and logs that are exchanged.
    pub fn of_stages(
        level: Vec<NamedLog>,
        slope: Vec<NamedLog>,
        note: impl FnMut(String),
    ) -> Result<Self> {
        for (name, log) in level.iter().chain(&slope) {
            ensure!(
                log.pose_count() > 0,
                "{name}: the log has no poses, which identification needs: x_m, y_m, z_m and yaw_rad, or `pose` of \
                 --columns"
            );
        }
        check_exchanged(&level, &slope, note)?;
        let logs = |named: Vec<NamedLog>| named.into_iter().map(|(_, log)| log).collect();
        Ok(Self {
            level: logs(level),
            slope: logs(slope),
            across: Vec::new(),
        })
    }

    /// Returns the logs of the paper's procedure, driven by vehicles that `put` puts to the pose and attitude at which each
    /// begins, on ground that goes on as the plane it begins on. Noise of usual sensors is added; `encoder_scale` is what
    /// makes true tread speeds of the measured ones.
    ///
    /// # Errors
    /// Those of `put` and of the vehicle, or that its ground is another.
    pub fn driven<P>(
        encoder_scale: &EncoderScale,
        seed: u64,
        mut put: impl FnMut(&TrueState) -> Result<P>,
    ) -> Result<Self>
    where
        P: Plant<Error: Send + Sync + 'static>,
    {
        Self::of_procedure(seed, |terrain, legs, seed| {
            let attitude = terrain.attitude(0.0, 0.0, 0.0)?;
            let mut plant = put(&TrueState {
                attitude,
                ..TrueState::default()
            })?;
            let log = drive_plant(&mut plant, legs, encoder_scale, &LogNoise::usual(), seed)?;
            let (asked_deg, found_deg) = (attitude.pitch_rad.to_degrees(), tilt_deg(&log));
            ensure!(
                (asked_deg - found_deg).abs() < OTHER_GROUND_DEG,
                "it was put on ground of {asked_deg:.1} deg and tells of {found_deg:.1} deg: its ground must go on as the \
                 plane on which it is put"
            );
            Ok(log)
        })
    }

    fn of_procedure(
        seed: u64,
        mut log: impl FnMut(Terrain, &[Leg], u64) -> Result<DriveLog>,
    ) -> Result<Self> {
        let procedure = Procedure::of_the_paper();
        let slope = procedure.slope_terrain()?;
        Ok(Self {
            level: vec![log(Terrain::Level, &procedure.level, seed)?],
            slope: vec![log(slope.clone(), &procedure.slope, seed.wrapping_add(1))?],
            across: vec![log(slope, &procedure.across, seed.wrapping_add(2))?],
        })
    }
}

/// Returns the logs that the command line names.
///
/// # Errors
/// Names the file, row and column at fault, or a log without poses.
pub(super) fn recorded(args: &IdentifyArgs) -> Result<Logs> {
    let reader = LogReader::new(&args.maps)?;
    let read = |paths: &[PathBuf]| -> Result<Vec<NamedLog>> {
        let read = |path: &PathBuf| {
            let log = reader.read(path, console::complain)?;
            Ok((path.display().to_string(), log))
        };
        paths.iter().map(read).collect()
    };
    Logs::of_stages(read(&args.level)?, read(&args.slope)?, console::complain)
}

/// Returns the median of a log's tilts, deg.
fn tilt_deg(log: &DriveLog) -> f64 {
    let tilts = log.rows().iter().map(|row| {
        let attitude = &row.attitude;
        attitude.roll_rad.hypot(attitude.pitch_rad).to_degrees()
    });
    median(tilts.collect()).unwrap_or(0.0)
}

/// Checks that no log of level ground is from steeper ground than one of a slope.
fn check_exchanged(
    level: &[NamedLog],
    slope: &[NamedLog],
    mut note: impl FnMut(String),
) -> Result<()> {
    let tilts = |logs: &[NamedLog]| -> Vec<(f64, String)> {
        let tilt = |(name, log): &NamedLog| (tilt_deg(log), name.clone());
        logs.iter().map(tilt).collect()
    };
    let steepest = tilts(level).into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    let flattest = tilts(slope).into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((steepest_deg, level)) = steepest.filter(|(tilt_deg, _)| *tilt_deg > LEVEL_DEG) else {
        return Ok(());
    };
    match flattest {
        Some((flattest_deg, slope)) if flattest_deg < steepest_deg => bail!(
            "--level {level} is from ground of {steepest_deg:.1} deg and --slope {slope} from ground of {flattest_deg:.1} deg: \
             are they exchanged?"
        ),
        _ => {
            note(format!(
                "{level}: warning: it is a log of --level, but from ground of {steepest_deg:.1} deg: on more than {LEVEL_DEG} deg \
                 slopes shift the level parameters; name it under --slope"
            ));
            Ok(())
        }
    }
}

/// Drives the paper's procedure with a contact vehicle whose encoders are off by `vehicle`'s factors.
pub(super) fn simulated(contact: &ContactVehicle, vehicle: &Vehicle, seed: u64) -> Result<Logs> {
    Logs::of_procedure(seed, |terrain, legs, seed| {
        let setup = ProcedureDrive {
            motion: Box::new(ContactModel::new(contact.clone())),
            encoder_scale: vehicle.encoder_scale,
            terrain,
            legs,
        };
        Ok(drive(setup, &LogNoise::usual(), seed)?)
    })
}
