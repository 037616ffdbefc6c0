//! Errors of the tracer, each of which says whose fault it is.

use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};

use crate::text::{SENTENCE_BYTES_MAX, printable};

/// Each variant says who is at fault; the scene's author for all but [`Error::Device`] and
/// [`Error::Io`].
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene breaks a rule or a limit.
    #[error("the scene cannot be drawn: {}", sentence(.0))]
    InvalidScene(SceneError),
    /// A frame's update does not fit its scene.
    #[error("the scene update does not fit: {}", sentence(.0))]
    InvalidUpdate(SceneError),
    /// The settings or the image size are out of range.
    #[error("{0}")]
    InvalidSettings(SettingsError),
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
        source: io::Error,
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

    /// This error as one of a file that holds what it is about.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        Self::format(path, self.to_string())
    }

    pub(crate) fn settings(sentence: String) -> Self {
        Self::InvalidSettings(SettingsError(sentence))
    }
}

/// Names in a scene are a stranger's.
fn sentence(fault: &SceneError) -> String {
    printable(&fault.to_string(), SENTENCE_BYTES_MAX)
}

/// The rule that a scene, or an update of one, breaks: with the value that breaks it, and what to do.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A part of the scene is at fault: an object, a material, a light, a texture.
    #[error("{part}: {fault}")]
    Part {
        /// Which part, with its index or name.
        part: String,
        /// Its fault.
        fault: Box<SceneError>,
    },
    /// There is more of something than is allowed.
    #[error("it has {count} {what}: at most {max} are allowed")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// How much there is.
        count: usize,
        /// How much may be.
        max: usize,
    },
    /// A value is out of its range.
    #[error("{what} is {value}: {range}")]
    Value {
        /// The value's name.
        what: String,
        /// It, as it was given.
        value: String,
        /// What it must be.
        range: String,
    },
    /// Values do not fit each other.
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

/// What is wrong with settings, or with the size of a picture or film: the value, its rule and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct SettingsError(pub String);
