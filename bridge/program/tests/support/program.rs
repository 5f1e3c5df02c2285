//! The programs under test and the repository's files.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Returns the program `sidehill`, ready for arguments, which hands over to the one under test beside it.
///
/// Cargo builds it with the tests of the workspace, but not with those of this package alone.
pub fn sidehill() -> Command {
    let program = Path::new(env!("CARGO_BIN_EXE_sidehill-drive")).with_file_name("sidehill");
    assert!(
        program.is_file(),
        "{} is missing: build it with `cargo build --bin sidehill`",
        program.display()
    );
    Command::new(program)
}

/// Returns where a file of the repository is.
pub fn repository(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .canonicalize()
        .unwrap()
        .join(name)
}
