//! Messages of long work for the user: progress, and the result of an interrupt.

use crate::console;
use indicatif::{ProgressBar, ProgressStyle};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Time between lines if standard error is not a terminal, s.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Progress of a task: a bar on a terminal, otherwise a line from time to time.
pub struct Progress {
    name: String,
    bar: ProgressBar,
    /// When the last line was printed; none on a terminal.
    last_line: Option<Mutex<Instant>>,
}

impl Progress {
    /// Starts a task of `steps` steps.
    pub fn new(name: &str, steps: u64) -> Self {
        let style = ProgressStyle::with_template(
            "{prefix:14} {bar:40} {percent:>3} %  {elapsed} gone, {eta} left",
        )
        .unwrap_or_else(|_| ProgressStyle::default_bar());
        Self {
            name: name.to_owned(),
            bar: ProgressBar::new(steps)
                .with_style(style)
                .with_prefix(name.to_owned()),
            last_line: (!std::io::stderr().is_terminal()).then(|| Mutex::new(Instant::now())),
        }
    }

    /// Shows that `done` steps are completed; any thread may call it.
    pub fn at(&self, done: u64) {
        self.bar.set_position(done);
        self.line();
    }

    /// Shows that one more step is completed.
    pub fn step(&self) {
        self.bar.inc(1);
        self.line();
    }

    fn line(&self) {
        let Some(last) = &self.last_line else { return };
        // If the lock is held, another thread is printing.
        let Ok(mut last) = last.try_lock() else {
            return;
        };
        if last.elapsed() >= LINE_EVERY {
            *last = Instant::now();
            let (done, all) = (self.bar.position(), self.bar.length().unwrap_or(1));
            let percent = 100 * done / all.max(1);
            let left_s = self.bar.eta().as_secs();
            console::complain(format_args!("{}: {percent} %, {left_s} s left", self.name));
        }
    }

    /// Ends the task and removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Tells what is being done once it takes longer than two seconds, and from time to time after that, until it is
/// dropped.
pub struct Notice {
    ended: Option<std::sync::mpsc::Sender<()>>,
}

/// Time before the first message of a [`Notice`].
const PATIENCE: Duration = Duration::from_secs(2);

impl Notice {
    /// Starts the task that `doing` describes.
    pub fn begin(doing: String) -> Self {
        let (ended, wait) = std::sync::mpsc::channel();
        let begun = Instant::now();
        let say = move || {
            let mut patience = PATIENCE;
            while wait.recv_timeout(patience) == Err(std::sync::mpsc::RecvTimeoutError::Timeout) {
                let gone_s = begun.elapsed().as_secs();
                console::complain(format_args!("{doing} ({gone_s} s)"));
                patience = LINE_EVERY;
            }
        };
        // Without a thread there are no messages, but the work is done.
        let thread = std::thread::Builder::new().name("notice".to_owned());
        let started = thread.spawn(say).is_ok();
        Self {
            ended: started.then_some(ended),
        }
    }
}

impl Drop for Notice {
    fn drop(&mut self) {
        self.ended.take();
    }
}

/// Exit status after SIGINT, by the convention of shells.
const INTERRUPTED: i32 = 130;

/// Makes an interrupt print `message` and end the program at once. Only for work whose files are written atomically
/// or line by line, never while driving a vehicle.
///
/// # Errors
/// The system cannot watch signals or start a thread.
pub fn explain_interrupt(message: impl Fn() -> String + Send + 'static) -> std::io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    std::thread::Builder::new()
        .name("interrupt".to_owned())
        .spawn(move || {
            if signals.forever().next().is_some() {
                console::complain(message());
                std::process::exit(INTERRUPTED);
            }
        })?;
    Ok(())
}
