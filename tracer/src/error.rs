//! Errors of the tracer.

use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};

use crate::text::{SENTENCE_BYTES_MAX, printable};

/// An error of the tracer. All variants but [`Error::Device`] and [`Error::Io`] are faults of the
/// input.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene breaks a rule or a limit.
    #[error("the scene cannot be drawn: {}", sentence(.0))]
    InvalidScene(SceneError),
    /// A frame's update does not match its scene.
    #[error("the scene update does not fit: {}", sentence(.0))]
    InvalidUpdate(SceneError),
    /// The settings or the image size are out of range.
    #[error("{0}")]
    InvalidSettings(SettingsError),
    /// A file's contents do not conform to its format.
    #[error("{path}: {message}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        message: String,
    },
    /// The operating system reported an error for a file.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The device cannot do the work: it is absent, lost, out of memory or computes wrong results.
    #[error("{device}: {message}")]
    Device {
        /// The adapter, or the kind of device that was requested.
        device: String,
        /// What happened, and what to do about it.
        message: String,
    },
}

impl Error {
    pub(crate) fn io(path: &Path, source: io::Error) -> Self {
        let path = path.to_owned();
        Self::Io { path, source }
    }

    pub(crate) fn format(path: &Path, message: impl Into<String>) -> Self {
        Self::Format {
            path: path.to_owned(),
            message: message.into(),
        }
    }

    /// This error as one about the file that contains its subject.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        Self::format(path, self.to_string())
    }

    pub(crate) fn settings(sentence: String) -> Self {
        Self::InvalidSettings(SettingsError(sentence))
    }
}

/// Sanitised, as a scene's names come from untrusted sources.
fn sentence(fault: &SceneError) -> String {
    printable(&fault.to_string(), SENTENCE_BYTES_MAX)
}

/// The rule that a scene or an update of one breaks, with the offending value and the allowed
/// range.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A fault of a part of the scene: an object, a material, a light, a texture.
    #[error("{part}: {fault}")]
    Part {
        /// The part, with its index or name.
        part: String,
        /// The part's fault.
        fault: Box<SceneError>,
    },
    /// There are more items of a kind than allowed.
    #[error("it has {count} {what}: at most {max} are allowed")]
    TooMany {
        /// The kind of item.
        what: &'static str,
        /// Number of items.
        count: usize,
        /// Maximum number of items.
        max: usize,
    },
    /// A value is outside its range.
    #[error("{what} is {value}: {range}")]
    Value {
        /// Name of the value.
        what: String,
        /// The value as given.
        value: String,
        /// The allowed range.
        range: String,
    },
    /// Values are inconsistent with each other.
    #[error("{0}")]
    Rule(String),
}

impl SceneError {
    /// The fault as one of `part`.
    pub(crate) fn of(self, part: impl Into<String>) -> Self {
        Self::Part {
            part: part.into(),
            fault: Box::new(self),
        }
    }

    pub(crate) fn value(
        what: impl Into<String>,
        value: impl Display,
        range: impl Into<String>,
    ) -> Self {
        Self::Value {
            what: what.into(),
            value: value.to_string(),
            range: range.into(),
        }
    }

    pub(crate) fn rule(sentence: impl Into<String>) -> Self {
        Self::Rule(sentence.into())
    }

    pub(crate) fn immovable(object: u32) -> Self {
        Self::rule(format!(
            "object {object} is posed, but only spheres, truncated cones and meshes move"
        ))
    }
}

/// What is wrong with settings or with the size of an image or film: the value, its range and what
/// to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct SettingsError(pub String);
