//! The signals that end or suspend the program.

use anyhow::Result;
use signal_hook::consts::{SIGCONT, SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag::register;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Signals received since the program began.
pub struct Interrupts {
    /// Set by SIGINT, SIGTERM and SIGHUP.
    pub end: Arc<AtomicBool>,
    /// Set when the process is resumed after it was suspended.
    pub resumed: Arc<AtomicBool>,
}

impl Interrupts {
    /// Starts watching SIGINT, SIGTERM, SIGHUP and SIGCONT.
    ///
    /// # Errors
    /// The system does not let the program watch a signal.
    pub fn watch() -> Result<Self> {
        let (end, resumed) = <(Arc<AtomicBool>, Arc<AtomicBool>)>::default();
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            register(signal, Arc::clone(&end))?;
        }
        register(SIGCONT, Arc::clone(&resumed))?;
        Ok(Self { end, resumed })
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
