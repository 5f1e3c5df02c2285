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
    let bag = Bag::open(&path, None).unwrap();
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
fn compressed_messages_are_read_without_the_metadata_that_says_so() {
    let compress = |bytes: &[u8]| {
        ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest)
    };
    let packed: Vec<Recorded> = thirty()
        .into_iter()
        .map(|(topic, kind, time_ns, data)| (topic, kind, time_ns, compress(&data)))
        .collect();
    let (_plain, plain) = bag(&thirty());
    let (_packed, packed) = bag(&packed);
    let read = |path| texts(&Bag::open(path, None).unwrap());
    assert_eq!(read(&packed), read(&plain));
}

#[test]
fn a_killed_recording_is_read_to_its_last_whole_message_wherever_it_was_cut() {
    let folder = tempdir().unwrap();
    let whole = written(folder.path(), &thirty());
    let all = {
        let path = folder.path().join("whole.mcap");
        fs::write(&path, &whole).unwrap();
        texts(&Bag::open(&path, None).unwrap())
    };
    let path = folder.path().join("cut.mcap");
    let mut most = 0;
    // A prime, so that all places within records are met.
    for length in (0..whole.len()).step_by(13) {
        fs::write(&path, &whole[..length]).unwrap();
        match Bag::open(&path, None) {
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
    let bag = Bag::open(&path, None).unwrap();
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
    let error = Bag::open(&path, None).unwrap_err().to_string();
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
        Bag::open(&path, None).unwrap_err().to_string()
    };
    assert!(error("a.mcap", b"").contains("a.mcap: nothing was written to it"));
    assert!(error("a.mcap", b"MCAP").contains("a.mcap: not an MCAP file"));
    assert!(error("a.db3", b"").contains("a.db3: nothing was written to it"));
    assert!(error("b.db3", &[7; 5000]).contains("not a database"));
    assert!(error("c.db3.zstd", b"nonsense").contains("zstd"));
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let none = Bag::open(&empty, None).unwrap_err().to_string();
    assert!(none.contains("neither metadata.yaml nor a file"), "{none}");
    fs::write(
        empty.join("metadata.yaml"),
        "rosbag2_bagfile_information: {version: 5}",
    )
    .unwrap();
    let none = Bag::open(&empty, None).unwrap_err().to_string();
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
    let bag = Bag::open(&split, None).unwrap();
    let times: Vec<i64> = texts(&bag).iter().map(|(_, time_ns, _)| *time_ns).collect();
    assert_eq!(times, [0, 2, 10]);
}

fn record(op: u8, body: &[u8]) -> Vec<u8> {
    [&[op][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// An MCAP file of a chunk of zeros, compressed by zstd as blocks of one repeated byte.
fn zeros_as_chunk(megabytes: usize) -> Vec<u8> {
    // A frame of 8 MiB windows; a block of 128 KiB of one byte has four bytes.
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x68];
    let blocks = 8 * megabytes;
    for block in 0..blocks {
        let last = u32::from(block + 1 == blocks);
        let header = last | (1 << 1) | ((128 << 10) << 3);
        frame.extend_from_slice(&header.to_le_bytes()[..3]);
        frame.push(0);
    }
    let mut body = vec![0; 28];
    body[16..24].copy_from_slice(&((megabytes as u64) << 20).to_le_bytes());
    body.extend_from_slice(&4_u32.to_le_bytes());
    body.extend_from_slice(b"zstd");
    body.extend_from_slice(&(frame.len() as u64).to_le_bytes());
    body.extend_from_slice(&frame);
    let magic: &[u8] = ::mcap::MAGIC;
    [magic, &record(::mcap::records::op::CHUNK, &body)].concat()
}

#[test]
fn what_a_small_file_decompresses_to_is_limited() {
    let folder = tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8], max_bytes: Option<u64>| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        Bag::open(&path, max_bytes).unwrap_err().to_string()
    };
    let bomb = zeros_as_chunk(100);
    assert!(bomb.len() < 4_000);
    let error = refused("a.mcap", &bomb, None);
    assert!(
        error.contains("a.mcap") && error.contains("more than 64 MB when decompressed"),
        "{error}"
    );
    assert!(error.contains("--max-bytes"), "{error}");
    // Allowed, it is only damaged: zeros are no records.
    let error = refused("b.mcap", &bomb, Some(1 << 30));
    assert!(!error.contains("--max-bytes"), "{error}");
    let error = refused("c.mcap", &zeros_as_chunk(200), Some(1 << 30));
    assert!(error.contains("a record is larger than 134 MB"), "{error}");
    let frame = &bomb[8 + 9 + 28 + 8 + 8..];
    let error = refused("d.db3.zstd", frame, None);
    assert!(
        error.contains("d.db3.zstd") && error.contains("64 MB"),
        "{error}"
    );
}

/// Writes a file of rosbag2 with this definition of its messages.
fn database(path: &Path, messages: &str) {
    let database = rusqlite::Connection::open(path).unwrap();
    let topics = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT); \
                  INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/String', 'cdr');";
    database
        .execute_batch(&format!("{topics}{messages}"))
        .unwrap();
}

#[test]
fn messages_that_are_not_stored_are_not_read() {
    let folder = tempdir().unwrap();
    let error = |name: &str, messages: &str| {
        let path = folder.path().join(name);
        database(&path, messages);
        Bag::open(&path, None).unwrap_err().to_string()
    };
    let endless = "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) \
                   SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n;";
    let found = error("view.db3", endless);
    assert!(
        found.contains("view.db3: the view messages is computed"),
        "{found}"
    );
    let grown = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, \
                 data BLOB AS (zeroblob(100000000))); INSERT INTO messages VALUES (1, 1, 1);";
    let found = error("column.db3", grown);
    assert!(
        found.contains("the column data of messages is computed"),
        "{found}"
    );
    let path = folder.path().join("sound.db3");
    database(
        &path,
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB); \
         INSERT INTO messages VALUES (1, 1, 5, x'0102');",
    );
    assert_eq!(
        texts(&Bag::open(&path, None).unwrap()),
        [("/a".to_owned(), 5, vec![1, 2])]
    );
}

#[test]
fn what_a_power_cut_leaves_is_read_as_far_as_it_was_written() {
    let folder = tempdir().unwrap();
    let whole = written(folder.path(), &thirty());
    let bag = folder.path().join("bag");
    fs::create_dir(&bag).unwrap();
    fs::write(bag.join("bag_0.mcap"), &whole).unwrap();
    fs::write(bag.join("bag_1.mcap"), b"").unwrap();
    fs::write(bag.join("bag_2.mcap"), [0; 4096]).unwrap();
    fs::write(bag.join("metadata.yaml"), b"").unwrap();
    let found = Bag::open(&bag, None).unwrap();
    assert_eq!(texts(&found).len(), 30);
    let notes = found.notes().join("\n");
    for part in [
        "metadata.yaml is empty",
        "bag_1.mcap: nothing was written",
        "bag_2.mcap: nothing",
    ] {
        assert!(notes.contains(part), "{notes}");
    }
}

#[test]
fn a_file_that_metadata_names_and_the_folder_lacks_is_named_with_the_remedy() {
    let folder = tempdir().unwrap();
    let whole = written(folder.path(), &thirty());
    let bag = folder.path().join("bag");
    fs::create_dir(&bag).unwrap();
    fs::write(bag.join("renamed_0.mcap"), &whole).unwrap();
    let metadata = "rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap]}\n";
    fs::write(bag.join("metadata.yaml"), metadata).unwrap();
    let error = Bag::open(&bag, None).unwrap_err().to_string();
    for says in ["metadata.yaml: names bag_0.mcap", "delete metadata.yaml"] {
        assert!(error.contains(says), "{error}");
    }
    fs::remove_file(bag.join("metadata.yaml")).unwrap();
    assert_eq!(texts(&Bag::open(&bag, None).unwrap()).len(), 30);
}

#[test]
fn zeros_behind_what_was_written_are_no_records() {
    let folder = tempdir().unwrap();
    let mut bytes = written(folder.path(), &thirty());
    let whole_chunks = last_chunk(&bytes);
    bytes.truncate(whole_chunks);
    bytes.resize(whole_chunks + 8192, 0);
    let path = folder.path().join("cut.mcap");
    fs::write(&path, &bytes).unwrap();
    let bag = Bag::open(&path, None).unwrap();
    let count = texts(&bag).len();
    assert!((20..30).contains(&count), "{count}");
    assert!(
        bag.notes()[0].contains("interrupted (its rest is empty)"),
        "{:?}",
        bag.notes()
    );
}

#[test]
fn files_that_stand_for_others_name_the_remedy() {
    let folder = tempdir().unwrap();
    let error = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        Bag::open(&path, None).unwrap_err().to_string()
    };
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 5\n";
    for name in ["a_0.db3", "a_0.mcap"] {
        let found = error(name, pointer);
        assert!(found.contains("git lfs pull"), "{found}");
    }
    let found = error("b.mcap", "#ROSBAG V2.0\n");
    assert!(found.contains("rosbags-convert"), "{found}");
}
