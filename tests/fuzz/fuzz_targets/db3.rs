//! Bags in SQLite, and such files as a whole compressed by zstd.
#![no_main]
use sidehill::bag::Bag;
use sidehill::drive_log::{LogReader, positions};
use sidehill_fuzz::{Scratch, log_reader, target};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::default);
static READER: LazyLock<LogReader> = LazyLock::new(|| log_reader(&SCRATCH, None, None));

target!(|data| {
    let compressed = data.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]);
    let path = SCRATCH.file(
        if compressed {
            "fuzz.db3.zstd"
        } else {
            "fuzz.db3"
        },
        data,
    );
    let _ = Bag::open(&path, None).map(|bag| positions(&bag, None));
    let _ = READER.read(&path, drop);
});
