//! CAN databases, by the layouts of the repository.
#![no_main]
use sidehill::config::ConfigFile;
use sidehill_can::config::CanConfig;
use sidehill_can::database::Database;
use sidehill_can::layout::Layout;
use sidehill_fuzz::{repository, target};
use std::sync::LazyLock;

static LAYOUTS: LazyLock<[CanConfig; 2]> = LazyLock::new(|| {
    ["can.yaml", "cia402.yaml"].map(|name| {
        let file = ConfigFile::read(&repository("config/bridge").join(name)).expect("a file");
        file.parse().expect("a layout")
    })
});

target!(|data| {
    match Database::parse("fuzz.dbc", &String::from_utf8_lossy(data)) {
        Ok(database) => {
            for layout in LAYOUTS.iter() {
                drop(Layout::new(layout, &database).map_err(|error| error.to_string()));
            }
        }
        Err(error) => drop(error.to_string()),
    }
});
