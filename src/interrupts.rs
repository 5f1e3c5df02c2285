//! The signals that end a node which only listens.

use anyhow::Result;
use signal_hook::consts::{SIGCONT, SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag::register;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What has been asked of the program since it began.
pub struct Interrupts {
    ended: Arc<AtomicBool>,
    resumed: Arc<AtomicBool>,
}

impl Interrupts {
    /// Begins to watch SIGINT, SIGTERM, SIGHUP and SIGCONT.
    ///
    /// # Errors
    /// A signal that the system does not let watch.
    pub fn watch() -> Result<Self> {
        let (ended, resumed) = <(Arc<AtomicBool>, Arc<AtomicBool>)>::default();
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            register(signal, Arc::clone(&ended))?;
        }
        register(SIGCONT, Arc::clone(&resumed))?;
        Ok(Self { ended, resumed })
    }

    /// Returns whether the program was asked to end.
    pub fn ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    /// Returns whether the program was suspended; the middleware does not survive that its wait is interrupted.
    pub fn resumed(&self) -> bool {
        self.resumed.load(Ordering::Relaxed)
    }
}
