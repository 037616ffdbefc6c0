//! Work on its own thread, which can be watched, cancelled and waited for.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use crate::error::Error;
use crate::lock::lock;

/// A still or a film that is being traced. Dropping it cancels it.
#[derive(Debug)]
pub struct Job<T, P> {
    thread: Option<JoinHandle<Result<T, Error>>>,
    canceller: Canceller,
    progress: Arc<Mutex<P>>,
    /// Samples of a still, or frames of a film, from an interrupted job.
    pub(crate) resumed: u32,
}

/// Handle that cancels a still or a film from another thread.
#[derive(Clone, Debug, Default)]
pub struct Canceller(Arc<AtomicBool>);

impl Canceller {
    /// Cancels the work: [`Job::wait`] returns [`Error::Cancelled`] or [`Error::FilmCancelled`].
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub(crate) fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

impl<T: Send + 'static, P: Clone> Job<T, P> {
    /// Starts `run`, which must check its argument regularly and keep `progress` up to date.
    ///
    /// # Errors
    /// [`Error::Thread`].
    pub(crate) fn start(
        name: &str,
        progress: Arc<Mutex<P>>,
        resumed: u32,
        run: impl FnOnce(&Canceller) -> Result<T, Error> + Send + 'static,
    ) -> Result<Self, Error> {
        let canceller = Canceller::default();
        let seen = canceller.clone();
        let thread = std::thread::Builder::new().name(name.to_owned());
        let thread = thread.spawn(move || run(&seen)).map_err(Error::Thread)?;
        Ok(Self {
            thread: Some(thread),
            canceller,
            progress,
            resumed,
        })
    }

    /// The current progress.
    pub fn progress(&self) -> P {
        lock(&self.progress).clone()
    }

    /// Whether [`Job::wait`] would return at once.
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Cancels the work. Finished frames of a film are kept, and the checkpoint of a still if it has one.
    pub fn cancel(&self) {
        self.canceller.cancel();
    }

    /// A handle that cancels the work while another thread waits for it.
    pub fn canceller(&self) -> Canceller {
        self.canceller.clone()
    }

    /// Waits for the picture, or for all frames of a film's range.
    ///
    /// # Errors
    /// [`Error::NoNodes`] if no node has answered for [`crate::FarmConfig::timeout_secs`],
    /// [`Error::FrameRefused`] if every node refuses a picture, [`Error::Cancelled`] or [`Error::FilmCancelled`],
    /// [`Error::FarmClosed`] if the farm has been dropped, [`Error::File`].
    pub fn wait(mut self) -> Result<T, Error> {
        let thread = self.thread.take().ok_or(Error::RenderThread)?;
        thread.join().map_err(|_| Error::RenderThread)?
    }
}

impl<T, P> Drop for Job<T, P> {
    fn drop(&mut self) {
        self.canceller.cancel();
    }
}
