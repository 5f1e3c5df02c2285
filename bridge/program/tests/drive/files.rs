//! What a drive writes: its records, and what it has learned.

use super::{SIMULATED, configuration, run_to_end};
use crate::running::Running;
use crate::sidehill;
use sidehill_recording::{McapRecording, MessageSink, RecordLimits, Recording, Topic, scan};
use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::time::{Duration, Instant};

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
    // A damaged file does not prevent driving, and is kept.
    let events = drive(&[]);
    for part in ["j8.learned: refused: the file is", "nothing learned"] {
        assert!(events.contains(part), "{part}: {events}");
    }
    let set_aside = std::fs::read_to_string(beside("j8.learned.1")).unwrap();
    assert_eq!(set_aside, &second[..second.len() / 2]);
    assert!(std::fs::read_to_string(&kept).unwrap().contains("gains"));
}

#[test]
fn a_killed_drive_keeps_what_it_had_learned_before() {
    let mut changes = SIMULATED;
    changes[0].2 = "port: simulated\nlearned: {file: j8.learned, every_s: 1}";
    let file = configuration("killed", &changes);
    let kept = file.with_file_name("j8.learned");
    let _ = std::fs::remove_file(&kept);
    let arguments = ["--arm", "--duration-s"];
    let mut run = Running::start(
        sidehill()
            .arg("run")
            .arg(&file)
            .args(arguments)
            .arg("60")
            .stdout(Stdio::null())
            .stderr(Stdio::null()),
    );
    let deadline = Instant::now() + Duration::from_secs(30);
    while !kept.exists() {
        assert!(Instant::now() < deadline, "nothing was written");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(run.0.try_wait().unwrap().is_none(), "it still drives");
    drop(run);
    let output = run_to_end(&[
        "run",
        file.to_str().unwrap(),
        arguments[0],
        arguments[1],
        "2",
    ]);
    let events = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{events}");
    let says = "j8.learned: begins with what was learned";
    assert!(events.contains(says), "{events}");
}

#[test]
fn a_recording_without_its_first_file_is_replayed_from_where_it_was_armed() {
    let file = configuration("first_file_deleted", &SIMULATED);
    let whole = file.with_file_name("drive.mcap");
    let mut run = Running::start(
        sidehill()
            .arg("run")
            .arg(&file)
            .args([
                "--log-level",
                "debug",
                "--duration-s",
                "8",
                "--force",
                "--record",
            ])
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
    let left = file.with_file_name("cut_1.mcap");
    let _ = std::fs::remove_file(&left);
    let limits = RecordLimits {
        max_size: 1.0,
        split: true,
        keep: 1,
    };
    let mut recording = McapRecording::create(&cut, header, limits, false).unwrap();
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
    let page = file.with_file_name("replay.html");
    let report = ["--force", "--report", page.to_str().unwrap()];
    let replay = ["replay", left.to_str().unwrap(), "--format", "json"];
    let output = run_to_end(&[&replay[..], &report].concat());
    // The ground of a real drive is known by the attitude alone: here the 5.3 deg of the figure of eight.
    let page = std::fs::read_to_string(page).unwrap();
    let ground = |key: &str| -> Vec<f64> {
        let numbers = page
            .split_once(&format!("\"{key}\":["))
            .and_then(|(_, rest)| rest.split_once(']'))
            .unwrap_or_else(|| panic!("no {key} of the ground"));
        let numbers = numbers.0.split(',');
        numbers.map(|value| value.parse().unwrap()).collect()
    };
    let (size_m, heights_m) = (ground("size"), ground("heights"));
    let gradient = [
        (heights_m[1] - heights_m[0]) / size_m[0],
        (heights_m[2] - heights_m[0]) / size_m[1],
    ];
    let slope_deg = gradient[0].hypot(gradient[1]).atan().to_degrees();
    assert!((5.0..5.6).contains(&slope_deg), "{slope_deg}");
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
