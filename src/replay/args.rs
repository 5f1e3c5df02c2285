//! Arguments of `sidehill replay`.

use super::rebuild::ReplayChanges;
use crate::config::PlantKind;
use crate::recording::LiveArgs;
use crate::simulate::{Format, controller};
use serde::Deserialize;
use sidehill_controller::config::ControllerKind;
use std::path::PathBuf;

/// Arguments of `sidehill replay`.
#[derive(Debug, Default, clap::Args, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReplayArgs {
    /// Recording; files that continue it (FILE_1.mcap, ...) are read with it.
    pub recording: PathBuf,
    /// Controller instead of the recorded one.
    #[arg(long, value_name = "NAME", value_parser = controller)]
    pub controller: Option<ControllerKind>,
    /// Vehicle file for the controller instead of the recorded one.
    #[arg(long, value_name = "FILE")]
    pub vehicle: Option<PathBuf>,
    /// Setting of the controller instead of the recorded one, such as weights.heading_per_rad2=0.1;
    /// may be given several times.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
    /// Drive a simulated vehicle along the recorded path instead of using the recorded samples.
    #[arg(long)]
    pub closed_loop: bool,
    /// What moves the vehicle of --closed-loop, instead of the recorded plant.
    #[arg(long, requires = "closed_loop")]
    pub plant: Option<PlantKind>,
    /// Largest accepted difference of a command, m/s. Without it the replay must agree bit by bit;
    /// with another controller, vehicle or setting no difference is a failure.
    #[arg(long, value_name = "M_S")]
    pub tolerance: Option<f64>,
    /// Report with plots of the recorded and the replayed commands.
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Folder for a test case: the recording and the command that replays it.
    #[arg(long, value_name = "DIR")]
    pub write_case: Option<PathBuf>,
    /// The live view.
    #[command(flatten)]
    #[serde(skip)]
    pub live: LiveArgs,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
    /// How the differences are printed.
    #[arg(long, value_enum, default_value_t)]
    #[serde(skip)]
    pub format: Format,
}

impl ReplayArgs {
    /// Returns the requested changes to the recording.
    pub(super) fn changes(&self) -> ReplayChanges {
        ReplayChanges {
            controller: self.controller,
            vehicle: self.vehicle.clone(),
            settings: self.settings.clone(),
            plant: self.plant,
        }
    }
}
