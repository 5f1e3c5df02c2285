//! The tables of docs/configuration.md, made from the program: its keys, types, units, ranges, defaults and texts.
//!
//! Each table follows a comment `<!-- keys: FILE PATH of HOLDER with KEY=JSON... -->`: a file of `config/`, the section
//! in it, the struct or variant that holds the keys, and what is put into the file so that it has the section. The
//! program is asked by values that it must refuse: an unknown key makes it list the known ones, a map names the type, a
//! huge number the range. The text of a key is the doc comment of its field, its unit the end of its name.
//!
//! With the environment variable `UPDATE_DOCS` set, the page is made anew; the schemas are made from it.

mod source;
mod table;

use crate::{repository, text};
use serde_yaml::{Mapping, Value};
use sidehill_bridge::control_loop::CycleConfig;
use sidehill_bridge::control_loop::scheduling::RealtimeConfig;
use sidehill_bridge::ros2::settings::server::Ros2Config;
use sidehill_bridge::safety::SafetyConfig;
use sidehill_controller::config::ControllerConfig;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::sensors::SensorsConfig;
use std::collections::BTreeMap;
use table::*;

/// Returns the type of a key as the page calls it, from what the program says about a map in its place.
fn kind(table: &Table, key: &str) -> String {
    let map = Mapping::from_iter([(UNKNOWN.into(), 1.into())]);
    let Some(complaint) = table.complaint(key, map) else {
        return "section".into();
    };
    let variants = |complaint: &str| {
        let names: Vec<_> = expected(complaint)
            .iter()
            .map(|name| format!("`{name}`"))
            .collect();
        format!("one of {}", names.join(", "))
    };
    if complaint.contains("unknown variant") {
        return variants(&complaint);
    }
    let Some((_, wanted)) = complaint.split_once("invalid type: map, expected ") else {
        return "section".into();
    };
    let wanted = wanted.split(" at line").next().unwrap();
    match wanted {
        "f64" => "number".into(),
        "a boolean" => "boolean".into(),
        "a string" => "text".into(),
        "path string" => "file".into(),
        "a sequence" => "list".into(),
        wanted if wanted.starts_with("an array") => "list".into(),
        wanted if wanted.starts_with("a YAML tag") => {
            variants(&table.complaint(key, UNKNOWN).unwrap())
        }
        _ => "integer".into(),
    }
}

/// Returns the range of a number as in the program's error; empty if it accepts huge numbers of both signs.
fn range(table: &Table, key: &str, kind: &str) -> String {
    let tried: [Value; 2] = match kind {
        "number" => [9e15.into(), (-9e15).into()],
        "integer" if key.contains("priority") || key == "node_id" => [255.into(), 0.into()],
        "integer" => [1_000_000_000.into(), 0.into()],
        _ => return String::new(),
    };
    tried
        .into_iter()
        .filter_map(|value| table.complaint(key, value))
        .filter(|complaint| complaint.contains(key))
        .find_map(|complaint| {
            let (_, range) = complaint.split_once("out of range, must be ")?;
            // The rest of the message is the place in the file.
            Some(
                range
                    .split(" at line")
                    .next()?
                    .split(" (line")
                    .next()?
                    .to_owned(),
            )
        })
        .unwrap_or_default()
}

#[test]
fn every_key_has_its_row_with_type_and_range() {
    let mut wrong = Vec::new();
    let mut page = text(PAGE);
    let (mut tables, sources) = (tables(), source::declarations());
    for table in &mut tables {
        assert_eq!(
            table.complaint_about(table.content.clone()),
            None,
            "{}",
            table.name()
        );
        let known = expected(&table.complaint(UNKNOWN, 1).unwrap());
        let documented: Vec<_> = table.rows.iter().map(|row| row.key.clone()).collect();
        if known != documented {
            wrong.push(format!(
                "{}: keys {documented:?}, must be {known:?}",
                table.name()
            ));
            let lines = |rows: &[Row]| -> String {
                rows.iter().map(|row| format!("{}\n", row.line)).collect()
            };
            let before = lines(&table.rows);
            let mut old = std::mem::take(&mut table.rows);
            let rows = known.iter().map(|key| {
                let place = old.iter().position(|row| row.key == *key);
                place.map_or_else(|| Row::new(table, key), |place| old.swap_remove(place))
            });
            let rows: Vec<Row> = rows.collect();
            page = page.replace(&before, &lines(&rows));
            table.rows = rows;
        }
        let texts = sources.get(&table.holder).and_then(|fields| {
            let whole = |fields: &&BTreeMap<_, _>| known.iter().all(|key| fields.contains_key(key));
            fields.iter().find(whole)
        });
        let texts = texts.unwrap_or_else(|| {
            panic!("{}: no {} has its keys", table.name(), table.holder);
        });
        for row in &table.rows {
            let kind = kind(table, &row.key);
            let range = range(table, &row.key, &kind);
            let of_key = [
                kind.as_str(),
                source::unit(&row.key),
                &range,
                &texts[&row.key],
            ];
            let in_page = [&row.kind, &row.unit, &row.range, &row.meaning];
            if in_page != of_key {
                wrong.push(format!(
                    "{}: {}: {in_page:?}, must be {of_key:?}",
                    table.name(),
                    row.key
                ));
                let mut cells: Vec<String> = row.line.split('|').map(str::to_owned).collect();
                for (cell, text) in [2, 4, 5, 6].into_iter().zip(of_key) {
                    cells[cell] = format!(" {text} ");
                }
                page = page.replace(&row.line, &cells.join("|"));
            }
        }
    }
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(repository(PAGE), page).unwrap();
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(tables.len() > 60, "only {} tables were found", tables.len());
}

#[test]
fn keys_without_a_default_are_marked_required() {
    for table in tables() {
        for row in &table.rows {
            let content = without(table.content.clone(), &table.at(&row.key));
            let complaint = table.complaint_about(content).unwrap_or_default();
            let missing = complaint.contains(&format!("missing field `{}`", row.key));
            if missing {
                assert_eq!(row.default, "required", "{}: {}", table.name(), row.key);
            } else if row.default == "required" {
                // A missing key that tells kinds of files apart is reported before the file is parsed.
                assert!(
                    !complaint.is_empty(),
                    "{}: {} is not required",
                    table.name(),
                    row.key
                );
            }
        }
    }
}

/// Returns the defaults of the sections whose settings can be written out.
fn defaults(file: &str) -> Value {
    let value = |settings: Result<Value, serde_yaml::Error>| settings.unwrap();
    let mut sections = Mapping::new();
    let mut section = |key: &str, settings| sections.insert(key.into(), value(settings));
    section(
        "controller",
        serde_yaml::to_value(ControllerConfig::default()),
    );
    section(
        "drive_train",
        serde_yaml::to_value(DriveTrainConfig::default()),
    );
    section("sensors", serde_yaml::to_value(SensorsConfig::default()));
    if file.starts_with("bridge/run") {
        section("cycle", serde_yaml::to_value(CycleConfig::default()));
        section("safety", serde_yaml::to_value(SafetyConfig::default()));
        section("realtime", serde_yaml::to_value(RealtimeConfig::default()));
        section("ros2", serde_yaml::to_value(Ros2Config::default()));
    }
    Value::Mapping(sections)
}

#[test]
fn defaults_are_those_of_the_code() {
    let mut checked = 0;
    for table in tables() {
        let all = defaults(&table.file);
        let section = table
            .path
            .iter()
            .try_fold(&all, |at, key| at.get(key.as_str()));
        let Some(section) = section.filter(|_| !table.path.is_empty()) else {
            continue;
        };
        for row in &table.rows {
            let Some(value) = section.get(row.key.as_str()) else {
                continue;
            };
            let documented = row.default.trim_matches('`');
            if documented == "required" {
                continue;
            }
            let same = match value {
                Value::Number(number) => documented.parse().ok() == number.as_f64(),
                Value::Bool(value) => documented == value.to_string(),
                Value::String(value) if value.is_empty() => documented == "none",
                Value::String(value) => documented == value,
                Value::Null => documented == "none",
                _ => continue,
            };
            assert!(
                same,
                "{}: {}: default {documented}, the code has {value:?}",
                table.name(),
                row.key
            );
            checked += 1;
        }
    }
    assert!(checked >= 100, "only {checked} defaults were compared");
}
