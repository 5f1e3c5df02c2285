//! Hands the commands that drive over to the program `sidehill-drive`, and defines their arguments.

use crate::console::Level;
use crate::recording::LiveArgs;
use crate::simulate::Format;
use anyhow::{Error, anyhow};
use sidehill_controller::path::Point2;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::process::Command;

/// Name of the program that drives.
const PROGRAM: &str = "sidehill-drive";

/// Becomes the program that drives, with the arguments of this one: signals, standard streams and exit status are its
/// own. It is looked for beside this program, then on PATH.
///
/// Returns only if it cannot be run, with the reason.
pub fn hand_over() -> Error {
    let beside = std::env::current_exe()
        .ok()
        .map(|own| own.with_file_name(PROGRAM))
        .filter(|path| path.is_file());
    let program = beside.unwrap_or_else(|| PathBuf::from(PROGRAM));
    let error = become_program(Command::new(&program).args(std::env::args_os().skip(1)));
    if error.kind() == ErrorKind::NotFound {
        return anyhow!(
            "{PROGRAM}: this command is of the program {PROGRAM}, which is neither beside this one nor on PATH; from a \
             checkout, build it with `cargo build --release --package {PROGRAM}` or install it with \
             `cargo install --path bridge/program`"
        );
    }
    anyhow!("{}: {error}", program.display())
}

#[cfg(unix)]
fn become_program(command: &mut Command) -> std::io::Error {
    std::os::unix::process::CommandExt::exec(command)
}

/// Where no program can take the place of another, this one waits for it.
#[cfg(not(unix))]
fn become_program(command: &mut Command) -> std::io::Error {
    match command.status() {
        Ok(status) => std::process::exit(status.code().unwrap_or(1)),
        Err(error) => error,
    }
}

/// Arguments of `sidehill run`.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    /// Configuration: interface, layout of the bus, vehicle, controller, course, safety.
    pub config: PathBuf,
    /// Arm once as soon as the drives' feedback is fresh, within the first 5 s; over ROS 2, begin the route once there is
    /// a pose. Without it, and after every stop, SIGUSR1 does.
    #[arg(long)]
    pub arm: bool,
    /// Folder for candump.log, cycles.csv and events.jsonl; created if it does not exist. Files of an
    /// earlier run are kept beside them as candump.log.1 and so on.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// text: the inputs, then the state and missing inputs, for a person; json: lines of JSON, the state on standard
    /// output, events on standard error. By default text on a terminal and json elsewhere.
    #[arg(long, value_enum)]
    pub format: Option<RunFormat>,
    /// What is printed: errors, also what somebody should look at, also other events and, on change or once a minute,
    /// the state, or also the state each second, as on a terminal. Under systemd each line has its priority.
    #[arg(long, value_enum, default_value_t = Level::Info)]
    pub log_level: Level,
    /// Record the drive to an MCAP file, which `sidehill replay` and Foxglove read; instead of
    /// record.file of the configuration.
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Write the page of `sidehill report` about the recorded drive once it has ended.
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// The live view.
    #[command(flatten)]
    pub live: LiveArgs,
    /// Overwrite a recording that exists.
    #[arg(long)]
    pub force: bool,
    /// Duration of the run, s. Without it, the run ends with the course or on a signal.
    #[arg(long)]
    pub duration_s: Option<f64>,
}

/// How `run` prints its state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum RunFormat {
    /// For a person.
    Text,
    /// Lines of JSON.
    Json,
}

/// Arguments of `sidehill vehicle`.
#[derive(Debug, clap::Args)]
pub struct VehicleArgs {
    /// Configuration of the virtual vehicle.
    pub config: PathBuf,
    /// CSV file for the true state, one row for each report. An earlier file is kept beside it.
    #[arg(long)]
    pub truth: Option<PathBuf>,
    /// Record the vehicle to an MCAP file, instead of record.file of the configuration.
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// The live view.
    #[command(flatten)]
    pub live: LiveArgs,
    /// Overwrite a recording that exists.
    #[arg(long)]
    pub force: bool,
    /// Duration, s; without it, runs until SIGINT or SIGTERM.
    #[arg(long)]
    pub duration_s: Option<f64>,
}

/// Arguments of `sidehill drive-route`.
#[derive(Debug, clap::Args)]
pub struct DriveRouteArgs {
    /// Configuration of the `sidehill run` that drives: its action, frames, vehicle and datum.
    pub config: PathBuf,
    /// Route, .csv or .gpx; or its name without the ending, of a file beside the configuration.
    pub route: PathBuf,
    /// Lanes, side by side. Every second one is driven the other way, unless the route ends where it begins.
    #[arg(long, default_value_t = 1)]
    pub lanes: u32,
    /// Distance from lane to lane, m: to the left of the route, negative to the right.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub lane_m: Option<f64>,
    /// Times that all lanes are driven.
    #[arg(long, default_value_t = 1)]
    pub passes: u32,
    /// Place from which on they are driven, m along all of it, as a drive that ends early says it: to go on with it
    /// later, or to drive a stretch again. The vehicle goes there along the lane, forward or back.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub from_m: Option<f64>,
    /// Way that a vehicle which makes no progress is driven back in reverse before the drive pauses, m, from 0.5 to 5:
    /// along the lane, once, and without being asked, so the way behind must be clear. Without it, it stands where it is.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub retreat_m: Option<f64>,
    /// Distance at which the vehicle, driven back, goes on past the place where it made no progress, m: to the left of
    /// travel, negative to the right, 0.3 to 5. At each place once; the next time there the drive ends. Later lanes lead
    /// round it, too.
    #[arg(
        long,
        value_name = "M",
        allow_negative_numbers = true,
        requires = "retreat_m"
    )]
    pub go_round_m: Option<f64>,
    /// Place to go round from the start, m, as a drive that ends early says it; may be given several times.
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, value_parser = place, requires = "go_round_m")]
    pub stuck_at: Vec<Point2>,
}

/// Reads a place, as `3.1,-2`, m.
fn place(text: &str) -> Result<Point2, String> {
    let number = |text: &str| {
        text.trim()
            .parse()
            .ok()
            .filter(|value: &f64| value.is_finite())
    };
    let place = text
        .split_once(',')
        .and_then(|(x, y)| number(x).zip(number(y)));
    let (x_m, y_m) = place.ok_or("two numbers are expected, as 3.1,-2")?;
    Ok(Point2 { x_m, y_m })
}

/// Arguments of `sidehill can`.
#[derive(Debug, clap::Args)]
pub struct CanArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: CanCommand,
}

/// What `sidehill can` does.
#[derive(Debug, clap::Subcommand)]
pub enum CanCommand {
    /// Finds the CANopen nodes of a bus: state, identity, errors. It reads objects and moves nothing.
    Scan(CanScanArgs),
    /// Shows what the drives of a configuration say, once a second and on change. It sends nothing.
    Monitor(CanMonitorArgs),
    /// Turns each motor slowly while the space bar is held, and says which signs, scales and encoders of the layout are
    /// wrong. It moves the vehicle: lift it off the ground.
    Test(CanTestArgs),
}

/// Arguments of `sidehill can scan`.
#[derive(Debug, clap::Args)]
pub struct CanScanArgs {
    /// Configuration of `run`: its interface is scanned, and its drives are looked for.
    #[arg(required_unless_present = "interface")]
    pub config: Option<PathBuf>,
    /// SocketCAN interface, as can0, in place of the configuration's.
    #[arg(long)]
    pub interface: Option<String>,
    /// EDS or DCF file of the drives' maker, to check the layout by: one for both drives, or two in their order.
    #[arg(long, value_name = "FILE", requires = "config")]
    pub eds: Vec<PathBuf>,
    /// How the nodes are printed.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Arguments of `sidehill can monitor`.
#[derive(Debug, clap::Args)]
pub struct CanMonitorArgs {
    /// Configuration of `run`: its interface and its drives.
    pub config: PathBuf,
    /// text: for a person; json: a line of JSON each. By default text on a terminal and json elsewhere.
    #[arg(long, value_enum)]
    pub format: Option<RunFormat>,
    /// Duration, s; without it, until SIGINT or SIGTERM.
    #[arg(long)]
    pub duration_s: Option<f64>,
}

/// Arguments of `sidehill can test`.
#[derive(Debug, clap::Args)]
pub struct CanTestArgs {
    /// Configuration of `run`: its interface, drives and safety.
    pub config: PathBuf,
    /// Speed of a motor, m/s, from 0.01 to 0.1.
    #[arg(long, default_value_t = 0.05)]
    pub speed_m_s: f64,
    /// Write the corrected layout to a file beside the layout; comments stay.
    #[arg(long, value_name = "FILE.yaml")]
    pub write: Option<PathBuf>,
    /// Overwrite a layout that exists.
    #[arg(long)]
    pub force: bool,
    /// How the verdict is printed.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}
