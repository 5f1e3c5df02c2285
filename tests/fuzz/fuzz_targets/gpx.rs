//! Routes in GPX, up to the path that is driven.
#![no_main]
use sidehill_fuzz::{Scratch, check_file, target};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::default);

target!(|data| {
    check_file(&SCRATCH.file("fuzz.gpx", data));
});
