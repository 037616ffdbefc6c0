//! Picture file that appears whole or not at all: written under a name of this process's own, which
//! is claimed before anything is traced, and renamed.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context;
use carom_farm::{FileFormat, Picture};

use crate::commands::Failure;
use crate::commands::inputs::PictureFile;

/// A claim on a picture file: no other render writes it, nor its checkpoint, until this is dropped.
pub(crate) struct OutputFile {
    picture: PictureFile,
    partial: PathBuf,
    /// Locked while the claim lasts; what a killed process leaves behind is not.
    lock: File,
}

impl OutputFile {
    /// Claims the file.
    ///
    /// # Errors
    /// [`Failure::Input`] if the folder cannot be written or another render has the file.
    pub(crate) fn claim(picture: &PictureFile) -> Result<Self, Failure> {
        let partial = partial(&picture.path);
        let refused = |why: std::io::Error| match why.kind() {
            ErrorKind::AlreadyExists | ErrorKind::WouldBlock => Failure::Input(format!(
                "{}: another render is writing this file",
                picture.path.display()
            )),
            _ => Failure::Input(format!("{}: {why}", partial.display())),
        };
        let file = match create_new(&partial) {
            Err(why) if why.kind() == ErrorKind::AlreadyExists => {
                remove_unlocked(&partial).and_then(|()| create_new(&partial))
            }
            file => file,
        };
        let lock = file.map_err(refused)?;
        try_lock(&lock).map_err(refused)?;
        Ok(Self {
            picture: picture.clone(),
            partial,
            lock,
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.picture.path
    }

    pub(crate) fn format(&self) -> FileFormat {
        self.picture.format
    }

    /// Writes the picture, with its layers if the format has some.
    ///
    /// # Errors
    /// [`Failure::Run`] if it cannot be written.
    pub(crate) fn write(&self, picture: &Picture) -> Result<(), Failure> {
        let partial = &self.partial;
        // Where locks are mandatory no other handle could write.
        let _ = self.lock.unlock();
        let written = picture.write(partial, self.picture.format);
        let path = &self.picture.path;
        written
            .map_err(anyhow::Error::from)
            .and_then(|()| Ok(std::fs::rename(partial, path)?))
            .with_context(|| path.display().to_string())
            .map_err(Failure::Run)
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.partial); // renamed by now, if the picture was written
    }
}

/// `a/b.exr` becomes `a/.b.exr.partial`: names of different pictures differ.
fn partial(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(".partial");
    path.with_file_name(name)
}

fn create_new(path: &Path) -> Result<File, std::io::Error> {
    OpenOptions::new().write(true).create_new(true).open(path)
}

/// Removes what a killed process has left behind.
fn remove_unlocked(path: &Path) -> Result<(), std::io::Error> {
    try_lock(&OpenOptions::new().write(true).open(path)?)?;
    std::fs::remove_file(path)
}

/// A file system without locks has none held.
fn try_lock(file: &File) -> Result<(), std::io::Error> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(ErrorKind::WouldBlock.into()),
        Err(TryLockError::Error(why)) if why.kind() != ErrorKind::Unsupported => Err(why),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_written_by_one_render_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let picture: PictureFile = path.to_str().unwrap().parse().unwrap();
        let first = OutputFile::claim(&picture).unwrap();
        let refused = OutputFile::claim(&picture).err().unwrap();
        assert!(matches!(&refused, Failure::Input(_)), "{refused}");
        assert!(refused.to_string().contains("another render"), "{refused}");
        drop(first);
        // Left behind by a process that was killed.
        std::fs::write(partial(&path), "half a picture").unwrap();
        drop(OutputFile::claim(&picture).unwrap());
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0);
    }
}
