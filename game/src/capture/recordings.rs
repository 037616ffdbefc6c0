//! Recordings as files in a folder.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use carom_billiards::physics::Recording;
use carom_farm::WholeFile;

use crate::{Error, Result};

/// Kind of a recording, which its file's name tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordingKind {
    /// One shot.
    Shot,
    /// The shots of a match.
    Match,
    /// A layout of balls to play from.
    Layout,
}

impl RecordingKind {
    fn stem(self) -> &'static str {
        match self {
            Self::Shot => "shot",
            Self::Match => "match",
            Self::Layout => "layout",
        }
    }
}

/// File of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SavedRecording {
    /// Its name without the ending.
    pub name: String,
    /// Its path.
    pub path: PathBuf,
}

/// The folder of a player's recordings.
#[derive(Clone, Debug)]
pub struct RecordingStore {
    folder: PathBuf,
}

impl RecordingStore {
    /// A store in a folder, which is created when the first file is saved.
    pub fn at(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Path of the folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The recordings in the folder, sorted by name, at most a thousand. A missing folder is empty.
    ///
    /// # Errors
    /// [`Error::Folder`] if it cannot be read.
    pub fn list(&self) -> Result<Vec<SavedRecording>> {
        let entries = match fs::read_dir(&self.folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(source) => {
                let path = self.folder.clone();
                return Err(Error::Folder { path, source });
            }
        };
        let kept = entries.filter_map(|entry| {
            let path = entry.ok()?.path();
            let name = path.file_stem()?.to_string_lossy().into_owned();
            (path.extension()? == ENDING).then_some(SavedRecording { name, path })
        });
        let mut kept: Vec<SavedRecording> = kept.take(KEPT_MAX).collect();
        kept.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(kept)
    }

    /// Saves a recording under the next free name, and returns its path.
    ///
    /// # Errors
    /// If the folder or the file cannot be written.
    pub fn save(&self, kind: RecordingKind, recording: &Recording) -> Result<PathBuf> {
        let path = next_path(&self.folder, kind.stem(), &[ENDING])?;
        recording.save(&path)?;
        Ok(path)
    }
}

/// The first path of `stem_0001.ending` and so on whose number is free with all of the endings, with the
/// first of these. The folder is created if it is missing.
///
/// # Errors
/// [`Error::FolderFull`] if all numbers are in use, [`Error::Unwritable`].
pub(crate) fn next_path(folder: &Path, stem: &str, endings: &[&str]) -> Result<PathBuf> {
    let unwritable = |path: &Path, source| Error::Unwritable {
        path: path.to_owned(),
        source,
    };
    fs::create_dir_all(folder).map_err(|source| unwritable(folder, source))?;
    let path = |number: u32, ending: &str| folder.join(format!("{stem}_{number:04}.{ending}"));
    let is_free = |number: &u32| !endings.iter().any(|ending| path(*number, ending).exists());
    let free = (1..=NUMBER_MAX).find(is_free);
    let free = free.map(|number| path(number, endings[0]));
    let free = free.ok_or_else(|| Error::FolderFull {
        path: folder.to_owned(),
        files_max: NUMBER_MAX,
    })?;
    WholeFile::claim(&free).map_err(|source| unwritable(&free, source))?;
    Ok(free)
}

const ENDING: &str = "carom";
/// Largest number of recordings listed.
const KEPT_MAX: usize = 1000;
const NUMBER_MAX: u32 = 9999;

#[cfg(test)]
mod tests {
    use super::*;
    use carom_billiards::physics::{Table, World};

    #[test]
    fn what_is_put_there_is_found_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let store = RecordingStore::at(folder.path().join("shots"));
        assert_eq!(store.list().unwrap(), []);
        let table = Table::nine_foot();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        let layout = Recording::of(&table, "rack", world.release().unwrap());
        for kind in [
            RecordingKind::Layout,
            RecordingKind::Shot,
            RecordingKind::Layout,
        ] {
            store.save(kind, &layout).unwrap();
        }
        fs::write(store.folder().join("notes.txt"), "").unwrap();
        let names: Vec<String> = store.list().unwrap().into_iter().map(|k| k.name).collect();
        assert_eq!(names, ["layout_0001", "layout_0002", "shot_0001"]);
        let read = Recording::load(&store.list().unwrap()[0].path).unwrap();
        assert_eq!(read.clips[0].title, "rack");
        assert!(fs::metadata(&store.list().unwrap()[0].path).unwrap().len() < 4096);
        fs::write(folder.path().join("file"), "").unwrap();
        let blocked = RecordingStore::at(folder.path().join("file"));
        let error = blocked.save(RecordingKind::Shot, &layout).unwrap_err();
        assert!(error.to_string().contains("file"), "{error}");
    }
}
