use super::*;
use ::mcap::write::WriteOptions;
use ::mcap::write::Writer;
use std::fs;
use tempfile::{TempDir, tempdir};

/// Topic, type, time of recording in ns, and bytes of a message.
pub(crate) type Recorded = (&'static str, &'static str, i64, Vec<u8>);

/// Returns messages as an MCAP file with small chunks.
fn written(folder: &Path, messages: &[Recorded]) -> Vec<u8> {
    let path = folder.join("writing.mcap");
    let file = std::io::BufWriter::new(fs::File::create(&path).unwrap());
    let options = WriteOptions::new().compression(None).chunk_size(Some(200));
    let mut writer = Writer::with_options(file, options).unwrap();
    for (sequence, (topic, message_type, time_ns, data)) in messages.iter().enumerate() {
        let schema = writer.add_schema(message_type, "ros2msg", b"").unwrap();
        let channel = writer
            .add_channel(schema, topic, "cdr", &Default::default())
            .unwrap();
        let header = ::mcap::records::MessageHeader {
            channel_id: channel,
            sequence: sequence as u32,
            log_time: *time_ns as u64,
            publish_time: *time_ns as u64,
        };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    fs::read(&path).unwrap()
}

/// Writes messages as a bag.
pub(crate) fn bag(messages: &[Recorded]) -> (TempDir, PathBuf) {
    let folder = tempdir().unwrap();
    let path = folder.path().join("test.mcap");
    fs::write(&path, written(folder.path(), messages)).unwrap();
    (folder, path)
}

fn texts(bag: &Bag) -> Vec<(String, i64, Vec<u8>)> {
    let mut found = Vec::new();
    bag.read(&mut |message| {
        let name = message.topic.name.clone();
        found.push((name, message.received_ns, message.data.to_vec()));
        Ok(())
    })
    .unwrap();
    found
}

fn thirty() -> Vec<Recorded> {
    (0..30)
        .map(|i| ("/a", "std_msgs/msg/String", 1000 + i, vec![i as u8; 40]))
        .collect()
}

#[test]
fn an_mcap_file_reads_back_in_order() {
    let (_folder, path) = bag(&thirty());
    let bag = Bag::open(&path).unwrap();
    assert!(bag.notes().is_empty());
    let expected: Vec<_> = thirty()
        .into_iter()
        .map(|(topic, _, time_ns, data)| (topic.to_owned(), time_ns, data))
        .collect();
    assert_eq!(texts(&bag), expected);
    assert!(
        bag.topic_list()
            .contains("/a (std_msgs/msg/String, 30 messages)")
    );
}

#[test]
fn a_killed_recording_is_read_to_its_last_whole_message_wherever_it_was_cut() {
    let folder = tempdir().unwrap();
    let whole = written(folder.path(), &thirty());
    let all = {
        let path = folder.path().join("whole.mcap");
        fs::write(&path, &whole).unwrap();
        texts(&Bag::open(&path).unwrap())
    };
    let path = folder.path().join("cut.mcap");
    let mut most = 0;
    // A prime, so that all places within records are met.
    for length in (0..whole.len()).step_by(13) {
        fs::write(&path, &whole[..length]).unwrap();
        match Bag::open(&path) {
            Ok(bag) => {
                let found = texts(&bag);
                assert_eq!(found, all[..found.len()], "cut at {length}");
                assert!(found.len() >= most, "cut at {length}");
                most = found.len();
                // Behind the data only repetitions are missed.
                assert!(
                    found.len() == all.len() || bag.notes().len() == 1,
                    "cut at {length}"
                );
            }
            Err(error) => assert!(
                most == 0 && !error.to_string().is_empty(),
                "cut at {length}"
            ),
        }
    }
    assert_eq!(most, all.len());
}

#[test]
fn a_chunk_whose_length_was_never_written_is_read() {
    let folder = tempdir().unwrap();
    let mut bytes = written(folder.path(), &thirty());
    // What a recorder leaves behind its last finished chunk: opcode, and u64::MAX for all lengths.
    let last_chunk = last_chunk(&bytes);
    let body = &mut bytes[last_chunk + 1..];
    body[..8].fill(0xff);
    // Uncompressed size, checksum; then an empty name of the compression, and the compressed size.
    body[8 + 16..8 + 28].fill(0xff);
    body[8 + 32..8 + 40].fill(0xff);
    let path = folder.path().join("killed.mcap");
    fs::write(&path, &bytes).unwrap();
    let bag = Bag::open(&path).unwrap();
    assert_eq!(texts(&bag).len(), 30);
    assert!(
        bag.notes()[0].contains("its last chunk was not finished"),
        "{:?}",
        bag.notes()
    );
}

/// Returns where the last chunk begins.
fn last_chunk(bytes: &[u8]) -> usize {
    let (mut at, mut last) = (8, 0);
    while bytes[at] != ::mcap::records::op::DATA_END {
        if bytes[at] == ::mcap::records::op::CHUNK {
            last = at;
        }
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    last
}

#[test]
fn a_damaged_chunk_is_named_and_nothing_of_it_is_used() {
    let folder = tempdir().unwrap();
    let mut bytes = written(folder.path(), &thirty());
    let data = bytes
        .windows(40)
        .position(|window| window == [9; 40])
        .unwrap();
    bytes[data] = 77;
    let path = folder.path().join("damaged.mcap");
    fs::write(&path, &bytes).unwrap();
    let error = Bag::open(&path).unwrap_err().to_string();
    assert!(
        error.contains("damaged.mcap: damaged: a chunk has another checksum"),
        "{error}"
    );
}

#[test]
fn what_is_no_bag_is_told_from_one() {
    let folder = tempdir().unwrap();
    let error = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        Bag::open(&path).unwrap_err().to_string()
    };
    assert!(error("a.mcap", b"").contains("a.mcap: not an MCAP file"));
    assert!(error("a.db3", b"").contains("no such table: topics: not a bag"));
    assert!(error("b.db3", &[7; 5000]).contains("not a database"));
    assert!(error("c.db3.zstd", b"nonsense").contains("zstd"));
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let none = Bag::open(&empty).unwrap_err().to_string();
    assert!(none.contains("neither metadata.yaml nor a file"), "{none}");
    fs::write(
        empty.join("metadata.yaml"),
        "rosbag2_bagfile_information: {version: 5}",
    )
    .unwrap();
    let none = Bag::open(&empty).unwrap_err().to_string();
    assert!(
        none.contains("metadata.yaml") && none.contains("relative_file_paths"),
        "{none}"
    );
    assert!(!is_bag(Path::new("log.csv")) && is_bag(Path::new("x_0.DB3.zstd")));
}

#[test]
fn files_without_metadata_are_read_in_the_order_of_their_numbers() {
    let folder = tempdir().unwrap();
    let split = folder.path().join("split");
    fs::create_dir(&split).unwrap();
    for number in [10, 2, 0] {
        let message = ("/a", "std_msgs/msg/String", number, vec![number as u8]);
        let bytes = written(folder.path(), &[message]);
        fs::write(split.join(format!("split_{number}.mcap")), bytes).unwrap();
    }
    let bag = Bag::open(&split).unwrap();
    let times: Vec<i64> = texts(&bag).iter().map(|(_, time_ns, _)| *time_ns).collect();
    assert_eq!(times, [0, 2, 10]);
}
