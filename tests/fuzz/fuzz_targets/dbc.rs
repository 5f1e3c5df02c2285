//! CAN databases, by the layouts of the repository.
#![no_main]
use sidehill_fuzz::{Scratch, check_file, repository, target};
use std::path::PathBuf;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::default);
static LAYOUTS: LazyLock<[PathBuf; 2]> = LazyLock::new(|| {
    [("can.yaml", "j8.dbc"), ("cia402.yaml", "cia402.dbc")].map(|(layout, database)| {
        let text =
            std::fs::read_to_string(repository("config/bridge").join(layout)).expect("a layout");
        assert!(text.contains(database));
        SCRATCH.file(layout, text.replace(database, "fuzz.dbc").as_bytes())
    })
});

target!(|data| {
    SCRATCH.file("fuzz.dbc", data);
    for layout in LAYOUTS.iter() {
        check_file(layout);
    }
});
