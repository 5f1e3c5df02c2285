use super::*;
use sidehill_bridge::ros2::message::Text;
use sidehill_bridge::ros2::message::cdr::to_cdr;
use std::path::{Path, PathBuf};

fn header() -> Header {
    let mut header = Header::default();
    header.facts.insert("recording".into(), "7".into());
    header.files.insert("a/b.yaml".into(), "name: b".into());
    header
}

/// Records cycles until the files have about so many bytes.
fn record(path: &Path, limits: RecordLimits, bytes: usize) -> RecordingStatus {
    let mut recording = McapRecording::create(path, header(), limits).unwrap();
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
fn a_recording_made_before_there_was_a_yaw_rate_is_read_without_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.mcap");
    let cycle = ControllerCycle {
        index: 3,
        has_attitude: true,
        roll_rad: 0.1,
        // Text before the last field, whose length shifts it.
        solver_path: "odd".into(),
        solve_us: 42.0,
        ..ControllerCycle::default()
    };
    let topic = Topic::ControllerCycle;
    let (schema, bytes) = (topic.schema(), to_cdr(&cycle).unwrap());
    let (old_schema, _) = schema.split_once("bool has_yaw_rate").unwrap();
    let mut file = mcap::Writer::new(std::fs::File::create(&path).unwrap()).unwrap();
    let sidehill = mcap::records::Metadata {
        name: "sidehill".into(),
        metadata: header().facts,
    };
    file.write_metadata(&sidehill).unwrap();
    let schema = file.add_schema(&topic.type_name(), "ros2msg", old_schema.as_bytes());
    let no_metadata = std::collections::BTreeMap::new();
    let channel = file.add_channel(schema.unwrap(), topic.name(), "cdr", &no_metadata);
    let header = mcap::records::MessageHeader {
        channel_id: channel.unwrap(),
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    file.write_to_known_channel(&header, &bytes[..bytes.len() - 24])
        .unwrap();
    file.finish().unwrap();
    let read = Recording::read(&path).unwrap();
    let [old] = &read.cycles[..] else {
        panic!("{read:?}");
    };
    assert_eq!((old.index, old.solve_us), (3, 42.0));
    assert_eq!(old.sample().attitude.unwrap().value.roll_rad, 0.1);
    assert_eq!(old.sample().yaw_rate, None);
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
    let mut recording = McapRecording::create(&path, header(), limits).unwrap();
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
    assert!(McapRecording::create(&path, header(), limits).is_err());
}

#[test]
fn a_file_that_was_not_closed_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let mut recording = McapRecording::create(&path, header(), RecordLimits::default()).unwrap();
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
