//! Atomic file writes: under a hidden name, which one writer holds at a time, then renamed. Also bounded
//! reads.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read as _, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Exclusive claim on a file: no other claimant can write it until this is dropped. Its previous contents
/// stay in place until [`WholeFile::commit`].
///
/// The hidden file `.NAME.partial` is created anew for each claim, so that no link of that name is followed
/// and no file overwritten; what a killed process has left there is replaced.
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
    /// Locked during the claim; the lock of a killed process is released by the system.
    file: File,
}

impl WholeFile {
    /// Claims a file, which need not exist.
    ///
    /// # Errors
    /// [`ErrorKind::AlreadyExists`] if another process or thread has claimed it; an I/O error if its folder
    /// cannot be written.
    pub fn claim(path: &Path) -> io::Result<Self> {
        Self::claim_as(path, partial(path))
    }

    /// Claims a file under a hidden name of the caller's choice: claims under different names do not
    /// exclude each other.
    pub(crate) fn claim_as(path: &Path, partial: PathBuf) -> io::Result<Self> {
        // Exclusive creation keeps other writers out; the lock tells a live writer's file from one that a
        // killed process has left.
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
            return Err(claimed()); // it was taken for abandoned between its creation and its lock
        }
        Ok(Self {
            path: path.to_owned(),
            partial,
            file,
        })
    }

    /// Claims a file, writes it and commits it.
    ///
    /// # Errors
    /// As [`WholeFile::claim`] and [`WholeFile::commit`], or the writer's.
    pub fn replace(path: &Path, write: impl FnOnce(&mut Self) -> io::Result<()>) -> io::Result<()> {
        let mut file = Self::claim(path)?;
        write(&mut file)?;
        file.commit()
    }

    /// The final path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The hidden path, for a program that writes the file by opening it again without removing it.
    pub fn partial_path(&self) -> &Path {
        &self.partial
    }

    /// Truncates the file, to write it from the start.
    ///
    /// # Errors
    /// The I/O error.
    pub fn restart(&mut self) -> io::Result<()> {
        self.file.set_len(0)?;
        self.file.seek(SeekFrom::Start(0)).map(drop)
    }

    /// Waits until the contents are on the disk, so that a power cut after [`WholeFile::commit`] does not
    /// leave a name without contents.
    ///
    /// # Errors
    /// The I/O error.
    pub fn sync(&self) -> io::Result<()> {
        self.file.sync_all()
    }

    /// Renames the file to its final path, replacing what is there.
    ///
    /// # Errors
    /// The I/O error, or [`ErrorKind::NotFound`] if the hidden file was removed meanwhile.
    pub fn commit(self) -> io::Result<()> {
        // The rename goes by path, which must not name another writer's file.
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
        // After a commit, another writer may already have claimed the name.
        if is_file_at(&self.file, &self.partial).unwrap_or(false) {
            let _ = fs::remove_file(&self.partial);
        }
    }
}

/// `a/b.exr` becomes `a/.b.exr.partial`: injective, so that different files have different hidden names.
fn partial(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(".partial");
    path.with_file_name(name)
}

fn create_new(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).create_new(true).open(path)
}

/// Removes what a killed process has left behind; a link or a pipe is not ours.
fn remove_abandoned(path: &Path) -> io::Result<()> {
    let opened = fs::symlink_metadata(path).and_then(|found| match found.is_file() {
        true => OpenOptions::new().write(true).open(path),
        false => Err(in_the_way(path)),
    });
    let file = match opened {
        Err(why) if why.kind() == ErrorKind::NotFound => return Ok(()),
        file => file?,
    };
    // A live writer holds the lock; the system has released that of a killed one.
    try_lock(&file)?;
    // Another claimant may have replaced it since it was opened.
    match is_file_at(&file, path)? {
        true => fs::remove_file(path),
        false => Err(claimed()),
    }
}

/// Locks the file without waiting. On a file system without locks, it counts as unlocked by others.
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

/// Whether `path` still names the open file.
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

/// Locks are mandatory on such systems: no other process opens a locked file.
#[cfg(not(unix))]
fn is_file_at(_file: &File, path: &Path) -> io::Result<bool> {
    path.try_exists()
}

/// The text of a file. At most one byte beyond the limit is read, whatever the reported length: devices and
/// pipes report none.
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
        // A program that does not use locks removes the file.
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
