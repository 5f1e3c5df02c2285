//! The program as a person runs it: its binary, files, standard streams and exit status.

// The lints' exceptions for tests do not reach helper functions.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod campaign;
mod check;
mod configuration;
mod configured;
mod formats;
mod icr;
mod identify;
mod loaders;
mod mistakes;
mod odometry;
mod paths;
mod program;
mod readme;
mod replay;
mod report;
mod schema;
mod simulate;
mod simulate_output;
mod stranger;
mod tune;

use program::{repository, sidehill};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::{Command, Output};

/// Returns the text of a file of the repository.
fn text(name: &str) -> String {
    std::fs::read_to_string(repository(name)).unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Runs a command that must succeed and returns its standard output.
fn succeed(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(
        output.status.success(),
        "{:?} after\n{}\n{}",
        output.status,
        stdout(&output),
        stderr(&output)
    );
    stdout(&output)
}

/// Runs a command that must fail and returns its standard error.
fn fail(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(!output.status.success(), "{}", stdout(&output));
    stderr(&output)
}

/// Asserts that a message contains all of `parts`.
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "no `{part}` in: {message}");
    }
}

fn keys(value: &Value) -> BTreeSet<&str> {
    value
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect()
}

/// Returns the runs of what `--format json` printed.
fn runs(text: &str) -> Vec<Value> {
    let value: Value = serde_json::from_str(text).unwrap();
    assert_eq!(keys(&value), BTreeSet::from(["runs"]));
    value["runs"].as_array().unwrap().clone()
}

/// A folder with a short scenario: 2 m across a slope of 8 degrees.
struct Course {
    folder: tempfile::TempDir,
}

impl Course {
    /// Returns a course whose scenario has `extra` lines of YAML.
    fn new(extra: &str) -> Self {
        let course = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let vehicle = repository("config/vehicles/j8.yaml");
        course.write(
            "scenario.yaml",
            &format!(
                "name: short\n\
                 vehicle: {}\n\
                 terrain: {{kind: plane, slope_deg: 8, uphill_heading_deg: 60}}\n\
                 course: {{shape: straight, length_m: 2, speed_m_s: 0.5}}\n\
                 controllers: [icrik-mpc, icrhk-mpc]\n\
                 plant: icrik\n\
                 seed: 1\n\
                 step_s: 0.005\n\
                 {extra}",
                vehicle.display()
            ),
        );
        course
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    /// Returns `sidehill simulate` with this scenario.
    fn simulate(&self) -> Command {
        let mut command = sidehill();
        command.arg("simulate").arg(self.path("scenario.yaml"));
        command
    }
}
