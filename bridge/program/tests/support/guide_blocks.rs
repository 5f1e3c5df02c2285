//! The commands of docs/guide/: blocks of shell in its pages.

use crate::program::{repository, sidehill};
use std::path::Path;
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

/// Returns the text of a page.
pub fn text_of(page: &str) -> String {
    let folder = repository("docs/guide");
    std::fs::read_to_string(folder.join(page)).unwrap()
}

/// Returns the blocks of a page.
pub fn blocks_of(page: &str) -> Vec<Block> {
    let text = text_of(page);
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
        let program = sidehill();
        let program = Path::new(program.get_program());
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
            "{}: {}\n{:?} after\n{}\n{}\n{}",
            self.page,
            self.before,
            output.status,
            self.script,
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        );
    }
}
