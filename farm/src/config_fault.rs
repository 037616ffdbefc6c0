//! Faults of a farm's configuration.

use std::path::PathBuf;

/// Fault of a configuration.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigFault {
    /// The file cannot be read.
    #[error(
        "{}, which should hold the farm's configuration, cannot be read: {source}; correct its name or who may read it",
        path.display()
    )]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A line of the file is not a setting.
    #[error("{}: line {line}, `{excerpt}`: {reason}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, counted from 1.
        line: usize,
        /// The beginning of the line.
        excerpt: String,
        /// The parser's reason.
        reason: String,
    },
    /// A number is out of range.
    #[error("{field} is {value}: it must be from {min} to {max}")]
    OutOfRange {
        /// The field of [`crate::FarmConfig`].
        field: &'static str,
        /// Its value.
        value: usize,
        /// The minimum.
        min: usize,
        /// The maximum.
        max: usize,
    },
    /// The coarsest precision is finer than the finest.
    #[error("{0}")]
    Precision(carom_protocol::Reason),
    /// There are more nodes than a farm may have.
    #[error("there are {count} nodes: at most {max} are allowed")]
    TooManyNodes {
        /// The number, including the one to be added.
        count: usize,
        /// The maximum.
        max: usize,
    },
}
