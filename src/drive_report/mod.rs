//! `sidehill report`: what a recorded drive was like, as a page, as figures, and as a track for maps.

mod earth;
mod facts;
mod input;
mod limits;
mod page;
mod place;
mod stops;
mod tiles;
mod weather;

use crate::exit::Exit;

use crate::console;
use crate::output;
use crate::recording::damage;
use crate::simulate::Format;
use anyhow::{Result, ensure};
use facts::DriveFacts;
use input::DecodedRecording;
use limits::LimitArgs;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tiles::TileMap;

/// Arguments of `sidehill report`.
#[derive(Debug, Default, clap::Args, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReportArgs {
    /// Recording; files that continue it (FILE_1.mcap, ...) are read with it.
    pub recording: PathBuf,
    /// Page with map, plots, stops and figures: one file that needs no network.
    #[arg(long, value_name = "FILE.html")]
    pub out: Option<PathBuf>,
    /// Map or aerial picture below the drive, on the page: PNG, JPEG or WebP tiles as MBTiles. The recording must have a
    /// datum.
    #[arg(long, value_name = "FILE.mbtiles", requires = "out")]
    pub map: Option<PathBuf>,
    /// What was driven, stops and worst places as GeoJSON. The recording must have a datum.
    #[arg(long, value_name = "FILE.geojson")]
    pub geojson: Option<PathBuf>,
    /// The same as KML.
    #[arg(long, value_name = "FILE.kml")]
    pub kml: Option<PathBuf>,
    /// What the drive has to keep to.
    #[command(flatten)]
    pub limits: LimitArgs,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
    /// How the figures are printed.
    #[arg(long, value_enum, default_value_t)]
    #[serde(skip)]
    pub format: Format,
}

/// Writes what was asked for, prints the figures, and returns success unless a limit was exceeded.
///
/// # Errors
/// A recording that cannot be read, holds no drive, or has no place on earth where one is needed; a map without tiles
/// there.
pub fn run(args: &ReportArgs) -> Result<ExitCode> {
    let facts = written(args)?;
    match args.format {
        Format::Json => console::line(serde_json::to_string(&facts)?),
        Format::Table => console::text(facts.table()),
    }
    Ok(Exit::answer(facts.passed != Some(false)).into())
}

/// Writes what was asked for and returns, as JSON, what `--format json` prints.
///
/// # Errors
/// As [`run`].
pub fn facts(args: &ReportArgs) -> Result<String> {
    Ok(serde_json::to_string(&written(args)?)?)
}

fn written(args: &ReportArgs) -> Result<DriveFacts> {
    let files = [&args.out, &args.geojson, &args.kml];
    for file in files.into_iter().flatten() {
        output::check_writable(file, args.force)?;
        output::check_apart(file, [&args.recording])?;
    }
    let (input, facts) = read(&args.recording, &args.limits)?;
    if args.geojson.is_some() || args.kml.is_some() {
        let track = earth::track(&input, &facts)?;
        if let Some(file) = &args.geojson {
            output::write(file, track.geojson().as_bytes(), args.force)?;
        }
        if let Some(file) = &args.kml {
            output::write(file, &track.kml()?, args.force)?;
        }
    }
    if let Some(file) = &args.out {
        let map = args.map.as_deref().map(|map| TileMap::of(&input, map));
        let page = page::html(&input, &facts, map.transpose()?.as_ref())?;
        output::write(file, page.as_bytes(), args.force)?;
    }
    Ok(facts)
}

/// Writes the page of a recording that has just ended.
///
/// # Errors
/// As [`run`].
pub fn write_page(recording: &Path, file: &Path, force: bool) -> Result<()> {
    let (input, facts) = read(recording, &LimitArgs::default())?;
    output::write(file, page::html(&input, &facts, None)?.as_bytes(), force)
}

fn read(recording: &Path, limits: &LimitArgs) -> Result<(DecodedRecording, DriveFacts)> {
    let input = DecodedRecording::read(recording)?;
    ensure!(
        !input.steps.is_empty(),
        "{}: there is no step of a controller in it, so nothing to report; recordings of `run` and `simulate` have them{}",
        recording.display(),
        damage(input.damaged.as_deref())
    );
    let facts = DriveFacts::of(&input);
    let limits = limits.judge(&facts);
    Ok((input, facts.judged(limits)))
}
