//! Lines on standard error about how far a measurement is, for whoever waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

/// A measurement that says how far it is after three seconds and every ten from then on, until it is dropped.
pub(super) struct Progress {
    done: Arc<AtomicUsize>,
    /// Its end is the measurement's.
    _end: Option<Sender<()>>,
}

impl Progress {
    /// Of so many `pictures`.
    pub(super) fn start(what: &'static str, pictures: usize) -> Self {
        let done = Arc::<AtomicUsize>::default();
        let (end, ended) = mpsc::channel::<()>();
        let (counted, begun) = (Arc::clone(&done), Instant::now());
        let report = move || {
            let mut period = REPORT_AFTER;
            while ended.recv_timeout(period) == Err(RecvTimeoutError::Timeout) {
                let (done, secs) = (counted.load(Ordering::Relaxed), begun.elapsed().as_secs());
                eprintln!("carom-farm: {what}: {done} of {pictures} pictures in {secs} s");
                period = REPORT_PERIOD;
            }
        };
        // Without a thread there are no lines.
        let thread = std::thread::Builder::new().spawn(report);
        Self {
            done,
            _end: thread.is_ok().then_some(end),
        }
    }

    /// Counts a picture.
    pub(super) fn step(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }
}

/// As long as a render waits in silence.
const REPORT_AFTER: Duration = Duration::from_secs(3);
const REPORT_PERIOD: Duration = Duration::from_secs(10);
