//! Files of keys and certificates: private from their creation on, or replaced atomically.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::Path;

use crate::Error;
use crate::whole_file::WholeFile;

/// Creates a folder that only its owner can access.
pub(crate) fn create_private_dir(dir: &Path) -> Result<(), Error> {
    let mut builder = fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(dir).map_err(file_error(dir))
}

/// Writes a new file that is readable by its owner alone from its creation on.
pub(crate) fn write_private(path: &Path, text: &str) -> Result<(), Error> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
        .open(path)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .map_err(file_error(path))
}

/// Refuses a key that every user of this machine can access, and warns of one that its group can: containers
/// mount secrets for a group.
pub(crate) fn check_private(key: &Path) -> Result<(), Error> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let file = fs::metadata(key).map_err(file_error(key))?;
        let mode = file.permissions().mode();
        if mode & 0o007 != 0 {
            return Err(Error::KeyExposed {
                path: key.to_path_buf(),
                mode: mode & 0o777,
            });
        }
        if mode & 0o070 != 0 {
            let key = key.display();
            tracing::warn!("{key}: its group can read this key; run `chmod 600 {key}`");
        }
    }
    #[cfg(not(unix))]
    let _ = key;
    Ok(())
}

/// Replaces a file atomically: a reader sees the old content or all of the new one.
pub(crate) fn write_whole(path: &Path, text: &str) -> Result<(), Error> {
    let written = WholeFile::replace(path, |file| file.write_all(text.as_bytes()));
    written.map_err(file_error(path))
}

/// Converts the system's error about a file or folder.
pub(crate) fn file_error(path: &Path) -> impl Fn(std::io::Error) -> Error {
    move |source| Error::CredentialsFile {
        path: path.to_path_buf(),
        source,
    }
}
