//! The files of a set.

use super::bridge::bridge;
use super::file::File;
use super::port::PortKind;
use super::robots::Measures;
use super::schemas::{name_schema, schemas};
use super::texts::{COLUMNS, readme, scenario};
use super::vehicles::{contact_vehicle, first_guess};
use crate::config::{CONTACT_IDENTIFIED, CONTACT_VEHICLE, ConfigFile};
use anyhow::Result;
use sidehill_plant::vehicle::Vehicle;

/// Half length of the J8's wheel rectangle, m, for which the figure of eight is sized.
const J8_HALF_LENGTH_M: f64 = 1.06;

/// Returns all files of a set; without measures those of the J8, whose own are copied.
pub(super) fn all(measures: Option<Measures<'_>>, port: PortKind) -> Result<Vec<File>> {
    let speed_m_s = measures.and_then(|measures| measures.speed_m_s);
    let (vehicle, contact, identified, scale) = match measures {
        None => (
            built_in("config/vehicles/j8.yaml")?,
            built_in(CONTACT_VEHICLE)?,
            Some(built_in(CONTACT_IDENTIFIED)?),
            1.0,
        ),
        Some(measures) => {
            let contact = contact_vehicle(&measures);
            let scale = (0.5 * measures.wheelbase_m / J8_HALF_LENGTH_M).clamp(0.4, 1.0);
            (first_guess(&measures, &contact)?, contact, None, scale)
        }
    };
    let known: Vehicle = serde_yaml::from_str(&vehicle)?;
    let track_width_m = known.icrs.right_m - known.icrs.left_m;
    let identified_name = match identified {
        Some(_) => "identified.yaml",
        None => "vehicle.yaml",
    };
    let mut files = vec![
        File {
            name: "vehicle.yaml",
            text: vehicle,
        },
        File {
            name: "contact.yaml",
            text: contact,
        },
        File {
            name: "scenario.yaml",
            text: scenario(&known.name, identified_name, scale, speed_m_s),
        },
        File {
            name: "columns.yaml",
            text: COLUMNS.to_owned(),
        },
        File {
            name: "README.md",
            text: readme(&known.name, port),
        },
    ];
    files.extend(identified.map(|text| File {
        name: "identified.yaml",
        text,
    }));
    files.extend(bridge(port, track_width_m, measures.as_ref())?);
    files.iter_mut().for_each(name_schema);
    let schemas = schemas(&files);
    files.extend(schemas);
    Ok(files)
}

fn built_in(name: &str) -> Result<String> {
    Ok(ConfigFile::built_in(name)?.text().to_owned())
}
