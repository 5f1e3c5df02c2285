//! `sidehill migrate`: takes keys that no longer exist out of configuration files.

use crate::config::{ConfigFile, Migration};
use crate::console;
use crate::exit::Exit;
use crate::output;
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `sidehill migrate`.
#[derive(Debug, Clone, clap::Args)]
pub struct MigrateArgs {
    /// Configuration files in YAML.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Write the files; without it, only list what would change. The file before is kept as FILE.old.
    #[arg(long)]
    pub write: bool,
}

/// Lists the keys of each file that no longer exist, and with `--write` takes them out. Returns success if no file has such
/// keys any more.
///
/// # Errors
/// Names the first file that cannot be read or edited (none is written then), or that cannot be written, or whose copy
/// exists.
pub fn run(args: &MigrateArgs) -> Result<ExitCode> {
    let mut migrations = Vec::new();
    for path in &args.files {
        migrations.push((path, Migration::of(&ConfigFile::read(path)?)?));
    }
    let mut up_to_date = true;
    for (path, migration) in migrations {
        let name = path.display();
        for line in migration.removed.iter().chain(&migration.by_hand) {
            console::line(format_args!("{name}: {line}"));
        }
        up_to_date &= migration.by_hand.is_empty();
        match migration.removed.len() {
            0 if !migration.by_hand.is_empty() => {}
            0 => console::line(format_args!("{name}: nothing to remove")),
            count if args.write => {
                let kept = write(path, &migration.text)?;
                console::line(format_args!(
                    "{name}: removed {count}; the file before is {}",
                    kept.display()
                ));
            }
            count => {
                up_to_date = false;
                console::line(format_args!(
                    "{name}: {count} to remove: repeat with --write"
                ));
            }
        }
    }
    Ok(Exit::answer(up_to_date).into())
}

/// Copies a file to FILE.old and writes it in place, with its owner and permissions; returns the copy.
fn write(path: &Path, text: &str) -> Result<PathBuf> {
    let mut copy = path.as_os_str().to_owned();
    copy.push(".old");
    let copy = PathBuf::from(copy);
    let before = std::fs::read(path).with_context(|| path.display().to_string())?;
    output::write(&copy, &before, false).context("nothing is written")?;
    std::fs::write(path, text).with_context(|| {
        let copy = copy.display();
        format!(
            "{}: cannot be written; the file before is {copy}",
            path.display()
        )
    })?;
    Ok(copy)
}
