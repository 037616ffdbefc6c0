//! Files that are rendered beside the game: their progress, and the sentence at their end.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use carom_farm::Canceller;

/// A place for one file in the making.
#[derive(Debug, Default)]
pub struct CaptureSlot {
    current: Option<Capture>,
}

/// A file in the making. Dropped, it is cancelled and leaves nothing.
#[derive(Debug)]
struct Capture {
    canceller: Canceller,
    progress: CaptureProgress,
    outcome: Receiver<anyhow::Result<String>>,
}

/// How much of a file is rendered, in percent: written by the render, read by the window.
#[derive(Clone, Debug, Default)]
pub struct CaptureProgress(Arc<AtomicU32>);

impl CaptureProgress {
    /// Notes a share from 0 to 1.
    pub fn set(&self, share: f64) {
        self.0.store((100.0 * share) as u32, Ordering::Relaxed);
    }
}

impl CaptureSlot {
    /// Begins a file, in place of one that is being made: `finish` waits for the render on a thread,
    /// writes the file and returns what the player is to be told.
    ///
    /// # Errors
    /// [`crate::Error::CaptureThread`].
    pub fn begin(
        &mut self,
        canceller: Canceller,
        progress: CaptureProgress,
        finish: impl FnOnce() -> anyhow::Result<String> + Send + 'static,
    ) -> crate::Result<()> {
        let (sender, outcome) = channel();
        thread::Builder::new()
            .name("capture".to_owned())
            // Nobody waits any more once the receiver is gone.
            .spawn(move || drop(sender.send(finish())))
            .map_err(crate::Error::CaptureThread)?;
        self.current = Some(Capture {
            canceller,
            progress,
            outcome,
        });
        Ok(())
    }

    /// What came of the file, once it is finished or has failed.
    pub fn poll(&mut self) -> Option<anyhow::Result<String>> {
        let outcome = match self.current.as_ref()?.outcome.try_recv() {
            Ok(outcome) => outcome,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => Err(anyhow::anyhow!("its thread ended")),
        };
        self.current = None;
        Some(outcome)
    }

    /// Gives the file up.
    pub fn cancel(&mut self) {
        self.current = None;
    }

    /// How much of the file is rendered, if one is being made.
    pub fn percent(&self) -> Option<u32> {
        let CaptureProgress(percent) = &self.current.as_ref()?.progress;
        Some(percent.load(Ordering::Relaxed))
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        self.canceller.cancel();
    }
}
