//! The tables of docs/configuration.md, and what the program says about their keys.

use crate::{repository, text};
use serde_yaml::{Mapping, Value};
use sidehill::check::check;
use sidehill::config::ConfigFile;
use sidehill_plant::log::ColumnMap;

pub(super) const PAGE: &str = "docs/configuration.md";

pub(super) const UNKNOWN: &str = "zzz";

/// A table of the page.
pub(super) struct Table {
    pub(super) file: String,
    pub(super) path: Vec<String>,
    /// The struct or variant that holds the keys.
    pub(super) holder: String,
    pub(super) content: Value,
    pub(super) rows: Vec<Row>,
}

/// A row: the cells that are compared.
pub(super) struct Row {
    pub(super) line: String,
    pub(super) key: String,
    pub(super) kind: String,
    pub(super) default: String,
    pub(super) unit: String,
    pub(super) range: String,
    pub(super) meaning: String,
}

impl Row {
    /// Returns a row of a key that the page lacks; all but whether it is required remains to be filled in.
    pub(super) fn new(table: &Table, key: &str) -> Self {
        let content = without(table.content.clone(), &table.at(key));
        let complaint = table.complaint_about(content).unwrap_or_default();
        let missing = complaint.contains(&format!("missing field `{key}`"));
        let default = if missing { "required" } else { "none" };
        Self {
            line: format!("| `{key}` |  | {default} |  |  |  |"),
            key: key.to_owned(),
            kind: String::new(),
            default: default.to_owned(),
            unit: String::new(),
            range: String::new(),
            meaning: String::new(),
        }
    }
}

/// Returns the tables of the page that name their keys' origin.
pub(super) fn tables() -> Vec<Table> {
    let page = text(PAGE);
    page.split("<!-- keys: ")
        .skip(1)
        .map(|part| {
            let (origin, rest) = part.split_once(" -->").unwrap();
            let mut withs = origin.split(" with ");
            let (place, holder) = withs.next().unwrap().split_once(" of ").unwrap();
            let (file, path) = place.split_once(' ').unwrap();
            let mut content = match file {
                "columns.yaml" => text("plant/tests/data/trento_ramps/columns.yaml"),
                "topics.yaml" => text("tests/data/bags/topics.yaml"),
                file => text(&format!("config/{file}")),
            };
            for with in withs {
                let (key, value) = with.split_once('=').unwrap();
                let value = serde_yaml::from_str(value).unwrap();
                let whole = serde_yaml::from_str(&content).unwrap();
                content = serde_yaml::to_string(&put(whole, &keys(key), value)).unwrap();
            }
            let rows = rest
                .lines()
                .skip_while(|line| !line.starts_with("|---"))
                .skip(1)
                .take_while(|line| line.starts_with('|'))
                .map(|line| {
                    let cells: Vec<&str> = line.split('|').map(str::trim).collect();
                    Row {
                        line: line.into(),
                        key: cells[1].trim_matches('`').into(),
                        kind: cells[2].into(),
                        default: cells[3].into(),
                        unit: cells[4].into(),
                        range: cells[5].into(),
                        meaning: cells[6].into(),
                    }
                })
                .collect();
            Table {
                file: file.into(),
                path: keys(path),
                holder: holder.into(),
                content: serde_yaml::from_str(&content).unwrap(),
                rows,
            }
        })
        .collect()
}

pub(super) fn keys(path: &str) -> Vec<String> {
    let names = path.split('.').filter(|name| *name != "/");
    names.map(str::to_owned).collect()
}

/// Returns the content with a value at a path; missing sections are added.
fn put(mut content: Value, path: &[String], value: Value) -> Value {
    let mut at = &mut content;
    for key in path {
        at = match key.parse::<usize>() {
            Ok(index) => &mut at.as_sequence_mut().unwrap()[index],
            Err(_) => {
                if !at.is_mapping() {
                    *at = Value::Mapping(Mapping::new());
                }
                let section = at.as_mapping_mut().unwrap();
                section.entry(key.as_str().into()).or_insert(Value::Null)
            }
        };
    }
    *at = value;
    content
}

/// Returns the content without the key at a path, if it has it.
pub(super) fn without(mut content: Value, path: &[String]) -> Value {
    let mut at = &mut content;
    let (last, sections) = path.split_last().unwrap();
    for key in sections {
        let next = match key.parse::<usize>() {
            Ok(index) => at.as_sequence_mut().and_then(|list| list.get_mut(index)),
            Err(_) => at
                .as_mapping_mut()
                .and_then(|section| section.get_mut(key.as_str())),
        };
        match next {
            Some(next) => at = next,
            None => return content,
        }
    }
    if let Some(section) = at.as_mapping_mut() {
        section.remove(last.as_str());
    }
    content
}

impl Table {
    /// Returns what the program says about the file with `value` at a key of this table, or nothing if it accepts it.
    pub(super) fn complaint(&self, key: &str, value: impl Into<Value>) -> Option<String> {
        self.complaint_about(put(self.content.clone(), &self.at(key), value.into()))
    }

    pub(super) fn complaint_about(&self, content: Value) -> Option<String> {
        if self.file == "columns.yaml" {
            let map = serde_yaml::to_string(&content).unwrap();
            let map = serde_yaml::from_str::<ColumnMap>(&map);
            return map.err().map(|error| error.to_string());
        }
        let path = repository("config").join(&self.file);
        let content = serde_yaml::to_string(&content).unwrap();
        let checked = check(ConfigFile::with_text(&path, content));
        checked.err().map(|error| format!("{error:#}"))
    }

    pub(super) fn at(&self, key: &str) -> Vec<String> {
        let mut path = self.path.clone();
        path.push(key.to_owned());
        path
    }

    pub(super) fn name(&self) -> String {
        format!("{PAGE}, {} of {}", self.path.join("."), self.file)
    }
}

/// Returns the words in backticks after the last `expected`.
pub(super) fn expected(complaint: &str) -> Vec<String> {
    let (_, list) = complaint.rsplit_once("expected ").unwrap();
    let names = list.split('`').skip(1).step_by(2);
    names.map(str::to_owned).collect()
}
