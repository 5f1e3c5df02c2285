//! `sidehill` becomes `sidehill-drive` for the commands that drive.

use super::{SIMULATED, configuration};
use crate::running::Running;
use crate::sidehill;
use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
fn signals_and_the_exit_status_are_those_of_the_program_that_drives() {
    let file = configuration("hand_over", &SIMULATED);
    let mut run = Running::start(
        sidehill()
            .args(["run", file.to_str().unwrap(), "--format", "json"])
            .stdout(Stdio::piped()),
    );
    let mut lines = BufReader::new(run.0.stdout.take().unwrap());
    lines.read_line(&mut String::new()).unwrap();
    // One process: the signal that a service manager or a terminal sends reaches the control loop.
    let id = run.0.id();
    let program = std::fs::read_link(format!("/proc/{id}/exe")).unwrap();
    assert_eq!(program.file_name().unwrap(), "sidehill-drive");
    kill_process(Pid::from_raw(id as i32).unwrap(), Signal::TERM).unwrap();
    assert_eq!(run.0.wait().unwrap().code(), Some(3));
    let last = lines.lines().last().unwrap().unwrap();
    assert!(last.contains("\"ended\":\"signal\""), "{last}");
}

#[test]
fn without_the_program_that_drives_the_command_that_builds_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let alone = folder.path().join("sidehill");
    std::fs::copy(sidehill().get_program(), &alone).unwrap();
    let run = |path: &Path| {
        let output = Command::new(&alone)
            .args(["run", "no_such_file.yaml"])
            .env("PATH", path)
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    let complaint = run(folder.path());
    let build = "cargo build --release --package sidehill-drive";
    assert!(complaint.contains(build), "{complaint}");
    // It is found on PATH too.
    let drive = Path::new(env!("CARGO_BIN_EXE_sidehill-drive"));
    let complaint = run(drive.parent().unwrap());
    assert!(complaint.contains("no_such_file.yaml"), "{complaint}");
}
