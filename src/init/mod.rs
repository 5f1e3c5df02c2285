//! `sidehill init`: a commented, checked set of configuration files for a robot.

mod bridge;
mod file;
mod files;
mod port;
mod robots;
mod schemas;
mod texts;
mod vehicles;

pub use port::PortKind;
pub use robots::{OwnRobot, Robot, robot_name};

use crate::check;
use crate::config::ConfigFile;
use crate::console;
use crate::output;
use crate::progress::{self, Notice};
use anyhow::{Context, Result, bail};
use sidehill_plant::contact::ContactVehicle;
use sidehill_plant::vehicle::Vehicle;
use std::path::PathBuf;

/// Arguments of `sidehill init`.
#[derive(Debug, Clone, clap::Args)]
pub struct InitArgs {
    /// Folder for the files; created if it does not exist.
    pub dir: PathBuf,
    /// Robot whose published dimensions the files start from.
    #[arg(long, value_enum, default_value_t)]
    pub vehicle: Robot,
    /// Measures of another robot.
    #[command(flatten)]
    pub own: Option<OwnRobot>,
    /// How the drives are commanded.
    #[arg(long, value_enum, default_value_t)]
    pub port: PortKind,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
}

impl OwnRobot {
    /// Returns the robot on wheels, as the file `contact.yaml` of its set has it.
    ///
    /// # Errors
    /// [`RangeError`](sidehill_plant::vehicle::RangeError) with the argument out of its range.
    pub fn on_wheels(&self) -> Result<ContactVehicle> {
        Ok(serde_yaml::from_str(&vehicles::contact_vehicle(
            &self.measures()?,
        ))?)
    }

    /// Returns the robot as the ICR models know it, as the file `vehicle.yaml` of its set has it.
    ///
    /// # Errors
    /// As [`OwnRobot::on_wheels`], or why it cannot drive the procedure of identification.
    pub fn first_guess(&self) -> Result<Vehicle> {
        let measures = self.measures()?;
        let contact = vehicles::contact_vehicle(&measures);
        Ok(serde_yaml::from_str(&vehicles::first_guess(
            &measures, &contact,
        )?)?)
    }
}

/// Writes the files, checks each as `sidehill check` does, and prints what to do next.
///
/// # Errors
/// A file that exists already (nothing is written then), or one that cannot be written.
pub fn run(args: &InitArgs) -> Result<()> {
    progress::explain_interrupt(|| "interrupted: the set is not complete".to_owned())?;
    let notice = Notice::begin("init: drives the robot in simulation for first guesses".to_owned());
    let measures = match &args.own {
        Some(own) => Some(own.measures()?),
        None => args.vehicle.measures(),
    };
    let files = files::all(measures, args.port)?;
    drop(notice);
    let paths: Vec<PathBuf> = files.iter().map(|file| args.dir.join(file.name)).collect();
    output::check_free(&paths, args.force)?;
    let folder = args.dir.join(schemas::SCHEMAS);
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("{}: cannot create the folder", folder.display()))?;
    for (file, path) in files.iter().zip(&paths) {
        output::write(path, file.text.as_bytes(), args.force)?;
    }
    for path in paths
        .iter()
        .filter(|path| path.extension().is_some_and(|ending| ending == "yaml"))
    {
        let checked = ConfigFile::read(path)
            .map_err(Into::into)
            .and_then(check::check);
        match checked {
            Ok(kind) => console::line(format_args!("{}: {kind}", path.display())),
            // The files are our own, so an error is a bug.
            Err(error) => bail!("{error:#}"),
        }
    }
    console::line(format_args!(
        "{}: what to do next",
        args.dir.join("README.md").display()
    ));
    Ok(())
}
