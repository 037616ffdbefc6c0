//! Frame pipeline between farm and window, with one method for each step.
//!
//! ```text
//! request ─▶ Farm ─▶ poll_farm ─┬─────────────────▶ choose ─▶ reproject, fade ─▶ displayed
//!                               └─▶ accumulate ────▶
//! ```
//! No step waits for the farm.

use carom_farm::{Farm, FarmConfig, NodeStatus};
use carom_tracer::{ImageSize, Scene, SceneUpdate};
use carom_window::display::DisplayFrame;

use crate::frame::accumulation::AccumulationThread;
use crate::frame::cross_fade::CrossFade;
use crate::frame::farm_startup::FarmState;
use crate::frame::reprojection::Reprojector;
use crate::frame::scheduler::{FrameScheduler, SchedulerAction, ViewTarget};

/// Farm, scheduler, accumulation and reprojection of a window.
pub struct FramePipeline {
    farm: FarmState,
    scheduler: FrameScheduler,
    accumulation: AccumulationThread,
    reprojector: Reprojector,
    cross_fade: CrossFade,
    in_flight_max: usize,
    /// Number of frames that the farm has finished.
    finished: u64,
    /// Serial number of the frame that was drawn last (before reprojection), and whether it is of a moving
    /// view.
    drawn: u64,
    is_drawn_moving: bool,
}

/// Statistics of a frame that the farm has finished.
#[derive(Debug)]
pub struct FinishedFrame {
    /// Its number, counted from 1.
    pub number: u64,
    /// Its size in pixels.
    pub size: ImageSize,
    /// Samples per pixel.
    pub samples: u32,
    /// The farm's statistics of it.
    pub stats: carom_farm::FrameStats,
    /// Status of the nodes after it.
    pub nodes: Vec<NodeStatus>,
}

impl FramePipeline {
    /// Starts the farm of `config` with `scene` and a maximum path depth of `max_depth`.
    ///
    /// # Errors
    /// If the scene is invalid, or a thread cannot be started.
    pub fn new(config: FarmConfig, scene: &Scene, max_depth: u32) -> anyhow::Result<Self> {
        let in_flight_max = config.frames_in_flight;
        Ok(Self {
            scheduler: FrameScheduler::new(ImageSize::new(0, 0), in_flight_max, max_depth),
            accumulation: AccumulationThread::open()?,
            reprojector: Reprojector::new(scene)?,
            cross_fade: CrossFade::default(),
            farm: FarmState::start(config, scene.clone()),
            in_flight_max,
            finished: 0,
            drawn: 0,
            is_drawn_moving: false,
        })
    }

    /// Switches to another scene and maximum path depth, and cancels the frames in flight.
    ///
    /// # Errors
    /// If the scene is invalid.
    pub fn set_scene(&mut self, scene: &Scene, max_depth: u32) -> anyhow::Result<()> {
        self.reprojector = Reprojector::new(scene)?;
        self.scheduler.set_max_depth(max_depth);
        self.cancel_all();
        self.farm.set_scene(scene)?;
        Ok(())
    }

    /// Processes the frames that the farm has finished, and passes the statistics of each to `record` if it
    /// is given.
    pub fn poll_farm(&mut self, mut record: Option<&mut dyn FnMut(FinishedFrame)>) {
        let Some(farm) = self.farm.poll() else {
            return;
        };
        while let Some(frame) = farm.poll_frame() {
            self.finished += 1;
            if let Some(record) = &mut record {
                record(FinishedFrame {
                    number: self.finished,
                    size: frame.size,
                    samples: self.scheduler.samples_of(frame.id).unwrap_or(0),
                    stats: frame.stats.clone(),
                    nodes: farm.nodes(),
                });
            }
            if let Some((series, batch)) = self.scheduler.finished(frame) {
                self.accumulation.submit(series, batch);
            }
        }
    }

    /// Processes the frames that the accumulation thread has merged.
    pub fn accumulate(&mut self) {
        while let Some(frame) = self.accumulation.poll() {
            self.scheduler.accumulated(frame);
        }
    }

    /// Chooses the frame to show now; its late tiles are filled from the one before.
    pub fn choose(&mut self) {
        let reprojector = &mut self.reprojector;
        let fill = &mut |frame: &mut _, missing: &_, before: &_| {
            reprojector.fill(frame, missing, before);
        };
        self.scheduler.present_due(fill);
    }

    /// Blends the chosen frame of a moving view with earlier ones and reprojects it to the present view;
    /// fades in the first one of a view at rest.
    pub fn reproject(&mut self, now_secs: f64, now: &SceneUpdate) {
        let replaced = self.scheduler.take_replaced();
        let moving = self.scheduler.shown_moving();
        let is_moving = moving.is_some();
        if let Some(frame) = moving {
            let drawn = replaced.as_ref().filter(|frame| frame.serial == self.drawn);
            let at_rest = drawn.filter(|_| !self.is_drawn_moving);
            self.reprojector.accumulate(frame, at_rest);
        }
        let Some(frame) = self.scheduler.shown() else {
            return;
        };
        // Fades only from a picture that was on screen, and only if it looks different: a draft of a moving
        // view, or a picture of another size.
        if let Some(replaced) = &replaced
            && replaced.serial == self.drawn
            && (self.is_drawn_moving || replaced.size != frame.size)
        {
            let before = self.reprojector.reprojected(replaced);
            // Fades from the reprojected picture that was on screen rather than from the traced one, which
            // would begin with a jump.
            self.cross_fade.begin(now_secs, before, frame);
        }
        // Recorded before reprojection, as a reprojected picture has a serial number of its own.
        self.drawn = frame.serial;
        self.is_drawn_moving = is_moving;
        let frame = self.reprojector.reproject_to(frame, now);
        self.cross_fade.advance(now_secs, frame);
    }

    /// The frame to draw: the result of the last [`FramePipeline::reproject`].
    pub fn displayed(&self) -> Option<&DisplayFrame> {
        let frame = self.scheduler.shown()?;
        let blended = self.cross_fade.blended();
        Some(blended.unwrap_or_else(|| self.reprojector.reprojected(frame)))
    }

    /// Requests frames of `target` until the farm has enough to do. `scene_at` returns the scene at a
    /// moment of the present shot.
    pub fn request(
        &mut self,
        now_secs: f64,
        target: &ViewTarget,
        scene_at: &dyn Fn(f64) -> SceneUpdate,
    ) {
        let Some(farm) = self.farm.ready() else {
            return;
        };
        loop {
            let slots = self.in_flight_max.saturating_sub(farm.in_flight());
            match self.scheduler.plan(now_secs, target, slots, scene_at) {
                SchedulerAction::Rest => return,
                SchedulerAction::Cancel(frames) => {
                    frames.into_iter().for_each(|id| farm.cancel(id))
                }
                SchedulerAction::Trace(request) => {
                    match farm.submit_with(request.spec.clone(), request.submission()) {
                        Ok(id) => {
                            self.scheduler.submitted(id, &request);
                            if request.is_reprojected() {
                                let spec = &request.spec;
                                self.reprojector.expect(&spec.update, spec.size);
                            }
                        }
                        Err(error) => return self.farm.fail(error.to_string()),
                    }
                }
            }
        }
    }

    /// Cancels all frames of the window that are in flight.
    pub fn cancel_all(&mut self) {
        if let Some(farm) = self.farm.ready() {
            let frames = self.scheduler.cancel_all().into_iter();
            frames.for_each(|id| farm.cancel(id));
        }
    }

    /// Whether another frame was chosen since the last one was drawn, or a fade is in progress.
    pub fn has_new_frame(&self) -> bool {
        let chosen = self.scheduler.shown().map_or(0, |frame| frame.serial);
        chosen != self.drawn || self.cross_fade.blended().is_some()
    }

    /// Whether no further frame will arrive without a new request.
    pub fn is_at_rest(&self) -> bool {
        match &self.farm {
            FarmState::Starting { .. } => false,
            FarmState::Ready(_) => {
                self.scheduler.is_at_rest() && self.cross_fade.blended().is_none()
            }
            FarmState::Failed(_) => true,
        }
    }

    /// The farm.
    pub fn farm(&self) -> &FarmState {
        &self.farm
    }

    /// The farm, if it is ready.
    pub fn farm_mut(&mut self) -> Option<&mut Farm> {
        self.farm.ready()
    }

    /// The scheduler.
    pub fn scheduler(&self) -> &FrameScheduler {
        &self.scheduler
    }

    /// The scheduler, to change its settings.
    pub fn scheduler_mut(&mut self) -> &mut FrameScheduler {
        &mut self.scheduler
    }

    /// Share of the drawn frame's pixels that were disoccluded in the chosen one, if it was reprojected.
    pub fn disocclusion_fraction(&self) -> Option<f64> {
        self.reprojector.disocclusion_fraction()
    }
}
