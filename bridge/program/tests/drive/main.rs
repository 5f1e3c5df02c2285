//! `sidehill-drive` without a bus, as a person runs it: by `sidehill`, which hands over to it.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

#[path = "../../../../tests/program/configured.rs"]
mod configured;
#[path = "../support/guide_blocks.rs"]
mod guide_blocks;
#[path = "../support/program.rs"]
mod program;
#[path = "../support/running.rs"]
mod running;

mod drive;
mod faults;
mod files;
mod guide;
mod hand_over;
mod live;
mod mistakes;
mod output;
mod ros2_client;
mod service;

use program::{repository, sidehill};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs a command that must succeed and returns its standard output.
fn succeed(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}

fn run_to_end(arguments: &[&str]) -> Output {
    sidehill().args(arguments).output().unwrap()
}

/// Copies the bridge's configuration beside the vehicles and changes it.
fn configuration(test: &str, changes: &[(&str, &str, &str)]) -> PathBuf {
    let (from, to) = (
        repository("config"),
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(test),
    );
    for folder in ["bridge", "vehicles", "scenarios"] {
        std::fs::create_dir_all(to.join(folder)).unwrap();
        for file in std::fs::read_dir(from.join(folder)).unwrap() {
            let file = file.unwrap();
            if file.path().is_dir() {
                continue;
            }
            let mut text = std::fs::read_to_string(file.path()).unwrap();
            for (name, old, new) in changes {
                if file.file_name() == *name {
                    assert!(text.contains(old), "{old}");
                    text = text.replace(old, new);
                }
            }
            std::fs::write(to.join(folder).join(file.file_name()), text).unwrap();
        }
    }
    to.join("bridge/run_vcan0.yaml")
}

/// Changes for the simulated bus of a machine whose cores are busy.
const SIMULATED: [(&str, &str, &str); 4] = [
    ("run_vcan0.yaml", "port: can", "port: simulated"),
    (
        "run_vcan0.yaml",
        "command_timeout_s: 0.15",
        "command_timeout_s: 1.0",
    ),
    (
        "run_vcan0.yaml",
        "feedback_timeout_s: 0.2",
        "feedback_timeout_s: 1.0",
    ),
    (
        "run_vcan0.yaml",
        "handshake_timeout_s: 1.0",
        "handshake_timeout_s: 10.0",
    ),
];
