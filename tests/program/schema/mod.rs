//! docs/schema/*.json: JSON schemas of all files for editors, made from the tables of docs/configuration.md, which
//! `configuration.rs` checks against the program.
//!
//! With the environment variable `UPDATE_DOCS` set, the schemas are written anew.

mod builder;
mod page;
mod validate;

use crate::repository;
use builder::schema;
use serde_json::{Value, json};
use std::path::PathBuf;
use validate::misfit;

/// Schemas with the anchor of their section in the page, and the files of the repository that they are for.
const KINDS: [(&str, &str, &[&str]); 11] = [
    (
        "vehicle",
        "vehicle",
        &[
            "config/vehicles/j8.yaml",
            "config/vehicles/lazaro.yaml",
            "config/vehicles/j8_contact_identified.yaml",
        ],
    ),
    (
        "contact_vehicle",
        "contact-vehicle",
        &[
            "config/vehicles/j8_contact.yaml",
            "config/vehicles/j8_loaded_contact.yaml",
        ],
    ),
    (
        "scenario",
        "scenario",
        &[
            "config/scenarios/across_slope.yaml",
            "config/scenarios/figure_eight.yaml",
            "config/scenarios/figure_eight_10deg.yaml",
            "config/scenarios/figure_eight_15deg.yaml",
            "config/scenarios/j8_route.yaml",
            "config/scenarios/paper_1_pivot.yaml",
            "config/scenarios/paper_3_zones.yaml",
            "config/scenarios/reverse_cusp.yaml",
            "config/scenarios/slalom.yaml",
            "config/scenarios/start_off_path.yaml",
            "config/scenarios/steep_ground.yaml",
        ],
    ),
    (
        "conditions",
        "conditions",
        &["config/conditions/realistic.yaml"],
    ),
    (
        "campaign",
        "campaign",
        &[
            "config/campaigns/default.yaml",
            "config/campaigns/first_day.yaml",
            "config/campaigns/guard.yaml",
            "config/campaigns/vehicles.yaml",
        ],
    ),
    ("columns", "column-map", &[]),
    ("topics", "topic-map", &["tests/data/bags/topics.yaml"]),
    (
        "odometry_node",
        "odometry-node",
        &["config/bridge/odometry_ros2.yaml"],
    ),
    (
        "run",
        "run",
        &[
            "config/bridge/run_can_ros2.yaml",
            "config/bridge/run_ros2.yaml",
            "config/bridge/run_vcan0.yaml",
        ],
    ),
    (
        "virtual_rover",
        "virtual-rover",
        &[
            "config/bridge/vehicle_ros2.yaml",
            "config/bridge/vehicle_vcan0.yaml",
        ],
    ),
    (
        "can",
        "can-layout",
        &["config/bridge/can.yaml", "config/bridge/cia402.yaml"],
    ),
];

fn path(kind: &str) -> PathBuf {
    repository(&format!("docs/schema/{kind}.json"))
}

fn yaml(file: &PathBuf) -> Value {
    serde_yaml::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
}

#[test]
fn schemas_are_made_from_the_reference_of_all_keys() {
    let update = std::env::var_os("UPDATE_DOCS").is_some();
    for (kind, anchor, _) in KINDS {
        let made = serde_json::to_string_pretty(&schema(anchor)).unwrap() + "\n";
        if update {
            std::fs::create_dir_all(path(kind).parent().unwrap()).unwrap();
            std::fs::write(path(kind), &made).unwrap();
        }
        let kept = std::fs::read_to_string(path(kind)).unwrap_or_default();
        assert!(
            kept == made,
            "docs/schema/{kind}.json: make it anew with UPDATE_DOCS=1 cargo test --test program schema"
        );
    }
}

#[test]
fn all_files_fit_their_schema_and_none_with_an_unknown_key_does() {
    for (kind, anchor, files) in KINDS {
        let schema = schema(anchor);
        let mut files: Vec<PathBuf> = files.iter().map(|file| repository(file)).collect();
        if kind == "columns" {
            files.extend(
                ["drive", "norlab", "trento_ramps", "warthog_grass"]
                    .map(|data| repository(&format!("plant/tests/data/{data}/columns.yaml"))),
            );
        }
        assert!(!files.is_empty(), "{kind}");
        for file in files {
            let value = yaml(&file);
            assert_eq!(
                misfit(&schema, &schema, &value, kind),
                None,
                "{}",
                file.display()
            );
            let head = std::fs::read_to_string(&file).unwrap();
            let line = head.lines().next().unwrap().to_owned();
            if file.starts_with(repository("config")) {
                assert_eq!(
                    line,
                    format!("# yaml-language-server: $schema=../../docs/schema/{kind}.json"),
                    "{}",
                    file.display()
                );
            }
            // An unknown key in any section.
            let mut sections = 0;
            for path in objects(&value, String::new()) {
                let mut changed = value.clone();
                changed.pointer_mut(&path).unwrap()["zzz"] = json!(1);
                // Sections without fixed keys: keys of a scenario in a campaign.
                if path.starts_with("/with") || path.contains("/one_of") {
                    continue;
                }
                sections += 1;
                let said = misfit(&schema, &schema, &changed, kind);
                assert!(
                    said.is_some_and(|said| said.contains("zzz")),
                    "{}: zzz in {path:?}",
                    file.display()
                );
            }
            assert!(sections > 0);
        }
    }
}

/// Returns pointers to all objects in a value.
fn objects(value: &Value, at: String) -> Vec<String> {
    match value {
        Value::Object(fields) => {
            let below = fields.iter().flat_map(|(key, value)| {
                objects(
                    value,
                    format!("{at}/{}", key.replace('~', "~0").replace('/', "~1")),
                )
            });
            let mut all: Vec<String> = below.collect();
            all.push(at);
            all
        }
        Value::Array(items) => items
            .iter()
            .enumerate()
            .flat_map(|(i, value)| objects(value, format!("{at}/{i}")))
            .collect(),
        _ => Vec::new(),
    }
}

#[test]
fn wrong_values_do_not_fit() {
    let schema = schema("scenario");
    let good = yaml(&repository("config/scenarios/slalom.yaml"));
    for (pointer, value, says) in [
        ("/terrain/slope_deg", json!(95), "95"),
        ("/terrain/slope_deg", json!("steep"), "steep"),
        ("/terrain/kind", json!("hill"), "hill"),
        ("/plant", json!("icrick"), "icrick"),
        ("/vehicle", json!(5), "5 is no"),
        ("/controllers", json!("icrik-mpc"), "is no"),
    ] {
        let mut changed = good.clone();
        *changed.pointer_mut(pointer).unwrap() = value;
        let said = misfit(&schema, &schema, &changed, "").unwrap_or_default();
        assert!(said.contains(says), "{pointer}: {said}");
    }
}

#[test]
fn init_writes_the_schemas_that_its_files_name() {
    for port in ["ros2", "can"] {
        let folder = tempfile::tempdir().unwrap();
        let set = folder.path().join("set");
        crate::succeed(
            crate::sidehill()
                .args(["init", "--vehicle", "j8", "--port", port])
                .arg(&set),
        );
        let mut files = 0;
        for entry in set.read_dir().unwrap() {
            let file = entry.unwrap().path();
            if file.extension().is_none_or(|ending| ending != "yaml") {
                continue;
            }
            let text = std::fs::read_to_string(&file).unwrap();
            let named = text
                .lines()
                .next()
                .unwrap()
                .strip_prefix("# yaml-language-server: $schema=")
                .unwrap_or_else(|| panic!("{}", file.display()))
                .to_owned();
            let schema =
                serde_json::from_str(&std::fs::read_to_string(set.join(named)).unwrap()).unwrap();
            assert_eq!(
                misfit(&schema, &schema, &yaml(&file), ""),
                None,
                "{}",
                file.display()
            );
            assert_eq!(text.matches("yaml-language-server").count(), 1);
            files += 1;
        }
        assert!(files >= 6, "{files}");
    }
}
