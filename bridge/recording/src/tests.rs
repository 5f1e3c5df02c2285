use super::*;
use sidehill_bridge::ros2::message::Text;
use sidehill_bridge::ros2::message::cdr::to_cdr;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn header() -> Header {
    let mut header = Header::default();
    header.facts.insert("recording".into(), "7".into());
    header.files.insert("a/b.yaml".into(), "name: b".into());
    header
}

/// Records cycles until the files have about so many bytes.
fn record(path: &Path, limits: RecordLimits, bytes: usize) -> RecordingStatus {
    let mut recording = McapRecording::create(path, header(), limits, false).unwrap();
    for index in 0..bytes / 1000 {
        let cycle = ControllerCycle {
            index: index as u64,
            time_s: 0.05 * index as f64,
            status: "x".repeat(700),
            ..ControllerCycle::default()
        };
        recording.put(
            Topic::ControllerCycle,
            index as u64,
            &to_cdr(&cycle).unwrap(),
        );
    }
    recording.finish()
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn a_recording_goes_on_in_new_files_and_is_read_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let limits = RecordLimits {
        max_size: 1.0,
        ..RecordLimits::default()
    };
    let status = record(&path, limits, 3_500_000);
    assert_eq!(status.ended, None);
    assert_eq!(files(folder.path()).len(), 4);
    for file in files(folder.path()) {
        assert!(std::fs::metadata(file).unwrap().len() < 1_200_000);
    }
    let read = Recording::read(&path).unwrap();
    assert_eq!(read.header.files, header().files);
    assert_eq!((read.cycles.len(), read.damaged), (3500, None));
    assert!(
        read.cycles
            .iter()
            .enumerate()
            .all(|(i, cycle)| cycle.index == i as u64)
    );
    // Whichever is named, all are read; without the first, those that are left.
    let third = McapRecording::part_name(&path, 2);
    let read = Recording::read(&third).unwrap();
    assert_eq!((read.cycles.len(), read.files.len()), (3500, 4));
    std::fs::remove_file(&path).unwrap();
    let read = Recording::read(&third).unwrap();
    assert_eq!(read.files.len(), 3);
    assert!(read.cycles[0].index > 900);
}

#[test]
fn nothing_recorded_is_lost_by_recording_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let part = |number| McapRecording::part_name(&path, number);
    let limits = RecordLimits {
        max_size: 1.0,
        split: true,
        keep: 2,
    };
    record(&path, limits, 3_500_000);
    // What an incident left, a file of another name's pattern, and a link to a file elsewhere.
    let elsewhere = folder.path().join("elsewhere.txt");
    std::fs::write(&elsewhere, "not a recording").unwrap();
    std::os::unix::fs::symlink(&elsewhere, part(5)).unwrap();
    std::fs::write(folder.path().join("drive_02.mcap"), "").unwrap();
    let present = McapRecording::present(&path).unwrap();
    assert_eq!(present, [2, 3, 5].map(|number| (number, part(number))));
    let kept: Vec<_> = [2, 3]
        .map(|number| std::fs::read(part(number)).unwrap())
        .into();
    // The first file is gone, so its name is free.
    let all = RecordLimits { keep: 0, ..limits };
    let mut header = header();
    header.facts.insert("recording".into(), "8".into());
    let mut recording = McapRecording::create(&path, header, all, false).unwrap();
    for index in 0..5_000 {
        let cycle = ControllerCycle {
            index,
            status: "x".repeat(700),
            ..ControllerCycle::default()
        };
        recording.put(Topic::ControllerCycle, index, &to_cdr(&cycle).unwrap());
    }
    recording.finish();
    assert_eq!(
        std::fs::read_to_string(&elsewhere).unwrap(),
        "not a recording"
    );
    let still: Vec<_> = [2, 3]
        .map(|number| std::fs::read(part(number)).unwrap())
        .into();
    assert!(still == kept, "a part of another recording was replaced");
    let read = Recording::read(&part(4)).unwrap();
    assert_eq!(read.cycles.len(), 5_000);
    assert_eq!(read.files, [0, 1, 4, 6, 7, 8].map(part));
    let earlier = Recording::read(&part(3)).unwrap();
    assert_eq!(earlier.files, [part(2), part(3)]);
}

#[test]
fn messages_of_another_layout_are_refused_with_both_versions() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let header = Header {
        facts: BTreeMap::from([("version".to_owned(), "9.1.0".to_owned())]),
        ..Header::default()
    };
    McapRecording::create(&path, header, RecordLimits::default(), false)
        .unwrap()
        .finish();
    assert!(Recording::read(&path).is_ok());
    // A key, and the length of its value.
    let fact = b"format\x01\0\0\0";
    let mut bytes = std::fs::read(&path).unwrap();
    let place = bytes.windows(fact.len()).position(|part| part == fact);
    bytes[place.unwrap() + fact.len()] = b'7';
    std::fs::write(&path, &bytes).unwrap();
    let error = Recording::read(&path).unwrap_err().to_string();
    for part in ["drive.mcap", "layout 7", "layout 2", "9.1.0"] {
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn a_file_is_replaced_only_where_that_is_asked_for_and_nobody_records_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let create = |replace| McapRecording::create(&path, header(), RecordLimits::default(), replace);
    let first = create(false).unwrap();
    assert!(create(false).is_err());
    let error = create(true).err().unwrap().to_string();
    assert!(error.contains("another program is recording"), "{error}");
    first.finish();
    create(true).unwrap().finish();
    let target = folder.path().join("target.txt");
    std::fs::rename(&path, &target).unwrap();
    let before = std::fs::read(&target).unwrap();
    std::os::unix::fs::symlink(&target, &path).unwrap();
    assert!(create(false).is_err());
    create(true).unwrap().finish();
    assert_eq!(std::fs::read(&target).unwrap(), before);
    assert!(!std::fs::symlink_metadata(&path).unwrap().is_symlink());
}

#[test]
fn only_the_newest_files_are_kept_and_a_full_one_may_end_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let limits = RecordLimits {
        max_size: 1.0,
        split: true,
        keep: 2,
    };
    record(&path, limits, 4_500_000);
    let kept = files(folder.path());
    assert_eq!(
        kept,
        [3, 4].map(|part| McapRecording::part_name(&path, part))
    );
    let path = folder.path().join("one.mcap");
    let limits = RecordLimits {
        max_size: 1.0,
        split: false,
        keep: 0,
    };
    let status = record(&path, limits, 4_500_000);
    assert!(status.ended.unwrap().contains("record.max_size"));
    assert!(Recording::read(&path).unwrap().cycles.len() > 900);
}

#[test]
fn what_the_disk_refuses_ends_the_recording_and_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    let path = inner.join("drive.mcap");
    let limits = RecordLimits {
        max_size: 1.0,
        ..RecordLimits::default()
    };
    let mut recording = McapRecording::create(&path, header(), limits, false).unwrap();
    std::fs::remove_dir_all(&inner).unwrap();
    let message = to_cdr(&Text {
        data: "x".repeat(10_000),
    })
    .unwrap();
    for i in 0..300 {
        recording.put(Topic::Events, i, &message);
    }
    let ended = recording.status().ended.clone().unwrap();
    assert!(ended.contains("drive"), "{ended}");
    assert!(McapRecording::create(&path, header(), limits, false).is_err());
}

#[test]
fn a_file_that_was_not_closed_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let mut recording =
        McapRecording::create(&path, header(), RecordLimits::default(), false).unwrap();
    let mut sizes = Vec::new();
    for index in 0..3000 {
        let cycle = ControllerCycle {
            index,
            status: "x".repeat(700),
            ..ControllerCycle::default()
        };
        recording.put(Topic::ControllerCycle, index, &to_cdr(&cycle).unwrap());
        let bytes = std::fs::read(&path).unwrap();
        if sizes.last() != Some(&bytes.len()) {
            sizes.push(bytes.len());
            // The reader of the library asks for a proper end.
            let messages = mcap::MessageStream::new(&bytes).unwrap();
            assert!(messages.map(Result::unwrap).count() <= index as usize + 1);
        }
    }
    assert!(sizes.len() >= 3, "{sizes:?}");
}

/// Returns where the first chunk of a file begins.
fn first_chunk(bytes: &[u8]) -> usize {
    let mut at = 8;
    while bytes[at] != mcap::records::op::CHUNK {
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    at
}

#[test]
fn a_damaged_recording_is_read_as_far_as_it_is_sound() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    record(&path, RecordLimits::default(), 40_000);
    let sound = std::fs::read(&path).unwrap();
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Recording::read(&path).unwrap()
    };
    assert_eq!(read(&sound).cycles.len(), 40);
    let chunk = first_chunk(&sound);
    // Behind the header of the chunk, whose compression has no name, each record has a length.
    let records = chunk + 9 + 28 + 4 + 8;
    let length = |at: usize| u64::from_le_bytes(sound[at + 1..at + 9].try_into().unwrap());
    let second = records + 9 + length(records) as usize;
    for longer in [1, 1_000_000, u64::MAX / 2, u64::MAX] {
        let mut damaged = sound.clone();
        damaged[second + 1..second + 9]
            .copy_from_slice(&length(second).saturating_add(longer).to_le_bytes());
        let found = read(&damaged);
        assert!(
            found.cycles.len() <= 40 && found.damaged.is_some(),
            "{longer}"
        );
    }
    // One bit of a number: nothing but the checksum shows it.
    let mut flipped = sound.clone();
    flipped[second - 20] ^= 1;
    let found = read(&flipped);
    assert!(found.cycles.len() < 40);
    assert_eq!(
        found.damaged.as_deref(),
        Some("a chunk has another checksum than was recorded")
    );
    // What a power cut leaves of a file whose room was given before it was written.
    let mut zeros = sound[..chunk].to_vec();
    zeros.resize(chunk + 10_000, 0);
    let found = read(&zeros);
    assert_eq!(found.damaged.as_deref(), Some("its rest is empty"));
}

/// Kinds of panels of Lichtblick, `packages/suite-base/src/panels/index.ts`.
const PANELS: [&str; 5] = ["3D", "Plot", "DiagnosticSummary", "RosOut", "Parameters"];

/// Returns the names of the panels of a layout's tree.
fn panels(tree: &serde_json::Value) -> Vec<String> {
    match tree.as_str() {
        Some(name) => vec![name.to_owned()],
        None => [panels(&tree["first"]), panels(&tree["second"])].concat(),
    }
}

#[test]
fn the_layout_shows_topics_and_fields_that_there_are() {
    let layout = include_str!("../../../config/foxglove_layout.json");
    let layout: serde_json::Value = serde_json::from_str(layout).unwrap();
    let configured = layout["configById"].as_object().unwrap();
    let mut shown = panels(&layout["layout"]);
    shown.sort();
    assert_eq!(shown, configured.keys().cloned().collect::<Vec<_>>());
    let topic = |name: &str| {
        let topic = Topic::ALL.into_iter().find(|topic| topic.name() == name);
        topic.unwrap_or_else(|| panic!("no topic {name}"))
    };
    for (panel, config) in configured {
        let (kind, _) = panel.split_once('!').unwrap();
        assert!(PANELS.contains(&kind), "{panel}");
        for name in config["topics"]
            .as_object()
            .into_iter()
            .flat_map(|all| all.keys())
        {
            topic(name);
        }
        if let Some(name) = config["topicToRender"].as_str() {
            topic(name);
        }
        for path in config["paths"].as_array().into_iter().flatten() {
            let (name, field) = path["value"].as_str().unwrap().split_once('.').unwrap();
            let schema = topic(name).schema();
            let is_field = |line: &str| line.split_whitespace().nth(1) == Some(field);
            assert!(schema.lines().any(is_field), "{name}.{field}");
        }
    }
}
