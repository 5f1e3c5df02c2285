//! docs/schema/*.json: JSON schemas of all files for editors, made from the tables of docs/configuration.md, which
//! `configuration.rs` checks against the program.
//!
//! With the environment variable `UPDATE_DOCS` set, the schemas are written anew.

use crate::{repository, text};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Schemas with the anchor of their section in the page, and the files of the repository that they are for.
const KINDS: [(&str, &str, &[&str]); 9] = [
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
            "config/campaigns/guard.yaml",
            "config/campaigns/vehicles.yaml",
        ],
    ),
    ("columns", "column-map", &[]),
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

/// A section of the page.
struct Section {
    level: usize,
    title: String,
    anchor: String,
    /// Key and values that choose it among its siblings, as in "`kind: plane`".
    tag: Option<(String, Vec<String>)>,
    rows: Vec<Row>,
}

struct Row {
    key: String,
    kind: String,
    required: bool,
    range: String,
    meaning: String,
}

fn sections() -> Vec<Section> {
    let mut found: Vec<Section> = Vec::new();
    for line in text("docs/configuration.md").lines() {
        if let Some((marks, title)) = line
            .split_once("# ")
            .filter(|(marks, _)| marks.chars().all(|c| c == '#'))
        {
            let anchor = title.to_lowercase().replace(' ', "-");
            found.push(Section {
                level: marks.len(),
                title: title.to_owned(),
                anchor: anchor
                    .chars()
                    .filter(|c| c.is_alphanumeric() || *c == '-')
                    .collect(),
                tag: None,
                rows: Vec::new(),
            });
            continue;
        }
        let Some(section) = found.last_mut() else {
            continue;
        };
        for name in ["kind", "shape"] {
            let values: Vec<String> = line
                .split(&format!("`{name}: "))
                .skip(1)
                .filter_map(|rest| Some(rest.split_once('`')?.0.to_owned()))
                .collect();
            if line.starts_with(&format!("`{name}: ")) {
                section.tag = Some((name.to_owned(), values));
            }
        }
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if let [_, key, kind, default, unit, range, meaning, _] = cells[..]
            && key.starts_with('`')
        {
            let unit = if unit.is_empty() {
                String::new()
            } else {
                format!(" In {unit}.")
            };
            section.rows.push(Row {
                key: key.trim_matches('`').to_owned(),
                kind: kind.to_owned(),
                required: default == "required",
                range: range.to_owned(),
                meaning: format!("{meaning}{unit}"),
            });
        }
    }
    found
}

/// Returns the anchors of a text's links within the page, and the text without them.
fn links(text: &str) -> (Vec<String>, String) {
    let (mut anchors, mut plain) = (Vec::new(), String::new());
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('[') {
        let Some(((label, target), end)) = after.split_once("](").and_then(|(label, rest)| {
            rest.split_once(')')
                .map(|(target, end)| ((label, target), end))
        }) else {
            break;
        };
        anchors.extend(target.strip_prefix('#').map(str::to_owned));
        plain += &format!("{before}{label}");
        rest = end;
    }
    (anchors, plain + rest)
}

/// Makes schemas of sections and notes which sections they refer to.
struct Builder<'a> {
    sections: &'a [Section],
    needed: BTreeSet<String>,
}

impl Builder<'_> {
    fn reference(&mut self, anchor: &str) -> Value {
        self.needed.insert(anchor.to_owned());
        json!({ "$ref": format!("#/definitions/{anchor}") })
    }

    /// Returns the schema of the section with this anchor: its own keys, or those of any of the sections that its
    /// `kind` chooses.
    fn definition(&mut self, anchor: &str) -> Value {
        let at = self
            .sections
            .iter()
            .position(|s| s.anchor == anchor)
            .unwrap_or_else(|| panic!("no section {anchor}"));
        let section = &self.sections[at];
        if section.rows.is_empty() {
            let below = self.sections[at + 1..]
                .iter()
                .take_while(|s| s.level > section.level);
            let variants: Vec<String> = below
                .filter(|s| s.tag.is_some())
                .map(|s| s.anchor.clone())
                .collect();
            if !variants.is_empty() {
                let variants: Vec<Value> = variants
                    .iter()
                    .map(|anchor| self.reference(anchor))
                    .collect();
                return json!({ "title": section.title, "anyOf": variants });
            }
        }
        let mut properties = Map::new();
        let mut required: Vec<&str> = Vec::new();
        if let Some((key, values)) = &section.tag {
            properties.insert(key.clone(), json!({ "enum": values }));
            required.push(key);
        }
        for row in &section.rows {
            let value = self.property(anchor, row);
            properties.insert(row.key.clone(), value);
            if row.required {
                required.push(&row.key);
            }
        }
        json!({
            "title": section.title,
            "type": "object",
            "properties": properties,
            "required": required,
            "additionalProperties": false,
        })
    }

    fn property(&mut self, anchor: &str, row: &Row) -> Value {
        let (anchors, meaning) = links(&row.meaning);
        // A link that only explains does not make a section.
        let anchors: Vec<String> = anchors
            .into_iter()
            .filter(|a| self.sections.iter().any(|s| s.anchor == *a))
            .collect();
        let mut section = || -> Value {
            let references: Vec<Value> = anchors
                .iter()
                .map(|anchor| self.reference(anchor))
                .collect();
            match references.len() {
                0 => json!({}),
                _ => json!({ "anyOf": references }),
            }
        };
        let mut value = match row.kind.as_str() {
            "number" => json!({ "type": "number" }),
            "integer" => json!({ "type": "integer" }),
            "boolean" => json!({ "type": "boolean" }),
            "text" | "file" => json!({ "type": "string" }),
            "section" => {
                let mut value = section();
                if value == json!({}) {
                    value["type"] = json!("object");
                }
                value
            }
            "list" => {
                let items = section();
                json!({ "type": "array", "items": items })
            }
            // Some of its kinds have a value, by a tag of YAML.
            _ if anchor == "fault-on-ros-2" && row.key == "fault" => json!({}),
            kind => {
                let values: Vec<&str> = kind
                    .strip_prefix("one of ")
                    .unwrap_or_else(|| panic!("{anchor}: {kind}"))
                    .split('`')
                    .skip(1)
                    .step_by(2)
                    .collect();
                json!({ "enum": values })
            }
        };
        // A range that depends on other keys is left to the program.
        if let Some((from, to)) = row
            .range
            .strip_prefix("from ")
            .and_then(|range| range.split_once(" to "))
            && !row.range.contains('(')
        {
            let number = |text: &str| text.split(' ').next().and_then(|n| n.parse::<f64>().ok());
            if let (Some(from), Some(to)) = (number(from), number(to)) {
                value["minimum"] = json!(from);
                value["maximum"] = json!(to);
            }
        }
        value["description"] = json!(meaning);
        value
    }
}

fn schema(anchor: &str) -> Value {
    let sections = sections();
    let mut builder = Builder {
        sections: &sections,
        needed: BTreeSet::new(),
    };
    let mut whole = builder.definition(anchor);
    let mut definitions: Map<String, Value> = Map::new();
    while let Some(next) = builder
        .needed
        .iter()
        .find(|anchor| !definitions.contains_key(*anchor))
        .cloned()
    {
        let definition = builder.definition(&next);
        definitions.insert(next, definition);
    }
    whole["$schema"] = json!("http://json-schema.org/draft-07/schema#");
    whole["definitions"] = Value::Object(definitions);
    whole
}

fn path(kind: &str) -> PathBuf {
    repository(&format!("docs/schema/{kind}.json"))
}

/// Returns why a value does not fit a schema, if it does not; knows what the schemas here use.
fn misfit(root: &Value, schema: &Value, value: &Value, at: &str) -> Option<String> {
    for (keyword, rule) in schema.as_object().unwrap() {
        let misfit = match keyword.as_str() {
            "$schema" | "title" | "description" | "definitions" => None,
            "$ref" => {
                let name = rule.as_str().unwrap().strip_prefix("#").unwrap();
                misfit(root, root.pointer(name).unwrap(), value, at)
            }
            "anyOf" => {
                let tried: Vec<_> = rule
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|schema| misfit(root, schema, value, at))
                    .collect();
                tried
                    .iter()
                    .all(Option::is_some)
                    .then(|| format!("{at}: {tried:?}"))
            }
            "type" => {
                let fits = match rule.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "boolean" => value.is_boolean(),
                    "number" => value.is_number(),
                    "integer" => value.is_i64() || value.is_u64(),
                    other => panic!("type {other}"),
                };
                (!fits).then(|| format!("{at}: {value} is no {rule}"))
            }
            "enum" => (!rule.as_array().unwrap().contains(value))
                .then(|| format!("{at}: {value} is not in {rule}")),
            "minimum" => value
                .as_f64()
                .filter(|n| *n < rule.as_f64().unwrap())
                .map(|n| format!("{at}: {n} < {rule}")),
            "maximum" => value
                .as_f64()
                .filter(|n| *n > rule.as_f64().unwrap())
                .map(|n| format!("{at}: {n} > {rule}")),
            "items" => value.as_array().and_then(|items| {
                items
                    .iter()
                    .enumerate()
                    .find_map(|(i, item)| misfit(root, rule, item, &format!("{at}.{i}")))
            }),
            "properties" => value.as_object().and_then(|value| {
                value.iter().find_map(|(key, value)| {
                    misfit(root, rule.get(key)?, value, &format!("{at}.{key}"))
                })
            }),
            "required" => {
                let keys = rule.as_array().unwrap().iter();
                keys.filter(|key| value.get(key.as_str().unwrap()).is_none())
                    .map(|key| format!("{at}: {key} is missing"))
                    .next()
            }
            "additionalProperties" => value.as_object().and_then(|value| {
                let known = schema["properties"].as_object().unwrap();
                value
                    .keys()
                    .find(|key| !known.contains_key(*key))
                    .map(|key| format!("{at}: {key} is not known"))
            }),
            other => panic!("keyword {other}"),
        };
        if misfit.is_some() {
            return misfit;
        }
    }
    None
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
                ["drive", "trento_ramps", "warthog_grass"]
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
                // What holds anything: keys of a scenario in a campaign.
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
