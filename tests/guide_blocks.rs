//! The commands of docs/guide/: blocks of shell in its pages.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A block of commands.
pub struct Block {
    /// Name of the page.
    pub page: String,
    /// What it needs: nothing, or the word after `sh`.
    pub needs: String,
    /// The line of text before it.
    pub before: String,
    /// The commands.
    pub script: String,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/guide")
}

/// Returns the blocks of all pages in the order in which the guide's first page links them.
pub fn blocks() -> Vec<Block> {
    let first = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let links = first
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next());
    let pages = links.filter(|link| link.ends_with(".md") && !link.contains('/'));
    pages.flat_map(blocks_of).collect()
}

/// Returns the blocks of a page.
pub fn blocks_of(page: &str) -> Vec<Block> {
    let text = std::fs::read_to_string(folder().join(page)).unwrap();
    let mut found = Vec::new();
    let mut before = "";
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let Some(needs) = line.trim_start().strip_prefix("```sh") else {
            if !line.trim().is_empty() {
                before = line;
            }
            continue;
        };
        let script: Vec<&str> = lines
            .by_ref()
            .map(str::trim_start)
            .take_while(|line| *line != "```")
            .collect();
        found.push(Block {
            page: page.to_owned(),
            needs: needs.trim().to_owned(),
            before: before.to_owned(),
            script: script.join("\n"),
        });
    }
    found
}

impl Block {
    /// Runs the commands in a folder, with the program of the tests as `sidehill`.
    pub fn run(&self, scratch: &Path) -> Output {
        let program = Path::new(env!("CARGO_BIN_EXE_sidehill"));
        let path = std::env::var("PATH").unwrap_or_default();
        let path = format!("{}:{path}", program.parent().unwrap().display());
        Command::new("sh")
            .args(["-euc", &self.script])
            .current_dir(scratch)
            .env("PATH", path)
            .output()
            .unwrap()
    }

    /// Runs the commands, and fails where one of them does.
    pub fn succeed(&self, scratch: &Path) {
        let output = self.run(scratch);
        assert!(
            output.status.success(),
            "{}: {:?} after\n{}\n{}\n{}",
            self.page,
            output.status,
            self.script,
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        );
    }
}
