//! What README.md names has to be there.

use crate::{repository, text};
use std::collections::BTreeSet;

/// Folders whose files the README may name.
const FOLDERS: [&str; 6] = [
    "config/",
    "docs/",
    "plant/",
    "controller/",
    "benches/",
    ".ci/",
];

#[test]
fn the_files_it_names_exist() {
    let readme = text("README.md");
    let named: BTreeSet<&str> = readme
        .split(|c: char| c.is_whitespace() || "()[]`\"'|,;:<>".contains(c))
        .map(|word| word.trim_end_matches('.'))
        // A shell's pattern is no name.
        .filter(|word| !word.contains('*'))
        .filter(|word| FOLDERS.iter().any(|folder| word.starts_with(folder)))
        .collect();
    let scenarios = named
        .iter()
        .filter(|name| name.starts_with("config/scenarios/"));
    assert!(scenarios.count() >= 3, "{named:?}");
    for name in named {
        assert!(repository(name).exists(), "README.md names {name}");
    }
}
