//! Progress of a measurement, reported on standard error.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

/// Reporter that prints progress after three seconds and every ten seconds from then on, until it is dropped.
pub(super) struct Progress {
    done: Arc<AtomicUsize>,
    /// Dropping it ends the thread.
    _end: Option<Sender<()>>,
}

impl Progress {
    /// Starts reporting about a measurement of this many pictures.
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
        // If no thread can be started, nothing is reported.
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

/// Silence before the first report, as long as that of a render.
const REPORT_AFTER: Duration = Duration::from_secs(3);
const REPORT_PERIOD: Duration = Duration::from_secs(10);
