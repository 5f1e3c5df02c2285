//! Files of each version, kept in tests/data/formats: what a later version does with them.
//!
//! With the environment variable `UPDATE_DOCS` set, `keys.txt` is written into a folder that has none.

use crate::{assert_says, fail, repository, sidehill, stdout, succeed, text};
use serde_json::Value;
use sidehill::learned::LearnedFile;
use sidehill_plant::log::{ColumnMap, DriveLog};
use sidehill_recording::Recording;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The folders of all versions, and whether they have more than configurations.
const VERSIONS: [(&str, bool); 2] = [("0.1.0", false), ("0.2.0", true)];

fn folder(version: &str) -> PathBuf {
    repository("tests/data/formats").join(version)
}

fn yaml_files(folder: &Path) -> Vec<PathBuf> {
    let entries = folder
        .read_dir()
        .unwrap()
        .map(|entry| entry.unwrap().path());
    entries
        .filter(|path| path.extension().is_some_and(|ending| ending == "yaml"))
        .collect()
}

/// Returns a copy of a version's files.
fn copy(version: &str) -> tempfile::TempDir {
    let copy = tempfile::tempdir().unwrap();
    for entry in folder(version).read_dir().unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, copy.path().join(path.file_name().unwrap())).unwrap();
    }
    copy
}

/// Returns a copy of a version's files, with configurations as the program reads them.
fn migrated(version: &str) -> tempfile::TempDir {
    let copy = copy(version);
    succeed(
        sidehill()
            .args(["migrate", "--write"])
            .args(yaml_files(copy.path())),
    );
    copy
}

/// Returns the versions whose folder has a drive.
fn each_with_a_drive() -> impl Iterator<Item = &'static str> {
    VERSIONS
        .into_iter()
        .filter(|(_, has_drive)| *has_drive)
        .map(|(version, _)| version)
}

#[test]
fn every_folder_is_listed_here() {
    let entries = repository("tests/data/formats").read_dir().unwrap();
    let found: BTreeSet<String> = entries
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.file_type().unwrap().is_dir())
        .map(|entry| entry.file_name().into_string().unwrap())
        .collect();
    assert_eq!(found, VERSIONS.map(|(name, _)| name.to_owned()).into());
}

#[test]
fn configurations_of_every_version_are_valid_once_they_are_migrated() {
    for (version, _) in VERSIONS {
        let copy = migrated(version);
        let files = yaml_files(copy.path());
        assert!(files.len() >= 7, "{files:?}");
        let lines = succeed(sidehill().arg("check").args(&files));
        assert_eq!(lines.lines().count(), files.len());
        let again = succeed(sidehill().arg("migrate").args(&files));
        for file in &files {
            let name = file.display();
            assert_says(&again, &[&format!("{name}: nothing to remove")]);
        }
    }
}

#[test]
fn what_was_removed_is_listed_first_and_nothing_else_changes() {
    let copy = copy("0.1.0");
    let run = copy.path().join("run.yaml");
    let before = std::fs::read_to_string(&run).unwrap();
    assert_says(
        &fail(sidehill().arg("check").arg(&run)),
        &[
            "unknown field `last_step_s`",
            "removed in 0.2.0",
            "sidehill migrate FILE",
        ],
    );
    let listed = sidehill().arg("migrate").arg(&run).output().unwrap();
    assert_eq!(listed.status.code(), Some(1));
    assert_says(
        &stdout(&listed),
        &[
            "run.yaml: line 11: - settings.last_step_s, removed in 0.2.0: ",
            "--write",
        ],
    );
    assert_eq!(std::fs::read_to_string(&run).unwrap(), before);

    let kept = copy.path().join("run.yaml.old");
    std::fs::write(&kept, "of the user").unwrap();
    let said = fail(sidehill().args(["migrate", "--write"]).arg(&run));
    assert_says(&said, &["run.yaml.old: exists already"]);
    assert_eq!(std::fs::read_to_string(&run).unwrap(), before);
    std::fs::remove_file(&kept).unwrap();
    succeed(sidehill().args(["migrate", "--write"]).arg(&run));
    assert_eq!(std::fs::read_to_string(&kept).unwrap(), before);
    let after = std::fs::read_to_string(&run).unwrap();
    for stays in [
        "# `sidehill run` on a virtual rover inside the program, with every setting of the controller.\nport: simulated\n",
        "  # The horizon: 6 s.\n  stages: 40\n  step_s: 0.15\n  command_delay_s: 0.03 # s, measured on 3 May\n",
        "    heading_per_rad2: 0.02\n\n    # Calm steer.\n    steer_change_s3_per_m2: 0.1\n  estimator:\n",
        // They are switched on by standing there.
        "  guard: {} # steep in the north\n  memory: {}\ncourse: ",
    ] {
        assert_says(&after, &[stays]);
    }
    // No line is new but these.
    let is_new = |line: &&str| !before.lines().any(|old| old == *line);
    let new: Vec<&str> = after.lines().filter(is_new).collect();
    assert_eq!(
        new,
        [
            "    adaptation: {}",
            "  guard: {} # steep in the north",
            "  memory: {}"
        ]
    );
}

#[test]
fn a_layout_that_cannot_be_edited_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("anchor.yaml");
    let text = "controller: {lead_max_m: &lead 0.3, stages: 40}\nname: *lead\n";
    std::fs::write(&file, text).unwrap();
    let said = fail(sidehill().args(["migrate", "--write"]).arg(&file));
    assert_says(
        &said,
        &["anchor.yaml", "by hand", "line 1: - controller.lead_max_m"],
    );
    assert_eq!(std::fs::read_to_string(&file).unwrap(), text);
    assert_eq!(folder.path().read_dir().unwrap().count(), 1);
}

/// Adds every key of a schema to `found`, with dots between nested ones; items of lists add none.
fn add_keys(schema: &Value, root: &Value, path: &str, found: &mut BTreeSet<String>) {
    if let Some(name) = schema["$ref"].as_str() {
        let definition = root.pointer(name.trim_start_matches('#')).unwrap();
        add_keys(definition, root, path, found);
    }
    for part in ["oneOf", "anyOf", "allOf"] {
        for inner in schema[part].as_array().into_iter().flatten() {
            add_keys(inner, root, path, found);
        }
    }
    if schema["items"].is_object() {
        add_keys(&schema["items"], root, path, found);
    }
    for (name, inner) in schema["properties"].as_object().into_iter().flatten() {
        let key = format!("{path}{name}");
        add_keys(inner, root, &format!("{key}."), found);
        found.insert(key);
    }
}

/// Returns every key that files may have, as lines of their kind and the key.
fn keys_of_today() -> BTreeSet<String> {
    let mut lines = BTreeSet::new();
    for entry in repository("docs/schema").read_dir().unwrap() {
        let path = entry.unwrap().path();
        let schema = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let mut keys = BTreeSet::new();
        add_keys(&schema, &schema, "", &mut keys);
        let kind = path.file_stem().unwrap().display();
        lines.extend(keys.iter().map(|key| format!("{kind} {key}")));
    }
    lines
}

#[test]
fn no_key_of_any_version_is_gone_without_migrate_knowing_it() {
    let today = keys_of_today();
    for (version, _) in VERSIONS {
        let list = folder(version).join("keys.txt");
        if std::env::var_os("UPDATE_DOCS").is_some() && !list.exists() {
            let lines: Vec<&str> = today.iter().map(String::as_str).collect();
            std::fs::write(&list, lines.join("\n") + "\n").unwrap();
        }
        // One file has each key of the controller that is gone.
        let listed = sidehill()
            .arg("migrate")
            .args(yaml_files(&folder(version)))
            .output()
            .unwrap();
        let listed = stdout(&listed);
        let known: Vec<&str> = listed
            .lines()
            .filter_map(|line| line.split_once(": - ")?.1.split_once(','))
            .map(|(key, _)| key.trim_start_matches("with."))
            .collect();
        let names = std::fs::read_to_string(&list).unwrap();
        assert!(names.lines().count() > 1000, "{version}");
        for line in names.lines().filter(|line| !today.contains(*line)) {
            let (_, key) = line.split_once(' ').unwrap();
            let of_run = key.replacen("controller.", "settings.", 1);
            let is_known = known.iter().any(|known| {
                let of_known = known.replacen("controller.", "settings.", 1);
                of_run == of_known || of_run.starts_with(&format!("{of_known}."))
            });
            assert!(
                is_known,
                "{version}: {line} is gone, and `sidehill migrate` does not list it"
            );
        }
    }
}

#[test]
fn logs_and_results_have_the_columns_and_fields_of_every_version() {
    for version in each_with_a_drive() {
        let copy = migrated(version);
        let log = text(&format!("tests/data/formats/{version}/log.csv"));
        let read = DriveLog::read(log.as_bytes(), &ColumnMap::default()).unwrap();
        assert_eq!(read.rows().len() + 1, log.lines().count(), "{version}");
        let printed = succeed(sidehill().current_dir(copy.path()).args([
            "simulate",
            "scenario.yaml",
            "--format",
            "json",
            "--out",
            "out",
        ]));
        let written = std::fs::read_to_string(copy.path().join("out/contact-mpc.csv")).unwrap();
        let columns = |log: &str| -> BTreeSet<String> {
            log.lines()
                .next()
                .unwrap()
                .split(',')
                .map(str::to_owned)
                .collect()
        };
        let gone: Vec<_> = columns(&log)
            .difference(&columns(&written))
            .cloned()
            .collect();
        assert_eq!(gone, [""; 0], "{version}: columns of logs are gone");
        let fields = |text: &str| {
            let mut fields = BTreeSet::new();
            add_fields(&serde_json::from_str(text).unwrap(), "", &mut fields);
            fields
        };
        let result = text(&format!("tests/data/formats/{version}/result.json"));
        let gone: Vec<_> = fields(&result)
            .difference(&fields(&printed))
            .cloned()
            .collect();
        assert_eq!(
            gone, [""; 0],
            "{version}: fields of results are gone, or of another type"
        );
    }
}

/// Adds every field of a JSON value with its type to `found`.
fn add_fields(value: &Value, path: &str, found: &mut BTreeSet<String>) {
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(items) => {
            items.iter().for_each(|item| add_fields(item, path, found));
            "list"
        }
        Value::Object(fields) => {
            for (name, inner) in fields {
                add_fields(inner, &format!("{path}.{name}"), found);
            }
            "object"
        }
    };
    found.insert(format!("{path} {kind}"));
}

#[test]
fn recordings_and_learned_files_are_read_or_refused_with_both_layouts() {
    let mut read = 0;
    for version in each_with_a_drive() {
        let folder = tempfile::tempdir().unwrap();
        let recording = crate::replay::unpacked(
            &format!("tests/data/formats/{version}/drive.mcap.zst"),
            folder.path(),
        );
        match Recording::read(&recording) {
            Ok(found) => {
                read += 1;
                assert!(found.damaged.is_none() && !found.paths.is_empty());
                let cycles = |column: &str| {
                    let log = text(&format!("tests/data/formats/{version}/log.csv"));
                    let names = log.lines().next().unwrap();
                    let at = names.split(',').position(|name| name == column).unwrap();
                    let value = |row: &str| row.split(',').nth(at).unwrap().parse().unwrap();
                    log.lines().skip(1).map(value).collect::<Vec<f64>>()
                };
                let times_s: Vec<f64> = found.cycles.iter().map(|cycle| cycle.time_s).collect();
                assert_eq!(times_s, cycles("time_s"));
            }
            Err(error) => assert_says(
                &error.to_string(),
                &["have layout", "reads layout", version],
            ),
        }
        match LearnedFile::of(text(&format!("tests/data/formats/{version}/j8.learned"))) {
            Ok(found) => assert!(found.learned.confidence() > 0.01),
            Err(error) => assert_says(&error.to_string(), &["refused: has layout", "reads"]),
        }
    }
    // Those of the newest version.
    assert!(read > 0);
}
