//! Names the commit of the build, and whether its DDS has the patches of bridge/patches.
#![allow(clippy::print_stdout)]

use std::process::Command;

fn main() {
    // Where git writes each change of the commit that is checked out.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={log}");
    }
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=SIDEHILL_DDS_PATCHES");
    // Named where there is no repository, as in a container.
    println!("cargo::rerun-if-env-changed=SIDEHILL_COMMIT");
    let commit = std::env::var("SIDEHILL_COMMIT").ok();
    let commit = commit
        .filter(|commit| !commit.is_empty())
        .or_else(|| git(&["rev-parse", "--short=12", "HEAD"]));
    let commit = commit.as_deref().unwrap_or("unknown");
    println!("cargo::rustc-env=SIDEHILL_COMMIT={commit}");
    // Set by bridge/patches/cargo.
    let dds = match std::env::var("SIDEHILL_DDS_PATCHES") {
        Ok(crates) => format!("patched {crates}"),
        Err(_) => "RustDDS as published: see bridge/patches".to_owned(),
    };
    println!("cargo::rustc-env=SIDEHILL_DDS={dds}");
}

/// Returns what git prints; nothing outside a repository.
fn git(arguments: &[&str]) -> Option<String> {
    let done = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(done.stdout).ok()?.trim().to_owned();
    (done.status.success() && !text.is_empty()).then_some(text)
}
