//! Errors of the tracer, each of which says whose fault it is.

use std::path::PathBuf;

/// Each variant says who is at fault; the scene's author for all but [`Error::Device`] and
/// [`Error::Io`].
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene breaks a rule or a limit: a sentence with the place, the value and the rule.
    #[error("the scene cannot be drawn: {0}")]
    InvalidScene(String),
    /// A frame's update does not fit its scene.
    #[error("the scene update does not fit: {0}")]
    InvalidUpdate(String),
    /// The settings or the image size are out of range.
    #[error("{0}")]
    InvalidSettings(String),
    /// A file holds something else than its format asks for.
    #[error("{path}: {message}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        message: String,
    },
    /// The operating system refused a file.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Its reason.
        source: std::io::Error,
    },
    /// The device cannot do the work: absent, lost, out of memory or wrong.
    #[error("{device}: {message}")]
    Device {
        /// The adapter, or the kind of device that was looked for.
        device: String,
        /// What happened and what to do.
        message: String,
    },
}
