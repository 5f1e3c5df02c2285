//! `--record`: the header of recordings, and the recording of simulations.

mod datum;
mod live;
mod simulation;

pub(crate) use datum::datum;
pub use live::LiveArgs;
pub use simulation::SimulationRecording;

use crate::config::{Bundle, ConfigFile};
use crate::console;
use crate::output;
use anyhow::{Context, Result, bail};
use serde_json::Value;
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::path::Path as Curve;
use sidehill_plant::terrain::Terrain;
use sidehill_recording::live::{LiveAddress, LiveView, PlaybackControl, Values};
use sidehill_recording::{Header, Marker, McapRecording, RecordLimits, ground};
use std::path::Path;
use std::sync::PoisonError;
use std::time::{SystemTime, UNIX_EPOCH};

/// Returns why a recording was not read to its end, to follow a message about what it lacks.
pub fn damage(reason: Option<&str>) -> String {
    reason.map_or_else(String::new, |reason| {
        format!("; it was not read to its end: {reason}")
    })
}

/// Names of the facts in the header of a recording.
pub mod fact {
    /// Version of the program.
    pub const VERSION: &str = "version";
    /// Machine it was built for.
    pub const TARGET: &str = "target";
    /// Subcommand.
    pub const COMMAND: &str = "command";
    /// Name of its configuration file.
    pub const CONFIG: &str = "config";
    /// Name of the controller.
    pub const CONTROLLER: &str = "controller";
    /// Number shared by all files of a recording.
    pub const RECORDING: &str = "recording";
    /// Plant that replaced the scenario's.
    pub const PLANT: &str = "plant";
    /// Seed that replaced the scenario's.
    pub const SEED: &str = "seed";
    /// Path that replaced the scenario's.
    pub const PATH: &str = "path";
    /// Text of the file of learned parameters that the controller started from.
    pub const LEARNED: &str = "learned";
}

/// Returns the machine that this program was built for.
pub fn target() -> String {
    format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS)
}

/// Returns the header of a recording: the configuration `file` in use, all files read with it into `bundle`, and
/// the settings of the command line.
pub fn header(
    command: &str,
    kind: Option<ControllerKind>,
    file: &ConfigFile,
    bundle: &Bundle,
    facts: &[(&str, Option<String>)],
) -> Header {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    let id = now.map_or(0, |now| now.as_nanos());
    let mut header = Header {
        files: bundle
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone(),
        ..Header::default()
    };
    header
        .files
        .insert(file.path().to_owned(), file.text().to_owned());
    let all = [
        (fact::VERSION, Some(env!("CARGO_PKG_VERSION").to_owned())),
        (fact::TARGET, Some(target())),
        (fact::COMMAND, Some(command.to_owned())),
        (fact::CONFIG, Some(file.path().display().to_string())),
        (fact::CONTROLLER, kind.map(|kind| kind.name().to_owned())),
        (
            fact::RECORDING,
            Some(format!("{id}-{}", std::process::id())),
        ),
    ];
    for (name, value) in all.iter().chain(facts) {
        if let Some(value) = value {
            header.facts.insert((*name).to_owned(), value.clone());
        }
    }
    header
}

/// Creates the first file of a recording.
///
/// # Errors
/// A file that exists and must not be overwritten, or an I/O error.
pub fn create(
    path: &Path,
    header: Header,
    limits: RecordLimits,
    force: bool,
) -> Result<McapRecording> {
    check_free(path, force)?;
    McapRecording::create(path, header, limits, force)
        .with_context(|| format!("{}: cannot be written", path.display()))
}

/// Checks that a recording can begin at `path` without replacing or continuing an earlier one.
///
/// # Errors
/// Names the file that is there, unless `force`; or a folder that is missing or cannot be written.
pub fn check_free(path: &Path, force: bool) -> Result<()> {
    output::check_writable(path, force)?;
    let present = McapRecording::present(path)
        .with_context(|| format!("{}: cannot be written", path.display()))?;
    if let (Some((_, first)), false) = (present.first(), force) {
        bail!(
            "{}: exists already and may be part of an earlier recording; name another file, or allow both with \
             --force, which replaces {} and no other file",
            first.display(),
            path.display()
        );
    }
    Ok(())
}

/// Starts the live view if requested, and prints its address.
///
/// # Errors
/// An address that cannot be listened to, or that needs a token.
pub fn live(args: &LiveArgs, config: Option<&ControllerConfig>) -> Result<Option<LiveView>> {
    let Some(address) = args.address()? else {
        return Ok(None);
    };
    let view = LiveView::start(address.clone(), settings(config)?);
    let view = view.with_context(|| cannot_listen(&address))?;
    announce(&view, address);
    Ok(Some(view))
}

/// Starts the live view of a recording whose first and last times, ns, are given.
///
/// # Errors
/// An address that cannot be listened to.
pub fn playback(
    address: LiveAddress,
    config: &ControllerConfig,
    range_ns: [u64; 2],
) -> Result<(LiveView, PlaybackControl)> {
    let settings = settings(Some(config))?;
    let (view, control) = LiveView::start_playback(address.clone(), settings, range_ns)
        .with_context(|| cannot_listen(&address))?;
    announce(&view, address);
    Ok((view, control))
}

/// Returns the controller's settings as parameters.
fn settings(config: Option<&ControllerConfig>) -> Result<Values> {
    let mut settings = Values::new();
    if let Some(config) = config {
        flatten("", &serde_json::to_value(config)?, &mut settings);
    }
    Ok(settings)
}

fn cannot_listen(address: &LiveAddress) -> String {
    format!("--live: {} cannot be listened to", address.address)
}

/// Prints where the view is seen.
fn announce(view: &LiveView, address: LiveAddress) {
    let query = address
        .token
        .map_or_else(String::new, |token| format!("?token={token}"));
    let at = live::reached_at(view.address());
    console::complain(format_args!(
        "live view: http://{at}/{query} in a browser, ws://{at}/{query} in Foxglove"
    ));
}

/// Flattens a tree: names are keys separated by dots.
fn flatten(name: &str, value: &Value, into: &mut Values) {
    match value {
        Value::Object(fields) => {
            for (key, value) in fields {
                let name = if name.is_empty() {
                    key.clone()
                } else {
                    format!("{name}.{key}")
                };
                flatten(&name, value, into);
            }
        }
        Value::Null => {}
        value => {
            into.insert(name.to_owned(), value.clone());
        }
    }
}

/// Margin of the ground shown around a path, m.
const GROUND_MARGIN_M: f64 = 5.0;

/// Returns the ground around a path.
pub fn ground_around(terrain: &Terrain, path: Option<&Curve>) -> Marker {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    if let Some(path) = path {
        for i in 0..=200 {
            let at = path.at(path.length_m() * f64::from(i) / 200.0).position;
            for (axis, value) in [at.x_m, at.y_m].into_iter().enumerate() {
                low[axis] = low[axis].min(value);
                high[axis] = high[axis].max(value);
            }
        }
    }
    let bound = |value: f64, margin_m: f64| if value.is_finite() { value } else { 0.0 } + margin_m;
    ground(
        terrain,
        low.map(|value| bound(value, -GROUND_MARGIN_M)),
        high.map(|value| bound(value, GROUND_MARGIN_M)),
    )
}

/// Interval between state messages, s.
pub const DIAGNOSTICS_PERIOD_S: f64 = 1.0;
