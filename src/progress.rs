//! Messages of long work for the user: progress, and the result of an interrupt.

use crate::console;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Time between lines if standard error is not a terminal, s.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Time between changes of the bar.
const BAR_EVERY: Duration = Duration::from_millis(100);
/// Width of the bar, characters.
const BAR_WIDTH: u64 = 40;

/// Progress of a task: a bar on a terminal, otherwise a line from time to time.
pub struct TaskProgress {
    name: String,
    steps: u64,
    done: AtomicU64,
    begun: Instant,
    on_terminal: bool,
    shown: Mutex<Instant>,
}

impl TaskProgress {
    /// Starts a task of `steps` steps.
    pub fn new(name: &str, steps: u64) -> Self {
        let begun = Instant::now();
        Self {
            name: name.to_owned(),
            steps: steps.max(1),
            done: AtomicU64::new(0),
            begun,
            on_terminal: std::io::stderr().is_terminal(),
            shown: Mutex::new(begun),
        }
    }

    /// Shows that `done` steps are completed; any thread may call it.
    pub fn at(&self, done: u64) {
        self.done.store(done, Ordering::Relaxed);
        self.show();
    }

    /// Shows that one more step is completed.
    pub fn step(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
        self.show();
    }

    fn show(&self) {
        // If the lock is held, another thread is printing.
        let Ok(mut shown) = self.shown.try_lock() else {
            return;
        };
        let every = if self.on_terminal {
            BAR_EVERY
        } else {
            LINE_EVERY
        };
        if shown.elapsed() < every {
            return;
        }
        *shown = Instant::now();
        let done = self.done.load(Ordering::Relaxed).min(self.steps);
        let left = self.begun.elapsed().as_secs_f64() * (self.steps - done) as f64;
        let left_s = (left / done.max(1) as f64).ceil();
        let (name, percent) = (&self.name, 100 * done / self.steps);
        if self.on_terminal {
            let bar = "#".repeat((BAR_WIDTH * done / self.steps) as usize);
            let width = BAR_WIDTH as usize;
            console::renew_complaint(format_args!(
                "{name} [{bar:width$}] {percent:3} %, {left_s} s left"
            ));
        } else {
            console::complain(format_args!("{name}: {percent} %, {left_s} s left"));
        }
    }

    /// Ends the task and removes the bar.
    pub fn finish(&self) {
        if self.on_terminal {
            console::renew_complaint("");
        }
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

/// Makes an interrupt print `message` and end the program at once. Only for work whose files are written atomically
/// or line by line, never while driving a vehicle. Where the system is not a Unix, an interrupt ends it without the message.
///
/// # Errors
/// The system cannot watch signals or start a thread.
#[cfg(unix)]
pub fn explain_interrupt(message: impl Fn() -> String + Send + 'static) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    std::thread::Builder::new()
        .name("interrupt".to_owned())
        .spawn(move || {
            if signals.forever().next().is_some() {
                console::complain(message());
                std::process::exit(crate::exit::Exit::Interrupted as i32);
            }
        })?;
    Ok(())
}

/// An interrupt ends the program without a message.
///
/// # Errors
/// None.
#[cfg(not(unix))]
pub fn explain_interrupt(_: impl Fn() -> String + Send + 'static) -> std::io::Result<()> {
    Ok(())
}
