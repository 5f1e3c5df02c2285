//! Files of what was learned: written atomically, identified by vehicle, date and a checksum.
//!
//! The first line contains the format and the checksum (FNV-1a, 64 bits) of the JSON that follows.

use crate::limits;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use sidehill_controller::memory::Learned;
use sidehill_plant::fingerprint::fnv_1a;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// First word of a file, without the number of its layout.
const KIND: &str = "sidehill-learned-";
/// Number of the layout that is written and read.
const LAYOUT: &str = "2";

/// Default maximum age of what was learned, days.
pub const DAYS_MAX: f64 = 90.0;

/// Where what was learned is kept, and when.
#[derive(Debug, Clone)]
pub struct KeptFile {
    /// The file.
    pub path: PathBuf,
    /// Age beyond which it is refused, days.
    pub days_max: f64,
    /// Time of driving after which it is written again, s.
    pub every_s: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LearnedContents {
    /// When it was saved, s since 1970.
    saved_unix_s: f64,
    /// Share of the gains' uncertainty that has been removed.
    confidence: f64,
    learned: Learned,
}

/// Replaces the file atomically, through a temporary file beside it, so that a complete file exists even if the
/// program is killed or the power fails.
///
/// # Errors
/// An I/O error; the file is then unchanged.
pub fn save(path: &Path, learned: &Learned) -> Result<()> {
    let contents = LearnedContents {
        saved_unix_s: now_unix_s(),
        confidence: learned.confidence(),
        learned: learned.clone(),
    };
    let body = serde_json::to_string(&contents)?;
    let text = format!("{KIND}{LAYOUT} {:016x}\n{body}\n", fnv_1a(body.as_bytes()));
    replace(path, text.as_bytes())
        .with_context(|| format!("{}: what was learned cannot be written", path.display()))
}

/// Replaces the content of a file. The temporary file always has the same name, so that killed programs leave at
/// most one.
fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let mut file = std::fs::File::create(&beside)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    std::fs::rename(&beside, path)?;
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    std::fs::File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

/// The content of a file.
pub struct LearnedFile {
    /// Its text, stored in recordings.
    pub text: String,
    /// What was learned.
    pub learned: Learned,
}

impl LearnedFile {
    /// Returns the file with this text, whatever its age.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn of(text: String) -> Result<Self> {
        let learned = parse(&text)?.learned;
        Ok(Self { text, learned })
    }
}

/// Reads what was learned.
///
/// # Errors
/// Names the file and why it is refused: it cannot be read, has another format, is damaged, or is older than
/// `days_max`.
pub fn load(path: &Path, days_max: f64) -> Result<LearnedFile> {
    let name = || path.display().to_string();
    let bytes = limits::read(path).with_context(name)?;
    let read = |bytes| -> Result<LearnedFile> {
        let text =
            String::from_utf8(bytes).context("refused: the file is damaged, it is not text")?;
        let contents = parse(&text)?;
        check_age(&contents, days_max, now_unix_s())?;
        let learned = contents.learned;
        Ok(LearnedFile { text, learned })
    };
    read(bytes).with_context(name)
}

fn parse(text: &str) -> Result<LearnedContents> {
    let (head, body) = text.split_once('\n').unwrap_or((text, ""));
    let Some((layout, given)) = head
        .strip_prefix(KIND)
        .and_then(|rest| rest.split_once(' '))
    else {
        bail!("refused: no file of what was learned (first line must begin with {KIND}{LAYOUT})");
    };
    if layout != LAYOUT {
        bail!(
            "refused: has layout {layout}, this program reads layout {LAYOUT}; it is learned again by driving"
        );
    }
    let Some(body) = body.strip_suffix('\n') else {
        bail!("refused: the file is cut short");
    };
    if given != format!("{:016x}", fnv_1a(body.as_bytes())) {
        bail!("refused: the file is damaged, its checksum does not match");
    }
    serde_json::from_str(body).context("refused: the file is damaged")
}

fn check_age(contents: &LearnedContents, days_max: f64, now_unix_s: f64) -> Result<()> {
    let days = (now_unix_s - contents.saved_unix_s) / 86_400.0;
    if days > days_max {
        bail!("refused: learned {days:.0} days ago, more than {days_max}");
    }
    // Accept a file slightly in the future: the clock may have been set back.
    if days < -1.0 {
        bail!(
            "refused: learned {:.0} days from now, so one of the clocks is wrong",
            -days
        );
    }
    Ok(())
}

fn now_unix_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |since| since.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_controller::memory::{Cell, Evidence, Key};
    use std::time::{Duration, Instant};

    fn learned() -> Learned {
        Learned {
            owner: "j8 1 icrik-mpc".to_owned(),
            gains: None,
            cell_m: 0.3,
            cells: Vec::new(),
        }
    }

    fn many(aim_right_m: f64) -> Learned {
        let cell = |x| Cell {
            key: Key { x, y: 0, sector: 0 },
            evidence: Evidence {
                way_m: 1.0,
                aim_m2: aim_right_m,
                ..Evidence::default()
            },
            visits: 1,
        };
        Learned {
            cells: (0..4000).map(cell).collect(),
            ..learned()
        }
    }

    /// Names the file that a process of this test writes until it is killed.
    const WRITTEN: &str = "SIDEHILL_TEST_LEARNED";

    #[test]
    #[ignore = "is started and killed by the next test"]
    fn writes_until_it_is_killed() {
        let Some(path) = std::env::var_os(WRITTEN).map(PathBuf::from) else {
            return;
        };
        loop {
            for aim_right_m in [0.01, 0.02] {
                save(&path, &many(aim_right_m)).unwrap();
            }
        }
    }

    #[test]
    fn a_writer_that_is_killed_leaves_a_whole_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j8.learned");
        save(&path, &many(0.01)).unwrap();
        let (mut interrupted, mut contents) = (0, [0; 2]);
        for round in 0..50 {
            let before = std::fs::read(&path).unwrap();
            let mut writer = std::process::Command::new(std::env::current_exe().unwrap())
                .args(["--exact", "learned::tests::writes_until_it_is_killed"])
                .arg("--ignored")
                .env(WRITTEN, &path)
                .stdout(std::process::Stdio::null())
                .spawn()
                .unwrap();
            let deadline = Instant::now() + Duration::from_secs(60);
            while std::fs::read(&path).unwrap() == before {
                assert!(Instant::now() < deadline, "the writer writes nothing");
                std::thread::sleep(Duration::from_millis(1));
            }
            let beside = folder.path().join("j8.learned.new");
            if round % 2 == 0 {
                while !beside.exists() {
                    assert!(Instant::now() < deadline, "the writer writes no more");
                }
            } else {
                std::thread::sleep(Duration::from_micros(137 * round));
            }
            writer.kill().unwrap();
            writer.wait().unwrap();
            let found = load(&path, DAYS_MAX).unwrap().learned;
            let which = [0.01, 0.02].map(|aim_right_m| found == many(aim_right_m));
            assert!(which[0] || which[1], "round {round}");
            contents[usize::from(which[1])] += 1;
            // The file beside it is there only while one is being written.
            interrupted += u32::from(beside.exists());
        }
        let files = std::fs::read_dir(folder.path()).unwrap().count();
        assert!(files <= 2, "{files} files");
        assert!(interrupted > 0 && contents[0] + contents[1] == 50);
    }

    #[test]
    fn what_is_saved_comes_back_and_damage_is_refused_with_its_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j8.learned");
        save(&path, &learned()).unwrap();
        let file = load(&path, DAYS_MAX).unwrap();
        assert_eq!(file.learned, learned());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let refusal = |bytes: &[u8]| {
            let damaged = folder.path().join("damaged.learned");
            std::fs::write(&damaged, bytes).unwrap();
            let refused = load(&damaged, DAYS_MAX).err().unwrap();
            format!("{refused:#}")
        };
        let bytes = file.text.as_bytes();
        for end in 0..bytes.len() {
            let why = refusal(&bytes[..end]);
            assert!(why.contains("refused"), "{end}: {why}");
        }
        for at in 0..bytes.len() {
            for bit in [1, 0x80] {
                let mut bytes = bytes.to_vec();
                bytes[at] ^= bit;
                let why = refusal(&bytes);
                assert!(why.contains("refused"), "{at}: {why}");
            }
        }
        let older = file.text.replacen("learned-2", "learned-1", 1);
        let why = refusal(older.as_bytes());
        assert!(
            why.contains("damaged.learned: refused: has layout 1, this program reads layout 2"),
            "{why}"
        );
        let contents = parse(&file.text).unwrap();
        let days = |days: f64| {
            let now_s = contents.saved_unix_s + days * 86_400.0;
            let refused = check_age(&contents, DAYS_MAX, now_s).err();
            refused.map_or_else(String::new, |error| error.to_string())
        };
        assert_eq!(days(80.0), "");
        assert!(days(100.0).contains("100 days ago"));
        assert!(days(-10.0).contains("clocks"));
    }
}
