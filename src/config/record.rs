//! Where a drive is recorded, for `run` and `vehicle`.

use super::{ConfigError, ConfigFile};
use serde::Deserialize;
use sidehill_recording::RecordLimits;
use std::path::{Path, PathBuf};

/// Where a drive is recorded, and how large the recording may become.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordConfig {
    /// MCAP file. None: only `--record` records, which also overrides it.
    #[serde(default)]
    pub file: Option<PathBuf>,
    /// Largest size of a file, MB.
    #[serde(default = "record_size")]
    pub max_size: f64,
    /// Whether a full file is followed by another. Otherwise the recording ends, and the vehicle drives on.
    #[serde(default = "yes")]
    pub split: bool,
    /// Newest files that are kept, with `split`. 0 keeps all.
    #[serde(default)]
    pub keep: u32,
}

/// Returns the file of a recording and its limits, from the command line or else the configuration; none if
/// nothing is recorded.
///
/// # Errors
/// [`ConfigError`] with the file, key, value and range.
pub(super) fn recording(
    file: &ConfigFile,
    config: Option<&RecordConfig>,
    given: Option<&Path>,
) -> Result<Option<(PathBuf, RecordLimits)>, ConfigError> {
    let limits = config.map_or_else(RecordLimits::default, |config| RecordLimits {
        max_size: config.max_size,
        split: config.split,
        keep: config.keep,
    });
    limits
        .validate()
        .map_err(|error| file.error(format!("record.{error}")))?;
    let own = config
        .and_then(|config| config.file.as_deref())
        .map(|name| file.path().parent().unwrap_or(Path::new("")).join(name));
    Ok(given.map(Path::to_owned).or(own).map(|path| (path, limits)))
}

fn record_size() -> f64 {
    RecordLimits::default().max_size
}

pub(super) fn yes() -> bool {
    true
}
