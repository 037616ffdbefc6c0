//! The recorder of `--record`: every shot as a file of its own.

use std::fs;
use std::path::PathBuf;

use anyhow::Context as _;
use carom_billiards::physics::{Recording, Shot, Table};

use carom_text::text;

use super::recordings::{RecordingKind, RecordingStore};

/// A folder that shots are recorded in.
#[derive(Debug)]
pub struct ShotRecorder {
    store: RecordingStore,
    /// The number of the last shot.
    last: u64,
}

impl ShotRecorder {
    /// Records in a folder, which is made if there is none.
    ///
    /// # Errors
    /// A sentence if the folder cannot be made.
    pub fn new(folder: PathBuf) -> anyhow::Result<Self> {
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let store = RecordingStore::at(folder);
        Ok(Self { store, last: 0 })
    }

    /// Records a shot, each number once, under the next free name.
    pub fn record(&mut self, number: u64, shot: &Shot, table: &Table) {
        if number <= self.last {
            return;
        }
        self.last = number;
        let recording = Recording::of(table, text!("shot-numbered", number = number), shot.clone());
        if let Err(error) = self.store.save(RecordingKind::Shot, &recording) {
            tracing::error!("{error}");
        }
    }
}
