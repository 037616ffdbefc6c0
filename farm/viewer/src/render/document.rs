//! Document: the open scene file, read on a thread of its own, and reread when it changes.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant, SystemTime};

use carom_farm::{Error, SceneFile};
use carom_tracer::{Camera, Scene, SceneUpdate};

use super::Exchange;
use crate::lights::LightSwitches;

/// The open scene.
pub(super) struct Document {
    pub(super) number: u64,
    pub(super) path: PathBuf,
    pub(super) file: SceneFile,
    /// The shown state of it: a scene, and what has moved since.
    pub(super) scene: Arc<Scene>,
    pub(super) update: SceneUpdate,
    /// The animation and time of that state.
    pub(super) time: Option<(usize, f64)>,
    /// Camera and lights used until the window sets others.
    pub(super) camera: Camera,
    pub(super) lights: LightSwitches,
}

impl Document {
    /// Moves to another time.
    ///
    /// # Errors
    /// The reason why the scene cannot be drawn at that time; the shown state stays.
    pub(super) fn seek(&mut self, time: Option<(usize, f64)>) -> Result<(), Error> {
        if time == self.time {
            return Ok(());
        }
        self.time = time;
        if let Some((animation, secs)) = time {
            (self.scene, self.update) = self.file.seek(animation, secs)?;
        }
        Ok(())
    }
}

/// A file that is being read.
pub(super) struct Reading {
    pub(super) path: PathBuf,
    pub(super) is_reread: bool,
    file: Receiver<Result<SceneFile, Error>>,
}

impl Reading {
    /// Begins to read a file; `exchange` is notified at the end.
    pub(super) fn begin(
        path: PathBuf,
        is_reread: bool,
        exchange: &Arc<Exchange>,
    ) -> std::io::Result<Self> {
        let (sender, receiver) = channel();
        let (file, exchange) = (path.clone(), Arc::clone(exchange));
        let read = move || {
            // Fails if the window has been closed meanwhile.
            let _ = sender.send(SceneFile::open(&file));
            exchange.notify();
        };
        let thread = std::thread::Builder::new().name("carom-view-read".to_owned());
        thread.spawn(read)?;
        Ok(Self {
            path,
            is_reread,
            file: receiver,
        })
    }

    /// The result, once the file has been read.
    pub(super) fn poll(&self) -> Option<Result<SceneFile, String>> {
        match self.file.try_recv() {
            Ok(read) => Some(read.map_err(|why| why.to_string())),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                let thread = Error::RenderThread;
                Some(Err(format!("{}: {thread}", self.path.display())))
            }
        }
    }
}

/// Watch of a file for changes, by polling.
pub(super) struct FileWatch {
    path: PathBuf,
    /// Its stamps when it was read and at the last poll.
    read: Option<FileStamp>,
    seen: Option<FileStamp>,
    looked: Instant,
}

/// Modification time and length, which differ once a file has been rewritten.
type FileStamp = (SystemTime, u64);

impl FileWatch {
    /// A watch of a file that is about to be read.
    pub(super) fn new(path: &Path) -> Self {
        let stamp = stamp(path);
        Self {
            path: path.to_owned(),
            read: stamp,
            seen: stamp,
            looked: Instant::now(),
        }
    }

    /// The file, if it has changed since it was read and is not still being written.
    pub(super) fn changed(&mut self) -> Option<PathBuf> {
        if self.looked.elapsed() < LOOK_PERIOD {
            return None;
        }
        self.looked = Instant::now();
        let now = stamp(&self.path);
        let before = std::mem::replace(&mut self.seen, now);
        // A missing file is about to be replaced; one that differs between polls is being written.
        let has_changed = now.is_some() && now == before && now != self.read;
        has_changed.then(|| self.path.clone())
    }
}

fn stamp(path: &Path) -> Option<FileStamp> {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

/// Period of polling the file.
const LOOK_PERIOD: Duration = Duration::from_millis(500);
