//! `sidehill identify`: a vehicle's parameters from logs, in the paper's two stages.

mod args;
mod drives;
mod file;
mod found;
mod logs;
mod page;
mod report;
mod verdict;

pub use args::IdentifyArgs;
pub use drives::IdentifiedDrives;
pub use logs::{Logs, NamedLog, by_simulation};

use crate::config::ConfigFile;
use crate::console;
use crate::output;
use crate::progress::{self, Notice};
use crate::simulate::Format;
use anyhow::{Context, Result};
use file::commented;
use found::{Found, StageResult};
use logs::{recorded, simulated};
use report::{
    contact_json, contact_table, extension_json, extension_table, stage_json, stage_table,
};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::contact::ContactVehicle;
use sidehill_plant::identification::{
    IdentificationSettings, Segmentation, identify_contact, identify_extension,
    identify_level_determined, identify_slope_determined,
};
use sidehill_plant::log::DriveLog;
use sidehill_plant::vehicle::Vehicle;
use verdict::SlopeVerdict;

/// What identification finds in logs.
pub struct Identified {
    /// The vehicle.
    pub vehicle: Vehicle,
    found: Found,
    /// Parameters of the contact vehicle that the logs do not determine.
    guessed: Vec<&'static str>,
    verdict: SlopeVerdict,
    text: String,
}

impl Identified {
    /// Returns what was found of the stages, of the terms beyond ICRIK and of the contact vehicle, and the verdict, by the
    /// keys of `identify --format json`.
    pub fn json(&self) -> serde_json::Value {
        let stage = |stage: &Option<StageResult>| {
            let stage = stage.as_ref();
            stage.map(|stage| stage_json(&stage.report, &stage.undetermined))
        };
        serde_json::json!({
            "level": stage(&self.found.level),
            "slope": stage(&self.found.slope),
            "extension": self.found.extension.as_ref().map(|report| {
                extension_json(report, self.found.extension_not_used.as_ref())
            }),
            "contact": self.found.contact.as_ref().map(contact_json),
            "verdict": self.verdict,
        })
    }

    /// Returns what `identify` prints: tables of the stages, and the verdict with its reasons.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// Identifies from logs on level ground and on a slope, in the paper's two stages and the terms beyond ICRIK, and with
/// `contact` as a vehicle on wheels; `start` is where it begins.
///
/// # Errors
/// What the logs lack.
pub fn of_logs(
    logs: &Logs,
    start: &Vehicle,
    settings: &IdentificationSettings,
    contact: bool,
) -> Result<Identified> {
    let mut vehicle = start.clone();
    let mut found = Found::default();
    let mut text = String::new();
    let mut guessed = Vec::new();
    if !logs.level.is_empty() {
        let (fitted, report, undetermined) =
            identify_level_determined(&logs.level, &vehicle, settings).context("level logs")?;
        let stage = StageResult::new(report, undetermined, &vehicle)?;
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
            identify_slope_determined(&logs.slope, &vehicle, settings).context("slope logs")?;
        let stage = StageResult::new(report, undetermined, &vehicle)?;
        text += &stage_table("slope", "ICRHK", &stage.report, &stage.undetermined);
        found.slope = Some(stage);
        vehicle = fitted;
    }
    let mut verdict = SlopeVerdict::of(&found, &vehicle, logs);
    let slope: Vec<DriveLog> = logs.slope.iter().chain(&logs.across).cloned().collect();
    match identify_extension(&logs.level, &slope, &vehicle, settings) {
        Ok((extension, report)) => {
            text += &extension_table(&report);
            found.extension = Some(report);
            let extended = Vehicle {
                extension,
                ..vehicle.clone()
            };
            match extended.validated() {
                Ok(extended) => vehicle = extended,
                Err(reason) => {
                    text += &format!("extension: not used: {reason}\n");
                    found.extension_not_used = Some(reason);
                }
            }
        }
        // The result of the two stages is valid without it.
        Err(error) => text += &format!("extension: not tried: {error}\n"),
    }
    if contact {
        let all: Vec<DriveLog> = slope
            .iter()
            .chain(logs.level.iter().filter(|log| !slope.contains(log)))
            .cloned()
            .collect();
        let (fitted, report) =
            identify_contact(&all, &vehicle, settings).context("contact vehicle")?;
        text += &contact_table(&report);
        if report.is_nearer() {
            let unknown = report.estimates.iter().filter(|e| !e.determined);
            guessed = unknown.map(|estimate| estimate.name).collect();
        }
        verdict.judge_contact(&report);
        found.contact = Some(report);
        vehicle = fitted;
    }
    text += &verdict.to_string();
    Ok(Identified {
        vehicle,
        found,
        guessed,
        verdict,
        text,
    })
}

/// Identifies, prints what was found and how far to trust it, and writes the vehicle.
///
/// # Errors
/// Names the file, row and column at fault, or says what the logs lack.
pub fn run(args: &IdentifyArgs) -> Result<()> {
    Bounds::new(0.0, 10.0, "s").check("--smoothing-s", args.smoothing_s)?;
    for path in std::iter::once(&args.out).chain(&args.report) {
        output::check_writable(path, args.force)?;
        output::check_apart(
            path,
            args.level.iter().chain(&args.slope).chain(&args.drives),
        )?;
    }
    progress::explain_interrupt(|| "interrupted: nothing was written".to_owned())?;
    if !args.drives.is_empty() {
        return drives::run(args);
    }
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
    let mut identified = of_logs(&logs, &vehicle, &settings, args.contact)?;
    if let Some(name) = &args.name {
        identified.vehicle.name.clone_from(name);
    }
    drop(notice);
    let Identified {
        vehicle,
        found,
        guessed,
        verdict,
        text,
    } = &identified;
    let yaml = commented(vehicle, args, found, guessed)?;
    output::write(&args.out, yaml.as_bytes(), args.force)?;
    if let Some(path) = &args.report {
        let level = logs.level.iter().map(|log| ("level", log));
        let read: Vec<_> = level
            .chain(logs.slope.iter().map(|log| ("slope", log)))
            .collect();
        let page = page::html(&vehicle.name, found, &verdict.to_string(), &read);
        output::write(path, page.as_bytes(), args.force)?;
    }
    match args.format {
        Format::Table => {
            console::text(format_args!("{text}"));
            console::line(format_args!("written: {}", args.out.display()));
        }
        Format::Json => {
            let mut json = identified.json();
            json["vehicle"] = serde_json::to_value(vehicle)?;
            json["written"] = serde_json::to_value(&args.out)?;
            console::line(json);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive_log::LogArgs;
    use std::path::PathBuf;

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
            drives: Vec::new(),
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
