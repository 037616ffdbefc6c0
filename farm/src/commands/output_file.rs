//! Picture file of a render, which is claimed before tracing begins.

use std::io::ErrorKind;
use std::path::Path;

use anyhow::Context;
use carom_farm::{FileFormat, Picture, WholeFile};

use crate::commands::Failure;
use crate::commands::inputs::PictureFile;

/// Claim on a picture file: no other render writes it or its checkpoint until this is dropped.
pub(crate) struct OutputFile {
    file: WholeFile,
    format: FileFormat,
}

impl OutputFile {
    /// Claims the file.
    ///
    /// # Errors
    /// [`Failure::Input`] if the folder is not writable or another render has claimed the file.
    pub(crate) fn claim(picture: &PictureFile) -> Result<Self, Failure> {
        let path = picture.path.display();
        let file = WholeFile::claim(&picture.path).map_err(|why| match why.kind() {
            ErrorKind::AlreadyExists => {
                Failure::Input(format!("{path}: another render is writing this file"))
            }
            _ => Failure::Input(format!(
                "{path} cannot be written: {why}; choose another file or folder with --out"
            )),
        })?;
        Ok(Self {
            file,
            format: picture.format,
        })
    }

    pub(crate) fn path(&self) -> &Path {
        self.file.path()
    }

    pub(crate) fn format(&self) -> FileFormat {
        self.format
    }

    /// Writes the picture, with its layers if the format supports them.
    ///
    /// # Errors
    /// [`Failure::Run`] if writing fails.
    pub(crate) fn write(mut self, picture: &Picture) -> Result<(), Failure> {
        let path = self.file.path().display().to_string();
        let written = picture.encode(self.format, &mut self.file);
        written
            .and_then(|()| self.file.commit())
            .context(path)
            .map_err(Failure::Run)
    }
}
