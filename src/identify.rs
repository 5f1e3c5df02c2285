//! `sidehill identify`: a vehicle's parameters from logs, in the paper's two stages.

mod found;
mod page;
mod report;
mod verdict;

pub use report::stage_fields;

use crate::config::ConfigFile;
use crate::console;
use crate::drive_log::{LogArgs, LogReader};
use crate::output;
use crate::progress::{self, Notice};
use crate::simulate::Format;
use anyhow::{Context, Result, bail};
use found::{Found, Logs, Stage, Undetermined};
use report::{contact_json, contact_table, extension_table, stage_json, stage_table};
use sidehill_plant::contact::{ContactModel, ContactVehicle};
use sidehill_plant::identification::{
    Drive, IdentificationSettings, Leg, LogNoise, Procedure, Segmentation, drive, identify_contact,
    identify_extension, identify_level, identify_level_determined, identify_slope,
    identify_slope_determined,
};
use sidehill_plant::log::DriveLog;
use sidehill_plant::speeds::EncoderScale;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;
use std::path::PathBuf;
use verdict::Verdict;

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
          required_unless_present_any = ["level", "slope"])]
    pub simulate: Option<PathBuf>,
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

/// Identifies, prints what was found and how far to trust it, and writes the vehicle.
///
/// # Errors
/// Names the file, row and column at fault, or says what the logs lack.
pub fn run(args: &IdentifyArgs) -> Result<()> {
    if !(0.0..=10.0).contains(&args.smoothing_s) {
        bail!("smoothing_s: {}: must be from 0 to 10 s", args.smoothing_s);
    }
    for path in std::iter::once(&args.out).chain(&args.report) {
        output::check_writable(path, args.force)?;
    }
    progress::explain_interrupt(|| "interrupted: nothing was written".to_owned())?;
    let settings = IdentificationSettings {
        segmentation: Segmentation::of_length(args.segment_s)?,
        attitude_smoothing_s: args.smoothing_s,
    };
    let mut vehicle: Vehicle = ConfigFile::read(&args.vehicle)?.parse()?;
    let notice = Notice::begin(format!(
        "identify: {}, then fits and cross-validates",
        match &args.simulate {
            Some(_) => "drives the procedure in simulation".to_owned(),
            None => format!("reads {} logs", args.level.len() + args.slope.len()),
        }
    ));
    let logs = match &args.simulate {
        Some(path) => {
            let contact: ContactVehicle = ConfigFile::read(path)?.parse()?;
            simulated(&contact, &vehicle, args.seed).with_context(|| path.display().to_string())?
        }
        None => recorded(args)?,
    };
    if let (true, Some(path)) = (args.contact, &args.simulate) {
        let contact: ContactVehicle = ConfigFile::read(path)?.parse()?;
        vehicle.contact = Some(contact.geometry_alone());
    }
    let mut found = Found::default();
    let mut text = String::new();
    let mut guessed = Vec::new();
    let mut contact = serde_json::Value::Null;
    if !logs.level.is_empty() {
        let (fitted, report, undetermined) =
            identify_level_determined(&logs.level, &vehicle, &settings).context("level logs")?;
        let stage = Stage::new(report, undetermined, &vehicle)?;
        text += &stage_table(
            "level",
            "differential drive",
            &stage.report,
            &stage.undetermined,
        );
        found.level = Some(stage);
        vehicle = fitted;
    }
    if !logs.slope.is_empty() {
        let (fitted, report, undetermined) =
            identify_slope_determined(&logs.slope, &vehicle, &settings).context("slope logs")?;
        let stage = Stage::new(report, undetermined, &vehicle)?;
        text += &stage_table("slope", "ICRHK", &stage.report, &stage.undetermined);
        found.slope = Some(stage);
        vehicle = fitted;
    }
    let verdict = Verdict::of(&found, &vehicle, &logs);
    let slope: Vec<DriveLog> = logs.slope.iter().chain(&logs.across).cloned().collect();
    match identify_extension(&logs.level, &slope, &vehicle, &settings) {
        Ok((extension, report)) => {
            text += &extension_table(&report);
            vehicle.extension = extension;
            vehicle = vehicle.validated().context("the extended model")?;
        }
        // What the two stages found holds without it.
        Err(error) => text += &format!("extension: not tried: {error}\n"),
    }
    if args.contact {
        let all: Vec<DriveLog> = slope
            .iter()
            .chain(logs.level.iter().filter(|log| !slope.contains(log)))
            .cloned()
            .collect();
        let (fitted, report) =
            identify_contact(&all, &vehicle, &settings).context("contact vehicle")?;
        text += &contact_table(&report);
        contact = contact_json(&report);
        let unknown = report.estimates.iter().filter(|e| !e.determined);
        guessed = unknown.map(|estimate| estimate.name).collect();
        vehicle = fitted;
    }
    if let Some(name) = &args.name {
        vehicle.name.clone_from(name);
    }
    drop(notice);
    let yaml = commented(&vehicle, args, &found, &guessed)?;
    output::write(&args.out, yaml.as_bytes(), args.force)?;
    if let Some(path) = &args.report {
        let level = found.level.iter();
        let level = level.map(|stage| ("level", "differential drive", &stage.report));
        let slope = found.slope.iter();
        let slope = slope.map(|stage| ("slope", "ICRHK", &stage.report));
        let stages: Vec<page::NamedStage> = level.chain(slope).collect();
        let level = logs.level.iter().map(|log| ("level", log));
        let read: Vec<_> = level
            .chain(logs.slope.iter().map(|log| ("slope", log)))
            .collect();
        let conclusions: Vec<String> = verdict.to_string().lines().map(str::to_owned).collect();
        let page = page::html(&vehicle.name, &stages, &conclusions, &read);
        output::write(path, page.as_bytes(), args.force)?;
    }
    match args.format {
        Format::Table => {
            console::text(format_args!("{text}{verdict}"));
            console::line(format_args!("written: {}", args.out.display()));
        }
        Format::Json => {
            let stage = |stage: &Option<Stage>| {
                let stage = stage.as_ref();
                stage.map(|stage| stage_json(&stage.report, &stage.undetermined))
            };
            console::line(serde_json::json!({
                "vehicle": vehicle,
                "level": stage(&found.level),
                "slope": stage(&found.slope),
                "contact": contact,
                "verdict": verdict,
                "written": args.out,
            }));
        }
    }
    Ok(())
}

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

fn recorded(args: &IdentifyArgs) -> Result<Logs> {
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
    Ok(Logs {
        level: read(&args.level)?,
        slope: read(&args.slope)?,
        across: Vec::new(),
    })
}

/// Drives the paper's procedure with a contact vehicle whose encoders are off by `vehicle`'s factors.
fn simulated(contact: &ContactVehicle, vehicle: &Vehicle, seed: u64) -> Result<Logs> {
    let procedure = Procedure::of_the_paper();
    let encoder_scale: EncoderScale = vehicle.encoder_scale;
    let log = |terrain: Terrain, legs: &[Leg], seed: u64| {
        let setup = Drive {
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

/// Returns the vehicle as YAML with where it comes from.
fn commented(
    vehicle: &Vehicle,
    args: &IdentifyArgs,
    found: &Found,
    guessed: &[&'static str],
) -> Result<String> {
    let list = |paths: &[PathBuf]| {
        let names: Vec<_> = paths
            .iter()
            .map(|path| path.display().to_string())
            .collect();
        names.join(" ")
    };
    let source = match &args.simulate {
        Some(path) => format!("--simulate {} --seed {}", path.display(), args.seed),
        None => format!(
            "--level {} --slope {}",
            list(&args.level),
            list(&args.slope)
        ),
    };
    let mut yaml = serde_yaml::to_string(vehicle)?;
    for Undetermined { estimate, .. } in found.undetermined() {
        let key = format!("\n{}:", estimate.name);
        let interval = estimate.half_width.map_or_else(
            || "any value fits them".to_owned(),
            |half_width| format!("they say {:.4} +- {half_width:.4}", estimate.value),
        );
        let warning = format!(
            "\n# NOT DETERMINED by these logs ({interval}): kept from the --vehicle file.{key}"
        );
        yaml = yaml.replacen(&key, &warning, 1);
    }
    if let Some((before, contact)) = yaml.split_once("\ncontact:") {
        let mut contact = contact.to_owned();
        for name in guessed {
            let place = match *name {
                "inner_load_share" => "axles",
                name => name,
            };
            let key = format!("\n  {place}:");
            let warning = format!("\n  # NOT DETERMINED by these logs, still a guess: {name}{key}");
            contact = contact.replacen(&key, &warning, 1);
        }
        yaml = format!("{before}\ncontact:{contact}");
    }
    let contact = if args.contact { " --contact" } else { "" };
    Ok(format!(
        "# Identified by: sidehill identify {source}{contact} --vehicle {} --segment-s {} --smoothing-s {}\n\
         # Keys and units as in config/vehicles/j8.yaml: ICRs in m from the body's origin, slide gains\n\
         # in s/rad, largest speed in m/s, base in m; base and largest speed from the --vehicle file.\n\
         # extension: terms beyond ICRIK and the parameters found with them, see docs/identification.md.\n{yaml}",
        args.vehicle.display(),
        args.segment_s,
        args.smoothing_s
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn repository(name: &str) -> PathBuf {
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
    }

    fn arguments(out: PathBuf) -> IdentifyArgs {
        IdentifyArgs {
            force: false,
            format: Format::Table,
            report: None,
            contact: false,
            level: Vec::new(),
            slope: Vec::new(),
            simulate: Some(repository("config/vehicles/j8_contact.yaml")),
            vehicle: repository("config/vehicles/j8.yaml"),
            out,
            maps: LogArgs::default(),
            segment_s: 8.0,
            smoothing_s: 0.2,
            name: Some("j8-contact-identified".into()),
            seed: 1,
        }
    }

    fn creep(vehicle: &Vehicle) -> f64 {
        vehicle.extension_gains().creep_m_s_per_rad
    }

    #[test]
    fn the_identified_contact_vehicle_is_what_its_command_makes() {
        let out = std::env::temp_dir().join(format!("sidehill-{}.yaml", std::process::id()));
        run(&arguments(out.clone())).unwrap();
        let made: Vehicle = ConfigFile::read(&out).unwrap().parse().unwrap();
        std::fs::remove_file(&out).unwrap();
        let kept = repository("config/vehicles/j8_contact_identified.yaml");
        let kept: Vehicle = ConfigFile::read(&kept).unwrap().parse().unwrap();
        // Mathematical functions differ in the last digit between machines.
        for (made, kept) in [
            (made.icrs.left_m, kept.icrs.left_m),
            (made.icrs.right_m, kept.icrs.right_m),
            (made.icrs.forward_m, kept.icrs.forward_m),
            (made.slide.shift_s_per_rad, kept.slide.shift_s_per_rad),
            (
                made.slide.aggravated_s_per_rad,
                kept.slide.aggravated_s_per_rad,
            ),
            (made.encoder_scale.left, kept.encoder_scale.left),
            (made.encoder_scale.right, kept.encoder_scale.right),
            (creep(&made), creep(&kept)),
        ] {
            assert!((made - kept).abs() < 1e-3 * kept.abs(), "{made} {kept}");
        }
    }

    #[test]
    fn a_log_that_is_missing_is_named() {
        let error = run(&IdentifyArgs {
            level: vec!["no_such_log.csv".into()],
            simulate: None,
            ..arguments("unused.yaml".into())
        })
        .unwrap_err();
        assert!(format!("{error:#}").contains("no_such_log.csv"));
    }
}
