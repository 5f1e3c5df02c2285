//! The signals that end or suspend the program.

use anyhow::{Context, Result};
use nix::sys::signal::{SigSet, Signal};
use signal_hook::consts::{SIGCONT, SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag::register;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

/// Signals that a program watches.
const WATCHED: [Signal; 6] = [
    Signal::SIGINT,
    Signal::SIGTERM,
    Signal::SIGHUP,
    Signal::SIGCONT,
    Signal::SIGUSR1,
    Signal::SIGUSR2,
];
/// Memory for the stack of the thread that takes the signals, bytes: it may be locked.
const STACK_BYTES: usize = 64 * 1024;

/// Signals received since the program began.
pub struct Interrupts {
    /// Set by SIGINT, SIGTERM and SIGHUP.
    pub end: Arc<AtomicBool>,
    /// Set when the process is resumed after it was suspended.
    pub resumed: Arc<AtomicBool>,
}

impl Interrupts {
    /// Starts watching SIGINT, SIGTERM, SIGHUP and SIGCONT. Of two signals that come at once the system gives the
    /// second to any thread that does not block it, and one of RustDDS that is interrupted ends for good. So this
    /// thread blocks them, with SIGUSR1 and SIGUSR2, and those that it starts inherit that; a thread of its own takes
    /// them. Call it before RustDDS starts.
    ///
    /// # Errors
    /// The system does not let the program watch a signal.
    pub fn watch() -> Result<Self> {
        thread::Builder::new()
            .name("signals".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(|| {
                loop {
                    thread::park();
                }
            })
            .context("the thread that takes signals")?;
        SigSet::from_iter(WATCHED)
            .thread_block()
            .context("leaving signals to their thread")?;
        let (end, resumed) = <(Arc<AtomicBool>, Arc<AtomicBool>)>::default();
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            register(signal, Arc::clone(&end))?;
        }
        register(SIGCONT, Arc::clone(&resumed))?;
        Ok(Self { end, resumed })
    }

    /// Lets this thread, and those that it starts from now on, take signals as well, once the threads of RustDDS have
    /// started. After a suspension the first thread that runs then knows of it, be it the cycle.
    ///
    /// # Errors
    /// The system does not change the thread's signals.
    pub fn admit() -> Result<()> {
        SigSet::from_iter(WATCHED)
            .thread_unblock()
            .context("taking signals")
    }

    /// Returns whether the program was asked to end.
    pub fn ended(&self) -> bool {
        self.end.load(Ordering::Relaxed)
    }

    /// Returns, once per suspension, whether the process was suspended and resumed: RustDDS fails for good when
    /// its wait is interrupted, so its nodes must be started anew. A program that was also asked to end just ends:
    /// systemd sends SIGTERM and SIGCONT.
    pub fn take_resumed(&self) -> bool {
        self.resumed.swap(false, Ordering::Relaxed) && !self.ended()
    }
}
