//! What the sources say about keys: the doc comment of the field that holds a key is its text in the page, and the end
//! of its name is its unit.

use crate::repository;
use std::collections::BTreeMap;
use std::path::Path;

/// Ends of names, the longest of those that fit counts.
const UNITS: [(&str, &str); 23] = [
    ("_m_per_sqrt_s", "m/sqrt(s)"),
    ("_rad_per_sqrt_s", "rad/sqrt(s)"),
    ("_s3_per_m2", "s^3/m^2"),
    ("_m_s_per_rad", "m/s/rad"),
    ("_s_per_rad", "s/rad"),
    ("_per_rad2", "1/rad^2"),
    ("_per_rad", "1/rad"),
    ("_per_m2", "1/m^2"),
    ("_per_m", "1/m"),
    ("_per_s", "1/s"),
    ("_deg_s", "deg/s"),
    ("_rad_s", "rad/s"),
    ("_m_s2", "m/s^2"),
    ("_m_s", "m/s"),
    ("_kg_m2", "kg m^2"),
    ("_kg", "kg"),
    ("_hz", "Hz"),
    ("_deg", "deg"),
    ("_rad", "rad"),
    ("_share_m", "m"),
    ("_m", "m"),
    ("_std_s", "s"),
    ("_s", "s"),
];

/// Returns the unit of a key.
pub(super) fn unit(key: &str) -> &'static str {
    let fits = UNITS.iter().filter(|(end, _)| key.ends_with(end));
    fits.max_by_key(|(end, _)| end.len())
        .map_or("", |(_, unit)| unit)
}

/// Texts of the fields of a struct, or of a variant of an enum.
type Fields = BTreeMap<String, String>;

/// Returns the fields of all structs and variants by their names, `Struct` or `Enum::Variant`.
pub(super) fn declarations() -> BTreeMap<String, Vec<Fields>> {
    let mut found = BTreeMap::new();
    for folder in ["plant/src", "controller/src", "bridge", "src"] {
        read_folder(&repository(folder), &mut found);
    }
    found
}

fn read_folder(folder: &Path, found: &mut BTreeMap<String, Vec<Fields>>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            read_folder(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            read_file(&std::fs::read_to_string(path).unwrap(), found);
        }
    }
}

fn read_file(text: &str, found: &mut BTreeMap<String, Vec<Fields>>) {
    // The struct or enum, the variant of an enum, and what was read of the one that is open.
    let (mut outer, mut variant): (Option<(&str, bool)>, Option<&str>) = (None, None);
    let (mut fields, mut doc, mut renamed) = (Fields::new(), Vec::new(), None);
    for line in text.lines() {
        let words = line.trim().trim_start_matches("pub(crate) ");
        let words = words
            .trim_start_matches("pub(super) ")
            .trim_start_matches("pub ");
        let is_type = ["struct ", "enum "]
            .iter()
            .find(|kind| words.starts_with(**kind));
        if let (Some(kind), Some(name)) = (is_type, words.strip_suffix(" {")) {
            let name = name[kind.len()..].split('<').next().unwrap();
            outer = Some((name, *kind == "enum "));
            (variant, fields) = (None, Fields::new());
        } else if let Some((name, is_enum)) = outer {
            let closes = line.trim() == "}" || line.trim() == "},";
            let opened = words.strip_suffix(" {");
            let opened = opened.filter(|name| name.chars().all(char::is_alphanumeric));
            if closes {
                let name = match variant.take() {
                    Some(variant) => format!("{name}::{variant}"),
                    None => {
                        outer = None;
                        name.to_owned()
                    }
                };
                found
                    .entry(name)
                    .or_default()
                    .push(std::mem::take(&mut fields));
            } else if let Some(opened) = opened.filter(|_| is_enum) {
                variant = Some(opened);
                fields = Fields::new();
            } else if let Some(line) = words.strip_prefix("///") {
                doc.push(line.trim());
                continue;
            } else if words.starts_with("#[") {
                let name = words.split_once("rename = \"");
                renamed = name
                    .and_then(|(_, rest)| rest.split('"').next())
                    .or(renamed);
                continue;
            } else if let Some((field, _)) = words.split_once(": ") {
                let field = renamed.unwrap_or(field.trim_start_matches("r#"));
                fields.insert(field.to_owned(), doc.join(" "));
            }
        }
        doc.clear();
        renamed = None;
    }
}
