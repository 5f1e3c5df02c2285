//! Files of what was learned, up to the controller that begins with it: as they are, and with their checksum and, for
//! `OWNER`, their owner put right.
#![no_main]
use sidehill::config::{ConfigFile, DEFAULT_SCENARIO, Overrides, Prepared, Scenario};
use sidehill::learned::LearnedFile;
use sidehill_fuzz::target;
use sidehill_plant::fingerprint::fnv_1a;
use std::sync::{Arc, LazyLock, Mutex};

/// A scenario whose controllers keep what they learn, and the owner of that.
static PREPARED: LazyLock<Mutex<(Prepared, String)>> = LazyLock::new(|| {
    let keys = serde_yaml::from_str("controller: {memory: {}}").expect("a mapping");
    let file = ConfigFile::built_in(DEFAULT_SCENARIO).and_then(|file| file.with_keys(&keys));
    let prepared = file
        .and_then(Scenario::read)
        .and_then(|scenario| scenario.prepare(&Overrides::default()));
    let prepared = prepared.expect("a scenario");
    let learned = prepared
        .controller(prepared.controllers[0])
        .expect("a controller")
        .learned();
    Mutex::new((prepared, learned.expect("memory is on").owner))
});

target!(|data| {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    let (prepared, owner) = &mut *PREPARED.lock().expect("no panic before");
    let (head, body) = text.split_once('\n').unwrap_or((text, ""));
    let format = head.split_once(' ').map_or(head, |(format, _)| format);
    let body = body.trim_end_matches('\n').replace("OWNER", owner);
    let righted = format!("{format} {:016x}\n{body}\n", fnv_1a(body.as_bytes()));
    for text in [text.to_owned(), righted] {
        let Ok(file) = LearnedFile::of(text) else {
            continue;
        };
        prepared.learned = Some(Arc::new(file));
        let _ = prepared.controller(prepared.controllers[0]);
    }
});
