//! Frame scheduler: which frame to request from the farm next, and which one is on show.
//!
//! ```text
//!            things move          │ a draft at the quality that holds the frame time
//! live ──────────────────────────▶│
//!            nothing moves        │ disjoint sample ranges at full size, merged in linear light
//! shot ──────────────────────────▶  moments of the future, each shown when its time comes
//! ```
//!
//! The scheduler uses neither farm nor clock: times are arguments, so that tests run hours in milliseconds.

mod shown_frame;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::time::Duration;

use carom_farm::pacing::{FrameSchedule, LeadTime, PresentationQueue};
use carom_farm::quality::{Quality, QualityLevel, QualityPreference, Resolution};
use carom_farm::{
    AccumulatedRender, Frame, FrameId, FrameSpec, PixelFormat, Pixels, Priority, SampleBatch,
    Submission,
};
use carom_tracer::{ImageSize, RenderSettings, SceneUpdate, Tile};
use carom_window::display::DisplayFrame;

use self::shown_frame::ShownFrame;
use crate::frame::accumulation::AccumulatedFrame;
use crate::frame::opening_still::OpeningStill;
use crate::play::ShotClock;
use crate::scene::scene_builder::EXPOSURE;

/// Content of the player's view.
#[derive(Clone, Debug, PartialEq)]
pub enum ViewTarget {
    /// The table as it is now.
    Live(SceneUpdate),
    /// A shot that plays on its own clock.
    Shot(ShotClock),
}

/// Picture to be requested from the farm.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRequest {
    /// Specification to submit.
    pub spec: FrameSpec,
    /// Time from now until it must be shown, if it has a fixed one: see [`Submission::deadline`].
    pub deadline: Option<Duration>,
    role: RequestKind,
}

impl FrameRequest {
    /// Whether the picture is shown while things move, and therefore reprojected until the next one arrives.
    pub fn is_reprojected(&self) -> bool {
        self.role != RequestKind::Accumulation
    }

    /// Its priority and deadline: refinement has a lower priority than pictures that respond to the player.
    pub fn submission(&self) -> Submission {
        let priority = match self.role {
            RequestKind::Accumulation => Priority::Background,
            RequestKind::Interactive | RequestKind::Lookahead(_) => Priority::Interactive,
        };
        Submission {
            priority,
            deadline: self.deadline,
            ..Submission::default()
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum RequestKind {
    Interactive,
    Accumulation,
    Lookahead(f64),
}

/// Next action towards the farm.
#[derive(Clone, Debug, PartialEq)]
pub enum SchedulerAction {
    /// Nothing to do for now.
    Rest,
    /// Cancel these pictures.
    Cancel(Vec<FrameId>),
    /// Submit this picture.
    Trace(FrameRequest),
}

/// Statistics for the player.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SchedulerStats {
    /// Number of pictures finished so far.
    pub pictures: u64,
    /// Number of tiles so far that were missing when their pictures had to be shown, and were filled from the
    /// picture before.
    pub late_tiles: u64,
    /// Number of pictures of shots so far that were skipped because a later one was due.
    pub skipped: u64,
    /// Time by which pictures are requested ahead of their moment, in seconds.
    pub lead_secs: f64,
}

/// State machine that turns a [`ViewTarget`] into requests, and finished frames into the picture on show.
#[derive(Debug)]
pub struct FrameScheduler {
    window: ImageSize,
    resolution: Resolution,
    max_depth: u32,
    quality: Quality,
    lead: LeadTime,
    in_flight_max: usize,
    target: Option<ViewTarget>,
    /// Time of the last change of the target.
    still_since_secs: f64,
    /// Whether a draft of the present target has been requested.
    drafted: bool,
    refinement: Option<AccumulationState>,
    schedule: FrameSchedule,
    moments: PresentationQueue<TimedFrame>,
    pending: VecDeque<PendingFrame>,
    /// Number of drafts and frames of shots requested so far.
    requests: u64,
    shown: ShownFrame,
    /// Moment of the picture on show in the present shot, if it is of that, in seconds.
    shown_moment: Option<f64>,
    stats: SchedulerStats,
}

/// Picture of a shot, possibly with missing tiles.
#[derive(Debug)]
struct TimedFrame {
    picture: DisplayFrame,
    missing: Vec<Tile>,
}

/// Function that fills the missing tiles of a picture from the picture that was on show before.
pub type FillMissing<'a> = &'a mut dyn FnMut(&mut DisplayFrame, &[Tile], &DisplayFrame);

#[derive(Clone, Debug)]
struct PendingFrame {
    id: FrameId,
    role: RequestKind,
    settings: RenderSettings,
    update: SceneUpdate,
}

impl FrameScheduler {
    /// A scheduler for a window of `window` pixels, a farm that takes `in_flight_max` pictures at once, and
    /// a maximum path depth of `max_depth`.
    pub fn new(window: ImageSize, in_flight_max: usize, max_depth: u32) -> Self {
        Self {
            window,
            resolution: Resolution::default(),
            max_depth,
            quality: Quality::default(),
            lead: LeadTime::default(),
            in_flight_max,
            target: None,
            still_since_secs: 0.0,
            drafted: false,
            refinement: None,
            schedule: FrameSchedule::default(),
            moments: PresentationQueue::default(),
            pending: VecDeque::new(),
            requests: 0,
            shown: ShownFrame::default(),
            shown_moment: None,
            stats: SchedulerStats::default(),
        }
    }

    /// Sets what is reduced first while things move.
    pub fn set_quality_preference(&mut self, preference: QualityPreference) {
        self.quality.set_quality_preference(preference);
    }

    /// Fixes the quality of moving pictures to a level, however long they take, for measurements.
    pub fn fix_quality(&mut self, level: QualityLevel) {
        self.quality.fix(level);
    }

    /// Sets the maximum path depth from the next picture on.
    pub fn set_max_depth(&mut self, max_depth: u32) {
        self.max_depth = max_depth;
    }

    /// Sets the window's size; if it differs, the view is requested again.
    pub fn resize(&mut self, window: ImageSize) {
        if self.window != window {
            self.window = window;
            self.target = None;
        }
    }

    /// Limits the resolution of pictures from the next one on.
    pub fn set_resolution(&mut self, resolution: Resolution) {
        if self.resolution != resolution {
            self.resolution = resolution;
            self.target = None;
        }
    }

    /// Size of pictures of a view at rest, the largest in use.
    pub fn sharpest(&self) -> ImageSize {
        self.resolution.size(self.window)
    }

    /// Size of the window in pixels.
    pub fn window(&self) -> ImageSize {
        self.window
    }

    /// Decides what the farm, which can take `room` more frames, should do next; to be called until it
    /// returns [`SchedulerAction::Rest`]. `at` returns the scene at a moment of the shot.
    pub fn plan(
        &mut self,
        now_secs: f64,
        target: &ViewTarget,
        room: usize,
        at: &dyn Fn(f64) -> SceneUpdate,
    ) -> SchedulerAction {
        if self.window.pixels() == 0 {
            return SchedulerAction::Rest;
        }
        let cancel = self.set_target(now_secs, target);
        // Cancels before requesting anything new: the farm works on frames in order, and the new one would
        // wait.
        if cancel && !self.pending.is_empty() {
            return SchedulerAction::Cancel(self.drain_pending());
        }
        if room == 0 {
            return SchedulerAction::Rest;
        }
        let request = match target {
            ViewTarget::Live(update) => self.live_order(now_secs, update),
            ViewTarget::Shot(clock) => {
                let (lead, end_secs, clock) = (self.lead.secs(), clock.end_secs, clock.now_secs);
                self.schedule
                    .next(clock, lead, self.quality.period_secs(), end_secs)
                    .map(|moment| FrameRequest {
                        deadline: Some(Duration::from_secs_f64((moment - clock).max(0.0))),
                        ..self.level_order(at(moment), RequestKind::Lookahead(moment))
                    })
            }
        };
        request.map_or(SchedulerAction::Rest, SchedulerAction::Trace)
    }

    /// Records that `request` was submitted as `id`.
    pub fn submitted(&mut self, id: FrameId, request: &FrameRequest) {
        if let (RequestKind::Accumulation, Some(refinement)) = (request.role, &mut self.refinement)
        {
            refinement.render.submitted(id);
        }
        self.pending.push_back(PendingFrame {
            id,
            role: request.role,
            settings: request.spec.settings,
            update: request.spec.update.clone(),
        });
    }

    /// Resets the target and returns all pending frames, which the caller must cancel.
    pub fn cancel_all(&mut self) -> Vec<FrameId> {
        self.target = None;
        self.drain_pending()
    }

    /// Processes a finished frame. A batch of samples is returned with the series of its picture, to be
    /// summed by [`crate::frame::accumulation`]. Cancelled frames are ignored.
    pub fn finished(&mut self, frame: Frame) -> Option<(u64, SampleBatch)> {
        let is_frame = |pending: &PendingFrame| pending.id == frame.id;
        let place = self.pending.iter().position(is_frame)?;
        let pending = if frame.missing.is_empty() {
            let pending = self.pending.remove(place)?;
            self.measure(&pending, &frame);
            pending
        } else {
            self.stats.late_tiles += frame.missing.len() as u64;
            self.pending[place].clone()
        };
        if pending.role == RequestKind::Accumulation {
            let refinement = self.refinement.as_mut()?;
            return Some((refinement.series, refinement.render.accept(frame)?));
        }
        match (pending.role, frame.pixels) {
            (RequestKind::Interactive, Pixels::Srgb8(_)) if self.shown.keeps_still(frame.size) => {}
            (RequestKind::Interactive, Pixels::Srgb8(rgba)) => {
                let picture = self.shown.picture(frame.size, rgba, pending.update);
                self.shown.replace(picture);
            }
            (RequestKind::Lookahead(at), Pixels::Srgb8(rgba)) => {
                let picture = self.shown.picture(frame.size, rgba, pending.update);
                self.add_moment(frame.id, at, picture, frame.missing);
            }
            // The farm's contract is to answer in the requested format.
            (role, _) => tracing::error!("frame {} of {role:?} has another format", frame.id.0),
        }
        None
    }

    /// Processes merged sample ranges; those of a picture that is no longer refined are ignored.
    pub fn accumulated(&mut self, frame: AccumulatedFrame) {
        let wanted = |refinement: &&mut AccumulationState| refinement.series == frame.series;
        let Some(refinement) = self.refinement.as_mut().filter(wanted) else {
            return;
        };
        refinement.accumulated = frame.samples;
        // With fewer samples it would look noisier than the draft, whose pixels are larger.
        if frame.samples >= SHOWN_SAMPLES_MIN {
            let update = refinement.update.clone();
            let picture = self.shown.picture(frame.size, frame.rgba, update);
            self.shown.refine(picture);
        }
    }

    /// Shows the frame of the shot that is due; `fill` fills its missing tiles.
    pub fn present_due(&mut self, fill: FillMissing<'_>) {
        if let Some(ViewTarget::Shot(clock)) = &self.target
            && let Some((at, moment)) = self.moments.due(clock.now_secs)
        {
            self.present(at, moment, fill);
        }
    }

    /// The frame on show.
    pub fn shown(&self) -> Option<&DisplayFrame> {
        self.shown.frame()
    }

    /// The frame on show, if it is of a moving view, to be blended with earlier ones.
    pub fn shown_moving(&mut self) -> Option<&mut DisplayFrame> {
        self.shown.moving()
    }

    /// Shows a stored picture until the farm has traced one.
    pub fn show_still(&mut self, still: OpeningStill) {
        self.shown.show_still(still);
    }

    /// Takes the frame that was on show before, if it has not been taken.
    pub fn take_replaced(&mut self) -> Option<DisplayFrame> {
        self.shown.take_replaced()
    }

    /// Shows a picture of the shot. With missing tiles it is shown only if there is another to fill them
    /// from.
    fn present(&mut self, at: f64, moment: TimedFrame, fill: FillMissing<'_>) {
        let TimedFrame {
            mut picture,
            missing,
        } = moment;
        match self.shown.frame() {
            _ if missing.is_empty() => {}
            Some(before) => fill(&mut picture, &missing, before),
            None => return,
        }
        self.shown.replace(picture);
        self.shown_moment = Some(at);
    }

    /// Queues a picture of the shot. One whose deadline passed before it was complete arrives twice, first
    /// with missing tiles; pictures requested before it will not arrive any more.
    fn add_moment(&mut self, id: FrameId, at: f64, picture: DisplayFrame, missing: Vec<Tile>) {
        let comes = |pending: &PendingFrame| {
            pending.id >= id || !matches!(pending.role, RequestKind::Lookahead(_))
        };
        self.pending.retain(comes);
        match self.shown_moment {
            // Too late: the shot on screen must not run backwards.
            Some(shown) if at < shown => {}
            Some(shown) if at == shown && missing.is_empty() => self.shown.replace(picture),
            _ => self.moments.push(at, TimedFrame { picture, missing }),
        }
    }

    /// Delay from a click to the stroke that lets pictures of the shot arrive in time, in seconds.
    pub fn stroke_delay_secs(&self) -> f64 {
        self.lead.stroke_delay_secs(self.quality.period_secs())
    }

    /// Whether the picture on show is complete and will not change without a new target.
    pub fn is_at_rest(&self) -> bool {
        let finished = self
            .refinement
            .as_ref()
            .is_some_and(|refinement| refinement.accumulated >= SAMPLES_MAX);
        self.pending.is_empty() && finished
    }

    /// The quality of moving pictures, and the reason for it.
    pub fn quality(&self) -> &Quality {
        &self.quality
    }

    /// Samples per pixel of a pending picture.
    pub fn samples_of(&self, id: FrameId) -> Option<u32> {
        let pending = self.pending.iter().find(|pending| pending.id == id)?;
        Some(pending.settings.samples)
    }

    /// Statistics for the player.
    pub fn stats(&self) -> SchedulerStats {
        SchedulerStats {
            skipped: self.moments.skipped,
            lead_secs: self.lead.secs(),
            ..self.stats
        }
    }

    /// Sets the target, and returns whether it makes the pictures in flight useless.
    fn set_target(&mut self, now_secs: f64, target: &ViewTarget) -> bool {
        let before = self.target.replace(target.clone());
        let same = match (&before, target) {
            (Some(ViewTarget::Live(a)), ViewTarget::Live(b)) => a == b,
            (Some(ViewTarget::Shot(a)), ViewTarget::Shot(b)) => a.number == b.number,
            _ => false,
        };
        if same {
            return false;
        }
        let view = match target {
            ViewTarget::Live(update) => Some(update),
            ViewTarget::Shot(_) => None,
        };
        self.shown.look(now_secs, view);
        self.still_since_secs = now_secs;
        self.drafted = false;
        self.refinement = None;
        self.schedule = FrameSchedule::default();
        self.moments.clear();
        self.shown_moment = None;
        // Drafts stay in flight when a live view moves on: a slightly outdated one is still shown,
        // reprojected.
        self.pending
            .iter()
            .any(|pending| pending.role != RequestKind::Interactive)
            || matches!(target, ViewTarget::Shot(_))
    }

    fn live_order(&mut self, now_secs: f64, update: &SceneUpdate) -> Option<FrameRequest> {
        if !self.drafted {
            // More pictures in flight than cover the round trip to the farm would only add latency.
            let period_secs = self.quality.period_secs();
            let drafts_max = self
                .lead
                .pictures_in_flight(period_secs, self.in_flight_max);
            let room = self.pending.len() < drafts_max;
            self.drafted |= room;
            return room.then(|| self.level_order(update.clone(), RequestKind::Interactive));
        }
        if now_secs - self.still_since_secs < STILL_SECS {
            return None;
        }
        let size = self.sharpest();
        let spec = || FrameSpec {
            update: update.clone(),
            size,
            settings: RenderSettings {
                samples: SAMPLES_MAX,
                max_depth: self.max_depth,
                ..RenderSettings::default()
            },
            format: PixelFormat::LinearF16,
        };
        let state = || AccumulationState {
            // The number of the last draft, which differs for every view, so that samples of an earlier
            // view are recognised.
            series: self.requests,
            update: update.clone(),
            render: AccumulatedRender::new(spec(), Priority::Background),
            accumulated: 0,
        };
        let render = &mut self.refinement.get_or_insert_with(state).render;
        render.set_frame_samples(self.quality.samples_within(REFINEMENT_SECS, size));
        render.next_frame().map(|spec| FrameRequest {
            spec,
            deadline: None,
            role: RequestKind::Accumulation,
        })
    }

    fn drain_pending(&mut self) -> Vec<FrameId> {
        self.pending.drain(..).map(|pending| pending.id).collect()
    }

    /// Size of a quality level's pictures, at most that of a view at rest.
    fn size_of(&self, level: QualityLevel) -> ImageSize {
        let (size, sharpest) = (level.size(self.window), self.sharpest());
        match size.pixels() > sharpest.pixels() {
            true => sharpest,
            false => size,
        }
    }

    /// A request at the present quality level.
    fn level_order(&mut self, update: SceneUpdate, role: RequestKind) -> FrameRequest {
        let level: QualityLevel = self.quality.level();
        self.requests += 1;
        FrameRequest {
            spec: FrameSpec {
                update,
                size: self.size_of(level),
                settings: RenderSettings {
                    samples: level.samples,
                    denoise: level.denoise,
                    // A different seed for each picture, so that noise averages out over time.
                    seed: self.requests as u32,
                    max_depth: self.max_depth,
                    ..RenderSettings::default()
                },
                format: PixelFormat::Srgb8 { exposure: EXPOSURE },
            },
            deadline: None,
            role,
        }
    }

    fn measure(&mut self, pending: &PendingFrame, frame: &Frame) {
        // Quality is by the busy time alone: queueing and transfer delay a picture, but not the rate of
        // pictures.
        self.quality.observe(
            frame.size.pixels(),
            &pending.settings,
            self.window,
            frame.stats.busy_secs,
        );
        if pending.role != RequestKind::Accumulation {
            self.lead.observe(frame.stats.makespan_secs);
        }
        self.stats.pictures += 1;
    }
}

/// Picture that is refined by disjoint sample ranges.
#[derive(Debug)]
struct AccumulationState {
    /// Number of the draft that it refines.
    series: u64,
    update: SceneUpdate,
    render: AccumulatedRender,
    /// Samples per pixel of the last accumulated picture.
    accumulated: u32,
}

/// Time without motion after which refinement begins, in seconds.
const STILL_SECS: f64 = 0.1;
/// Intended duration of one refinement, in seconds. Longer ones waste less on fixed costs, shorter ones
/// show progress and free the farm sooner for the player's next move.
const REFINEMENT_SECS: f64 = 0.25;
/// Samples per pixel at which accumulation ends: the error is then 1/32 of that of one sample, below a step
/// of 8 bits.
const SAMPLES_MAX: u32 = 1024;
/// Samples per pixel from which an accumulated picture is shown.
const SHOWN_SAMPLES_MIN: u32 = 2;
