//! `run` and `vehicle` without a bus.
#![allow(clippy::unwrap_used)]

#[path = "support/program.rs"]
mod program;
#[path = "support/running.rs"]
mod running;

use program::{repository, sidehill};
use running::Running;
use sidehill_bridge::recording::{
    McapRecording, MessageSink, RecordLimits, Recording, Topic, scan,
};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

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

#[test]
fn a_simulated_vehicle_is_driven_in_real_time() {
    // The longest time-outs there are, since other tests may keep the machine busy.
    let file = configuration("simulated", &SIMULATED);
    let recording = file.with_file_name("drive.mcap");
    let recording = recording.to_str().unwrap();
    let output = run_to_end(&[
        "run",
        file.to_str().unwrap(),
        "--arm",
        "--duration-s",
        "6",
        "--record",
        recording,
        "--force",
    ]);
    let text = String::from_utf8(output.stdout).unwrap();
    let events = String::from_utf8(output.stderr).unwrap();
    let lines: Vec<serde_json::Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let (ending, cycles) = lines.split_last().unwrap();
    assert_eq!(ending["ended"], "time_over", "{text}\n{events}");
    assert_eq!(output.status.code(), Some(0));
    let position = |line: &serde_json::Value| {
        let value = |key: &str| line[key].as_f64();
        Some([value("x_m")?, value("y_m")?])
    };
    let positions: Vec<[f64; 2]> = cycles.iter().filter_map(position).collect();
    let [first, last] = [positions.first(), positions.last()].map(|found| found.unwrap());
    let driven_m = f64::hypot(last[0] - first[0], last[1] - first[1]);
    // The course begins at 0.5 m/s, and at least 3 s of the 6 s are driven.
    assert!(driven_m > 0.5, "{driven_m} m\n{text}\n{events}");
    // Standing, arming and driving are replayed as they were.
    let output = run_to_end(&["replay", recording, "--format", "json"]);
    let replayed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(replayed["different"], 0, "{replayed}");
    assert!(replayed["cycles"].as_u64().unwrap() > 100, "{replayed}");
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn what_a_drive_has_learned_is_kept_over_a_restart() {
    let mut changes = SIMULATED;
    changes[0].2 = "port: simulated\nlearned: {file: j8.learned}";
    let file = configuration("learned", &changes);
    let beside = |name: &str| file.with_file_name(name);
    for name in ["j8.learned", "j8.learned.1", "drive.mcap"] {
        let _ = std::fs::remove_file(beside(name));
    }
    let (kept, recording) = (beside("j8.learned"), beside("drive.mcap"));
    let recording = recording.to_str().unwrap();
    let drive = |more: &[&str]| {
        let begin = ["run", file.to_str().unwrap(), "--arm", "--duration-s", "4"];
        let output = run_to_end(&[&begin, more].concat());
        let events = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{events}");
        events
    };
    let events = drive(&[]);
    assert!(!events.contains("learned"), "{events}");
    let first = std::fs::read_to_string(&kept).unwrap();
    assert!(first.contains("\"gains\":{"), "{first}");
    // The next drive begins with it, and a replay of that drive too, even where the file is gone.
    let events = drive(&["--record", recording]);
    let says = "j8.learned: begins with what was learned";
    assert!(events.contains(says), "{events}");
    let second = std::fs::read_to_string(&kept).unwrap();
    assert_ne!(first, second);
    std::fs::write(&kept, &second[..second.len() / 2]).unwrap();
    let output = run_to_end(&["replay", recording, "--format", "json"]);
    let replayed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(replayed["different"], 0, "{replayed}");
    assert!(replayed["cycles"].as_u64().unwrap() > 50, "{replayed}");
    // A damaged file keeps nothing from driving, and is not lost.
    let events = drive(&[]);
    for part in ["j8.learned: refused: the file is", "nothing learned"] {
        assert!(events.contains(part), "{part}: {events}");
    }
    let set_aside = std::fs::read_to_string(beside("j8.learned.1")).unwrap();
    assert_eq!(set_aside, &second[..second.len() / 2]);
    assert!(std::fs::read_to_string(&kept).unwrap().contains("gains"));
}

#[test]
fn a_recording_without_its_first_file_is_replayed_from_where_it_was_armed() {
    let file = configuration("first_file_deleted", &SIMULATED);
    let whole = file.with_file_name("drive.mcap");
    let mut run = Running::start(
        sidehill()
            .arg("run")
            .arg(&file)
            .args(["--duration-s", "8", "--force", "--record"])
            .arg(&whole)
            .stdout(Stdio::piped())
            .stderr(Stdio::null()),
    );
    let mut lines = BufReader::new(run.0.stdout.take().unwrap()).lines();
    let waits = lines.by_ref().map_while(Result::ok).take(3).count();
    assert_eq!(waits, 3);
    let id = rustix::process::Pid::from_child(&run.0);
    rustix::process::kill_process(id, rustix::process::Signal::USR1).unwrap();
    assert!(lines.all(|line| line.is_ok()));
    run.0.wait().unwrap();
    // The same messages, with a new file after the first half second, and only the newest file kept.
    let header = Recording::read(&whole).unwrap().header;
    let cut = file.with_file_name("cut.mcap");
    let limits = RecordLimits {
        max_size: 1.0,
        split: true,
        keep: 1,
    };
    let mut recording = McapRecording::create(&cut, header, limits).unwrap();
    let mut begin_ns = None;
    let mut padding = vec![0; 2_000_000];
    scan(&whole, &mut |topic, time_ns, message| {
        let begin_ns = *begin_ns.get_or_insert(time_ns);
        if time_ns > begin_ns + 500_000_000 && !padding.is_empty() {
            recording.put(Topic::Diagnostics, time_ns, &std::mem::take(&mut padding));
        }
        recording.put(topic, time_ns, message);
        Ok(())
    })
    .unwrap();
    recording.finish();
    assert!(!cut.exists());
    let left = file.with_file_name("cut_1.mcap");
    let output = run_to_end(&["replay", left.to_str().unwrap(), "--format", "json"]);
    let replayed: serde_json::Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    assert!(
        replayed["begins"]["cycle"].as_u64().unwrap() > 20,
        "{replayed}"
    );
    assert_eq!(replayed["different"], 0, "{replayed}");
    assert!(replayed["cycles"].as_u64().unwrap() > 40, "{replayed}");
}

#[test]
fn the_bridges_files_are_valid() {
    let folder = repository("config/bridge");
    for name in [
        "can.yaml",
        "cia402.yaml",
        "run_can_ros2.yaml",
        "run_ros2.yaml",
        "run_vcan0.yaml",
        "vehicle_ros2.yaml",
        "vehicle_vcan0.yaml",
    ] {
        let output = run_to_end(&["check", folder.join(name).to_str().unwrap()]);
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(
            output.status.success() && text.contains("valid"),
            "{name}: {text}"
        );
    }
}

#[test]
fn a_route_is_driven_on_wheels() {
    let changes = [
        ("run_vcan0.yaml", "port: can", "port: simulated"),
        (
            "run_vcan0.yaml",
            "vehicles/j8.yaml",
            "vehicles/j8_contact_identified.yaml",
        ),
        (
            "run_vcan0.yaml",
            "course: {shape: figure_eight}",
            "route: {file: ../route.csv}",
        ),
        (
            "vehicle_vcan0.yaml",
            "scenario: ../scenarios/figure_eight.yaml",
            "scenario: ../scenarios/across_slope.yaml",
        ),
        ("vehicle_vcan0.yaml", "# plant: contact", "plant: contact"),
    ];
    let file = configuration("route_on_wheels", &changes);
    let route = "x_m,y_m\n0,0\n0.5,0\n1,0\n1.5,0\n2,0\n";
    std::fs::write(
        file.parent().unwrap().parent().unwrap().join("route.csv"),
        route,
    )
    .unwrap();
    let output = run_to_end(&["run", file.to_str().unwrap(), "--arm", "--duration-s", "30"]);
    let text = String::from_utf8(output.stdout).unwrap();
    let events = String::from_utf8(output.stderr).unwrap();
    let ending = text.lines().last().unwrap();
    assert!(
        ending.contains("\"ended\":\"finished\""),
        "{text}\n{events}"
    );
}

#[test]
fn what_is_wrong_is_named_with_its_file() {
    for (file, old, new, expected) in [
        (
            "can.yaml",
            "signal: TractionSpeed",
            "signal: Tracton",
            "j8.dbc: message DriveCommand has no signal Tracton",
        ),
        (
            "can.yaml",
            "counter_skip_max",
            "counter_skip",
            "unknown field `counter_skip`",
        ),
        ("j8.dbc", "BO_ 256", "B0_ 256", "not a DBC file"),
        (
            "run_vcan0.yaml",
            "deceleration_m_s2: 2.0",
            "deceleration_m_s2: -2.0",
            "safety.deceleration_m_s2: -2 is out of range",
        ),
        (
            "run_vcan0.yaml",
            "can: can.yaml",
            "can: cam.yaml",
            "cam.yaml",
        ),
        (
            "run_vcan0.yaml",
            "decision_time_s: 0.03",
            "decision_time_s: 3",
            "cycle.decision_time_s: 3 is out of range",
        ),
    ] {
        let folder = format!("wrong_{}", new.replace(|c: char| !c.is_alphanumeric(), ""));
        let config = configuration(&folder, &[(file, old, new)]);
        let output = run_to_end(&["run", config.to_str().unwrap()]);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.contains(expected), "{text}");
        assert!(text.contains(".yaml") || text.contains(".dbc"), "{text}");
    }
}

#[test]
fn a_bus_is_not_driven_in_simulated_time() {
    let file = configuration("simulated_time", &[]);
    let file = file.with_file_name("run_can_ros2.yaml");
    let name = file.to_str().unwrap();
    let parameter = ["--ros-args", "-p", "use_sim_time:=true"];
    let by_parameter = run_to_end(&[&["run", name][..], &parameter].concat());
    let text = std::fs::read_to_string(&file).unwrap();
    let simulated = text.replace(
        "  autostart: true",
        "  use_sim_time: true\n  autostart: true",
    );
    assert_ne!(simulated, text);
    std::fs::write(&file, simulated).unwrap();
    for output in [by_parameter, run_to_end(&["check", name])] {
        let complaint = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success(), "{complaint}");
        for part in ["run_can_ros2.yaml", "ros2.use_sim_time"] {
            assert!(complaint.contains(part), "{complaint}");
        }
    }
}

#[test]
fn a_bus_that_is_not_there_is_named_on_the_screen_and_in_json() {
    let file = configuration("no_bus", &[("run_vcan0.yaml", "vcan0", "nocan7")]);
    let run = ["run", file.to_str().unwrap(), "--duration-s", "2.5"];
    let text = run_to_end(&[&run[..], &["--format", "text"]].concat());
    let text = String::from_utf8(text.stdout).unwrap();
    for part in [
        "listens to bus nocan7",
        "traction drive",
        "waits for bus on nocan7: there is no such interface",
        "ended: stopped",
    ] {
        assert!(text.contains(part), "no `{part}` in {text}");
    }
    let json = String::from_utf8(run_to_end(&run).stdout).unwrap();
    let first: serde_json::Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    assert_eq!(first["waits_for"][0]["input"], "bus", "{json}");
    assert_eq!(first["state"], "disarmed");
}

#[test]
fn what_an_earlier_run_recorded_is_kept() {
    let file = configuration("kept", &[("run_vcan0.yaml", "vcan0", "nocan7")]);
    let out = file.with_file_name("records");
    let _ = std::fs::remove_dir_all(&out);
    let names = || {
        let files = std::fs::read_dir(&out).unwrap();
        let mut names: Vec<_> = files.map(|file| file.unwrap().file_name()).collect();
        names.sort();
        names
    };
    for run in 0..2 {
        let arguments = [
            "run",
            file.to_str().unwrap(),
            "--duration-s",
            "0.3",
            "--out",
        ];
        run_to_end(&[&arguments[..], &[out.to_str().unwrap()]].concat());
        let kept = names()
            .iter()
            .filter(|name| *name == "cycles.csv.1")
            .count();
        assert_eq!(kept, run, "{:?}", names());
    }
}

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
            .stderr(output.try_clone().unwrap())
            .stdout(output),
    );
    let drives = |lines: &mut BufReader<File>| {
        let mut line = String::new();
        while lines.read_line(&mut line).unwrap() > 0 {
            let said: serde_json::Value = serde_json::from_str(&line).unwrap_or_default();
            if said["state"] == "driving" {
                return Some(said);
            }
            line.clear();
        }
        None
    };
    drives(&mut lines).expect("it drives");
    drop(lines);
    for _ in 0..100 {
        drop(reader());
        std::thread::sleep(std::time::Duration::from_millis(60));
    }
    // Whoever comes back sees that it drives on, and how many lines nobody has read.
    let said = drives(&mut reader()).expect("it still drives");
    assert!(said["lines_dropped"].as_u64() > Some(2), "{said}");
}

#[test]
fn it_drives_on_when_nobody_reads_and_stops_when_the_connection_drops() {
    let file = configuration("nobody_reads", &SIMULATED);
    let out = file.parent().unwrap().join("out");
    // What an earlier test left would look like a drive.
    let _ = std::fs::remove_dir_all(&out);
    let mut run = Running::start(
        sidehill()
            .args(["run", file.to_str().unwrap(), "--arm", "--out"])
            .arg(&out)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped()),
    );
    // Both ends of its text are gone before it says anything.
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
        Some(1),
        "ended by a signal, not killed by it"
    );
    assert_ne!(states().last().unwrap(), "driving");
}
