use super::*;
use crate::ros2::node::message::Text;
use crate::ros2::node::message::cdr::to_cdr;
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
    // A later file says where the first is.
    let error = Recording::read(&McapRecording::part_name(&path, 1)).unwrap_err();
    assert!(
        error.to_string().contains("part 1 of a recording"),
        "{error}"
    );
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
