//! Files of what was learned: whole or not at all, known by vehicle, date and a checksum.
//!
//! The first line names the format and the checksum (FNV-1a, 64 bits) of all that follows, which is JSON.

use crate::console;
use crate::output;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use sidehill_controller::controller::Controller;
use sidehill_controller::memory::Learned;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// First word of a file.
const FORMAT: &str = "sidehill-learned-1";

/// Days after which what was learned is too old to begin with, unless configured.
pub const DAYS_MAX: f64 = 90.0;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Contents {
    /// When it was saved, s since 1970.
    saved_unix_s: f64,
    /// Share of the uncertainty of the gains that has gone.
    confidence: f64,
    learned: Learned,
}

/// Writes what was learned, in place of what the file held.
///
/// # Errors
/// What the disk says; the file is then as it was.
pub fn save(path: &Path, learned: &Learned) -> Result<()> {
    let contents = Contents {
        saved_unix_s: now_unix_s(),
        confidence: learned.confidence(),
        learned: learned.clone(),
    };
    let body = serde_json::to_string(&contents)?;
    let text = format!("{FORMAT} {:016x}\n{body}\n", checksum(&body));
    output::write(path, text.as_bytes(), true)
}

/// Reads what was learned.
///
/// # Errors
/// Names the file and why it is refused: it cannot be read, is no such file, is damaged, or is older than
/// `days_max`.
pub fn load(path: &Path, days_max: f64) -> Result<Learned> {
    let name = || path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(name)?;
    parse(&text, days_max, now_unix_s()).with_context(name)
}

fn parse(text: &str, days_max: f64, now_unix_s: f64) -> Result<Learned> {
    let (head, body) = text.split_once('\n').unwrap_or((text, ""));
    let Some(given) = head.strip_prefix(FORMAT).map(str::trim) else {
        bail!("refused: no file of what was learned (first line must begin with {FORMAT})");
    };
    let Some(body) = body.strip_suffix('\n') else {
        bail!("refused: the file is cut short");
    };
    if given != format!("{:016x}", checksum(body)) {
        bail!("refused: the file is damaged, its checksum does not match");
    }
    let contents: Contents = serde_json::from_str(body).context("refused: the file is damaged")?;
    let days = (now_unix_s - contents.saved_unix_s) / 86_400.0;
    if days > days_max {
        bail!("refused: learned {days:.0} days ago, more than {days_max}");
    }
    // A clock that was put back a little is none to blame the file for.
    if days < -1.0 {
        bail!(
            "refused: learned {:.0} days from now, so one of the clocks is wrong",
            -days
        );
    }
    Ok(contents.learned)
}

fn now_unix_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |since| since.as_secs_f64())
}

fn checksum(text: &str) -> u64 {
    text.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    })
}

/// A thread that writes what was learned, so that no thread of the control loop waits for the disk.
pub struct Keeper {
    sender: SyncSender<Learned>,
    thread: JoinHandle<()>,
}

/// Longest wait for the last write.
const WRITE_TIMEOUT: Duration = Duration::from_secs(2);

impl Keeper {
    /// Lets `controller` begin with what a file holds, and keeps the file from then on. A file that is refused
    /// is named with its reason on standard error and replaced by the next that is learned.
    ///
    /// # Errors
    /// The system's, where it has no thread left.
    pub fn start(path: PathBuf, days_max: f64, controller: &mut Controller) -> Result<Self> {
        if path.exists() {
            let recalled = load(&path, days_max).and_then(|learned| {
                controller
                    .recall(&learned)
                    .with_context(|| format!("{}: refused", path.display()))
            });
            match recalled {
                Ok(()) => console::complain(format_args!(
                    "{}: begins with what was learned before",
                    path.display()
                )),
                Err(error) => console::complain(format_args!(
                    "warning: {error:#}; begins with nothing learned"
                )),
            }
        }
        let (sender, receiver) = sync_channel(1);
        let thread = std::thread::Builder::new()
            .name("learned".to_owned())
            .spawn(move || {
                while let Ok(learned) = receiver.recv() {
                    if let Err(error) = save(&path, &learned) {
                        console::complain(format_args!("warning: {error:#}"));
                    }
                }
            })?;
        Ok(Self { sender, thread })
    }

    /// Returns where to send what was learned; sending never waits.
    pub fn sender(&self) -> SyncSender<Learned> {
        self.sender.clone()
    }

    /// Waits for the last write, but not for ever.
    pub fn finish(self) {
        drop(self.sender);
        let deadline = Instant::now() + WRITE_TIMEOUT;
        while !self.thread.is_finished() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn learned() -> Learned {
        Learned {
            owner: "j8 1 icrik-mpc".to_owned(),
            gains: None,
            cell_m: 0.3,
            cells: Vec::new(),
        }
    }

    #[test]
    fn what_is_saved_comes_back_and_damage_is_refused_with_its_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j8.learned");
        save(&path, &learned()).unwrap();
        assert_eq!(load(&path, DAYS_MAX).unwrap(), learned());
        let text = std::fs::read_to_string(&path).unwrap();
        let now = now_unix_s();
        let refusal =
            |text: &str, now: f64| format!("{:#}", parse(text, DAYS_MAX, now).unwrap_err());
        for end in 0..text.len() {
            let why = refusal(&text[..end], now);
            assert!(why.contains("refused"), "{end}: {why}");
        }
        for at in 0..text.len() {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1;
            let why = refusal(&String::from_utf8_lossy(&bytes), now);
            assert!(why.contains("refused"), "{at}: {why}");
        }
        assert!(refusal(&text, now + 100.0 * 86_400.0).contains("100 days ago"));
        assert!(refusal(&text, now - 10.0 * 86_400.0).contains("clocks"));
    }
}
