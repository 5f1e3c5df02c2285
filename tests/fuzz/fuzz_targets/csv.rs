//! Paths and logs in CSV, the latter also as their readers with a map of columns take them.
#![no_main]
use sidehill::drive_log::LogReader;
use sidehill_fuzz::{Scratch, check_file, log_reader, target};
use sidehill_plant::speeds::EncoderScale;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::default);
static READERS: LazyLock<[LogReader; 2]> = LazyLock::new(|| {
    let map = "{time: t, tread_speed_left: l, tread_speed_right: r, \
               attitude: {kind: quaternion, x: qx, y: qy, z: qz, w: qw}, \
               pose: {x: x, y: y, z: z, heading: {kind: quaternion, x: qx, y: qy, z: qz, w: qw}, repeats: true}, \
               commands: {kind: treads, left: cl, right: cr}}";
    [None, Some(map)].map(|map| log_reader(&SCRATCH, map, None))
});

target!(|data| {
    let path = SCRATCH.file("fuzz.csv", data);
    check_file(&path);
    for reader in READERS.iter() {
        let _ = reader.read(&path, drop);
        let _ = reader.read_commands(
            &path,
            &EncoderScale {
                left: 1.0,
                right: 1.0,
            },
            drop,
        );
    }
});
