//! What the fuzz targets share: a file that is read as users' files are, limits, and a mutation that makes inputs long.

use rustix::time::{ClockId, clock_gettime};
use sidehill::check::check;
use sidehill::config::ConfigFile;
use sidehill::drive_log::{LogArgs, LogReader};
use sidehill_controller::path::{read_csv, read_gpx};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Most time of the processor that reading an input may take, s. Time that other programs take does not count.
const TIME_MAX_S: f64 = 1.0;
/// Length to which [`stretch`] lengthens, bytes.
const STRETCHED: usize = 100_000;

/// A folder in memory, where the system has one.
pub struct Scratch(TempDir);

impl Default for Scratch {
    fn default() -> Self {
        let made = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir());
        Self(made.expect("a temporary folder"))
    }
}

impl Scratch {
    /// Returns the name of a file in the folder, with this content.
    pub fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("room for a file");
        path
    }
}

/// Returns a reader of logs with maps of columns and topics in these texts.
pub fn log_reader(scratch: &Scratch, columns: Option<&str>, topics: Option<&str>) -> LogReader {
    let map = |name, text: Option<&str>| text.map(|text| scratch.file(name, text.as_bytes()));
    let args = LogArgs {
        columns: map("columns.yaml", columns),
        topics: map("topics.yaml", topics),
        max_bytes: None,
    };
    LogReader::new(&args).expect("sound maps")
}

/// Returns a folder of the repository.
pub fn repository(folder: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(folder)
}

/// Longest path that is smoothed, m: smoothing takes time in proportion to the length, up to 0.4 ms a metre in this build.
pub const PATH_MAX_M: f64 = 2000.0;

/// Does what `sidehill check` does with a file; of a longer path than [`PATH_MAX_M`] only reads it.
pub fn check_file(path: &Path) {
    let Ok(file) = ConfigFile::read(path) else {
        return;
    };
    let text = file.text().as_bytes();
    let route = match file.ending().as_deref() {
        Some("gpx") => read_gpx(text, None).ok(),
        Some("csv") => read_csv(text).ok(),
        _ => None,
    };
    let points = route.map(|route| route.points).unwrap_or_default();
    let legs_m = points
        .windows(2)
        .map(|pair| pair[0].position.distance_m(&pair[1].position));
    if legs_m.sum::<f64>() <= PATH_MAX_M {
        let _ = check(file);
    }
}

/// Runs `read`; a panic says so if it takes too long.
pub fn in_time(read: impl FnOnce()) {
    let now_s = || {
        let now = clock_gettime(ClockId::ThreadCPUTime);
        now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
    };
    let begun_s = now_s();
    read();
    let took_s = now_s() - begun_s;
    assert!(took_s < TIME_MAX_S, "took {took_s:.2} s");
}

/// Changes an input as libFuzzer does; one in 64 gets a piece repeated until it is long.
pub fn mutate(data: &mut [u8], size: usize, size_max: usize, seed: u32) -> usize {
    let size = libfuzzer_sys::fuzzer_mutate(data, size, size_max);
    if seed % 64 == 0 {
        stretch(data, size, size_max, seed / 64)
    } else {
        size
    }
}

fn stretch(data: &mut [u8], size: usize, size_max: usize, seed: u32) -> usize {
    let size_max = size_max.min(STRETCHED);
    if size == 0 || size >= size_max {
        return size;
    }
    let from = seed as usize % size;
    let length = 1 + (seed as usize / size) % (size - from).min(400);
    let piece = data[from..from + length].to_vec();
    let rest = data[from + length..size].to_vec();
    let repetitions = 1 + (size_max - size) / length;
    let mut at = from;
    for _ in 0..repetitions {
        data[at..at + length].copy_from_slice(&piece);
        at += length;
    }
    data[at..at + rest.len()].copy_from_slice(&rest);
    at + rest.len()
}

/// Defines a target by what is done with the bytes of an input.
#[macro_export]
macro_rules! target {
    (|$data:ident| $body:block) => {
        libfuzzer_sys::fuzz_target!(|$data: &[u8]| { $crate::in_time(|| $body) });
        libfuzzer_sys::fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
            $crate::mutate(data, size, max_size, seed)
        });
    };
}
