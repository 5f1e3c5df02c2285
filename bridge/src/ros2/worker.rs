//! A thread that ends with its handle.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, Thread};

/// A thread; dropped, it is asked to end and waited for.
pub(super) struct Worker {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts `work`, which looks at its argument at least ten times a second and ends when it is
    /// true.
    pub(super) fn start(
        name: &str,
        work: impl FnOnce(&AtomicBool) + Send + 'static,
    ) -> std::io::Result<Self> {
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let thread = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || work(&ended))?;
        Ok(Self {
            end,
            thread: Some(thread),
        })
    }

    /// Returns the thread while it works.
    pub(super) fn thread(&self) -> Option<&Thread> {
        let working = self.thread.as_ref().filter(|thread| !thread.is_finished());
        working.map(JoinHandle::thread)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic in it has shown itself as silence.
            let _ = thread.join();
        }
    }
}
