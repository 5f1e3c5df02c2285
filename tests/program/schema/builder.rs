//! From the tables of the page to JSON schemas.

use super::page::{Row, Section, links, sections};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;

/// Builds schemas of sections and records the sections they refer to.
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
        // A link in the explanation does not define a section.
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
            // Some kinds have a value, given by a YAML tag.
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

/// Returns the schema of the files that the section with this anchor describes.
pub(super) fn schema(anchor: &str) -> Value {
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
