//! The operator of a drive, who pauses it, lets it go on and ends it.

use crate::interrupts::Interrupts;
use anyhow::Result;
use signal_hook::consts::{SIGUSR1, SIGUSR2};
use signal_hook::flag::register;
use std::io::BufRead;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What the operator wants: by signals, or by Enter.
pub(super) struct Operator {
    pub(super) interrupts: Interrupts,
    go_on: Arc<AtomicBool>,
    pause: Arc<AtomicBool>,
    toggle: Arc<AtomicBool>,
}

impl Operator {
    pub(super) fn watch() -> Result<Self> {
        let interrupts = Interrupts::watch()?;
        let (go_on, pause, toggle) =
            <(Arc<AtomicBool>, Arc<AtomicBool>, Arc<AtomicBool>)>::default();
        register(SIGUSR1, Arc::clone(&go_on))?;
        register(SIGUSR2, Arc::clone(&pause))?;
        let pressed = Arc::clone(&toggle);
        // Ends with the program.
        std::thread::spawn(move || {
            for _ in std::io::stdin().lock().lines().map_while(Result::ok) {
                pressed.store(true, Ordering::Relaxed);
            }
        });
        Ok(Self {
            interrupts,
            go_on,
            pause,
            toggle,
        })
    }

    pub(super) fn pauses(&self) -> bool {
        self.go_on.store(false, Ordering::Relaxed);
        let signalled = self.pause.swap(false, Ordering::Relaxed);
        self.toggle.swap(false, Ordering::Relaxed) || signalled
    }

    pub(super) fn goes_on(&self) -> bool {
        self.pause.store(false, Ordering::Relaxed);
        let signalled = self.go_on.swap(false, Ordering::Relaxed);
        self.toggle.swap(false, Ordering::Relaxed) || signalled
    }
}
