//! Threads that query directories periodically.

use std::io;
use std::sync::mpsc::{self, RecvTimeoutError};

use super::{Directory, ListedNode};

/// Thread of a directory, which ends after this is dropped.
pub(crate) struct DirectoryWatch {
    _running: mpsc::Sender<()>,
}

impl DirectoryWatch {
    /// Queries `directory` now and after each of its periods. `changed` is called with each answer that
    /// differs from the one before, and returns whether further answers are wanted.
    ///
    /// # Errors
    /// If the system can start no thread.
    pub(crate) fn start(
        mut directory: Box<dyn Directory>,
        changed: impl Fn(Vec<ListedNode>) -> bool + Send + 'static,
    ) -> Result<Self, io::Error> {
        let (running, stopped) = mpsc::channel::<()>();
        let watch = move || {
            let mut last = None;
            let mut fault = None;
            loop {
                match directory.nodes() {
                    Ok(nodes) if last.as_ref() != Some(&nodes) => {
                        fault = None;
                        last = Some(nodes.clone());
                        if !changed(nodes) {
                            return;
                        }
                    }
                    Ok(_) => fault = None,
                    // The same fault is logged once until there is an answer again.
                    Err(why) => {
                        let why = why.to_string();
                        if fault.as_ref() != Some(&why) {
                            tracing::warn!("{why}; the nodes that it has listed are kept");
                            fault = Some(why);
                        }
                    }
                }
                // The timeout is the pause between two queries; an error means that the watch has been
                // dropped.
                match stopped.recv_timeout(directory.period()) {
                    Err(RecvTimeoutError::Timeout) => {}
                    _ => return,
                }
            }
        };
        std::thread::Builder::new()
            .name("carom-directory".into())
            .spawn(watch)?;
        Ok(Self { _running: running })
    }
}
