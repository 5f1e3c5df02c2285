//! Arguments of `sidehill identify`.

use crate::drive_log::LogArgs;
use crate::simulate::Format;
use std::path::PathBuf;

/// Arguments of `sidehill identify`.
#[derive(Debug, Clone, clap::Args)]
pub struct IdentifyArgs {
    /// Log of varied driving on level ground, CSV or a bag of ROS 2; may be given several times.
    #[arg(long, value_name = "LOG", num_args = 1..)]
    pub level: Vec<PathBuf>,
    /// Log of turning on a slope, CSV or a bag of ROS 2; may be given several times. Without one,
    /// the slide gains are kept.
    #[arg(long, value_name = "LOG", num_args = 1..)]
    pub slope: Vec<PathBuf>,
    /// Drives the paper's procedure with this contact vehicle in simulation, instead of reading logs.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["level", "slope", "columns", "topics"],
          required_unless_present_any = ["level", "slope", "drives"])]
    pub simulate: Option<PathBuf>,
    /// Log with the commands of the drives, CSV, a bag of ROS 2 or a recording of `run`; may be given several times.
    /// Finds delay, lag and limits of the motors instead; --out gets them as conditions for a controller.
    #[arg(long, value_name = "LOG", num_args = 1..,
          conflicts_with_all = ["level", "slope", "simulate", "contact", "report"])]
    pub drives: Vec<PathBuf>,
    /// Vehicle to start from; its base and largest speed are kept.
    #[arg(long, value_name = "FILE")]
    pub vehicle: PathBuf,
    /// Where the identified vehicle is written, in YAML.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Also identifies the parameters that contact-mpc starts from (friction, centre of mass, load
    /// shares and more), from all logs. The geometry must be known: from section `contact` of the
    /// --vehicle file, or from its base.
    #[arg(long)]
    pub contact: bool,
    /// What the columns or topics of the logs mean.
    #[command(flatten)]
    pub maps: LogArgs,
    /// Length of the dead-reckoned segments, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 8.0)]
    pub segment_s: f64,
    /// Standard deviation of the Gaussian that smooths roll and pitch, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.2)]
    pub smoothing_s: f64,
    /// Name of the identified vehicle, instead of that of the vehicle to start from.
    #[arg(long)]
    pub name: Option<String>,
    /// Seed of the noise of simulated logs.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// HTML file for a report with plots and conclusions.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Overwrite --out and --report where they exist.
    #[arg(long)]
    pub force: bool,
    /// How the result is printed.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}
