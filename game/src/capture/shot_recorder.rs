//! Recorder of `--record`, which saves every shot as a file.

use std::fs;
use std::path::PathBuf;

use anyhow::Context as _;
use carom_billiards::physics::{Recording, Shot, Table};

use carom_text::text;

use super::recordings::{RecordingKind, RecordingStore};

/// Recorder of shots to a folder.
#[derive(Debug)]
pub struct ShotRecorder {
    store: RecordingStore,
    /// Number of the last recorded shot.
    last: u64,
}

impl ShotRecorder {
    /// A recorder to a folder, which is created if it is missing.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub fn new(folder: PathBuf) -> anyhow::Result<Self> {
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let store = RecordingStore::at(folder);
        Ok(Self { store, last: 0 })
    }

    /// Saves a shot under the next free name, each number once.
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
