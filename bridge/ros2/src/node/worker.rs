//! A thread that ends when its handle is dropped.

use std::os::unix::thread::JoinHandleExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, Thread};
use std::time::{Duration, Instant};
use thread_priority::ThreadId;

/// Longest wait for a thread on drop. One that leaves the graph takes 0.1 s.
const END_WAIT_MAX: Duration = Duration::from_secs(2);

/// A thread; on drop it is asked to end and waited for. One that hangs, as in a middleware that no longer answers, is left
/// behind, so that the program ends.
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
            let deadline = Instant::now() + END_WAIT_MAX;
            while !thread.is_finished() && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    #[test]
    fn a_thread_that_ends_is_waited_for_and_one_that_hangs_is_left_behind() {
        let done = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&done);
        let worker = Worker::start("ends", move |end| {
            while !end.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(20));
            }
            told.store(true, Ordering::Relaxed);
        });
        drop(worker.unwrap());
        assert!(done.load(Ordering::Relaxed));
        let (sender, receiver) = mpsc::channel::<()>();
        let worker = Worker::start("hangs", move |_| {
            let _ = receiver.recv();
        });
        // This returns.
        drop(worker.unwrap());
        assert!(sender.send(()).is_ok());
    }
}
