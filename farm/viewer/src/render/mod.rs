//! Renderer: the farm on a thread of its own, so that the window never waits for it.
//!
//! ```text
//! window ──Wanted──▶ worker ──▶ Farm: live picture, stills, films
//!        ◀───News───        ──▶ files, on threads of their own
//! ```
//!
//! The window states what it wants as a whole instead of queueing commands: the worker compares it with what
//! there is. News are kept until they are taken, only the newest of each kind.

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

/// State that the window wants of the renderer.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    /// A file to open, and the number of such requests so far: a new number for the same file rereads it.
    pub file: Option<(u64, PathBuf)>,
    /// The view of a scene; until one is set, as the scene has it.
    pub look: Option<SceneLook>,
    /// The size of the window in pixels; `None` while it has no area.
    pub size: Option<ImageSize>,
    /// Factor on radiance for display.
    pub exposure: f32,
    /// Whether gathering of samples is paused.
    pub is_paused: bool,
    /// What is sacrificed first while things change.
    pub preference: QualityPreference,
    /// The balancing of frames among nodes.
    pub balancing: Balancing,
    /// The distribution of frames: by tiles or by samples.
    pub distribution: Distribution,
    /// Whether frames are reported for statistics.
    pub has_statistics: bool,
    /// A picture or film to save.
    pub save: Option<SaveOrder>,
    /// The number of the last cancelled order; 0 for none.
    pub cancelled_save: u64,
}

/// View of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneLook {
    /// The scene, see [`OpenedScene::number`].
    pub scene: u64,
    /// The camera.
    pub camera: Camera,
    /// The lights that are on.
    pub lights: LightSwitches,
    /// An animation and the time in it in seconds; `None` if the scene has none.
    pub time: Option<(usize, f64)>,
}

/// Order to save a picture or film.
#[derive(Clone, Debug, PartialEq)]
pub struct SaveOrder {
    /// Number that differs for each order, from 1.
    pub number: u64,
    /// The file, whose extension determines its format.
    pub path: PathBuf,
    /// Size in pixels.
    pub size: ImageSize,
    /// Samples per pixel.
    pub samples: u32,
    /// Factor on radiance for display.
    pub exposure: f32,
    /// The view of a still, or those of a film's frames.
    pub views: Arc<[FrameView]>,
    /// Frames per second of a film; `None` for a still.
    pub frames_per_sec: Option<u16>,
}

/// Camera and time of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameView {
    /// The camera.
    pub camera: FrameCamera,
    /// An animation and the time in it in seconds; `None` shows the scene without animation.
    pub time: Option<(usize, f64)>,
}

/// Camera of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameCamera {
    /// A fixed camera.
    Placed(Camera),
    /// The file's camera with this index, at the picture's time.
    OfFile(usize),
}

/// Accuracy of tracing, from the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Accuracy {
    /// Samples per pixel that are gathered while nothing changes.
    pub samples: u32,
    /// Maximum scattering events of a path.
    pub max_depth: u32,
}

/// A scene that has been opened.
#[derive(Clone, Debug)]
pub struct OpenedScene {
    /// Number that differs for each opened or reread scene.
    pub number: u64,
    /// Its file.
    pub path: PathBuf,
    /// The parsed file.
    pub file: SceneFile,
    /// Whether its file was reread after a change.
    pub is_reread: bool,
}

/// Picture to show.
#[derive(Clone, Debug)]
pub struct ShownPicture {
    /// The picture at its exposure.
    pub frame: DisplayFrame,
    /// Samples per pixel.
    pub samples: u32,
    /// Whether it is a draft, shown while things change.
    pub is_draft: bool,
}

/// News of the renderer since they were last taken.
#[derive(Clone, Debug, Default)]
pub struct News {
    /// A scene that has been opened.
    pub opened: Option<OpenedScene>,
    /// The reason why a file could not be opened; the previous scene stays.
    pub refused: Option<String>,
    /// A newer picture.
    pub picture: Option<ShownPicture>,
    /// Whether there is nothing to show any more.
    pub is_cleared: bool,
    /// The reason why pictures have stopped; empty once they arrive again.
    pub fault: Option<String>,
    /// Frames that have arrived, the oldest first, if they are to be reported.
    pub frames: Vec<LiveFrame>,
    /// Status of the nodes.
    pub nodes: Option<Vec<NodeStatus>>,
    /// Quality of drafts.
    pub quality: Option<Quality>,
    /// The file that was saved, or the reason why it was not.
    pub saved: Option<Result<PathBuf, String>>,
    /// A file that is being read.
    pub reading: Option<PathBuf>,
    /// Progress of the file that is being saved, 0 to 1.
    pub saving: Option<f64>,
}

/// Renderer of the viewer's pictures; see the [module](self).
pub struct Renderer {
    exchange: Arc<Exchange>,
    worker: Option<JoinHandle<()>>,
}

impl Renderer {
    /// Starts a farm; `wake` is called from other threads when there are news.
    ///
    /// # Errors
    /// The system's error if no thread can be started.
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

    /// A renderer without a farm, whose part a test plays by [`Renderer::post`].
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

    /// Changes the wanted state.
    pub fn want(&self, change: impl FnOnce(&mut Wanted)) {
        let mut state = self.exchange.lock();
        change(&mut state.wanted);
        state.is_changed = true;
        drop(state);
        self.exchange.changed.notify_all();
    }

    /// The wanted state.
    pub fn wanted(&self) -> Wanted {
        self.exchange.lock().wanted.clone()
    }

    /// Takes the news; those about ongoing work are kept as well.
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
    /// Waits for the farm to end, since a GPU driver must not be active in an exiting process.
    fn drop(&mut self) {
        self.exchange.lock().quits = true;
        self.exchange.changed.notify_all();
        if let Some(worker) = self.worker.take() {
            let _ = worker.join(); // a panic has been reported where it happened
        }
    }
}

/// State shared by window and worker.
struct Exchange {
    state: Mutex<ExchangeState>,
    changed: Condvar,
    wake: Box<dyn Fn() + Send + Sync>,
}

struct ExchangeState {
    wanted: Wanted,
    news: News,
    /// Whether the worker has something to check.
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

    /// Adds news and wakes the window.
    fn post(&self, add: impl FnOnce(&mut News)) {
        add(&mut self.lock().news);
        (self.wake)();
    }

    /// Wakes the worker.
    fn notify(&self) {
        self.lock().is_changed = true;
        self.changed.notify_all();
    }

    /// Waits until there is something to do, at most for `patience`; `None` once the window is closed.
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
