//! Format of the crate's files: a line that names the kind, a version, and a body in postcard.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::path::Path;

use serde::{Serialize, de::DeserializeOwned};

use crate::FileFault;

/// A kind of file.
pub(crate) struct FileFormat {
    /// Name of the kind, for messages.
    pub(crate) kind: &'static str,
    /// First bytes of its files.
    pub(crate) magic: &'static [u8],
    /// Version, raised when the format of the body changes.
    pub(crate) version: u16,
    /// Maximum size of a file in bytes.
    pub(crate) bytes_max: u64,
}

impl FileFormat {
    /// Encodes a file with this body.
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

    /// Decodes the body of a file, after which the file must end.
    pub(crate) fn decode<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T, FileFault> {
        self.check_size(bytes.len() as u64)?;
        let kind = self.kind;
        let rest = bytes.strip_prefix(self.magic);
        let rest = rest.ok_or(FileFault::OtherKind(kind))?;
        let (version, body) = rest.split_first_chunk().ok_or(FileFault::NoVersion)?;
        let (version, known) = (u16::from_le_bytes(*version), self.version);
        if version != known {
            return Err(FileFault::OtherVersion { version, known });
        }
        let (body, left) = postcard::take_from_bytes(body).map_err(FileFault::Damaged)?;
        match left.len() {
            0 => Ok(body),
            bytes => Err(FileFault::TrailingBytes(bytes)),
        }
    }

    /// Reads a plain file up to the maximum size, whatever its metadata say of its length. Pipes and
    /// devices, which have no length, are refused.
    pub(crate) fn read(&self, path: &Path) -> Result<Vec<u8>, FileFault> {
        let found = fs::metadata(path).map_err(FileFault::Io)?;
        if !found.is_file() {
            return Err(FileFault::NotPlain);
        }
        self.check_size(found.len())?;
        let mut bytes = Vec::new();
        let limited = File::open(path).map(|file| file.take(self.bytes_max + 1));
        let read = limited.and_then(|mut file| file.read_to_end(&mut bytes));
        read.map_err(FileFault::Io)?;
        self.check_size(bytes.len() as u64)?; // it may have grown
        Ok(bytes)
    }

    fn check_size(&self, bytes: u64) -> Result<(), FileFault> {
        let max = self.bytes_max;
        match bytes <= max {
            true => Ok(()),
            false => Err(FileFault::TooLarge { bytes, max }),
        }
    }
}

/// Writes a file atomically: under a new hidden name, which is then renamed. A reader sees the old
/// contents or all of the new, and no link is followed.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.partial", std::process::id()));
    let partial = path.with_file_name(name);
    // A file of this name is left over from a killed process with the same id.
    match fs::remove_file(&partial) {
        Err(why) if why.kind() != ErrorKind::NotFound => return Err(why),
        _ => {}
    }
    let write = || {
        File::create_new(&partial)?.write_all(bytes)?;
        fs::rename(&partial, path)
    };
    write().inspect_err(|_| {
        let _ = fs::remove_file(&partial); // the reason that counts is the first
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORMAT: FileFormat = FileFormat {
        kind: "test",
        magic: b"test\n",
        version: 1,
        bytes_max: 100,
    };

    #[test]
    fn files_are_read_to_their_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long");
        File::create(&path).unwrap().set_len(101).unwrap();
        let why = FORMAT.read(&path).unwrap_err().to_string();
        assert!(why.contains("101"), "{why}");
        let why = FORMAT.read(folder.path()).unwrap_err().to_string();
        assert!(why.contains("no plain file"), "{why}");
        #[cfg(unix)]
        {
            let endless = folder.path().join("endless");
            std::os::unix::fs::symlink("/dev/zero", &endless).unwrap();
            let why = FORMAT.read(&endless).unwrap_err().to_string();
            assert!(why.contains("no plain file"), "{why}");
        }
    }

    #[test]
    fn files_are_replaced_whole_and_through_no_link() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("a"), folder.path().join("a.new"));
        fs::write(&other, "somebody's").unwrap();
        replace(&path, b"first").unwrap();
        #[cfg(unix)]
        {
            let hidden = format!(".a.{}.partial", std::process::id());
            std::os::unix::fs::symlink(&other, folder.path().join(hidden)).unwrap();
        }
        replace(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read(&other).unwrap(), b"somebody's");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
        fs::create_dir(folder.path().join("taken")).unwrap();
        replace(&folder.path().join("taken"), b"third").unwrap_err();
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 3);
    }
}
