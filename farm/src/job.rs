//! Work on a thread of its own, which can be cancelled and waited for.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use crate::error::Error;

/// See the [module](self). Dropped, it is cancelled.
#[derive(Debug)]
pub(crate) struct Job<T> {
    thread: Option<JoinHandle<Result<T, Error>>>,
    canceller: Canceller,
}

/// Cancels a still or a film from another thread.
#[derive(Clone, Debug, Default)]
pub struct Canceller(Arc<AtomicBool>);

impl Canceller {
    /// Ends the work: who waits for it gets [`Error::Cancelled`] or [`Error::FilmCancelled`].
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub(crate) fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

impl<T: Send + 'static> Job<T> {
    /// Starts `run`, which looks at its argument now and then.
    ///
    /// # Errors
    /// [`Error::Thread`].
    pub(crate) fn start(
        name: &str,
        run: impl FnOnce(&Canceller) -> Result<T, Error> + Send + 'static,
    ) -> Result<Self, Error> {
        let canceller = Canceller::default();
        let seen = canceller.clone();
        let thread = std::thread::Builder::new().name(name.to_owned());
        let thread = thread.spawn(move || run(&seen)).map_err(Error::Thread)?;
        Ok(Self {
            thread: Some(thread),
            canceller,
        })
    }

    pub(crate) fn canceller(&self) -> &Canceller {
        &self.canceller
    }

    pub(crate) fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the result.
    pub(crate) fn wait(mut self) -> Result<T, Error> {
        let thread = self.thread.take().ok_or(Error::RenderThread)?;
        thread.join().map_err(|_| Error::RenderThread)?
    }
}

impl<T> Drop for Job<T> {
    fn drop(&mut self) {
        self.canceller.cancel();
    }
}
