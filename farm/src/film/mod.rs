//! Films: a frame for each state of a scene, traced by the whole farm into a folder.

mod apng;
mod frame_range;
mod frames;
mod states;
mod y4m;

use std::collections::{BTreeSet, VecDeque};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use carom_protocol::PixelFormat;
use carom_protocol::limits::FRAMES_IN_FLIGHT_MAX;
use carom_tracer::tonemap::srgb8;
use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate, film};

use crate::accumulated_render::{AccumulatedRender, SampleBatch};
use crate::error::Error;
use crate::farm::Farm;
use crate::frame::{FrameSpec, Pixels};
use crate::job::{Canceller, Job};
use crate::lock::lock;
use crate::stats::FrameStats;
use crate::submission::{Priority, SceneHandle};
use crate::submitter::Submitter;

pub use frame_range::FrameRange;
pub use frames::{FilmFormat, FilmFrames};
pub use states::FilmState;

use frames::{FRAMES_MAX, FilmIdentity};
use states::FilmStates;

/// Description of a film: a frame for each state of a scene, see [`Farm::film`].
///
/// ```
/// # use carom_farm::prelude::*;
/// # fn main() -> carom_farm::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let mut scene = Scene::new();
/// # scene.add(Sphere::new(1.0), Material::grey(0.5));
/// # let mut farm = Farm::new(FarmConfig { local: LocalNode::Cpu, ..FarmConfig::default() })?;
/// let orbit = (0..4).map(|frame| {
///     let angle = 0.1 * frame as f32;
///     let eye = [4.0 * angle.sin(), -4.0 * angle.cos(), 2.0];
///     SceneUpdate::default().camera(Camera::looking_at(eye, [0.0; 3]))
/// });
/// let frames = folder.path().join("orbit.frames");
/// let job = farm.film(&scene, Film::new(32, 18, orbit).samples(4), frames)?; // does not wait
/// let film = job.wait()?;
/// film.save(folder.path().join("orbit.png"), 24)?;
/// film.remove()
/// # }
/// ```
pub struct Film {
    size: ImageSize,
    settings: RenderSettings,
    states: FilmStates,
    exposure: f32,
    priority: Priority,
    range: FrameRange,
    on_progress: Option<ProgressCallback>,
}

type ProgressCallback = Box<dyn FnMut(&FilmProgress) + Send>;

impl Film {
    /// A film of `width` × `height` pixels at 64 samples each, with a frame for each of `updates`.
    pub fn new(width: u32, height: u32, updates: impl IntoIterator<Item = SceneUpdate>) -> Self {
        let updates = updates.into_iter().collect();
        Self::of(width, height, FilmStates::Updates(updates))
    }

    /// A film of `frames` frames whose states `make` creates from the frame's number when it is about to be
    /// traced: for scenes that deform. `make` is called on the job's thread in the order of the frames,
    /// except for those that the folder holds; its error ends the job. `key` identifies the film: equal
    /// films have equal keys, different ones different keys.
    pub fn of_states(
        width: u32,
        height: u32,
        frames: usize,
        key: String,
        make: impl FnMut(u32) -> Result<FilmState, Error> + Send + 'static,
    ) -> Self {
        let make = Box::new(make);
        Self::of(width, height, FilmStates::Made { frames, key, make })
    }

    fn of(width: u32, height: u32, states: FilmStates) -> Self {
        Self {
            size: ImageSize::new(width, height),
            settings: RenderSettings {
                samples: 64,
                ..RenderSettings::default()
            },
            states,
            exposure: 1.0,
            priority: Priority::Interactive,
            range: FrameRange::ALL,
            on_progress: None,
        }
    }

    /// Sets all render settings: samples, depth, seed and denoising.
    #[must_use]
    pub fn settings(self, settings: RenderSettings) -> Self {
        Self { settings, ..self }
    }

    /// Sets the samples per pixel, see [`RenderSettings::samples`].
    #[must_use]
    pub fn samples(mut self, samples: u32) -> Self {
        self.settings.samples = samples;
        self
    }

    /// Denoises, guided by albedo, normal and depth.
    #[must_use]
    pub fn denoise(mut self) -> Self {
        self.settings.denoise = true;
        self
    }

    /// Sets the factor of radiance for display. Default: 1.
    #[must_use]
    pub fn exposure(self, exposure: f32) -> Self {
        Self { exposure, ..self }
    }

    /// Restricts the job to some of the frames, while others are traced elsewhere into the same folder, or
    /// into folders that are merged later.
    #[must_use]
    pub fn range(self, range: FrameRange) -> Self {
        Self { range, ..self }
    }

    /// Gives the film background priority: it is traced where nothing interactive waits.
    #[must_use]
    pub fn background(mut self) -> Self {
        self.priority = Priority::Background;
        self
    }

    /// Sets a callback that the job's thread calls after each frame, and some ten times a second while
    /// tiles arrive.
    #[must_use]
    pub fn on_progress(mut self, callback: impl FnMut(&FilmProgress) + Send + 'static) -> Self {
        self.on_progress = Some(Box::new(callback));
        self
    }

    /// The specification of a frame with all samples: in sRGB if they come in one batch, as then nothing
    /// has to be summed.
    fn spec(&self, update: SceneUpdate) -> FrameSpec {
        FrameSpec {
            update,
            size: self.size,
            settings: self.settings,
            format: match self.is_one_batch() {
                true => PixelFormat::Srgb8 {
                    exposure: self.exposure,
                },
                false => PixelFormat::LinearF32,
            },
        }
    }

    const fn is_one_batch(&self) -> bool {
        self.settings.samples <= BATCH_SAMPLES
    }

    fn frame(&self, index: u32, scene: SceneHandle, update: SceneUpdate) -> FilmFrame {
        let mut render = AccumulatedRender::new(self.spec(update), self.priority);
        render.set_frame_samples(BATCH_SAMPLES);
        FilmFrame {
            index,
            scene,
            render,
            sums: (!self.is_one_batch()).then(|| film::Film::new(self.size)),
        }
    }
}

/// Progress of a film.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct FilmProgress {
    /// Finished frames of its range.
    pub frames_done: u32,
    /// All frames of its range.
    pub frames: u32,
    /// Tiles that have arrived of the frames in progress.
    pub tiles_done: u32,
    /// All tiles of the frames in progress.
    pub tiles: u32,
    /// The frame of which samples have just arrived, and their statistics; absent in between.
    pub frame: Option<(u32, FrameStats)>,
}

/// A film that is being traced. Dropping it cancels it.
pub type FilmJob = Job<FilmFrames, FilmProgress>;

impl Farm {
    /// Starts to trace a film on its own thread. Each frame is in `folder` as soon as it is finished, and a
    /// repeated call resumes with the missing ones.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the first rule that the scene or a frame breaks, [`Error::NoFrameOfRange`],
    /// [`Error::FilmLength`], [`Error::UnfinishedFilm`] if the folder holds frames of another film,
    /// [`Error::ForeignFrame`] if it holds frames without a film's identity, [`Error::Resume`],
    /// [`Error::File`], [`Error::Thread`].
    pub fn film(
        &mut self,
        scene: &Scene,
        film: Film,
        folder: impl Into<PathBuf>,
    ) -> Result<FilmJob, Error> {
        let frames = match u32::try_from(film.states.frames()) {
            Ok(frames) if frames <= FRAMES_MAX => frames,
            _ => {
                return Err(Error::FilmLength {
                    frames: film.states.frames(),
                    max: FRAMES_MAX,
                });
            }
        };
        film.range.of_film(frames)?;
        let scene = self.announce(scene)?;
        scene.check(&film.spec(SceneUpdate::default()))?;
        for update in film.states.known() {
            scene.check(&film.spec(update.clone()))?;
        }
        let Film { size, settings, .. } = film;
        let identity = FilmIdentity::of(scene.hash(), size, settings, film.exposure, &film.states);
        let kept = FilmFrames::open(&folder.into(), identity, size, film.range)?;
        let resumed_frames = kept.kept();
        let waiting: VecDeque<u32> = kept.missing().collect();
        let progress = Arc::new(Mutex::new(FilmProgress {
            frames_done: resumed_frames,
            frames: resumed_frames + waiting.len() as u32,
            ..FilmProgress::default()
        }));
        let run = FilmRun {
            submitter: self.submitter(),
            scene,
            own_scene: None,
            film,
            kept,
            waiting,
            tracing: Vec::new(),
            progress: Arc::clone(&progress),
        };
        Job::start("carom-film", progress, resumed_frames, |cancelled| {
            run.run(cancelled)
        })
    }
}

impl FilmJob {
    /// Frames of its range that the folder held at the start.
    pub const fn resumed_frames(&self) -> u32 {
        self.resumed
    }
}

/// State of a film job's thread.
struct FilmRun {
    submitter: Submitter,
    scene: SceneHandle,
    /// The last scene that belonged to a frame, with its handle.
    own_scene: Option<(Arc<Scene>, SceneHandle)>,
    film: Film,
    kept: FilmFrames,
    /// Frames of which nothing has been submitted.
    waiting: VecDeque<u32>,
    tracing: Vec<FilmFrame>,
    progress: Arc<Mutex<FilmProgress>>,
}

/// A frame in progress.
struct FilmFrame {
    index: u32,
    scene: SceneHandle,
    render: AccumulatedRender,
    /// Sums of the batches, if there are several.
    sums: Option<film::Film>,
}

impl FilmRun {
    fn run(mut self, cancelled: &Canceller) -> Result<FilmFrames, Error> {
        match self.trace(cancelled) {
            Ok(()) => Ok(self.kept),
            Err(why) => {
                if self.kept.kept() == 0 && self.film.range == FrameRange::ALL {
                    // No frame is finished, so the folder is of no use; what cannot be removed does no
                    // harm.
                    let _ = self.kept.remove();
                }
                Err(why)
            }
        }
    }

    fn trace(&mut self, cancelled: &Canceller) -> Result<(), Error> {
        while !(self.waiting.is_empty() && self.tracing.is_empty()) {
            if cancelled.is_cancelled() {
                return Err(Error::FilmCancelled {
                    frames_done: self.kept.kept(),
                    frames: self.kept.kept() + self.kept.missing().count() as u32,
                });
            }
            self.submit()?;
            let stats = match self.submitter.wait_frame(POLL_INTERVAL) {
                Some(frame) => {
                    let mut tracing = self.tracing.iter();
                    match tracing.position(|of| of.render.owns(frame.id)) {
                        Some(place) => self.accept(place, frame)?,
                        None => None,
                    }
                }
                None => {
                    self.submitter.check_nodes()?;
                    None
                }
            };
            self.report(stats);
        }
        Ok(())
    }

    /// Submits as much as the farm accepts now, in the order of the frames.
    fn submit(&mut self) -> Result<(), Error> {
        for frame in &mut self.tracing {
            frame
                .render
                .submit_through(&mut self.submitter, &frame.scene)?;
        }
        loop {
            // A frame is started once all samples of those before it have been submitted.
            let has_to_wait = |frame: &FilmFrame| frame.render.next_frame().is_some();
            let scenes: BTreeSet<_> = self.tracing.iter().map(|of| of.scene.hash()).collect();
            if self.tracing.iter().any(has_to_wait)
                || self.tracing.len() >= FRAMES_IN_FLIGHT_MAX
                || scenes.len() >= SCENES_IN_FLIGHT_MAX
            {
                return Ok(());
            }
            let Some(index) = self.waiting.pop_front() else {
                return Ok(());
            };
            let FilmState { scene, update } = self.film.states.state(index)?;
            let scene = self.handle(scene)?;
            let mut frame = self.film.frame(index, scene, update);
            frame
                .render
                .submit_through(&mut self.submitter, &frame.scene)?;
            self.tracing.push(frame);
        }
    }

    /// The handle of a frame's scene: the film's if it has none of its own.
    fn handle(&mut self, own: Option<Arc<Scene>>) -> Result<SceneHandle, Error> {
        let Some(own) = own else {
            return Ok(self.scene.clone());
        };
        match &self.own_scene {
            Some((scene, handle)) if Arc::ptr_eq(scene, &own) => Ok(handle.clone()),
            _ => {
                own.validate_visible()?;
                let handle = SceneHandle::new(&own)?;
                self.own_scene = Some((own, handle.clone()));
                Ok(handle)
            }
        }
    }

    /// Accepts samples of the frame at index `place`, and stores it once they are complete.
    fn accept(
        &mut self,
        place: usize,
        frame: crate::Frame,
    ) -> Result<Option<(u32, FrameStats)>, Error> {
        let FilmFrame {
            index,
            render,
            sums,
            ..
        } = &mut self.tracing[place];
        let Some(batch) = render.accept(frame) else {
            return Ok(None);
        };
        let index = *index;
        if let Some(sums) = sums {
            batch.add_to(sums)?;
        }
        let SampleBatch { frame, .. } = batch;
        if render.is_done() {
            let rgb = match (sums, frame.pixels) {
                (None, Pixels::Srgb8(rgba)) => rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
                (None, Pixels::Linear(pixels)) => self.film.tone_map(&pixels),
                (Some(sums), _) => self.film.tone_map(&sums.image().pixels),
            };
            self.kept.keep(index, rgb.as_flattened())?;
            self.tracing.remove(place);
        }
        Ok(Some((index, frame.stats)))
    }

    fn report(&mut self, frame: Option<(u32, FrameStats)>) {
        let (tiles_done, tiles) = self.submitter.tiles_in_flight();
        let mut known = lock(&self.progress);
        let progress = FilmProgress {
            frames_done: self.kept.kept(),
            frames: known.frames,
            tiles_done,
            tiles,
            frame,
        };
        known.clone_from(&progress);
        drop(known);
        if let Some(callback) = &mut self.film.on_progress {
            callback(&progress);
        }
    }
}

impl Film {
    fn tone_map(&self, radiance: &[[f32; 3]]) -> Vec<[u8; 3]> {
        let pixels = radiance.iter();
        pixels.map(|&pixel| srgb8(pixel, self.exposure)).collect()
    }
}

/// Maximum samples per pixel of a batch: more take long to repeat when a node is lost. Independent of the
/// farm, so that all machines produce the same bits.
const BATCH_SAMPLES: u32 = 1024;
/// Maximum number of scenes in flight: one is traced while another is transferred, and a node, which keeps
/// [`SCENES_KEPT_MAX`](carom_protocol::limits::SCENES_KEPT_MAX) of them, has room for that of a view.
const SCENES_IN_FLIGHT_MAX: usize = 2;
/// Timeout of a wait for a frame, after which other work is checked.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
