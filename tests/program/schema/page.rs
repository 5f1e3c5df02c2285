//! The tables of docs/configuration.md.

use crate::text;

/// A section of the page.
pub(super) struct Section {
    pub(super) level: usize,
    pub(super) title: String,
    pub(super) anchor: String,
    /// Key and values that choose it among its siblings, as in "`kind: plane`".
    pub(super) tag: Option<(String, Vec<String>)>,
    pub(super) rows: Vec<Row>,
}

pub(super) struct Row {
    pub(super) key: String,
    pub(super) kind: String,
    pub(super) required: bool,
    pub(super) range: String,
    pub(super) meaning: String,
}

pub(super) fn sections() -> Vec<Section> {
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
pub(super) fn links(text: &str) -> (Vec<String>, String) {
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
