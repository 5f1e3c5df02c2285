//! A configuration file without the keys that no longer exist.
//!
//! The text is edited at the places of the keys, so comments, order and layout of all else stay.

use super::file::{ConfigError, ConfigFile};
use super::keys::{KeyPlace, Keys};
use super::removed::{Removed, removed, removed_draws};
use serde_yaml::Value;
use std::ops::Range;

/// What a file becomes without the keys that no longer exist.
#[derive(Debug, Clone)]
pub struct Migration {
    /// The new text; the file's own where nothing is removed.
    pub text: String,
    /// A line for each key that is removed: its place, its name, the version that removed it and why.
    pub removed: Vec<String>,
    /// Likewise for each row of `draws` that draws such a key: the row stays, as what to draw instead is the user's choice.
    pub by_hand: Vec<String>,
}

impl Migration {
    /// Returns what becomes of a file.
    ///
    /// # Errors
    /// [`ConfigError::Content`], if it is no YAML, or if its layout does not allow to take out these keys and nothing else.
    pub fn of(file: &ConfigFile) -> Result<Self, ConfigError> {
        let mut expected: Value = file.parse()?;
        let keys = Keys::of(file.text());
        let mut lines = Vec::new();
        for Removed {
            place,
            version,
            reason,
        } in removed(&keys)
        {
            take_out(&mut expected, &place.path);
            let key = place.path.join(".");
            lines.push(format!(
                "line {}: - {key}, removed in {version}: {reason}",
                place.line
            ));
        }
        let by_hand = removed_draws(&keys).map(|removed| {
            let key = removed.place.value.as_deref().unwrap_or_default();
            format!(
                "line {}: draws {key}, removed in {}: {}; take the row out by hand",
                removed.place.line, removed.version, removed.reason
            )
        });
        let by_hand = by_hand.collect();
        let mut text = file.text().to_owned();
        // Each moves the places of those after it.
        for _ in &lines {
            let keys = Keys::of(&text);
            if let Some(key) = removed(&keys).next() {
                text = without(&text, &keys, key.place);
            }
        }
        let is_right =
            |text: &str| serde_yaml::from_str::<Value>(text).is_ok_and(|found| found == expected);
        if !(keys.complete && is_right(&text)) {
            return Err(file.error(format!(
                "its layout does not allow to take keys out; do it by hand: {}",
                lines.join("; ")
            )));
        }
        Ok(Self {
            text,
            removed: lines,
            by_hand,
        })
    }
}

/// Removes a key, named with its parents.
fn take_out(value: &mut Value, path: &[String]) {
    if let Some((name, parents)) = path.split_last()
        && let Some(Value::Mapping(section)) = parents
            .iter()
            .try_fold(value, |value, parent| value.get_mut(parent))
    {
        section.remove(name);
    }
}

/// Returns the text without a key and its value.
fn without(text: &str, keys: &Keys, place: &KeyPlace) -> String {
    let mut characters: Vec<char> = text.chars().collect();
    if place.in_braces {
        characters.drain(among_commas(&characters, &place.span));
        return characters.into_iter().collect();
    }
    characters.drain(whole_lines(&characters, &place.span));
    // A section without keys would have no value, and be off.
    let parents = &place.path[..place.path.len() - 1];
    let is_beside =
        |other: &&KeyPlace| other.path.len() == place.path.len() && other.path.starts_with(parents);
    if keys.keys.iter().filter(is_beside).count() == 1
        && let Some(section) = keys.keys.iter().find(|key| key.path == parents)
        && let Some(colon) = characters[section.name_end..]
            .iter()
            .position(|c| *c == ':')
    {
        let after = section.name_end + colon + 1;
        characters.splice(after..after, " {}".chars());
    }
    characters.into_iter().collect()
}

/// Returns the range of an entry between braces, with one of the commas that part it from others.
fn among_commas(characters: &[char], entry: &Range<usize>) -> Range<usize> {
    let spaces = |from: usize| {
        let rest = &characters[from..];
        from + rest.iter().take_while(|c| c.is_whitespace()).count()
    };
    let at = |place: usize| characters.get(place).copied();
    // A key without a value ends before its colon.
    let colon = spaces(entry.end);
    let end = match at(colon) {
        Some(':') => colon + 1,
        _ => entry.end,
    };
    let next = spaces(end);
    if at(next) == Some(',') {
        return entry.start..spaces(next + 1);
    }
    let before = characters[..entry.start]
        .iter()
        .rposition(|c| !c.is_whitespace());
    match before.filter(|before| characters[*before] == ',') {
        Some(comma) => comma..end,
        None => entry.start..end,
    }
}

/// Returns the range of the lines of an entry.
fn whole_lines(characters: &[char], entry: &Range<usize>) -> Range<usize> {
    let is_end = |c: &char| *c == '\n';
    let start = characters[..entry.start].iter().rposition(is_end);
    // A text in several lines ends with the last of them.
    let last = entry.end.saturating_sub(1).max(entry.start);
    let end = characters[last..].iter().position(is_end);
    start.map_or(0, |end| end + 1)..end.map_or(characters.len(), |end| last + end + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::path::Path;

    fn migration(text: &str) -> Result<Migration, ConfigError> {
        Migration::of(&ConfigFile::with_text(Path::new("a.yaml"), text.to_owned()))
    }

    #[test]
    fn only_the_key_goes_whatever_the_ends_of_lines_and_the_place() {
        for (before, after) in [
            (
                "settings:\r\n  stages: 9 # ü\r\n  lead_max_m: 1 # ü\r\n",
                "settings:\r\n  stages: 9 # ü\r\n",
            ),
            ("settings: {lead_max_m: 1}", "settings: {}"),
            (
                "settings: {lead_max_m: , stages: 9}",
                "settings: {stages: 9}",
            ),
            ("settings:\n  lead_max_m: 1", "settings: {}\n"),
            (
                "settings:\n  # c\n  lead_max_m:\n\n  stages: 9\n",
                "settings:\n  # c\n\n  stages: 9\n",
            ),
            (
                "settings:\n  guard: # why\n    stop_before_m: 1\nport: can\n",
                "settings:\n  guard: {} # why\nport: can\n",
            ),
            ("other: {lead_max_m: 1}\n", "other: {lead_max_m: 1}\n"),
        ] {
            assert_eq!(migration(before).unwrap().text, after, "{before}");
        }
    }

    #[test]
    fn a_row_of_a_campaign_that_draws_a_removed_key_is_named_and_stays() {
        let text = "with: {controller: {lead_max_m: 1}}\ndraws:\n  - {key: controller.lead_max_m, one_of: [1]}\n  - key: \
                    controller.contact.step_limit\n    one_of: [1]\n  - {key: friction.minimum, one_of: [lead_max_m]}\n";
        let migration = migration(text).unwrap();
        assert_eq!(migration.removed.len(), 1);
        assert_eq!(migration.text, text.replace("lead_max_m: 1", ""));
        let [first, second] = &migration.by_hand[..] else {
            panic!("{:?}", migration.by_hand);
        };
        assert!(
            first.starts_with("line 3: draws controller.lead_max_m, removed in 0.2.0"),
            "{first}"
        );
        assert!(
            second.starts_with("line 4: draws controller.contact.step_limit"),
            "{second}"
        );
    }

    proptest! {
        #[test]
        fn a_damaged_file_keeps_its_other_keys_or_is_refused(
            at in any::<prop::sample::Index>(),
            length in 0..24_usize,
            put in "[ -~\n\u{e4}]{0,6}",
        ) {
            let old = "settings:\n  lead_max_m: 1 # \u{e4}\n  stages: 9\n  guard:\n    look_ahead_s: 9\n  memory: {cell_m: 1,\n    \
                       kept_share: 1}\n  solver:\n    mode: a\nport: can\n";
            let mut text: Vec<char> = old.chars().collect();
            let begin = at.index(text.len());
            let end = (begin + length).min(text.len());
            text.splice(begin..end, put.chars());
            if let Ok(once) = migration(&text.into_iter().collect::<String>()) {
                let twice = migration(&once.text).unwrap();
                prop_assert!(twice.removed.is_empty() && twice.text == once.text, "{once:?}\n{twice:?}");
            }
        }
    }
}
