//! The program under test and the repository's files.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Returns the program, ready for arguments.
pub fn sidehill() -> Command {
    Command::new(env!("CARGO_BIN_EXE_sidehill"))
}

/// Returns where a file of the repository is.
pub fn repository(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}
