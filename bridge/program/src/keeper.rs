//! Reads what was learned when a drive begins, and writes it while and after it is driven.

use anyhow::{Context, Result};
use sidehill::learned::{KeptFile, load, save};
use sidehill::{console, output};
use sidehill_bridge::control_loop::learned::{LearnedOutlet, learned_channel};
use sidehill_controller::controller::Controller;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A thread that writes what was learned, so that no thread of the control loop waits for the disk.
pub struct Keeper {
    thread: JoinHandle<()>,
}

/// Longest wait for the last write.
const WRITE_TIMEOUT: Duration = Duration::from_secs(2);
/// Time between two looks at what there is to write.
const LOOK_EVERY: Duration = Duration::from_millis(50);

impl Keeper {
    /// Lets `controller` begin with what a file holds, and keeps the file from then on with what is left at
    /// the outlet; also returns the text that the controller begins with. A file that is refused is named with
    /// its reason on standard error and kept under another name.
    ///
    /// # Errors
    /// The system's, where it has no thread left, or the disk's, where the file cannot be kept.
    pub fn start(
        file: KeptFile,
        controller: &mut Controller,
    ) -> Result<(Self, LearnedOutlet, Option<String>)> {
        let KeptFile {
            path,
            days_max,
            every_s,
        } = file;
        let mut begun_with = None;
        if path.exists() {
            let recalled = load(&path, days_max).and_then(|file| {
                controller
                    .recall(&file.learned)
                    .with_context(|| format!("{}: refused", path.display()))?;
                Ok(file.text)
            });
            match recalled {
                Ok(text) => {
                    begun_with = Some(text);
                    console::complain(format_args!(
                        "{}: begins with what was learned before",
                        path.display()
                    ));
                }
                Err(error) => {
                    output::keep_earlier(&[&path])?;
                    console::complain(format_args!(
                        "warning: {error:#}; begins with nothing learned, and the file is kept as {}.1 \
                         or a higher number",
                        path.display()
                    ));
                }
            }
        }
        let (outlet, mut inlet) = learned_channel(controller, every_s);
        let thread = std::thread::Builder::new()
            .name("learned".to_owned())
            .spawn(move || {
                loop {
                    // In this order, so that what was left last is not missed.
                    let ended = inlet.is_abandoned();
                    let wrote = inlet.take(|learned| {
                        if let Err(error) = save(&path, learned) {
                            console::complain(format_args!("warning: {error:#}"));
                        }
                    });
                    if ended && !wrote {
                        return;
                    }
                    if !wrote {
                        std::thread::sleep(LOOK_EVERY);
                    }
                }
            })?;
        Ok((Self { thread }, outlet, begun_with))
    }

    /// Waits for the last write, but not for ever.
    pub fn finish(self) {
        let deadline = Instant::now() + WRITE_TIMEOUT;
        while !self.thread.is_finished() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
