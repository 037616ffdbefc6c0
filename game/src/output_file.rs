//! Path of the file that a subcommand writes.

use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// The named file, which may exist; or the usual one, which must not.
///
/// # Errors
/// [`Error::InTheWay`].
pub fn output_file(named: Option<&Path>, usual: &str) -> Result<PathBuf> {
    let usual = PathBuf::from(usual);
    match named {
        Some(named) => Ok(named.to_owned()),
        None if usual.exists() => Err(Error::InTheWay(usual)),
        None => Ok(usual),
    }
}
