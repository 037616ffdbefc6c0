//! Stills: one picture of many samples, traced by the whole farm.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use carom_protocol::PixelFormat;
use carom_tracer::film::Film;
use carom_tracer::{Camera, ImageSize, RenderSettings, Scene, SceneUpdate};

use crate::accumulated_render::{AccumulatedRender, trace_aovs};
use crate::checkpoint::Checkpoint;
use crate::error::Error;
use crate::farm::Farm;
use crate::frame::FrameSpec;
use crate::job::{Canceller, Job};
use crate::lock::lock;
use crate::picture::Picture;
use crate::stats::FrameStats;
use crate::submission::{Priority, SceneHandle};
use crate::submitter::Submitter;

/// Description of a still, see [`Farm::still`].
///
/// ```
/// # use carom_farm::prelude::*;
/// # fn main() -> carom_farm::Result<()> {
/// # let mut scene = Scene::new();
/// # scene.add(Sphere::new(1.0), Material::grey(0.5));
/// # let mut farm = Farm::new(FarmConfig { local: LocalNode::Cpu, ..FarmConfig::default() })?;
/// let still = Still::new(32, 18)
///     .samples(4)
///     .on_progress(|progress| eprintln!("{:.0} %", 100.0 * progress.fraction()));
/// let job = farm.still(&scene, still)?; // does not wait
/// let picture = job.wait()?;
/// assert_eq!(picture.samples(), 4);
/// # Ok(())
/// # }
/// ```
pub struct Still {
    spec: FrameSpec,
    priority: Priority,
    exposure: f32,
    has_layers: bool,
    frame_samples: Option<u32>,
    checkpoint: Option<(PathBuf, Duration)>,
    on_progress: Option<ProgressCallback>,
}

type ProgressCallback = Box<dyn FnMut(&StillProgress) + Send>;

impl Still {
    /// A picture of `width` × `height` pixels at 64 samples each.
    pub fn new(width: u32, height: u32) -> Self {
        Self::of(FrameSpec {
            update: SceneUpdate::default(),
            size: ImageSize::new(width, height),
            settings: RenderSettings {
                samples: 64,
                ..RenderSettings::default()
            },
            format: PixelFormat::LinearF32,
        })
    }

    /// The picture of a frame specification, whose format is ignored.
    pub fn of(spec: FrameSpec) -> Self {
        Self {
            spec: FrameSpec {
                format: PixelFormat::LinearF32,
                ..spec
            },
            priority: Priority::Interactive,
            exposure: 1.0,
            has_layers: false,
            frame_samples: None,
            checkpoint: None,
            on_progress: None,
        }
    }

    /// Sets the samples per pixel, see [`RenderSettings::samples`].
    #[must_use]
    pub fn samples(mut self, samples: u32) -> Self {
        self.spec.settings.samples = samples;
        self
    }

    /// Sets the maximum number of scattering events per path, see [`RenderSettings::max_depth`].
    #[must_use]
    pub fn max_depth(mut self, max_depth: u32) -> Self {
        self.spec.settings.max_depth = max_depth;
        self
    }

    /// Sets the seed of the random numbers.
    #[must_use]
    pub fn seed(mut self, seed: u32) -> Self {
        self.spec.settings.seed = seed;
        self
    }

    /// Denoises, guided by albedo, normal and depth.
    #[must_use]
    pub fn denoise(mut self) -> Self {
        self.spec.settings.denoise = true;
        self
    }

    /// Sets a camera in place of the scene's.
    #[must_use]
    pub fn camera(mut self, camera: Camera) -> Self {
        self.spec.update.camera = Some(camera);
        self
    }

    /// Sets an update of the scene, such as poses of its objects.
    #[must_use]
    pub fn update(mut self, update: SceneUpdate) -> Self {
        self.spec.update = update;
        self
    }

    /// Sets the factor of radiance in 8-bit files. Default: 1.
    #[must_use]
    pub fn exposure(mut self, exposure: f32) -> Self {
        self.exposure = exposure;
        self
    }

    /// Adds albedo, normal and depth, which EXR files store as layers.
    #[must_use]
    pub fn layers(mut self) -> Self {
        self.has_layers = true;
        self
    }

    /// Gives the picture background priority: it is traced where nothing interactive waits.
    #[must_use]
    pub fn background(mut self) -> Self {
        self.priority = Priority::Background;
        self
    }

    /// Sets the samples per pixel of a frame. More delay the next progress, fewer cost bytes; the default
    /// depends on the size.
    #[must_use]
    pub fn frame_samples(mut self, samples: u32) -> Self {
        self.frame_samples = Some(samples);
        self
    }

    /// Checkpoints the job to a file at most every `period`, and when it is cancelled or fails; resumes
    /// from the file if it exists. Once the picture is saved the file is no longer needed:
    /// [`Picture::remove_checkpoint`].
    #[must_use]
    pub fn checkpoint(mut self, path: impl Into<PathBuf>, period: Duration) -> Self {
        self.checkpoint = Some((path.into(), period));
        self
    }

    /// Sets a callback that the job's thread calls after each frame, and some ten times a second while
    /// tiles arrive.
    #[must_use]
    pub fn on_progress(mut self, callback: impl FnMut(&StillProgress) + Send + 'static) -> Self {
        self.on_progress = Some(Box::new(callback));
        self
    }
}

/// Progress of a still.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct StillProgress {
    /// Samples per pixel that have arrived.
    pub samples_done: u32,
    /// Samples per pixel of the whole picture.
    pub samples: u32,
    /// Tiles that have arrived of the frames in flight.
    pub tiles_done: u32,
    /// All tiles of the frames in flight.
    pub tiles: u32,
    /// Samples per pixel of the frames in flight.
    pub samples_in_flight: u32,
    /// Statistics of the frame that has just arrived; absent in between.
    pub frame: Option<FrameStats>,
}

impl StillProgress {
    /// Finished share of the work, from 0 to 1.
    pub fn fraction(&self) -> f64 {
        let partly = f64::from(self.tiles_done) / f64::from(self.tiles.max(1));
        let samples = f64::from(self.samples_done) + partly * f64::from(self.samples_in_flight);
        samples / f64::from(self.samples.max(1))
    }
}

/// A still that is being traced. Dropping it cancels it.
pub type StillJob = Job<Picture, StillProgress>;

impl Farm {
    /// Traces a picture and waits for it.
    ///
    /// # Errors
    /// As [`Farm::still`] and [`StillJob::wait`].
    pub fn render(&mut self, scene: &Scene, still: Still) -> Result<Picture, Error> {
        self.still(scene, still)?.wait()
    }

    /// Starts to trace a picture on its own thread.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the first rule that the scene or the still breaks, [`Error::Resume`] if the
    /// checkpoint is damaged or of another picture, [`Error::Thread`].
    pub fn still(&mut self, scene: &Scene, still: Still) -> Result<StillJob, Error> {
        let scene = self.announce(scene)?;
        scene.check(&still.spec)?;
        let checkpoint = still.checkpoint.clone();
        let mut checkpoint = checkpoint
            .map(|(path, period)| Checkpoint::new(path, scene.hash(), &still.spec, period));
        let resumed = match &mut checkpoint {
            Some(checkpoint) => checkpoint.resume()?,
            None => None,
        };
        let (film, done) = resumed.unwrap_or_else(|| (Film::new(still.spec.size), 0));
        let progress = Arc::new(Mutex::new(StillProgress {
            samples_done: done,
            samples: still.spec.settings.samples,
            ..StillProgress::default()
        }));
        let mut render = AccumulatedRender::new(still.spec.clone(), still.priority).resume(done);
        if let Some(samples) = still.frame_samples {
            render.set_frame_samples(samples);
        }
        let run = StillRun {
            submitter: self.submitter(),
            render,
            film,
            scene,
            checkpoint,
            progress: Arc::clone(&progress),
            still,
        };
        Job::start("carom-still", progress, done, |cancelled| {
            run.run(cancelled)
        })
    }
}

impl StillJob {
    /// Samples per pixel that a checkpoint held at the start.
    pub const fn resumed_samples(&self) -> u32 {
        self.resumed
    }
}

/// State of a still job's thread.
struct StillRun {
    submitter: Submitter,
    render: AccumulatedRender,
    film: Film,
    scene: SceneHandle,
    checkpoint: Option<Checkpoint>,
    progress: Arc<Mutex<StillProgress>>,
    still: Still,
}

impl StillRun {
    fn run(mut self, cancelled: &Canceller) -> Result<Picture, Error> {
        if let Err(why) = self.trace(cancelled) {
            return Err(self.interrupt(why)?);
        }
        let layers = if self.still.has_layers {
            trace_aovs(&self.scene.scene, &self.still.spec)?
        } else {
            Vec::new()
        };
        let picture = Picture::new(self.film, layers, self.still.exposure);
        Ok(picture.with_checkpoint(self.checkpoint))
    }

    fn trace(&mut self, cancelled: &Canceller) -> Result<(), Error> {
        while !self.render.is_done() {
            if cancelled.is_cancelled() {
                let samples_done = self.render.samples_done();
                return Err(Error::Cancelled { samples_done });
            }
            self.render
                .submit_through(&mut self.submitter, &self.scene)?;
            let frame = self.submitter.wait_frame(POLL_INTERVAL);
            let batch = frame.and_then(|frame| self.render.accept(frame));
            let stats = match batch {
                Some(batch) => {
                    batch.add_to(&mut self.film)?;
                    Some(batch.frame.stats)
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

    fn report(&mut self, frame: Option<FrameStats>) {
        let done = self.render.samples_done();
        if let (Some(checkpoint), Some(_)) = (&mut self.checkpoint, &frame) {
            checkpoint.offer(&self.film, done);
        }
        let (tiles_done, tiles) = self.submitter.tiles_in_flight();
        let progress = StillProgress {
            samples_done: done,
            samples: self.still.spec.settings.samples,
            tiles_done,
            tiles,
            samples_in_flight: self.render.samples_in_flight(),
            frame,
        };
        if let Some(callback) = &mut self.still.on_progress {
            callback(&progress);
        }
        *lock(&self.progress) = progress;
    }

    /// Writes the checkpoint of an interrupted job, and returns `why` it ended.
    fn interrupt(&mut self, why: Error) -> Result<Error, Error> {
        let has_samples = self.render.samples_done() > 0;
        if let (Some(checkpoint), true) = (&mut self.checkpoint, has_samples) {
            checkpoint.write(&self.film)?;
        }
        Ok(why)
    }
}

/// Timeout of a wait for a frame, after which other work is checked.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
