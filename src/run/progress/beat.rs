//! Calls something again and again while a run goes, whether or not anything happens in it.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// A thread that calls until it is dropped; none where the system gives none.
pub struct Beat {
    stop: Sender<()>,
    thread: Option<JoinHandle<()>>,
}

impl Beat {
    pub fn every(pause: Duration, call: impl Fn() + Send + 'static) -> Self {
        let (stop, stopped) = channel();
        let work = move || {
            while stopped.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                call();
            }
        };
        Self { stop, thread: std::thread::Builder::new().name("turbid-beat".into()).spawn(work).ok() }
    }
}

impl Drop for Beat {
    fn drop(&mut self) {
        let _ = self.stop.send(());
        // It has nothing to tell, and a panic of its was said already.
        drop(self.thread.take().map(JoinHandle::join));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// It calls until it is dropped, and not once after that; nobody waits for its pause.
    #[test]
    fn it_beats_until_it_is_dropped() {
        let calls = Arc::new(AtomicUsize::new(0));
        let counted = calls.clone();
        let beat = Beat::every(Duration::from_millis(1), move || {
            counted.fetch_add(1, Ordering::SeqCst);
        });
        while calls.load(Ordering::SeqCst) < 3 {
            std::thread::yield_now();
        }
        drop(beat);
        let before = calls.load(Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(calls.load(Ordering::SeqCst), before);
        let began = std::time::Instant::now();
        drop(Beat::every(Duration::from_secs(3600), || {}));
        assert!(began.elapsed() < Duration::from_secs(60));
    }
}
