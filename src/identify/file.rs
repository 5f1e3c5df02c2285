//! The vehicle file that identification writes.

use super::args::IdentifyArgs;
use super::found::{Found, Undetermined};
use anyhow::Result;
use sidehill_plant::vehicle::Vehicle;
use std::path::PathBuf;

/// Returns the vehicle as YAML, with comments that say where it comes from and what is still a guess.
pub(super) fn commented(
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
            let warning = format!(
                "\n  # HARDLY DETERMINED by these logs, drawn to the guess it started from: {name}{key}"
            );
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
