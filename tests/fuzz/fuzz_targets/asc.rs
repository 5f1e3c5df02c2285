//! Elevation grids, ESRI ASCII and GeoTIFF.
#![no_main]
use sidehill_fuzz::{Scratch, check_file, target};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::default);

target!(|data| {
    let name = if data.starts_with(b"II") || data.starts_with(b"MM") {
        "fuzz.tif"
    } else {
        "fuzz.asc"
    };
    check_file(&SCRATCH.file(name, data));
});
