//! Standard output and error that nobody reads.

use super::{SIMULATED, configuration};
use crate::running::Running;
use crate::sidehill;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
fn it_survives_100_closings_of_its_output_while_it_drives() {
    let file = configuration("closings", &SIMULATED);
    let pipe = file.with_file_name("pipe");
    let _ = std::fs::remove_file(&pipe);
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let reader = || BufReader::new(File::open(&pipe).unwrap());
    let opens = {
        let pipe = pipe.clone();
        std::thread::spawn(move || File::options().write(true).open(pipe).unwrap())
    };
    let mut lines = reader();
    let output = opens.join().unwrap();
    let _run = Running::start(
        sidehill()
            .args(["run", file.to_str().unwrap(), "--arm"])
            .args(["--log-level", "debug"])
            .stderr(output.try_clone().unwrap())
            .stdout(output),
    );
    let drives = |lines: &mut BufReader<File>| {
        let mut line = String::new();
        while lines.read_line(&mut line).unwrap() > 0 {
            let said: serde_json::Value = serde_json::from_str(&line).unwrap_or_default();
            match said["state"].as_str() {
                Some("driving") => return Some(said),
                // Nothing arms it again.
                Some("stopping" | "latched") => panic!("it stopped: {said}"),
                _ => line.clear(),
            }
        }
        None
    };
    drives(&mut lines).expect("it drives");
    drop(lines);
    for _ in 0..100 {
        drop(reader());
        std::thread::sleep(std::time::Duration::from_millis(60));
    }
    // A new reader sees that it is still driving, and how many lines were dropped; the pipe may hold older lines.
    let mut lines = reader();
    let dropped = |_| drives(&mut lines).expect("it still drives")["lines_dropped"].as_u64();
    assert!((0..20).map(dropped).any(|dropped| dropped > Some(2)));
}

#[test]
fn it_drives_on_when_nobody_reads_and_stops_when_the_connection_drops() {
    let file = configuration("nobody_reads", &SIMULATED);
    let out = file.parent().unwrap().join("out");
    // Files of an earlier test would look like a drive.
    let _ = std::fs::remove_dir_all(&out);
    let mut run = Running::start(
        sidehill()
            .args(["run", file.to_str().unwrap(), "--arm", "--out"])
            .arg(&out)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped()),
    );
    // Close both pipes before it prints anything.
    drop(run.0.stdout.take());
    drop(run.0.stderr.take());
    let states = || -> Vec<String> {
        let cycles = std::fs::read_to_string(out.join("cycles.csv")).unwrap_or_default();
        let mut lines = cycles.lines();
        let header = lines.next().unwrap_or_default();
        let column = header.split(',').position(|name| name == "state");
        // The last line may be half written.
        let whole: Vec<&str> = lines.collect();
        whole[..whole.len().saturating_sub(1)]
            .iter()
            .filter_map(|line| Some(line.split(',').nth(column?)?.to_owned()))
            .collect()
    };
    let driving = || states().iter().filter(|state| *state == "driving").count();
    let begun = std::time::Instant::now();
    while driving() < 60 {
        assert!(run.0.try_wait().unwrap().is_none(), "{:?}", states().last());
        assert!(begun.elapsed().as_secs() < 60, "{:?}", states().last());
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    let id = rustix::process::Pid::from_raw(i32::try_from(run.0.id()).unwrap()).unwrap();
    rustix::process::kill_process(id, rustix::process::Signal::HUP).unwrap();
    let status = run.0.wait().unwrap();
    assert_eq!(
        status.code(),
        Some(3),
        "ended by a signal, not killed by it"
    );
    assert_ne!(states().last().unwrap(), "driving");
}

/// Runs with its output in a file, which the environment names as the journal's, and returns its lines.
fn journal(test: &str, config: &Path, arguments: &[&str]) -> Vec<String> {
    let path = config.with_file_name(test);
    let file = File::create(&path).unwrap();
    let stream = file.metadata().unwrap();
    sidehill()
        .args(["run", config.to_str().unwrap()])
        .args(arguments)
        .env(
            "JOURNAL_STREAM",
            format!("{}:{}", stream.dev(), stream.ino()),
        )
        .stderr(file.try_clone().unwrap())
        .stdout(file)
        .status()
        .unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(str::to_owned).collect()
}

#[test]
fn without_a_terminal_the_state_is_printed_when_it_changes() {
    let file = configuration("states", &SIMULATED);
    let lines = journal("log", &file, &["--arm", "--duration-s", "6"]);
    let lines: Vec<serde_json::Value> = lines
        .iter()
        .map(|line| serde_json::from_str(line.strip_prefix("<6>").unwrap()).unwrap())
        .collect();
    let is_state = |line: &&serde_json::Value| line.get("lateness_s").is_some();
    let states: Vec<_> = lines.iter().filter(is_state).collect();
    assert!(
        states.iter().any(|line| line["state"] == "driving"),
        "{lines:?}"
    );
    for pair in states.windows(2) {
        let key = |line: &serde_json::Value| (line["state"].clone(), line["waits_for"].clone());
        assert_ne!(key(pair[0]), key(pair[1]));
    }
    assert_eq!(lines.last().unwrap()["ended"], "time_over");
}

#[test]
fn lines_have_the_priorities_of_syslog_for_the_journal_and_only_those_asked_for_are_printed() {
    let file = configuration("priorities", &[("run_vcan0.yaml", "vcan0", "nocan7")]);
    let arguments = ["--format", "text", "--duration-s", "2.5", "--log-level"];
    let log = |level: &'static str| journal("log", &file, &[&arguments[..], &[level]].concat());
    let lines = log("warn");
    assert!(!lines.is_empty());
    for line in &lines {
        assert!(line.starts_with("<4>"), "{lines:?}");
    }
    assert!(
        lines.iter().any(|line| line.contains("waits for bus")),
        "{lines:?}"
    );
    let lines = log("debug");
    let count = |prefix: &str| lines.iter().filter(|line| line.starts_with(prefix)).count();
    // Start, state and end; a warning for each missing input; and a state each second.
    assert!(
        count("<6>") >= 3 && count("<4>") >= 1 && count("<7>") >= 1,
        "{lines:?}"
    );
    assert_eq!(count("<"), lines.len(), "{lines:?}");
    // A file that is wrong is told as an error.
    let missing = file.with_file_name("no_such_file.yaml");
    let lines = journal("log", &missing, &[]);
    assert!(lines[0].starts_with("<3>sidehill-drive: "), "{lines:?}");
}
