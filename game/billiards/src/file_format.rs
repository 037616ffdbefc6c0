//! The form of the crate's files: a line that says the kind, a version, and a body by postcard.

use std::{fs, path::Path};

use serde::{Serialize, de::DeserializeOwned};

use crate::FileFault;

/// A kind of file.
pub(crate) struct FileFormat {
    /// For people.
    pub(crate) kind: &'static str,
    /// What its files begin with.
    pub(crate) magic: &'static [u8],
    /// Rises when what follows it changes.
    pub(crate) version: u16,
    /// Bytes of the largest.
    pub(crate) bytes_max: u64,
}

impl FileFormat {
    /// The bytes of a file.
    pub(crate) fn encode(&self, body: &impl Serialize) -> Result<Vec<u8>, FileFault> {
        let mut bytes = self.magic.to_vec();
        bytes.extend(self.version.to_le_bytes());
        bytes.extend(postcard::to_stdvec(body).map_err(FileFault::NotEncoded)?);
        self.check_size(bytes.len() as u64)?;
        Ok(bytes)
    }

    /// Whether bytes begin as a file of this kind and version does.
    pub(crate) fn is_of(&self, bytes: &[u8]) -> bool {
        let rest = bytes.strip_prefix(self.magic);
        rest.is_some_and(|rest| rest.starts_with(&self.version.to_le_bytes()))
    }

    /// The body of a file, which ends with it.
    pub(crate) fn decode<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T, FileFault> {
        self.check_size(bytes.len() as u64)?;
        let kind = self.kind;
        let rest = bytes.strip_prefix(self.magic);
        let rest = rest.ok_or(FileFault::OtherKind { kind })?;
        let (version, body) = rest.split_first_chunk().ok_or(FileFault::NoVersion)?;
        let (version, known) = (u16::from_le_bytes(*version), self.version);
        if version != known {
            return Err(FileFault::OtherVersion { version, known });
        }
        let (body, left) = postcard::take_from_bytes(body).map_err(FileFault::Damaged)?;
        match left.len() {
            0 => Ok(body),
            bytes => Err(FileFault::TrailingBytes { bytes }),
        }
    }

    /// The bytes of a file on the disk; one that is too large is not read.
    pub(crate) fn read(&self, path: &Path) -> Result<Vec<u8>, FileFault> {
        self.check_size(fs::metadata(path).map_err(FileFault::Io)?.len())?;
        fs::read(path).map_err(FileFault::Io)
    }

    fn check_size(&self, bytes: u64) -> Result<(), FileFault> {
        let max = self.bytes_max;
        match bytes <= max {
            true => Ok(()),
            false => Err(FileFault::TooLarge { bytes, max }),
        }
    }
}
