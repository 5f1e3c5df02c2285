//! Hints about likely mistakes, where the parser's message says little.

use super::keys::Keys;
use crate::foreign::{foreign, not_utf8};
use sidehill_plant::number::likely_mistake;

/// Keys by which a kind of file is known.
const KINDS: [(&str, &str); 9] = [
    ("draws", "a campaign"),
    ("controllers", "a scenario"),
    ("x_icr_left_m", "a vehicle"),
    ("axles", "a contact vehicle"),
    ("tread_speed_left", "a column map"),
    ("database", "the layout of a CAN bus"),
    ("controller", "a configuration of run"),
    ("scenario", "a configuration of vehicle"),
    ("port", "a configuration of run"),
];

/// Returns the text of an XML file in the encoding that its first bytes or its declaration name, or else UTF-8.
pub(crate) fn decoded_xml(bytes: &[u8]) -> Result<String, String> {
    /// A declaration ends within this many bytes.
    const DECLARATION: usize = 200;
    if let Some((encoding, _)) = encoding_rs::Encoding::for_bom(bytes) {
        return decoded(encoding, bytes);
    }
    if let Some(reason) = foreign(bytes) {
        return Err(reason);
    }
    let start = String::from_utf8_lossy(&bytes[..bytes.len().min(DECLARATION)]);
    let declared = start
        .split_once("?>")
        .filter(|(declaration, _)| declaration.trim_start().starts_with("<?xml"))
        .and_then(|(declaration, _)| declaration.split_once("encoding"))
        .and_then(|(_, rest)| rest.split(['"', '\'']).nth(1));
    let encoding = match declared {
        Some(name) => encoding_rs::Encoding::for_label(name.as_bytes())
            .ok_or_else(|| format!("line 1: the encoding {name} is not known; save it as UTF-8"))?,
        None => encoding_rs::UTF_8,
    };
    decoded(encoding, bytes)
}

fn decoded(encoding: &'static encoding_rs::Encoding, bytes: &[u8]) -> Result<String, String> {
    let (text, _, faulty) = encoding.decode(bytes);
    if faulty {
        let reason = match std::str::from_utf8(bytes) {
            Err(error) if encoding == encoding_rs::UTF_8 => not_utf8(bytes, error),
            _ => format!(
                "line 1: is not {} text, as it says; save it as UTF-8",
                encoding.name()
            ),
        };
        return Err(format!(
            "{reason}, or declare its encoding in the first line, as in <?xml version=\"1.0\" \
             encoding=\"windows-1252\"?>"
        ));
    }
    Ok(text.into_owned())
}

/// Returns which key has the value that a message quotes, where the message does not name the key.
pub(super) fn key_of_value(keys: &Keys, message: &str) -> Option<String> {
    let (_, rest) = message.split_once("invalid type: ")?;
    let (found, _) = rest.split_once(", expected")?;
    let value = match found.split_once('"') {
        Some((_, quoted)) => quoted.trim_end_matches('"'),
        None => found.split('`').nth(1)?,
    };
    let section = keys_named(message);
    let (key, line) = keys.with_value(&section, value)?;
    (section.last() != Some(&key)).then(|| format!("; it is the value of `{key}` (line {line})"))
}

/// Keys that conditions may have.
const CONDITIONS: [&str; 6] = [
    "name",
    "plant",
    "friction",
    "drive_train",
    "sensors",
    "controller",
];

/// Returns what is likely wrong, for messages of the YAML parser that say little.
pub(super) fn syntax_hint(message: &str) -> Option<String> {
    let hint = if message.contains("more than one document") {
        "; remove the line `---` between them and what follows it"
    } else if message.contains("unknown field `<<`") {
        "; merge keys are not read, write out the keys that it stands for"
    } else if message.contains("expected field index") {
        "; a number stands in place of a key: is a comma meant as decimal sign? Decimals are written with a point"
    } else if message.contains("mapping values are not allowed") {
        "; is the line indented too far, or does a text with a colon need quotes?"
    } else if message.contains("could not find expected ':'") {
        "; is there a space after the colon of its key?"
    } else if message.contains("there are no fields") {
        ": this kind has no further keys"
    } else {
        return None;
    };
    Some(hint.to_owned())
}

/// Returns what is likely wrong with a value that is of another type than a message expects.
pub(super) fn type_hint(message: &str) -> &'static str {
    let Some((_, rest)) = message.split_once("invalid type: ") else {
        return "";
    };
    let Some((found, expected)) = rest.split_once(", expected ") else {
        return "";
    };
    let numbers = [
        "f64", "f32", "u64", "u32", "u16", "u8", "usize", "i64", "i32",
    ];
    if found == "unit value" {
        "; the key has no value"
    } else if expected.starts_with("a boolean") {
        "; write true or false"
    } else if numbers.iter().any(|number| expected.starts_with(number)) {
        found.split('"').nth(1).map_or("", likely_mistake)
    } else {
        ""
    }
}

/// Returns the line, counted from 1, of the first character that YAML does not allow.
pub(super) fn control_character(text: &str) -> Option<usize> {
    let forbidden = |c: char| c.is_control() && !matches!(c, '\n' | '\r' | '\t' | '\u{85}');
    let line = text.split('\n').position(|line| line.contains(forbidden));
    line.map(|index| index + 1)
}

/// Returns which other kind of file a text looks like, if it has the key by which that kind is known and the
/// message does not expect that key.
pub(super) fn other_kind(text: &str, message: &str) -> Option<String> {
    if !message.contains(" field `") {
        return None;
    }
    let keys: serde_yaml::Mapping = serde_yaml::from_str(text).ok()?;
    let conditions =
        |key: &serde_yaml::Value| key.as_str().is_some_and(|key| CONDITIONS.contains(&key));
    if message.contains("missing field") && keys.keys().all(conditions) {
        return Some(
            "; the file looks like conditions, as `tune` writes them: use it with `sidehill simulate SCENARIO \
             --conditions FILE`"
                .to_owned(),
        );
    }
    let (_, expected) = message.split_once("expected ")?;
    let (_, kind) = KINDS
        .iter()
        .find(|(key, _)| keys.contains_key(*key) && !expected.contains(&format!("`{key}`")))?;
    // An unknown key that is not at the top level is a mistake within a section.
    let unknown = message.split('`').nth(1)?;
    keys.contains_key(unknown)
        .then(|| format!("; the file looks like {kind}"))
}

/// Returns the line, counted from 1, of the first tab that indents a line up to `last`.
pub(super) fn indented_by_tab(text: &str, last: usize) -> Option<usize> {
    text.lines()
        .take(last + 1)
        .position(|line| line.trim_start_matches(' ').starts_with('\t'))
        .map(|index| index + 1)
}

/// Returns the keys at the start of a message (`terrain.slope_deg: 95: must be ...`), followed by the one that it
/// quotes as unknown (`terrain: unknown field `slope_rad`, ...`).
pub(super) fn keys_named(message: &str) -> Vec<&str> {
    let is_key = |text: &str| {
        !text.is_empty()
            && text
                .chars()
                .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
    };
    let mut keys = Vec::new();
    for part in message.split(": ") {
        // Items of lists are written `zones[1]`.
        let names: Vec<&str> = part
            .split('.')
            .map(|name| name.split('[').next().unwrap_or(name))
            .collect();
        if !names.iter().all(|name| is_key(name)) {
            break;
        }
        keys.extend(names);
    }
    let unknown = message
        .split_once("unknown field `")
        .and_then(|(_, rest)| rest.split('`').next());
    keys.extend(unknown);
    keys
}
