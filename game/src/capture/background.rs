//! Files that are rendered in the background: progress, and the message at the end.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use carom_farm::Canceller;

/// Slot for at most one file that is being rendered.
#[derive(Debug, Default)]
pub struct CaptureSlot {
    current: Option<Capture>,
}

/// A file that is being rendered. Dropping it cancels it.
#[derive(Debug)]
struct Capture {
    canceller: Canceller,
    progress: CaptureProgress,
    outcome: Receiver<anyhow::Result<String>>,
}

/// Rendered share of a file in percent: written by the render, read by the window.
#[derive(Clone, Debug, Default)]
pub struct CaptureProgress(Arc<AtomicU32>);

impl CaptureProgress {
    /// Sets the share, from 0 to 1.
    pub fn set(&self, share: f64) {
        self.0.store((100.0 * share) as u32, Ordering::Relaxed);
    }
}

impl CaptureSlot {
    /// Begins a file and cancels a previous one. `finish` runs on a thread: it waits for the render, writes
    /// the file and returns the message for the player.
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
            // The receiver is gone if the file was cancelled.
            .spawn(move || drop(sender.send(finish())))
            .map_err(crate::Error::CaptureThread)?;
        self.current = Some(Capture {
            canceller,
            progress,
            outcome,
        });
        Ok(())
    }

    /// The result of the file once it is finished or has failed: the message for the player.
    pub fn poll(&mut self) -> Option<anyhow::Result<String>> {
        let outcome = match self.current.as_ref()?.outcome.try_recv() {
            Ok(outcome) => outcome,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => Err(anyhow::anyhow!("its thread ended")),
        };
        self.current = None;
        Some(outcome)
    }

    /// Cancels the file.
    pub fn cancel(&mut self) {
        self.current = None;
    }

    /// Rendered share of the file in percent, if there is one.
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
