//! Live pictures: a view that follows its camera and its objects, and gathers samples while nothing
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

/// A live picture to begin.
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
    /// A view of so many pixels.
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

    /// With so many samples per pixel in each frame: higher is smoother while things move, and slower
    /// in proportion. Default: 1.
    #[must_use]
    pub fn samples_per_frame(self, samples_per_frame: u32) -> Self {
        Self {
            samples_per_frame,
            ..self
        }
    }

    /// Gathering so many samples per pixel while nothing changes. Default: 1024.
    #[must_use]
    pub fn samples(mut self, samples: u32) -> Self {
        self.settings.samples = samples;
        self
    }

    /// With paths of at most so many scattering events, see [`RenderSettings::max_depth`].
    #[must_use]
    pub fn max_depth(mut self, max_depth: u32) -> Self {
        self.settings.max_depth = max_depth;
        self
    }

    /// 8-bit pixels show radiance times this. Default: 1.
    #[must_use]
    pub fn exposure(self, exposure: f32) -> Self {
        Self { exposure, ..self }
    }

    /// With drafts while things change: denoised, and of as few pixels as it takes to come as often as
    /// is preferred, see [`crate::quality`]. Once nothing changes, samples gather at the full size, in
    /// larger frames where they are quick, and take the draft's place when there are [`Live::DRAFT_SAMPLES`]. Default: none, so that a change
    /// shows with the first samples of the full size.
    #[must_use]
    pub fn drafts(self, preference: QualityPreference) -> Self {
        Self {
            drafts: Some(preference),
            ..self
        }
    }

    /// Samples per pixel with which a picture is better than the draft of it.
    pub const DRAFT_SAMPLES: u32 = 8;

    /// Calls this from the view's thread whenever [`LiveView::latest`] has something new, an error or
    /// a picture: to wake a loop of events.
    #[must_use]
    pub fn on_frame(self, callback: impl FnMut() + Send + 'static) -> Self {
        Self {
            on_frame: Some(Box::new(callback)),
            ..self
        }
    }
}

/// A live picture. Its calls never wait; dropped, it ends.
pub struct LiveView {
    settings: RenderSettings,
    shared: Arc<Shared>,
    job: Job<(), ()>,
}

/// What the view's owner and its thread share.
struct Shared {
    state: Mutex<LiveState>,
    changed: Condvar,
}

struct LiveState {
    scene: SceneHandle,
    update: SceneUpdate,
    size: ImageSize,
    /// Counts changes of the three.
    version: u64,
    is_paused: bool,
    /// Of drafts, if there are any.
    quality: Option<Quality>,
    latest: Option<Picture>,
    frames: VecDeque<LiveFrame>,
    error: Option<Error>,
}

/// A frame that a view was made of, for statistics.
#[derive(Clone, Debug)]
pub struct LiveFrame {
    /// Its number in the farm.
    pub id: FrameId,
    /// Pixels across and down.
    pub size: ImageSize,
    /// Samples of each pixel.
    pub samples: u32,
    /// How it was made.
    pub stats: FrameStats,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, LiveState> {
        lock(&self.state)
    }
}

impl Farm {
    /// Begins a live picture, on a thread of its own.
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
    /// Looks through this camera from now on.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the rule that the camera breaks; the view stays as it was.
    pub fn set_camera(&mut self, camera: Camera) -> Result<(), Error> {
        self.change(|update, _| update.camera = Some(camera))
    }

    /// Shows an object elsewhere from now on: `position` in metres, `rotation` a unit quaternion.
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

    /// Shows an object, or leaves it out, where the scene has it.
    ///
    /// # Errors
    /// As [`LiveView::move_to`].
    pub fn set_visible(&mut self, object: ObjectHandle, visible: bool) -> Result<(), Error> {
        let pose = self.shared.lock().scene.scene.base_pose(object)?;
        self.pose(ObjectPose { visible, ..pose })
    }

    /// Shows this state of the scene from now on: what is not in `update` is as the scene has it.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the rule that the update breaks; the view stays as it was.
    pub fn set_update(&mut self, update: SceneUpdate) -> Result<(), Error> {
        self.change(|before, _| *before = update)
    }

    /// Shows this state of another scene from now on, of the farm that the view is of.
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

    /// Traces so many pixels from now on, as when a window has another size.
    ///
    /// # Errors
    /// [`Error::Tracer`] if there are none or too many.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<(), Error> {
        self.change(|_, size| *size = ImageSize::new(width, height))
    }

    /// The newest picture, if there is one that has not been taken.
    ///
    /// # Errors
    /// What has ended the view, once: [`Error::NoNodes`] if no node has answered for
    /// [`crate::FarmConfig::timeout_secs`], [`Error::FrameRefused`] if every node refuses a frame,
    /// [`Error::FarmClosed`] if the farm has been dropped.
    pub fn latest(&mut self) -> Result<Option<Picture>, Error> {
        let mut state = self.shared.lock();
        match state.error.take() {
            Some(error) => Err(error),
            None => Ok(state.latest.take()),
        }
    }

    /// Gathers no more samples while `paused`, so that others have the farm; changes are shown even so.
    pub fn set_paused(&mut self, paused: bool) {
        self.shared.lock().is_paused = paused;
        self.shared.changed.notify_all();
    }

    /// Gives up something else first in drafts, if there are any.
    pub fn set_quality_preference(&mut self, preference: QualityPreference) {
        if let Some(quality) = &mut self.shared.lock().quality {
            quality.set_quality_preference(preference);
        }
    }

    /// Quality of the next draft, and what is known of the others' cost; none without
    /// [`Live::drafts`].
    pub fn quality(&self) -> Option<Quality> {
        self.shared.lock().quality.clone()
    }

    /// The frames that have come since the last call, the oldest first: at most
    /// [`LiveView::FRAMES_MAX`], those before are dropped.
    pub fn frames(&mut self) -> Vec<LiveFrame> {
        self.shared.lock().frames.drain(..).collect()
    }

    /// Frames that wait for [`LiveView::frames`]: those of a second.
    pub const FRAMES_MAX: usize = 64;

    fn pose(&mut self, pose: ObjectPose) -> Result<(), Error> {
        self.change(|update, _| {
            update.poses.retain(|other| other.object != pose.object);
            update.poses.push(pose);
        })
    }

    /// Changes what is seen, if the result fits the scene.
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

/// What the thread of a view works on.
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

    /// One picture after the other, each as long as nothing changes.
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

    /// Shows a picture of the quality that comes in time.
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

    /// Adds samples up until all are there or something changes. Without drafts the first frame is
    /// shown even so: a view that is moved all the time must not stand still.
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
            // What changes next is seen in a draft: until then, larger frames are less transport.
            // Frames of before the last doubling are still on their way: each size is doubled once.
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

    /// Adds the next frame up, if one comes soon.
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

    /// Waits a while, but no longer than until something changes.
    fn wait_for_change(&self) {
        let state = self.shared.lock();
        // What has changed, or that nothing has, is for the caller to see.
        drop(self.shared.changed.wait_timeout(state, REST_INTERVAL));
    }

    /// Waits until something changes.
    fn rest(&self, version: u64, cancelled: &Canceller) {
        let mut state = self.shared.lock();
        while state.version == version && !cancelled.is_cancelled() {
            // A change is made under the lock and wakes this at once. Cancelling is not: its call may
            // come between the look above and the wait, which then ends by itself.
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

/// Frames that keep a node busy for less are doubled.
const QUICK_SECS: f64 = 0.03;
/// Frames in flight that are not quick: one is traced while pixels of another travel.
const SLOW_FRAMES_MAX: usize = 2;
/// Samples of a pixel in a frame that has been doubled.
const FRAME_SAMPLES_MAX: u32 = 64;
/// How long to wait for a frame before looking at what has changed.
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// How long a view that is finished sleeps at most: a change wakes it.
const REST_INTERVAL: Duration = Duration::from_millis(200);
