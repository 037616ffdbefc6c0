//! Live pictures: a view that follows its camera and objects, and accumulates samples while nothing
//! changes.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use carom_protocol::{FrameId, PixelFormat};
use carom_tracer::film::Film;
use carom_tracer::glam::{Quat, Vec3};
use carom_tracer::{
    Camera, ImageSize, ObjectHandle, ObjectPose, RenderSettings, Scene, SceneUpdate,
};

use crate::accumulated_render::AccumulatedRender;
use crate::error::Error;
use crate::farm::Farm;
use crate::frame::FrameSpec;
use crate::job::{Canceller, Job};
use crate::lock::lock;
use crate::picture::Picture;
use crate::quality::{Quality, QualityPreference};
use crate::stats::FrameStats;
use crate::submission::{Priority, SceneHandle};
use crate::submitter::Submitter;

/// Description of a live picture, see [`Farm::live`].
///
/// ```
/// # use carom_farm::prelude::*;
/// # fn main() -> carom_farm::Result<()> {
/// # let mut scene = Scene::new();
/// let ball = scene.add(Sphere::new(0.5), Material::plastic([0.1, 0.3, 0.8]));
/// # let mut farm = Farm::new(FarmConfig { local: LocalNode::Cpu, ..FarmConfig::default() })?;
/// let mut view = farm.live(&scene, Live::new(32, 18).samples_per_frame(2))?;
/// view.set_camera(Camera::looking_at([0.0, -3.0, 1.0], [0.0; 3]))?;
/// view.move_to(ball, [0.2, 0.0, 0.0], Quat::IDENTITY)?; // samples gather anew
/// loop {
///     match view.latest()? {
///         Some(picture) if picture.samples() >= 8 => break,
///         _ => std::thread::yield_now(), // an application draws, and handles its events
///     }
/// }
/// # Ok(())
/// # }
/// ```
pub struct Live {
    size: ImageSize,
    settings: RenderSettings,
    samples_per_frame: u32,
    exposure: f32,
    drafts: Option<QualityPreference>,
    on_frame: Option<FrameCallback>,
}

type FrameCallback = Box<dyn FnMut() + Send>;

impl Live {
    /// A view of `width` × `height` pixels.
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            size: ImageSize::new(width, height),
            settings: RenderSettings {
                samples: 1024,
                ..RenderSettings::default()
            },
            samples_per_frame: 1,
            exposure: 1.0,
            drafts: None,
            on_frame: None,
        }
    }

    /// Sets the samples per pixel of each frame: more are smoother in motion, and proportionally slower.
    /// Default: 1.
    #[must_use]
    pub fn samples_per_frame(self, samples_per_frame: u32) -> Self {
        Self {
            samples_per_frame,
            ..self
        }
    }

    /// Sets the samples per pixel to accumulate while nothing changes. Default: 1024.
    #[must_use]
    pub fn samples(mut self, samples: u32) -> Self {
        self.settings.samples = samples;
        self
    }

    /// Sets the maximum number of scattering events per path, see [`RenderSettings::max_depth`].
    #[must_use]
    pub fn max_depth(mut self, max_depth: u32) -> Self {
        self.settings.max_depth = max_depth;
        self
    }

    /// Sets the factor of radiance for 8-bit pixels. Default: 1.
    #[must_use]
    pub fn exposure(self, exposure: f32) -> Self {
        Self { exposure, ..self }
    }

    /// Shows drafts while things change: denoised, and with as few pixels as needed to reach the preferred
    /// frame rate, see [`crate::quality`]. Once nothing changes, samples accumulate at the full size, in
    /// larger frames where they are fast, and replace the draft from [`Live::DRAFT_SAMPLES`] on. Default:
    /// no drafts, so that a change shows with the first samples at full size.
    #[must_use]
    pub fn drafts(self, preference: QualityPreference) -> Self {
        Self {
            drafts: Some(preference),
            ..self
        }
    }

    /// Samples per pixel from which a picture is better than its draft.
    pub const DRAFT_SAMPLES: u32 = 8;

    /// Sets a callback that the view's thread calls whenever [`LiveView::latest`] has something new, a
    /// picture or an error: to wake an event loop.
    #[must_use]
    pub fn on_frame(self, callback: impl FnMut() + Send + 'static) -> Self {
        Self {
            on_frame: Some(Box::new(callback)),
            ..self
        }
    }
}

/// A live picture. Its calls never wait; it ends when dropped.
pub struct LiveView {
    settings: RenderSettings,
    shared: Arc<Shared>,
    job: Job<(), ()>,
}

/// State shared by a view's owner and its thread.
struct Shared {
    state: Mutex<LiveState>,
    changed: Condvar,
}

struct LiveState {
    scene: SceneHandle,
    update: SceneUpdate,
    size: ImageSize,
    /// Number of changes of `scene`, `update` or `size`.
    version: u64,
    is_paused: bool,
    /// Quality control of drafts, if they are enabled.
    quality: Option<Quality>,
    latest: Option<Picture>,
    frames: VecDeque<LiveFrame>,
    error: Option<Error>,
}

/// A frame of a view, for statistics.
#[derive(Clone, Debug)]
pub struct LiveFrame {
    /// Its id in the farm.
    pub id: FrameId,
    /// Size in pixels.
    pub size: ImageSize,
    /// Samples per pixel.
    pub samples: u32,
    /// Its statistics.
    pub stats: FrameStats,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, LiveState> {
        lock(&self.state)
    }
}

impl Farm {
    /// Starts a live picture on its own thread.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the first rule that the scene or the view breaks, [`Error::Thread`].
    pub fn live(&mut self, scene: &Scene, live: Live) -> Result<LiveView, Error> {
        let handle = self.announce(scene)?;
        let shared = Arc::new(Shared {
            state: Mutex::new(LiveState {
                scene: handle.clone(),
                update: SceneUpdate::default(),
                size: live.size,
                version: 1,
                is_paused: false,
                quality: live.drafts.map(|preference| {
                    let mut quality = Quality::default();
                    quality.set_quality_preference(preference);
                    quality
                }),
                latest: None,
                frames: VecDeque::new(),
                error: None,
            }),
            changed: Condvar::new(),
        });
        let settings = RenderSettings {
            samples: live.samples_per_frame,
            ..live.settings
        };
        handle.check(&spec(&SceneUpdate::default(), live.size, settings))?;
        handle.check(&spec(&SceneUpdate::default(), live.size, live.settings))?;
        let run = LiveRun {
            submitter: self.submitter(),
            scene: handle,
            shared: Arc::clone(&shared),
            live,
        };
        Ok(LiveView {
            settings,
            shared,
            job: Job::start("carom-live", Arc::default(), 0, |cancelled| {
                run.run(cancelled);
                Ok(())
            })?,
        })
    }
}

impl LiveView {
    /// Sets the camera from now on.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the rule that the camera breaks; the view stays as it was.
    pub fn set_camera(&mut self, camera: Camera) -> Result<(), Error> {
        self.change(|update, _| update.camera = Some(camera))
    }

    /// Sets an object's pose from now on: `position` in metres, `rotation` a unit quaternion.
    ///
    /// # Errors
    /// [`Error::Tracer`] if the handle is of another scene, the object cannot move or a value is out
    /// of range; the view stays as it was.
    pub fn move_to(
        &mut self,
        object: ObjectHandle,
        position: impl Into<Vec3>,
        rotation: Quat,
    ) -> Result<(), Error> {
        let state = self.shared.lock();
        let pose = state.scene.scene.pose(object, position, rotation)?;
        drop(state);
        self.pose(pose)
    }

    /// Shows or hides an object, at its pose in the scene.
    ///
    /// # Errors
    /// As [`LiveView::move_to`].
    pub fn set_visible(&mut self, object: ObjectHandle, visible: bool) -> Result<(), Error> {
        let pose = self.shared.lock().scene.scene.base_pose(object)?;
        self.pose(ObjectPose { visible, ..pose })
    }

    /// Sets the state of the scene from now on: what `update` does not contain is as in the scene.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the rule that the update breaks; the view stays as it was.
    pub fn set_update(&mut self, update: SceneUpdate) -> Result<(), Error> {
        self.change(|before, _| *before = update)
    }

    /// Switches to another scene in the given state, on the view's own farm.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the first rule that the scene or the update breaks; the view stays as it was.
    pub fn set_scene(
        &mut self,
        farm: &Farm,
        scene: &Scene,
        update: SceneUpdate,
    ) -> Result<(), Error> {
        let handle = farm.announce(scene)?;
        let mut state = self.shared.lock();
        handle.check(&spec(&update, state.size, self.settings))?;
        (state.scene, state.update) = (handle, update);
        state.version += 1;
        drop(state);
        self.shared.changed.notify_all();
        Ok(())
    }

    /// Sets the size in pixels, as when a window is resized.
    ///
    /// # Errors
    /// [`Error::Tracer`] if there are no pixels or too many.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<(), Error> {
        self.change(|_, size| *size = ImageSize::new(width, height))
    }

    /// The newest picture, if it has not been taken.
    ///
    /// # Errors
    /// The error that has ended the view, once: [`Error::NoNodes`] if no node has answered for
    /// [`crate::FarmConfig::timeout_secs`], [`Error::FrameRefused`] if every node refuses a frame,
    /// [`Error::FarmClosed`] if the farm has been dropped.
    pub fn latest(&mut self) -> Result<Option<Picture>, Error> {
        let mut state = self.shared.lock();
        match state.error.take() {
            Some(error) => Err(error),
            None => Ok(state.latest.take()),
        }
    }

    /// Stops accumulating samples while `paused`, to leave the farm to others; changes are still shown.
    pub fn set_paused(&mut self, paused: bool) {
        self.shared.lock().is_paused = paused;
        self.shared.changed.notify_all();
    }

    /// Sets the quality preference of drafts, if they are enabled.
    pub fn set_quality_preference(&mut self, preference: QualityPreference) {
        if let Some(quality) = &mut self.shared.lock().quality {
            quality.set_quality_preference(preference);
        }
    }

    /// Quality of the next draft, and the learned costs; `None` without [`Live::drafts`].
    pub fn quality(&self) -> Option<Quality> {
        self.shared.lock().quality.clone()
    }

    /// The frames since the last call, oldest first; only the last [`LiveView::FRAMES_MAX`] are kept.
    pub fn frames(&mut self) -> Vec<LiveFrame> {
        self.shared.lock().frames.drain(..).collect()
    }

    /// Maximum number of frames kept for [`LiveView::frames`]: about a second's.
    pub const FRAMES_MAX: usize = 64;

    fn pose(&mut self, pose: ObjectPose) -> Result<(), Error> {
        self.change(|update, _| {
            update.poses.retain(|other| other.object != pose.object);
            update.poses.push(pose);
        })
    }

    /// Changes the update and size, if the result is valid for the scene.
    fn change(&self, change: impl FnOnce(&mut SceneUpdate, &mut ImageSize)) -> Result<(), Error> {
        let mut state = self.shared.lock();
        let (mut update, mut size) = (state.update.clone(), state.size);
        change(&mut update, &mut size);
        if (&update, size) == (&state.update, state.size) {
            return Ok(());
        }
        state.scene.check(&spec(&update, size, self.settings))?;
        (state.update, state.size) = (update, size);
        state.version += 1;
        drop(state);
        self.shared.changed.notify_all();
        Ok(())
    }
}

impl Drop for LiveView {
    fn drop(&mut self) {
        self.job.cancel();
        self.shared.changed.notify_all();
    }
}

/// State of a view's thread.
struct LiveRun {
    submitter: Submitter,
    scene: SceneHandle,
    shared: Arc<Shared>,
    live: Live,
}

impl LiveRun {
    fn run(mut self, cancelled: &Canceller) {
        if let Err(error) = self.follow(cancelled) {
            self.shared.lock().error = Some(error);
            self.announce();
        }
    }

    /// Traces one picture after the other, each until something changes.
    fn follow(&mut self, cancelled: &Canceller) -> Result<(), Error> {
        while !cancelled.is_cancelled() {
            let (version, spec) = {
                let state = self.shared.lock();
                if self.scene.hash() != state.scene.hash() {
                    self.scene = state.scene.clone();
                }
                let spec = spec(&state.update, state.size, self.live.settings);
                (state.version, spec)
            };
            if self.live.drafts.is_some() {
                self.draft(&spec, cancelled)?;
            }
            self.gather(version, spec, cancelled)?;
            self.rest(version, cancelled);
        }
        Ok(())
    }

    /// Traces and shows a draft at the quality that meets the frame time.
    fn draft(&mut self, spec: &FrameSpec, cancelled: &Canceller) -> Result<(), Error> {
        let level = self.shared.lock().quality.as_ref().map(Quality::level);
        let Some(level) = level else { return Ok(()) };
        let draft = FrameSpec {
            size: level.size(spec.size),
            settings: RenderSettings {
                samples: level.samples,
                denoise: level.denoise,
                ..spec.settings
            },
            ..spec.clone()
        };
        let (size, settings) = (draft.size, draft.settings);
        let mut film = Film::new(size);
        let mut render = AccumulatedRender::new(draft, Priority::Interactive);
        render.set_frame_samples(settings.samples);
        while !render.is_done() && !cancelled.is_cancelled() {
            render.submit_through(&mut self.submitter, &self.scene)?;
            let Some(frame) = self.accept(&mut render, &mut film)? else {
                continue;
            };
            if let Some(quality) = &mut self.shared.lock().quality {
                quality.observe(size.pixels(), &settings, spec.size, frame.stats.busy_secs);
            }
            self.show(&film);
        }
        render.cancel(&mut self.submitter);
        Ok(())
    }

    /// Accumulates samples until all have arrived or something changes. Without drafts, the first frame is
    /// always shown: a view that moves all the time must not stand still.
    fn gather(
        &mut self,
        version: u64,
        spec: FrameSpec,
        cancelled: &Canceller,
    ) -> Result<(), Error> {
        let has_draft = self.live.drafts.is_some();
        let shown_from = match has_draft {
            true => Live::DRAFT_SAMPLES.min(spec.settings.samples),
            false => 1,
        };
        let mut film = Film::new(spec.size);
        let mut render = AccumulatedRender::new(spec, Priority::Interactive);
        let mut frame_samples = self.live.samples_per_frame;
        render.set_frame_samples(frame_samples);
        if has_draft {
            render.set_frames_max(SLOW_FRAMES_MAX);
        }
        while !render.is_done() && !cancelled.is_cancelled() {
            let is_shown = has_draft || render.samples_done() > 0;
            let (has_changed, is_paused) = {
                let state = self.shared.lock();
                (state.version != version, state.is_paused)
            };
            if has_changed && is_shown {
                break;
            }
            // After a change, a view without drafts only completes its first frame: nothing more is
            // submitted while one is in flight.
            let is_waiting = render.samples_in_flight() == 0;
            if is_paused && is_shown {
                if is_waiting {
                    self.wait_for_change();
                    continue;
                }
            } else if !has_changed || is_waiting {
                render.submit_through(&mut self.submitter, &self.scene)?;
            }
            let Some(frame) = self.accept(&mut render, &mut film)? else {
                continue;
            };
            if render.samples_done() >= shown_from {
                self.show(&film);
            }
            // The next change shows as a draft anyway, so larger frames, with less transport, may be in
            // flight. Frames issued before the last doubling are still arriving: only one of the current
            // size doubles it again.
            let is_quick = frame.samples == frame_samples && frame.stats.busy_secs < QUICK_SECS;
            if has_draft && is_quick {
                render.set_frames_max(usize::MAX);
                frame_samples = (2 * frame_samples).min(FRAME_SAMPLES_MAX);
                render.set_frame_samples(frame_samples);
            }
        }
        render.cancel(&mut self.submitter);
        Ok(())
    }

    /// Adds the next frame to the film, if one comes within the poll interval.
    fn accept(
        &mut self,
        render: &mut AccumulatedRender,
        film: &mut Film,
    ) -> Result<Option<LiveFrame>, Error> {
        let frame = self.submitter.wait_frame(POLL_INTERVAL);
        let Some(batch) = frame.and_then(|frame| render.accept(frame)) else {
            self.submitter.check_nodes()?;
            return Ok(None);
        };
        batch.add_to(film)?;
        let frame = LiveFrame {
            id: batch.frame.id,
            size: batch.frame.size,
            samples: batch.samples,
            stats: batch.frame.stats,
        };
        let mut state = self.shared.lock();
        if state.frames.len() == LiveView::FRAMES_MAX {
            state.frames.pop_front();
        }
        state.frames.push_back(frame.clone());
        Ok(Some(frame))
    }

    fn show(&mut self, film: &Film) {
        let picture = Picture::new(film.clone(), Vec::new(), self.live.exposure);
        self.shared.lock().latest = Some(picture);
        self.announce();
    }

    /// Waits for a change, at most for [`REST_INTERVAL`].
    fn wait_for_change(&self) {
        let state = self.shared.lock();
        // The caller checks what has changed, if anything.
        drop(self.shared.changed.wait_timeout(state, REST_INTERVAL));
    }

    /// Waits until something changes or the view is cancelled.
    fn rest(&self, version: u64, cancelled: &Canceller) {
        let mut state = self.shared.lock();
        while state.version == version && !cancelled.is_cancelled() {
            // A change is made under the lock and wakes this at once. A cancellation may come between the
            // check and the wait, which then ends by its timeout.
            let waited = self.shared.changed.wait_timeout(state, REST_INTERVAL);
            (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn announce(&mut self) {
        if let Some(callback) = &mut self.live.on_frame {
            callback();
        }
    }
}

fn spec(update: &SceneUpdate, size: ImageSize, settings: RenderSettings) -> FrameSpec {
    FrameSpec {
        update: update.clone(),
        size,
        settings,
        format: PixelFormat::LinearF16,
    }
}

/// Busy seconds of a frame below which the samples per frame are doubled.
const QUICK_SECS: f64 = 0.03;
/// Maximum frames in flight while they are slow: one is traced while pixels of another travel.
const SLOW_FRAMES_MAX: usize = 2;
/// Maximum samples per pixel of a frame after doublings.
const FRAME_SAMPLES_MAX: u32 = 64;
/// Timeout of a wait for a frame, after which changes are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Timeout of a finished view's wait; a change wakes it earlier.
const REST_INTERVAL: Duration = Duration::from_millis(200);
