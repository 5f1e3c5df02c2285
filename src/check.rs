//! `sidehill check`: validates configuration files.

use crate::config::{
    Campaign, Conditions, ConfigFile, LiveOdometryConfig, LoadedReference, NO_KEYS, Overrides,
    RunConfig, RunPort, Scenario, Source, VehicleConfig, ground_along, ground_point, load_layout,
    point_behind_icrs, read_route, route_warnings,
};
use crate::console;
use crate::drive_log::TopicMap;
use crate::exit::Exit;
use crate::progress::{self, Notice};
use anyhow::{Result, bail};
use sidehill_controller::controller::ControllerError;
use sidehill_controller::guard::{Stance, first_steep_place};
use sidehill_controller::path::{GeodeticOrigin, Smoothing, smooth};
use sidehill_controller::speed_profile::SpeedLimits;
use sidehill_plant::contact::ContactVehicle;
use sidehill_plant::log::{ColumnMap, DriveLog};
use sidehill_plant::terrain::{GridTerrain, RoutePoint};
use sidehill_plant::vehicle::Vehicle;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use walkdir::WalkDir;

/// Arguments of `sidehill check`.
#[derive(Debug, Clone, clap::Args)]
pub struct CheckArgs {
    /// Files to validate; their kind is recognised by their keys. Of a folder all YAML files, also those in folders in
    /// it, except hidden ones and links.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Route, CSV or GPX, to check with the steepness guard of the scenario or `run` configuration
    /// given.
    #[arg(long, value_name = "FILE")]
    pub route: Option<PathBuf>,
}

/// Depth of folders in a folder, and number of its entries, beyond which it is not one of configurations.
const DEPTH_MAX: usize = 10;
const ENTRIES_MAX: usize = 10_000;

/// A file whose keys are those of no kind of file.
#[derive(Debug, thiserror::Error)]
#[error(
    "{0}: neither a campaign (key draws), a scenario (controllers), a vehicle (x_icr_left_m), a contact vehicle (axles), a \
     column map (tread_speed_left), a topic map (tread_speeds), conditions (name, with sensors, drive_train or \
     controller), a layout of a CAN bus (database), nor a configuration of run (controller), vehicle (scenario) or \
     odometry --live (vehicle)"
)]
struct UnknownKind(String);

/// Validates each file with all it names, prints a line for each, and returns success only if all are valid. Files of no
/// kind in a folder are skipped.
///
/// # Errors
/// None: errors of files are printed.
pub fn run(args: &CheckArgs) -> Result<ExitCode> {
    progress::explain_interrupt(|| {
        "interrupted: files that are not listed above were not checked".to_owned()
    })?;
    let mut valid = true;
    for path in &args.files {
        let result = match path.is_dir() {
            true => check_folder(path, args),
            false => checked(path, args).map(|kind| {
                console::line(format_args!("{}: valid {kind}", path.display()));
                true
            }),
        };
        valid &= result.unwrap_or_else(|error| {
            console::complain(format_args!("{error:#}"));
            false
        });
    }
    Ok(Exit::answer(valid).into())
}

/// Validates a file with all it names, and the route of the command line, and returns what kind of file it is.
fn checked(path: &Path, args: &CheckArgs) -> Result<&'static str> {
    let file = ConfigFile::read(path)?;
    let kind = check(file.clone())?;
    if let Some(route) = &args.route {
        judge_route(&file, route)?;
    }
    Ok(kind)
}

/// Validates the YAML files of a folder, prints a line for each, and returns whether all are valid.
///
/// # Errors
/// A folder that cannot be read, is too large or has no file of Sidehill.
fn check_folder(folder: &Path, args: &CheckArgs) -> Result<bool> {
    let name = folder.display();
    if args.route.is_some() {
        bail!("{name}: --route: name the scenario or configuration of run, not its folder");
    }
    let is_hidden = |name: &OsStr| name.as_encoded_bytes().starts_with(b".");
    let entries = WalkDir::new(folder)
        .max_depth(DEPTH_MAX + 1)
        .sort_by_file_name()
        .into_iter()
        .filter_entry(|entry| entry.depth() == 0 || !is_hidden(entry.file_name()));
    let (mut valid, mut any) = (true, false);
    for (i, entry) in entries.enumerate() {
        let entry = entry?;
        if i >= ENTRIES_MAX || entry.depth() > DEPTH_MAX {
            bail!(
                "{name}: has more than {ENTRIES_MAX} entries, or more than {DEPTH_MAX} folders in one another: name a \
                 folder of configurations"
            );
        }
        let path = entry.path();
        let ending = path.extension().and_then(OsStr::to_str);
        if !entry.file_type().is_file() || !matches!(ending, Some("yaml" | "yml")) {
            continue;
        }
        let checked = ConfigFile::read(path)
            .map_err(anyhow::Error::from)
            .and_then(|file| match has_keys(&file) {
                true => check(file),
                false => bail!(UnknownKind(file.name())),
            });
        match checked {
            Ok(kind) => console::line(format_args!("{}: valid {kind}", path.display())),
            Err(error) if error.is::<UnknownKind>() => {
                console::line(format_args!("{}: skipped, not of Sidehill", path.display()));
                continue;
            }
            Err(error) => {
                valid = false;
                console::complain(format_args!("{error:#}"));
            }
        }
        any = true;
    }
    if !any {
        bail!("{name}: has no YAML file of Sidehill");
    }
    Ok(valid)
}

/// Returns whether a YAML file is one document with keys, as far as it can be read.
fn has_keys(file: &ConfigFile) -> bool {
    match file.parse::<serde_yaml::Value>() {
        Ok(value) => value.is_mapping(),
        // A line of only --- begins a document wherever it is.
        Err(_) => file.text().matches("\n---\n").count() < 2,
    }
}

/// Validates a file with all it names and returns what kind of file it is.
///
/// # Errors
/// Names the file at fault and what is wrong with it.
pub fn check(file: ConfigFile) -> Result<&'static str> {
    match file.ending().as_deref() {
        Some("gpx") => return check_route(&file),
        Some("csv") => return check_csv(&file),
        Some("kml" | "geojson") => {
            return Err(file
                .error("a route is a .gpx or .csv file: save it as GPX")
                .into());
        }
        Some("asc" | "tif" | "tiff") => {
            let grid = GridTerrain::parse(file.text()).map_err(|error| file.error(error))?;
            if let Some(suspicion) = grid.suspicion() {
                console::complain(format_args!("{}: warning: {suspicion}", file.name()));
            }
            return Ok("elevation grid");
        }
        _ => {}
    }
    let keys: serde_yaml::Mapping = file.parse()?;
    if keys.is_empty() {
        return Err(file.error(NO_KEYS).into());
    }
    let has = |key: &str| keys.contains_key(key);
    // Written by `tune`; a configuration of `run` has no name.
    let settings = has("name") && has("controller");
    if has("draws") {
        Campaign::read(&file)?;
        Ok("campaign")
    } else if has("controllers") {
        let prepared = Scenario::read(file.clone())?.prepare(&Overrides::default())?;
        for warning in &prepared.warnings {
            console::complain(format_args!("{}: warning: {warning}", file.name()));
        }
        for &kind in &prepared.controllers {
            prepared
                .controller(kind)
                .map_err(|error| file.error(error))?;
        }
        Ok("scenario")
    } else if has("x_icr_left_m") {
        file.parse::<Vehicle>()?;
        Ok("vehicle")
    } else if has("axles") {
        file.parse::<ContactVehicle>()?;
        Ok("contact vehicle")
    } else if has("tread_speed_left") {
        file.parse::<ColumnMap>()?;
        Ok("column map")
    } else if has("tread_speeds") {
        TopicMap::read(&file)?;
        Ok("topic map")
    } else if !has("scenario") && (has("sensors") || has("drive_train") || settings) {
        Conditions::parse(&file)?;
        Ok("conditions")
    } else if has("database") {
        load_layout(&file)?;
        Ok("layout of a CAN bus")
    } else if has("controller") {
        check_run(&file)?;
        Ok("configuration of run")
    } else if has("scenario") {
        file.parse::<VehicleConfig>()?.check(&file)?;
        Ok("configuration of vehicle")
    } else if has("vehicle") {
        let config: LiveOdometryConfig = file.parse()?;
        config.checked(&file)?;
        Ok("configuration of odometry --live")
    } else {
        bail!(UnknownKind(file.name()))
    }
}

/// Checks that the steepness guard of a file drives the whole of a route over its elevations or, of a
/// scenario whose route has none, over its ground.
fn judge_route(file: &ConfigFile, route: &Path) -> Result<()> {
    let keys: serde_yaml::Mapping = file.parse()?;
    let (guard, vehicle, loaded, ground) = if keys.contains_key("controllers") {
        let scenario = Scenario::read(file.clone())?;
        let prepared = scenario.prepare(&Overrides {
            path: Some(route.to_owned()),
            ..Overrides::default()
        })?;
        let limits = prepared.speed_limits;
        let loaded = load(file, route, scenario.datum(), &limits)?;
        let ground = Some(prepared.terrain);
        (prepared.controller.guard, prepared.vehicle, loaded, ground)
    } else {
        let config: RunConfig = file.parse()?;
        let vehicle = config.load_vehicle(file)?;
        let limits = config.speed.limits(&config.settings.limits, &vehicle);
        (
            config.settings.guard,
            vehicle,
            load(file, route, config.datum, &limits)?,
            None,
        )
    };
    let Some(guard) = guard else {
        bail!(
            "{}: --route: the steepness guard is off; switch it on with `guard: {{}}`",
            file.name()
        );
    };
    let Some(stance) = Stance::of(&vehicle) else {
        bail!("{}: {}", file.name(), ControllerError::CentreOfMass);
    };
    let own = loaded.ground()?;
    let Some(ground) = own.or(ground) else {
        bail!(
            "{}: not every point has an elevation, so its ground is not known",
            route.display()
        );
    };
    match first_steep_place(&guard, &stance, &loaded.trajectory, &ground) {
        Some(place) => bail!("{}: refused, too steep: {place}", route.display()),
        None => Ok(()),
    }
}

fn load(
    file: &ConfigFile,
    route: &Path,
    datum: Option<GeodeticOrigin>,
    limits: &SpeedLimits,
) -> Result<LoadedReference> {
    let source = Source::of(file, None, None, datum, Some(route))?;
    Ok(LoadedReference::build(file, source, limits)?)
}

/// Shortest path for a rover, m.
const SHORT_M: f64 = 0.05;

/// Checks that a route can be smoothed and driven.
fn check_route(file: &ConfigFile) -> Result<&'static str> {
    let route = read_route(file, None)?;
    let notice = Notice::begin(format!(
        "{}: smooths {} points",
        file.name(),
        route.points.len()
    ));
    let smoothed =
        smooth(&route.points, &Smoothing::default()).map_err(|error| file.error(error))?;
    drop(notice);
    for warning in route_warnings(file, &route, &smoothed.path) {
        console::complain(format_args!("warning: {warning}"));
    }
    let points: Option<Vec<RoutePoint>> = route.points.iter().map(ground_point).collect();
    if let Some(points) = points {
        ground_along(file, &points)?;
    }
    let length_m = smoothed.path.length_m();
    if length_m < SHORT_M {
        console::complain(format_args!(
            "{}: warning: the path is {length_m:.5} m long: are its points in degrees? They must be in m; a GPX \
             file is converted",
            file.name()
        ));
    }
    Ok("route")
}

/// Checks a route or a log, distinguished by its columns.
fn check_csv(file: &ConfigFile) -> Result<&'static str> {
    if file.text().trim().is_empty() {
        bail!(
            "{}: is empty: the first line must name the columns, x_m,y_m of a path or time_s,v_left_m_s,... of a log",
            file.name()
        );
    }
    let header = file.text().lines().find(|line| !line.starts_with('#'));
    let is_log = header.is_some_and(|header| {
        let map = ColumnMap::default();
        header
            .split([',', ';', '\t'])
            .any(|name| name.trim() == map.time || name.trim() == map.tread_speed_left)
    });
    if !is_log {
        return check_route(file);
    }
    let log = DriveLog::read(file.text().as_bytes(), &ColumnMap::default())
        .map_err(|error| file.error(error))?;
    for suspicion in log.suspicions() {
        console::complain(format_args!("{}: warning: {suspicion}", file.name()));
    }
    Ok("log")
}

fn check_run(file: &ConfigFile) -> Result<()> {
    let config: RunConfig = file.parse()?;
    let vehicle = config.load_vehicle(file)?;
    config.controller(file, &vehicle)?;
    if let Some(warning) = point_behind_icrs(&config.settings.tracked_point, &vehicle) {
        console::complain(format_args!("{}: warning: settings.{warning}", file.name()));
    }
    config.recording(file, None)?;
    config
        .cycle
        .validate()
        .and_then(|()| config.safety.validate())
        .and_then(|()| config.realtime.validate())
        .map_err(|error| file.error(error))?;
    match config.port {
        RunPort::Can => drop(config.bus(file)?),
        RunPort::Simulated => drop(config.simulated_port(file)?),
        RunPort::Ros2 => {}
    }
    if config.over_ros2() {
        let ros2 = config.ros2(file, &vehicle)?;
        ros2.check_names()
            .map_err(|error| file.error(format!("ros2.{error}")))?;
    }
    Ok(())
}
