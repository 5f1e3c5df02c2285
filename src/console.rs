//! Text on standard output and standard error.
//!
//! The reader may close its end at any time (`| head -1`, a log collector that crashes, a closed terminal). Text
//! that cannot be written is dropped and counted, and the program continues.

use crate::exit::Exit;
use anyhow::Result;
use std::fmt::Display;
use std::io::Write;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

static DROPPED: AtomicU64 = AtomicU64::new(0);
/// Why standard output cannot be written, other than that its reader has gone.
static FAULT: OnceLock<String> = OnceLock::new();

/// How much a line matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Level {
    /// Something has failed.
    Error,
    /// Somebody should look at it.
    Warn,
    /// What happens.
    Info,
    /// What is of use while a fault is looked for.
    Debug,
}

impl Level {
    /// Returns the priority of syslog, as `<4>`, with which a line begins that the journal of systemd reads.
    pub fn prefix(self) -> &'static str {
        match self {
            Self::Error => "<3>",
            Self::Warn => "<4>",
            Self::Info => "<6>",
            Self::Debug => "<7>",
        }
    }
}

/// Returns whether the journal of systemd reads a stream: systemd names the stream's device and inode in
/// `JOURNAL_STREAM`, which programs that write elsewhere inherit as well.
#[cfg(unix)]
pub fn is_journal(stream: &impl std::os::fd::AsFd) -> bool {
    use std::os::unix::fs::MetadataExt;
    let Ok(journal) = std::env::var("JOURNAL_STREAM") else {
        return false;
    };
    let stream = stream.as_fd().try_clone_to_owned();
    let file = stream.and_then(|stream| std::fs::File::from(stream).metadata());
    file.is_ok_and(|file| format!("{}:{}", file.dev(), file.ino()) == journal)
}

/// Other systems have no journal.
#[cfg(not(unix))]
pub fn is_journal<T>(_: &T) -> bool {
    false
}

/// Prints `text` without a line break.
pub fn text(text: impl Display) {
    output(write!(std::io::stdout().lock(), "{text}"));
}

/// Prints `text` and a line break.
pub fn line(text: impl Display) {
    output(writeln!(std::io::stdout().lock(), "{text}"));
}

/// Prints `text` and a line break to standard error. Of a text that quotes a file's content at length only beginning and
/// end are printed.
pub fn complain(text: impl Display) {
    let text = shortened(text.to_string());
    count(writeln!(std::io::stderr().lock(), "{text}"));
}

/// Replaces the last line of standard error, a terminal, by `text`, cut to its width.
pub fn renew_complaint(text: impl Display) {
    count(write!(std::io::stderr().lock(), "{}", renewed(text)));
}

/// Returns `text` after what removes the line of a terminal, and in a form that does not go beyond it.
fn renewed(text: impl Display) -> String {
    format!("\r\x1b[2K\x1b[?7l{text}\x1b[?7h")
}

/// Most characters of a complaint, and those of its end that are kept of a longer one.
const COMPLAINT_MAX: usize = 4000;
const COMPLAINT_END: usize = 1000;

fn shortened(text: String) -> String {
    let count = text.chars().count();
    if count <= COMPLAINT_MAX {
        return text;
    }
    let begin = text.chars().take(COMPLAINT_MAX - COMPLAINT_END);
    let end = text.chars().skip(count - COMPLAINT_END);
    begin.chain(" [...] ".chars()).chain(end).collect()
}

/// Returns how many texts could not be written.
pub fn dropped() -> u64 {
    DROPPED.load(Ordering::Relaxed)
}

/// Returns why something could not be written to standard output, as to a disk that is full; nothing where all is
/// written, or its reader has gone.
fn output_fault() -> Option<&'static str> {
    output(std::io::stdout().flush());
    FAULT.get().map(String::as_str)
}

fn output(written: std::io::Result<()>) {
    if let Err(error) = &written
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        let _ = FAULT.set(error.to_string());
    }
    count(written);
}

/// Most lines that wait for a slow reader.
const WAITING_MAX: usize = 256;

enum PrintedLine {
    Output(Vec<u8>),
    Error(Vec<u8>),
}

/// Prints from its own thread, so that a reader that is slow, blocked or gone delays nothing: lines beyond the queue
/// are dropped and counted.
pub struct Printer {
    lines: SyncSender<PrintedLine>,
    dropped: Arc<AtomicU64>,
    thread: JoinHandle<()>,
}

impl Printer {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start() -> std::io::Result<Self> {
        let (lines, waiting) = sync_channel(WAITING_MAX);
        let dropped = Arc::new(AtomicU64::new(0));
        let lost = Arc::clone(&dropped);
        let thread = std::thread::Builder::new()
            .name("printer".to_owned())
            .spawn(move || {
                for line in waiting {
                    let written = match line {
                        PrintedLine::Output(text) => {
                            let mut output = std::io::stdout().lock();
                            output.write_all(&text).and_then(|()| output.flush())
                        }
                        PrintedLine::Error(text) => std::io::stderr().write_all(&text),
                    };
                    if written.is_err() {
                        lost.fetch_add(1, Ordering::Relaxed);
                    }
                }
            })?;
        Ok(Self {
            lines,
            dropped,
            thread,
        })
    }

    /// Prints `text` and a line break to standard output.
    pub fn line(&self, text: impl Display) {
        self.send(PrintedLine::Output(format!("{text}\n").into_bytes()));
    }

    /// Replaces the last line on a terminal by `text`, cut to its width.
    pub fn renew(&self, text: impl Display) {
        self.send(PrintedLine::Output(renewed(text).into_bytes()));
    }

    /// Prints a permanent line above the one that is replaced.
    pub fn above(&self, text: impl Display) {
        self.send(PrintedLine::Output(
            format!("\r\x1b[2K{text}\n").into_bytes(),
        ));
    }

    /// Prints `text` and a line break to standard error.
    pub fn error_line(&self, text: impl Display) {
        self.send(PrintedLine::Error(format!("{text}\n").into_bytes()));
    }

    /// Returns how many lines were dropped.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Waits until everything is printed, at most for `longest`.
    pub fn finish(self, longest: Duration) {
        drop(self.lines);
        let begun = Instant::now();
        while !self.thread.is_finished() && begun.elapsed() < longest {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn send(&self, line: PrintedLine) {
        if self.lines.try_send(line).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

fn count(written: std::io::Result<()>) {
    if written.is_err() {
        DROPPED.fetch_add(1, Ordering::Relaxed);
    }
}
/// Complains of an error of `program`, or of a standard output that it needs and that failed; returns the exit status.
pub fn end(program: &str, result: Result<ExitCode>, needs_output: bool) -> ExitCode {
    let fault = output_fault().filter(|_| needs_output && result.is_ok());
    if let Some(fault) = fault {
        complain(format_args!("{program}: standard output: {fault}"));
        return Exit::Failed.into();
    }
    result.unwrap_or_else(|error| {
        let prefix = match is_journal(&std::io::stderr()) {
            true => Level::Error.prefix(),
            false => "",
        };
        complain(format_args!("{prefix}{program}: {error:#}"));
        Exit::Failed.into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_complaint_that_quotes_a_whole_file_is_shortened() {
        let text = "b.csv: row 7: \"ä\" is not a number".to_owned();
        assert_eq!(shortened(text.clone()), text);
        let long = format!("b.csv: row 7: \"{}\" is not a number", "ä".repeat(100_000));
        let short = shortened(long);
        assert!(short.chars().count() < COMPLAINT_MAX + 10);
        assert!(short.starts_with("b.csv: row 7") && short.ends_with("is not a number"));
    }
}
