//! Names the build by its sources, so that results of two programs are never mixed.
#![allow(clippy::print_stdout)]

use std::path::{Path, PathBuf};

/// What decides how a simulation comes out.
const SOURCES: [&str; 4] = ["Cargo.lock", "src", "plant/src", "controller/src"];

fn main() -> std::io::Result<()> {
    let mut files = Vec::new();
    for source in SOURCES {
        println!("cargo::rerun-if-changed={source}");
        collect(Path::new(source), &mut files)?;
    }
    files.sort();
    // FNV-1a.
    let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
    for file in files {
        let name = file.to_string_lossy().into_owned().into_bytes();
        for byte in name.into_iter().chain(std::fs::read(file)?) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    println!("cargo::rustc-env=SIDEHILL_BUILD={hash:016x}");
    Ok(())
}

/// Adds the files at a path. A part that is not there, as in a package of this crate alone, is left out.
fn collect(path: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if path.is_dir() {
        for entry in std::fs::read_dir(path)? {
            collect(&entry?.path(), files)?;
        }
    } else if path.is_file() {
        files.push(path.to_owned());
    }
    Ok(())
}
