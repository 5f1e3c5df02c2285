//! Lines of the keys of a YAML text, for error messages.
//!
//! serde_yaml knows the line of most errors, but neither in a section that depends on its `kind` nor for range
//! checks after parsing. This index knows the line of every key.

use saphyr_parser::{Event, Parser, Span, SpannedEventReceiver};
use std::ops::Range;

/// A key of a mapping with its parent keys and line.
#[derive(Debug, PartialEq)]
pub(super) struct KeyPlace {
    /// Names of its parents and its own.
    pub(super) path: Vec<String>,
    /// Line, counted from 1.
    pub(super) line: usize,
    /// Its value, unless that is a list or a mapping.
    pub(super) value: Option<String>,
    /// From the first character of the key to the end of its value, in characters of the text.
    pub(super) span: Range<usize>,
    /// End of its name, likewise.
    pub(super) name_end: usize,
    /// Whether it stands between braces.
    pub(super) in_braces: bool,
}

/// A key that occurs twice in one mapping.
#[derive(Debug, PartialEq)]
pub(super) struct Duplicate {
    /// The key with its parents, separated by dots.
    pub(super) key: String,
    /// Lines of both, counted from 1.
    pub(super) lines: (usize, usize),
}

/// All keys of a text, in their order.
#[derive(Debug, Default)]
pub(super) struct Keys {
    pub(super) keys: Vec<KeyPlace>,
    duplicate: Option<Duplicate>,
    /// Whether the text has no syntax error.
    pub(super) complete: bool,
}

/// Parser state: in a mapping before a key or a value, or in a sequence.
enum Level {
    Mapping {
        first_key: usize,
        waits_for_key: bool,
        in_braces: bool,
    },
    Sequence,
}

#[derive(Default)]
struct KeyReader {
    found: Keys,
    levels: Vec<Level>,
    path: Vec<String>,
    /// Keys whose value has not ended, as indices.
    open: Vec<usize>,
    /// End of the last event that has characters of its own.
    end: usize,
}

impl Keys {
    /// Returns the keys of `text`; with a syntax error, the keys before it.
    pub(super) fn of(text: &str) -> Self {
        let mut reader = KeyReader::default();
        // A syntax error is reported by the deserialiser, with its line.
        let read = Parser::new_from_str(text).load(&mut reader, false);
        reader.found.complete = read.is_ok();
        reader.found
    }

    /// Returns the first key that occurs twice in one mapping.
    pub(super) fn duplicate(&self) -> Option<&Duplicate> {
        self.duplicate.as_ref()
    }

    /// Returns the only key within a section that has this value, and its line, counted from 1.
    pub(super) fn with_value(&self, section: &[&str], value: &str) -> Option<(&str, usize)> {
        let mut found = self.keys.iter().filter(|key| {
            key.value.as_deref() == Some(value)
                && key.path.len() >= section.len()
                && key.path.iter().zip(section).all(|(a, b)| a == b)
        });
        match (found.next(), found.next()) {
            (Some(key), None) => Some((key.path.last()?, key.line)),
            _ => None,
        }
    }

    /// Returns the line, counted from 1, of the first key whose path ends with `path`, or else of its nearest
    /// existing parent.
    pub(super) fn line_of(&self, path: &[&str]) -> Option<usize> {
        (1..=path.len()).rev().find_map(|length| {
            let wanted = &path[..length];
            self.keys
                .iter()
                .find(|key| {
                    let tail = key.path.len().checked_sub(wanted.len());
                    tail.is_some_and(|from| key.path[from..].iter().eq(wanted))
                })
                .map(|key| key.line)
        })
    }
}

impl KeyReader {
    /// Ends a value: the enclosing mapping expects its next key.
    fn value_ended(&mut self) {
        if let Some(Level::Mapping { waits_for_key, .. }) = self.levels.last_mut() {
            *waits_for_key = true;
            self.path.pop();
            if let Some(key) = self.open.pop() {
                self.found.keys[key].span.end = self.end;
            }
        }
    }

    fn key(&mut self, name: &str, span: Span, first_key: usize, in_braces: bool) {
        let line = span.start.line();
        self.path.push(name.to_owned());
        let before = self.found.keys[first_key..]
            .iter()
            .find(|key| key.path == self.path)
            .map(|key| key.line);
        if let (Some(first), None) = (before, &self.found.duplicate) {
            self.found.duplicate = Some(Duplicate {
                key: self.path.join("."),
                lines: (first, line),
            });
        }
        self.open.push(self.found.keys.len());
        self.found.keys.push(KeyPlace {
            path: self.path.clone(),
            line,
            value: None,
            span: span.start.index()..span.end.index(),
            name_end: span.end.index(),
            in_braces,
        });
    }
}

impl<'input> SpannedEventReceiver<'input> for KeyReader {
    fn on_event(&mut self, event: Event<'input>, span: Span) {
        let key_of = match self.levels.last() {
            Some(Level::Mapping {
                first_key,
                waits_for_key: true,
                in_braces,
            }) => Some((*first_key, *in_braces)),
            _ => None,
        };
        // The end of a block has a place, but no characters.
        if !span.is_empty() {
            self.end = span.end.index();
        }
        match event {
            Event::Scalar(name, ..) => match key_of {
                Some((first_key, in_braces)) => {
                    self.key(&name, span, first_key, in_braces);
                    if let Some(Level::Mapping { waits_for_key, .. }) = self.levels.last_mut() {
                        *waits_for_key = false;
                    }
                }
                None => {
                    if let (Some(Level::Mapping { .. }), Some(key)) =
                        (self.levels.last(), self.found.keys.last_mut())
                    {
                        key.value = Some(name.into_owned());
                    }
                    self.value_ended();
                }
            },
            Event::Alias(_) => self.value_ended(),
            Event::MappingStart(..) => self.levels.push(Level::Mapping {
                first_key: self.found.keys.len(),
                waits_for_key: true,
                in_braces: !span.is_empty(),
            }),
            Event::SequenceStart(..) => self.levels.push(Level::Sequence),
            Event::MappingEnd | Event::SequenceEnd => {
                self.levels.pop();
                self.value_ended();
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "name: a\nterrain:\n  kind: plane\n  slope_deg: 5\nzones:\n  - {depth_m: 1, slope_deg: 2}\n  - depth_m: 3\ncontroller: {weights: {cross: 1}}\n";

    #[test]
    fn keys_are_found_by_the_end_of_their_path() {
        let keys = Keys::of(TEXT);
        assert_eq!(keys.line_of(&["terrain", "slope_deg"]), Some(4));
        assert_eq!(keys.line_of(&["slope_deg"]), Some(4));
        assert_eq!(keys.line_of(&["zones", "slope_deg"]), Some(6));
        assert_eq!(keys.line_of(&["weights", "cross"]), Some(8));
        assert_eq!(keys.line_of(&["terrain", "lost"]), Some(2));
        assert_eq!(keys.line_of(&["lost"]), None);
        assert_eq!(keys.duplicate(), None);
    }

    #[test]
    fn a_key_is_found_by_its_value() {
        let keys = Keys::of(TEXT);
        assert_eq!(keys.with_value(&["terrain"], "5"), Some(("slope_deg", 4)));
        assert_eq!(keys.with_value(&[], "plane"), Some(("kind", 3)));
        assert_eq!(keys.with_value(&["controller"], "5"), None);
        // Two keys have it.
        assert_eq!(keys.with_value(&[], "1"), None);
    }

    #[test]
    fn a_key_that_stands_twice_is_found_and_one_of_two_items_is_not() {
        assert_eq!(
            Keys::of("a: 1\nb: {c: 1}\na: 2\n")
                .duplicate()
                .unwrap()
                .lines,
            (1, 3)
        );
        let inner = Keys::of("a:\n  b: 1\n  b: 2\n");
        assert_eq!(inner.duplicate().unwrap().key, "a.b");
        assert_eq!(Keys::of("- {b: 1}\n- {b: 1}\n").duplicate(), None);
        assert_eq!(Keys::of("x: [{b: 1}, {b: 1}]\n").duplicate(), None);
    }
}
