//! Renderer: the farm on a thread of its own, so that the window never waits for it.
//!
//! ```text
//! window ──Wanted──▶ worker ──▶ Farm: live picture, stills, films
//!        ◀───News───        ──▶ files, on threads of their own
//! ```
//!
//! What is wanted is a state and no queue: the worker compares it with what there is. News are kept
//! until they are taken, the newest of a kind alone.

mod document;
mod save;
mod worker;

use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use carom_farm::quality::{Quality, QualityPreference};
use carom_farm::{Balancing, Distribution, FarmConfig, LiveFrame, NodeStatus, SceneFile};
use carom_tracer::{Camera, ImageSize};
use carom_window::display::DisplayFrame;

use crate::lights::LightSwitches;

/// What the window wants of the renderer.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    /// A file to open, and how often one was asked for so far: the same file again is read again.
    pub file: Option<(u64, PathBuf)>,
    /// How a scene is looked at; until it is known, as the scene has it.
    pub look: Option<SceneLook>,
    /// Pixels of the window; none while it has no area.
    pub size: Option<ImageSize>,
    /// Radiance is shown times this.
    pub exposure: f32,
    /// Whether no more samples are gathered.
    pub is_paused: bool,
    /// What is given up first while things change.
    pub preference: QualityPreference,
    /// How frames are divided.
    pub balancing: Balancing,
    /// What of them is divided.
    pub distribution: Distribution,
    /// Whether frames are told of.
    pub has_statistics: bool,
    /// A picture or film to save.
    pub save: Option<SaveOrder>,
    /// The number of the last order that is not wanted any more; 0 for none.
    pub cancelled_save: u64,
}

/// How a scene is looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneLook {
    /// Which, see [`OpenedScene::number`].
    pub scene: u64,
    /// From where.
    pub camera: Camera,
    /// By which lights.
    pub lights: LightSwitches,
    /// An animation of it and when in that, seconds; none if it has none.
    pub time: Option<(usize, f64)>,
}

/// A picture or film to save.
#[derive(Clone, Debug, PartialEq)]
pub struct SaveOrder {
    /// Differs for each; from 1 on.
    pub number: u64,
    /// The file, whose name says its format.
    pub path: PathBuf,
    /// Pixels across and down.
    pub size: ImageSize,
    /// Samples per pixel.
    pub samples: u32,
    /// Radiance is shown times this.
    pub exposure: f32,
    /// What is seen of the scene; of a film, in each frame.
    pub views: Arc<[FrameView]>,
    /// Frames per second of a film; none for a still.
    pub frames_per_sec: Option<u16>,
}

/// From where and when a picture shows the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameView {
    /// From where.
    pub camera: FrameCamera,
    /// An animation and when in it, seconds; none shows the scene without.
    pub time: Option<(usize, f64)>,
}

/// The camera of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameCamera {
    /// One that stands here.
    Placed(Camera),
    /// The file's camera of this number, where it is at the picture's time.
    OfFile(usize),
}

/// How pictures are traced, from the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Accuracy {
    /// Samples per pixel that gather while nothing changes.
    pub samples: u32,
    /// Scattering events of a path at most.
    pub max_depth: u32,
}

/// A scene that is open now.
#[derive(Clone, Debug)]
pub struct OpenedScene {
    /// Differs for each that is opened or read again.
    pub number: u64,
    /// Its file.
    pub path: PathBuf,
    /// What was read.
    pub file: SceneFile,
    /// Whether its file has changed since it was read before.
    pub is_reread: bool,
}

/// A picture to show.
#[derive(Clone, Debug)]
pub struct ShownPicture {
    /// At its exposure.
    pub frame: DisplayFrame,
    /// Samples of each pixel.
    pub samples: u32,
    /// Whether it is a draft, shown while things change.
    pub is_draft: bool,
}

/// News of the renderer since they were last taken.
#[derive(Clone, Debug, Default)]
pub struct News {
    /// A scene that has been opened.
    pub opened: Option<OpenedScene>,
    /// Why a file could not be opened; the scene before stays.
    pub refused: Option<String>,
    /// A newer picture.
    pub picture: Option<ShownPicture>,
    /// Whether there is nothing to show any more.
    pub is_cleared: bool,
    /// Why no more pictures come; empty once they do.
    pub fault: Option<String>,
    /// Frames that have come, if they are to be told of, the oldest first.
    pub frames: Vec<LiveFrame>,
    /// Nodes as they are.
    pub nodes: Option<Vec<NodeStatus>>,
    /// Quality of drafts.
    pub quality: Option<Quality>,
    /// The file that was saved, or why it was not.
    pub saved: Option<Result<PathBuf, String>>,
    /// A file that is being read.
    pub reading: Option<PathBuf>,
    /// How far the file is that is being saved, 0 to 1.
    pub saving: Option<f64>,
}

/// See the [module](self).
pub struct Renderer {
    exchange: Arc<Exchange>,
    worker: Option<JoinHandle<()>>,
}

impl Renderer {
    /// Starts a farm; `wake` is called, from other threads, when there are news.
    ///
    /// # Errors
    /// The system's reason if there can be no thread.
    pub fn start(
        config: FarmConfig,
        accuracy: Accuracy,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> std::io::Result<Self> {
        let wanted = Wanted {
            exposure: 1.0,
            balancing: config.balancer,
            distribution: config.distribution,
            ..Wanted::default()
        };
        let exchange = Arc::new(Exchange::new(wanted, wake));
        let shared = Arc::clone(&exchange);
        let worker = std::thread::Builder::new()
            .name("carom-view".to_owned())
            .spawn(move || worker::run(config, accuracy, &shared))?;
        Ok(Self {
            exchange,
            worker: Some(worker),
        })
    }

    /// One without a farm, whose part a test takes by [`Renderer::post`].
    pub fn without_farm() -> Self {
        let wanted = Wanted {
            exposure: 1.0,
            ..Wanted::default()
        };
        Self {
            exchange: Arc::new(Exchange::new(wanted, || {})),
            worker: None,
        }
    }

    /// Wants something else from now on.
    pub fn want(&self, change: impl FnOnce(&mut Wanted)) {
        let mut state = self.exchange.lock();
        change(&mut state.wanted);
        state.is_changed = true;
        drop(state);
        self.exchange.changed.notify_all();
    }

    /// What is wanted.
    pub fn wanted(&self) -> Wanted {
        self.exchange.lock().wanted.clone()
    }

    /// What is new.
    pub fn take_news(&self) -> News {
        let mut state = self.exchange.lock();
        let lasting = News {
            reading: state.news.reading.clone(),
            saving: state.news.saving,
            ..News::default()
        };
        std::mem::replace(&mut state.news, lasting)
    }

    /// Adds news.
    pub fn post(&self, add: impl FnOnce(&mut News)) {
        self.exchange.post(add);
    }
}

impl Drop for Renderer {
    /// Waits for the farm's end: a GPU's driver must not be at work in a process that is exiting.
    fn drop(&mut self) {
        self.exchange.lock().quits = true;
        self.exchange.changed.notify_all();
        if let Some(worker) = self.worker.take() {
            let _ = worker.join(); // a panic has been reported where it happened
        }
    }
}

/// What window and worker share.
struct Exchange {
    state: Mutex<ExchangeState>,
    changed: Condvar,
    wake: Box<dyn Fn() + Send + Sync>,
}

struct ExchangeState {
    wanted: Wanted,
    news: News,
    /// Whether there is something for the worker to look at.
    is_changed: bool,
    quits: bool,
}

impl Exchange {
    fn new(wanted: Wanted, wake: impl Fn() + Send + Sync + 'static) -> Self {
        Self {
            state: Mutex::new(ExchangeState {
                wanted,
                news: News::default(),
                is_changed: true,
                quits: false,
            }),
            changed: Condvar::new(),
            wake: Box::new(wake),
        }
    }

    fn lock(&self) -> MutexGuard<'_, ExchangeState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells the window something.
    fn post(&self, add: impl FnOnce(&mut News)) {
        add(&mut self.lock().news);
        (self.wake)();
    }

    /// Wakes the worker.
    fn notify(&self) {
        self.lock().is_changed = true;
        self.changed.notify_all();
    }

    /// Waits until there is something to do, but not longer than `patience`; none once the window is
    /// closed.
    fn wait(&self, patience: Duration) -> Option<Wanted> {
        let mut state = self.lock();
        if !state.is_changed && !state.quits {
            let waited = self.changed.wait_timeout(state, patience);
            (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        }
        state.is_changed = false;
        (!state.quits).then(|| state.wanted.clone())
    }
}
