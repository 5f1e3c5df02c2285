//! The README and the pages in docs/: commands that the program accepts, files and sections that exist.

use crate::{repository, sidehill, succeed, text};
use std::path::Path;

/// Returns the pages that a reader of the repository meets, as paths from its root.
fn pages() -> Vec<String> {
    let markdown = |folder: &str| {
        std::fs::read_dir(repository(folder))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter(|name| name.ends_with(".md"))
            .map(|name| Path::new(folder).join(name).to_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    let mut pages = markdown("");
    pages.extend(markdown("docs"));
    pages.extend(markdown("docs/guide"));
    pages.push("bridge/nav2/README.md".into());
    pages.push("tests/ros2/README.md".into());
    pages
}

/// Returns the commands of a page: what follows `cargo run --release` or, at the start of an indented line,
/// `sidehill`, up to the end of the line, a comment, a pipe or the closing backtick.
///
/// A synopsis, which has placeholders in capitals or optional parts in brackets, is no command.
fn commands(page: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for line in page.lines() {
        let mut rest = line;
        while let Some(start) = rest.find("cargo run --release") {
            rest = &rest[start + "cargo run --release".len()..];
            found.push(rest);
        }
        if let Some(arguments) = line.strip_prefix("    sidehill ") {
            found.push(arguments);
        }
    }
    found
        .into_iter()
        .filter(|rest| !rest.trim_start().starts_with("--example"))
        .map(|rest| {
            let end = rest.find(['`', '#', '|']).unwrap_or(rest.len());
            rest[..end]
                .split_whitespace()
                .skip_while(|word| ["-p", "sidehill-drive", "--"].contains(word))
                // The rest is for ROS, not for the program's own parser.
                .take_while(|word| *word != "--ros-args")
                .map(str::to_owned)
                .collect::<Vec<_>>()
        })
        .filter(|words| {
            !words
                .iter()
                .any(|word| word.contains(['[', '|']) || is_placeholder(word))
        })
        .collect()
}

/// Whether a word stands for something the reader fills in, such as `LOG...` or `MAP.yaml`.
fn is_placeholder(word: &str) -> bool {
    let stem = word.split('.').next().unwrap_or(word);
    stem.len() > 2 && stem.chars().all(|c| c.is_ascii_uppercase() || c == '_')
}

#[test]
fn the_program_accepts_every_command_of_the_pages() {
    let mut checked = 0;
    for page in pages() {
        for command in commands(&text(&page)) {
            // With --help the program reads the arguments before it, refuses unknown ones, and does nothing.
            let help = succeed(sidehill().args(&command).arg("--help"));
            assert!(help.contains("Usage:"), "{page}: {command:?}");
            for word in command.iter().filter(|word| is_input(word)) {
                let exists = match word.split_once('*') {
                    Some((start, _)) => !matching(start).is_empty(),
                    None => repository(word).exists(),
                };
                assert!(exists, "{page}: {command:?} names {word}");
            }
            checked += 1;
        }
    }
    assert!(checked >= 20, "only {checked} commands were found");
}

/// Whether an argument names a file of the repository.
fn is_input(word: &str) -> bool {
    ["config/", "plant/"]
        .iter()
        .any(|folder| word.starts_with(folder))
}

/// Returns the files whose path from the root starts like this.
fn matching(start: &str) -> Vec<String> {
    let (folder, name) = start.rsplit_once('/').unwrap();
    std::fs::read_dir(repository(folder))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|entry| entry.starts_with(name))
        .collect()
}

#[test]
fn links_lead_to_files_and_sections_that_exist() {
    let mut checked = 0;
    for page in pages() {
        let content = text(&page);
        for target in content
            .split("](")
            .skip(1)
            .filter_map(|rest| rest.split(')').next())
        {
            if target.contains("://") {
                continue;
            }
            let (file, section) = target.split_once('#').unwrap_or((target, ""));
            let linked = match file {
                "" => repository(&page),
                file => repository(&page).parent().unwrap().join(file),
            };
            assert!(linked.exists(), "{page} links to {target}");
            if !section.is_empty() {
                let linked = std::fs::read_to_string(&linked).unwrap();
                let sections: Vec<String> = linked
                    .lines()
                    .filter(|line| line.starts_with('#'))
                    .map(anchor)
                    .collect();
                assert!(
                    sections.iter().any(|s| s == section),
                    "{page} links to {target}: {sections:?}"
                );
            }
            checked += 1;
        }
    }
    assert!(checked >= 30, "only {checked} links were found");
}

/// Returns the anchor of a heading, as repository hosts make it.
fn anchor(heading: &str) -> String {
    heading
        .trim_start_matches('#')
        .trim()
        .to_lowercase()
        .chars()
        .filter_map(|c| match c {
            ' ' => Some('-'),
            c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
            _ => None,
        })
        .collect()
}

#[test]
fn files_named_in_the_readme_exist() {
    let readme = text("README.md");
    let named: Vec<&str> = readme
        .split('`')
        .skip(1)
        .step_by(2)
        .filter(|code| !code.contains(' '))
        .filter(|code| {
            [
                ".ci/",
                "config/",
                "docs/",
                "plant/",
                "controller/",
                "bridge/",
            ]
            .iter()
            .any(|folder| code.starts_with(folder))
        })
        .collect();
    assert!(named.len() >= 3, "{named:?}");
    for name in named {
        assert!(repository(name).exists(), "README.md names {name}");
    }
}
