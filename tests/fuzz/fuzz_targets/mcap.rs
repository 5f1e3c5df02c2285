//! Bags and recordings in MCAP.
#![no_main]
use sidehill::bag::Bag;
use sidehill::drive_log::{LogReader, positions};
use sidehill_fuzz::{Scratch, log_reader, target};
use sidehill_plant::speeds::EncoderScale;
use sidehill_recording::Recording;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::default);
static READERS: LazyLock<[LogReader; 2]> = LazyLock::new(|| {
    let map = "{tread_speeds: {kind: joint_states, radius_m: 0.1}, commands: {topic: /cmd_vel, track_width_m: 1}, \
               pose: {kind: tf, frame: map}, attitude: {kind: imu, axes: ned}}";
    [None, Some(map)].map(|map| log_reader(&SCRATCH, None, map))
});

target!(|data| {
    let path = SCRATCH.file("fuzz.mcap", data);
    let _ = Recording::read(&path);
    let _ = Bag::open(&path, None).map(|bag| positions(&bag, None));
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
