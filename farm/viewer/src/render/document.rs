//! Document: the scene file that is open, read on a thread of its own, and again when it changes.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant, SystemTime};

use carom_farm::{Error, SceneFile};
use carom_tracer::{Camera, Scene, SceneUpdate};

use super::Exchange;
use crate::lights::LightSwitches;

/// The scene that is open.
pub(super) struct Document {
    pub(super) number: u64,
    pub(super) path: PathBuf,
    pub(super) file: SceneFile,
    /// What is shown of it: a scene, and what has moved there since.
    pub(super) scene: Arc<Scene>,
    pub(super) update: SceneUpdate,
    /// When that is.
    pub(super) time: Option<(usize, f64)>,
    /// How it is looked at until the window says it.
    pub(super) camera: Camera,
    pub(super) lights: LightSwitches,
}

impl Document {
    /// Shows another moment.
    ///
    /// # Errors
    /// What cannot be drawn then; what is shown stays.
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
            // Nobody waits for it any more once the window is closed.
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

    /// What was read, once it is there.
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

/// A file that is looked at now and then for changes.
pub(super) struct FileWatch {
    path: PathBuf,
    /// As it was when it was read, and as it was at the last look.
    read: Option<FileStamp>,
    seen: Option<FileStamp>,
    looked: Instant,
}

/// What differs once a file has been written.
type FileStamp = (SystemTime, u64);

impl FileWatch {
    /// Of a file that is about to be read.
    pub(super) fn new(path: &Path) -> Self {
        let stamp = stamp(path);
        Self {
            path: path.to_owned(),
            read: stamp,
            seen: stamp,
            looked: Instant::now(),
        }
    }

    /// The file, if it has changed since it was read, and is not being written any more.
    pub(super) fn changed(&mut self) -> Option<PathBuf> {
        if self.looked.elapsed() < LOOK_PERIOD {
            return None;
        }
        self.looked = Instant::now();
        let now = stamp(&self.path);
        let before = std::mem::replace(&mut self.seen, now);
        // One that is away is about to be put in place.
        let has_changed = now.is_some() && now == before && now != self.read;
        has_changed.then(|| self.path.clone())
    }
}

fn stamp(path: &Path) -> Option<FileStamp> {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

/// How often a file is looked at.
const LOOK_PERIOD: Duration = Duration::from_millis(500);
