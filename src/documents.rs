//! `documents` of both programs: the man pages and shell completions of a package.

use crate::output;
use anyhow::Result;
use clap_complete::{Shell, generate};
use std::path::PathBuf;

/// Arguments of `documents`.
#[derive(Debug, clap::Args)]
pub struct DocumentsArgs {
    /// Folder for the files; created if it does not exist.
    pub folder: PathBuf,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
}

/// Writes a man page for the program and each subcommand, and completions for bash, zsh and fish.
///
/// # Errors
/// A file that cannot be written.
pub fn run(args: &DocumentsArgs, command: &mut clap::Command) -> Result<()> {
    std::fs::create_dir_all(&args.folder)?;
    command.build();
    let shown: Vec<_> = command
        .get_subcommands()
        .filter(|part| !part.is_hide_set() && part.get_name() != "help")
        .cloned()
        .collect();
    for part in std::iter::once(&*command).chain(&shown) {
        // `build` has set the name of a subcommand, such as "sidehill-run".
        let name = part
            .get_display_name()
            .unwrap_or(part.get_name())
            .to_owned();
        // `sidehill drive-route` has the name of a page of the other program, which it hands over to.
        if command.get_name() == "sidehill" && name.starts_with("sidehill-drive-") {
            continue;
        }
        let mut page = Vec::new();
        clap_mangen::Man::new(part.clone()).render(&mut page)?;
        output::write(&args.folder.join(format!("{name}.1")), &page, args.force)?;
    }
    let program = command.get_name().to_owned();
    for (shell, file) in [
        (Shell::Bash, format!("{program}.bash")),
        (Shell::Zsh, format!("_{program}")),
        (Shell::Fish, format!("{program}.fish")),
    ] {
        let mut script = Vec::new();
        generate(shell, command, program.as_str(), &mut script);
        output::write(&args.folder.join(file), &script, args.force)?;
    }
    Ok(())
}
