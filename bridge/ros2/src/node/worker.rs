//! A thread that ends when its handle is dropped.

use std::os::unix::thread::JoinHandleExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, Thread};
use thread_priority::ThreadId;

/// A thread; on drop it is asked to end and joined.
pub struct Worker {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts `work`, which must check its argument at least ten times a second and end when it is true.
    ///
    /// # Errors
    /// The system's, where no thread can be created.
    pub fn start(
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

    /// Returns the thread while it runs.
    pub fn thread(&self) -> Option<&Thread> {
        let working = self.thread.as_ref().filter(|thread| !thread.is_finished());
        working.map(JoinHandle::thread)
    }

    /// Returns the identity of the thread for its priority, while it runs.
    pub fn thread_id(&self) -> Option<ThreadId> {
        let working = self.thread.as_ref().filter(|thread| !thread.is_finished());
        working.map(JoinHandleExt::as_pthread_t)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic has shown as silence of the thread.
            let _ = thread.join();
        }
    }
}
