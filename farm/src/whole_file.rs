//! Files that are whole: written under a hidden name, which one writer holds at a time, and renamed; or read
//! with a bound.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read as _, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A claim on a file: nobody else that claims it can write it until this is dropped. What was in its
/// place stays there until [`WholeFile::commit`].
///
/// The hidden name `.NAME.partial` is new for each claim, so that no link that lies there is followed and
/// no file of that name is written over; what a killed process has left under it is replaced.
///
/// ```
/// # fn main() -> std::io::Result<()> {
/// # let folder = std::env::temp_dir().join(format!("carom-{}", std::process::id()));
/// # std::fs::create_dir_all(&folder)?;
/// let mut file = carom_farm::WholeFile::claim(&folder.join("notes.txt"))?;
/// std::io::Write::write_all(&mut file, b"all of it")?;
/// file.commit()?;
/// # std::fs::remove_dir_all(folder)
/// # }
/// ```
#[derive(Debug)]
pub struct WholeFile {
    path: PathBuf,
    partial: PathBuf,
    /// Locked while the claim lasts; what a killed process leaves behind is not.
    file: File,
}

impl WholeFile {
    /// Claims the file, which need not be there yet.
    ///
    /// # Errors
    /// [`ErrorKind::AlreadyExists`] if somebody else has claimed it; the system's if its folder cannot be
    /// written.
    pub fn claim(path: &Path) -> io::Result<Self> {
        Self::claim_as(path, partial(path))
    }

    /// Claims the file under a hidden name of the caller's choice: who chooses another one may claim it too.
    pub(crate) fn claim_as(path: &Path, partial: PathBuf) -> io::Result<Self> {
        let file = match create_new(&partial) {
            Err(why) if why.kind() == ErrorKind::AlreadyExists => {
                remove_abandoned(&partial)?;
                create_new(&partial).map_err(|why| match why.kind() {
                    ErrorKind::AlreadyExists => claimed(),
                    _ => why,
                })?
            }
            file => file?,
        };
        try_lock(&file)?;
        if !is_file_at(&file, &partial)? {
            return Err(claimed()); // between the two lines before, by somebody who took it for abandoned
        }
        Ok(Self {
            path: path.to_owned(),
            partial,
            file,
        })
    }

    /// Claims the file, writes it and commits it.
    ///
    /// # Errors
    /// As [`WholeFile::claim`] and [`WholeFile::commit`], or the writer's.
    pub fn replace(path: &Path, write: impl FnOnce(&mut Self) -> io::Result<()>) -> io::Result<()> {
        let mut file = Self::claim(path)?;
        write(&mut file)?;
        file.commit()
    }

    /// The name that it will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The name that it has until then, for a program that writes it: one that opens it again, without
    /// removing it.
    pub fn partial_path(&self) -> &Path {
        &self.partial
    }

    /// Empties it, to write it from its start.
    ///
    /// # Errors
    /// The system's.
    pub fn restart(&mut self) -> io::Result<()> {
        self.file.set_len(0)?;
        self.file.seek(SeekFrom::Start(0)).map(drop)
    }

    /// Waits until the bytes are on the disk, so that a power cut after [`WholeFile::commit`] leaves no name
    /// without content.
    ///
    /// # Errors
    /// The system's.
    pub fn sync(&self) -> io::Result<()> {
        self.file.sync_all()
    }

    /// Gives it its name, in place of what has it.
    ///
    /// # Errors
    /// The system's, and [`ErrorKind::NotFound`] if the hidden file was removed meanwhile.
    pub fn commit(self) -> io::Result<()> {
        if !is_file_at(&self.file, &self.partial)? {
            return Err(io::Error::new(
                ErrorKind::NotFound,
                format!(
                    "{} was replaced while it was written",
                    self.partial.display()
                ),
            ));
        }
        fs::rename(&self.partial, &self.path)
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for WholeFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        // After a commit somebody else may have claimed the name already.
        if is_file_at(&self.file, &self.partial).unwrap_or(false) {
            let _ = fs::remove_file(&self.partial);
        }
    }
}

/// `a/b.exr` becomes `a/.b.exr.partial`: names of different files differ.
fn partial(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(".partial");
    path.with_file_name(name)
}

fn create_new(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).create_new(true).open(path)
}

/// Removes what a killed process has left behind; a link or a pipe is none of ours.
fn remove_abandoned(path: &Path) -> io::Result<()> {
    let opened = fs::symlink_metadata(path).and_then(|found| match found.is_file() {
        true => OpenOptions::new().write(true).open(path),
        false => Err(in_the_way(path)),
    });
    let file = match opened {
        Err(why) if why.kind() == ErrorKind::NotFound => return Ok(()),
        file => file?,
    };
    try_lock(&file)?;
    match is_file_at(&file, path)? {
        true => fs::remove_file(path),
        false => Err(claimed()),
    }
}

/// A file system without locks has none held.
fn try_lock(file: &File) -> io::Result<()> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(claimed()),
        Err(TryLockError::Error(why)) if why.kind() != ErrorKind::Unsupported => Err(why),
        _ => Ok(()),
    }
}

fn claimed() -> io::Error {
    io::Error::new(
        ErrorKind::AlreadyExists,
        "another program is writing this file: wait for it, or choose another name",
    )
}

fn in_the_way(path: &Path) -> io::Error {
    io::Error::other(format!("{} is no plain file: remove it", path.display()))
}

/// Whether the open file still has the name.
#[cfg(unix)]
fn is_file_at(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt as _;
    let open = file.metadata()?;
    match fs::symlink_metadata(path) {
        Ok(named) => Ok((named.dev(), named.ino()) == (open.dev(), open.ino())),
        Err(why) if why.kind() == ErrorKind::NotFound => Ok(false),
        Err(why) => Err(why),
    }
}

/// Locks are mandatory there: nobody else opens what is locked.
#[cfg(not(unix))]
fn is_file_at(_file: &File, path: &Path) -> io::Result<bool> {
    path.try_exists()
}

/// The text of a file, of which no more is read than a byte past the limit, whatever the file says of its
/// length: devices and pipes have none.
pub(crate) fn read_limited(path: &Path, bytes_max: u64) -> io::Result<String> {
    let mut text = String::new();
    let bytes = File::open(path)?
        .take(bytes_max + 1)
        .read_to_string(&mut text)?;
    if bytes as u64 > bytes_max {
        let what = format!("it has more than {bytes_max} bytes");
        return Err(io::Error::new(ErrorKind::FileTooLarge, what));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn claim(path: &Path) -> WholeFile {
        WholeFile::claim(path).unwrap()
    }

    #[test]
    fn a_file_is_written_by_one_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let mut first = claim(&path);
        first.write_all(b"first").unwrap();
        let refused = WholeFile::claim(&path).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::AlreadyExists);
        first.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"first");
        drop(claim(&path));
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
    }

    #[test]
    fn what_a_killed_process_left_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        fs::write(partial(&path), "half a picture").unwrap();
        let mut file = claim(&path);
        file.write_all(b"whole").unwrap();
        file.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }

    #[cfg(unix)]
    #[test]
    fn no_link_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("a.exr"), folder.path().join("other"));
        fs::write(&other, "somebody's").unwrap();
        std::os::unix::fs::symlink(&other, partial(&path)).unwrap();
        let why = WholeFile::claim(&path).unwrap_err().to_string();
        assert!(
            why.contains(".a.exr.partial is no plain file: remove it"),
            "{why}"
        );
        assert_eq!(fs::read(&other).unwrap(), b"somebody's");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
    }

    #[cfg(unix)]
    #[test]
    fn nobody_commits_what_another_writes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let mut first = claim(&path);
        first.write_all(b"first").unwrap();
        // A program that knows no locks clears away.
        fs::remove_file(partial(&path)).unwrap();
        let mut second = claim(&path);
        first.commit().unwrap_err();
        second.write_all(b"second").unwrap();
        second.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
    }

    #[test]
    fn writers_at_the_same_time_never_mix() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let write = |byte: u8| {
            for _ in 0..200 {
                let Ok(mut file) = WholeFile::claim(&path) else {
                    continue;
                };
                for _ in 0..8 {
                    file.write_all(&[byte; 64]).unwrap();
                }
                file.commit().unwrap();
                let bytes = fs::read(&path).unwrap();
                assert_eq!(bytes.len(), 512);
                assert!(bytes.iter().all(|of| *of == bytes[0]));
            }
        };
        std::thread::scope(|scope| {
            for byte in 0..4 {
                scope.spawn(move || write(byte));
            }
        });
    }
}
