//! Progressive renderer: one picture of many samples, traced by the farm as frames of different samples and
//! summed in linear light.
//!
//! ```text
//! next_frame ──▶ farm ──▶ accept ──▶ SampleBatch ──add_to──▶ Film
//! ```
//!
//! It does not block and owns no farm, so that several renders, and frames of other kinds, share one,
//! ordered by [`Priority`]. [`crate::Still`] and [`crate::Live`] run it on their own threads.

use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

use carom_protocol::FrameId;
use carom_tracer::film::Film;
use carom_tracer::{
    Aovs, CompiledScene, CpuTracer, ImageSize, RenderSettings, Scene, Tile, TraceJob, Tracer,
};

use crate::error::Error;
use crate::frame::{Frame, FrameSpec, Pixels};
use crate::lock::lock;
use crate::submission::{Priority, SceneHandle, Submission};
use crate::submitter::Submitter;

/// A picture while its samples accumulate.
#[derive(Clone, Debug)]
pub struct AccumulatedRender {
    spec: FrameSpec,
    priority: Priority,
    frame_samples: Option<u32>,
    /// Maximum number of frames in flight.
    frames_max: usize,
    samples_done: u32,
    /// The first sample that has not been requested.
    next_sample: u32,
    /// Frames of this render in flight, with the samples of each.
    in_flight: Vec<(FrameId, u32)>,
    /// Passes of the farm per frame: known after the first.
    passes: Option<u32>,
}

/// A frame with some of a render's samples.
#[derive(Clone, Debug)]
pub struct SampleBatch {
    /// Mean of the samples, in linear light.
    pub frame: Frame,
    /// Samples per pixel.
    pub samples: u32,
}

impl AccumulatedRender {
    /// A render of which nothing has been requested. The samples of `spec` are those of the whole picture,
    /// and its format is linear. With denoising, the samples come in as few frames as possible, each of
    /// which is denoised by itself.
    pub fn new(spec: FrameSpec, priority: Priority) -> Self {
        Self {
            spec,
            priority,
            frame_samples: None,
            frames_max: usize::MAX,
            samples_done: 0,
            next_sample: 0,
            in_flight: Vec::new(),
            passes: None,
        }
    }

    /// Resumes a render of which a film holds the first `samples_done` samples of each pixel.
    #[must_use]
    pub fn resume(self, samples_done: u32) -> Self {
        Self {
            samples_done,
            next_sample: samples_done,
            ..self
        }
    }

    /// Sets the samples per pixel and frame from now on. More delay the next progress, fewer cost bytes;
    /// the default depends on the picture's size.
    pub fn set_frame_samples(&mut self, samples: u32) {
        self.frame_samples = Some(samples.max(1));
    }

    /// Limits the frames in flight from now on: more hide the transfer time of pixels, and make each wait
    /// for those before it.
    pub(crate) fn set_frames_max(&mut self, frames: usize) {
        self.frames_max = frames;
    }

    /// The next frame to submit; `None` while enough are in flight, or if all have been requested.
    pub fn next_frame(&self) -> Option<FrameSpec> {
        // The first frame shows in how many passes the farm traces: each pass is transmitted, so later
        // frames are larger by that factor. Until then only one is in flight.
        let in_flight_max = match (self.priority, self.passes, self.frame_samples) {
            (Priority::Interactive, None, None) => 1,
            (Priority::Interactive, ..) => usize::MAX,
            (Priority::Background, ..) => BACKGROUND_FRAMES_MAX,
        };
        let samples = self.next_samples();
        let in_flight_max = in_flight_max.min(self.frames_max);
        (samples > 0 && self.in_flight.len() < in_flight_max).then(|| FrameSpec {
            settings: RenderSettings {
                samples,
                first_sample: self.next_sample,
                ..self.spec.settings
            },
            ..self.spec.clone()
        })
    }

    /// Records that [`AccumulatedRender::next_frame`] has been submitted.
    pub fn submitted(&mut self, id: FrameId) {
        let samples = self.next_samples();
        self.in_flight.push((id, samples));
        self.next_sample += samples;
    }

    /// Submits as many frames as the farm accepts now.
    ///
    /// # Errors
    /// Those of [`crate::Farm::submit_with`], except [`Error::FramesInFlight`].
    pub(crate) fn submit_through(
        &mut self,
        submitter: &mut Submitter,
        scene: &SceneHandle,
    ) -> Result<(), Error> {
        while let Some(spec) = self.next_frame() {
            let submission = Submission {
                priority: self.priority,
                exact: true,
                ..Submission::default()
            };
            match submitter.submit(spec, submission, scene.clone()) {
                Ok(id) => self.submitted(id),
                Err(Error::FramesInFlight { .. }) => break,
                Err(why) => return Err(why),
            }
        }
        Ok(())
    }

    /// Whether a frame in flight belongs to this render.
    pub fn owns(&self, id: FrameId) -> bool {
        self.in_flight.iter().any(|(frame, _)| *frame == id)
    }

    /// Accepts a frame of this render; `None` for others.
    pub fn accept(&mut self, frame: Frame) -> Option<SampleBatch> {
        let mut frames = self.in_flight.iter();
        let place = frames.position(|(id, _)| *id == frame.id)?;
        let (_, samples) = self.in_flight.remove(place);
        self.passes = Some(frame.stats.passes.max(1));
        self.samples_done += samples;
        Some(SampleBatch { frame, samples })
    }

    /// Cancels the frames in flight, which frees the nodes.
    pub(crate) fn cancel(&mut self, submitter: &mut Submitter) {
        // Frames are delivered in the order of submission: those in flight hold the last requested samples,
        // so that `next_sample` can go back by theirs.
        for (id, samples) in self.in_flight.drain(..) {
            submitter.cancel(id);
            self.next_sample -= samples;
        }
    }

    /// Samples per pixel that have arrived.
    pub const fn samples_done(&self) -> u32 {
        self.samples_done
    }

    /// Samples per pixel that are in flight.
    pub(crate) fn samples_in_flight(&self) -> u32 {
        self.in_flight.iter().map(|(_, samples)| samples).sum()
    }

    /// Whether all samples have arrived.
    pub const fn is_done(&self) -> bool {
        self.samples_done >= self.spec.settings.samples
    }

    /// The specification of the whole picture.
    pub const fn spec(&self) -> &FrameSpec {
        &self.spec
    }

    /// Samples per pixel of the next frame.
    fn next_samples(&self) -> u32 {
        let FrameSpec { size, settings, .. } = &self.spec;
        let left = settings.samples.saturating_sub(self.next_sample);
        let samples = self.frame_samples;
        samples.map_or_else(
            || frame_samples(*size, settings, self.passes.unwrap_or(1)).min(left),
            |samples| samples.min(left),
        )
    }
}

impl SampleBatch {
    /// Adds the samples to a film of the picture.
    ///
    /// # Errors
    /// [`Error::Tracer`] if the film has another size, or the picture's format is not linear.
    pub fn add_to(&self, film: &mut Film) -> Result<(), Error> {
        let Frame { size, stats, .. } = &self.frame;
        let whole = Tile {
            x: 0,
            y: 0,
            width: size.width,
            height: size.height,
        };
        let pixels: &[[f32; 3]] = match &self.frame.pixels {
            Pixels::Linear(pixels) => pixels,
            Pixels::Srgb8(_) => &[],
        };
        film.add(whole, pixels, self.samples)?;
        film.count_dropped(u32::try_from(stats.dropped_samples).unwrap_or(u32::MAX));
        Ok(())
    }
}

/// Samples per pixel of a frame of a picture whose tiles are traced `passes` times each: as each pass is
/// transmitted, there are fewer frames by that factor. Denoised pictures use as few frames as possible, as
/// the denoiser works better on all samples together.
fn frame_samples(size: ImageSize, settings: &RenderSettings, passes: u32) -> u32 {
    let (pixels, spp) = (size.pixels(), settings.samples);
    let fewest = FRAME_SAMPLES_MIN.div_ceil(pixels);
    let most = (FRAME_SAMPLES_MAX / pixels).max(1);
    let frames = if settings.denoise { 1 } else { FRAMES };
    let samples = (spp.div_ceil(frames) as usize).max(fewest).min(most);
    u32::try_from(samples.saturating_mul(passes as usize)).unwrap_or(u32::MAX)
}

/// Albedo, normal and depth of each pixel of a picture of `scene`, row-major, for the AOVs of its file.
/// Traced on this machine's CPU, as it takes only moments.
///
/// # Errors
/// [`Error::Tracer`] if the update does not fit the scene.
pub fn trace_aovs(scene: &Scene, spec: &FrameSpec) -> Result<Vec<Aovs>, Error> {
    let ImageSize { width, height } = spec.size;
    // In rows, so that they can be concatenated without rearranging.
    let rows: Vec<Tile> = (0..height)
        .map(|y| Tile {
            x: 0,
            y,
            width,
            height: 1,
        })
        .collect();
    let job = TraceJob {
        size: spec.size,
        tiles: &rows,
        settings: RenderSettings {
            samples: spec.settings.samples.min(AOV_SAMPLES_MAX),
            ..spec.settings
        },
        cancelled: &AtomicBool::new(false),
    };
    let mut scene = CompiledScene::new(scene)?;
    scene.apply(&spec.update)?;
    let hits = Mutex::new(vec![Vec::new(); rows.len()]);
    CpuTracer::new()?.aovs(&scene, &job, &|row| {
        let mut hits = lock(&hits);
        hits[row.index] = row.pixels;
    })?;
    let hits = hits.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(hits.concat())
}

/// Number of frames of a picture, for progress in between.
const FRAMES: u32 = 16;
/// Minimum pixel samples of a frame: a smaller one is more transport than tracing.
const FRAME_SAMPLES_MIN: usize = 1 << 21;
/// Maximum pixel samples of a frame: a larger one takes long to repeat when a node is lost. The bounds
/// depend on the picture alone, so that it is bit-identical on any farm.
const FRAME_SAMPLES_MAX: usize = 1 << 26;
/// Frames in flight of a background render: one is traced while pixels of another travel.
const BACKGROUND_FRAMES_MAX: usize = 2;
/// Maximum samples per pixel of AOVs: enough for smooth outlines.
const AOV_SAMPLES_MAX: u32 = 16;

#[cfg(test)]
mod tests {
    use carom_protocol::PixelFormat;
    use carom_tracer::SceneUpdate;

    use super::*;

    fn render(width: u32, height: u32, samples: u32, denoise: bool) -> AccumulatedRender {
        let spec = FrameSpec {
            update: SceneUpdate::default(),
            size: ImageSize::new(width, height),
            settings: RenderSettings {
                samples,
                denoise,
                ..RenderSettings::default()
            },
            format: PixelFormat::LinearF32,
        };
        AccumulatedRender::new(spec, Priority::Interactive)
    }

    /// Samples per pixel of each frame.
    fn frames(mut render: AccumulatedRender, passes: u32) -> Vec<u32> {
        render.passes = Some(passes);
        std::iter::from_fn(|| {
            let spec = render.next_frame()?;
            render.submitted(FrameId(u64::from(spec.settings.first_sample)));
            Some(spec.settings.samples)
        })
        .collect()
    }

    #[test]
    fn frames_cover_each_sample_once() {
        for (width, height) in [(1, 1), (32, 18), (1280, 720), (16_384, 16_384)] {
            for samples in [1, 2, 15, 16, 17, 64, 4096, 65_536] {
                for denoise in [false, true] {
                    for passes in [1, 3, 1000] {
                        let frames = frames(render(width, height, samples, denoise), passes);
                        assert_eq!(frames.iter().sum::<u32>(), samples);
                    }
                }
            }
        }
    }

    #[test]
    fn bytes_do_not_grow_with_the_number_of_passes() {
        let alone = frames(render(1280, 720, 1024, false), 1).len();
        for passes in 2..=16 {
            let sent = frames(render(1280, 720, 1024, false), passes).len() * passes as usize;
            assert!(sent < alone + passes as usize, "{sent} of {passes} nodes");
        }
    }

    #[test]
    fn a_background_render_keeps_few_frames_in_flight() {
        let mut render = render(32, 18, 1 << 16, false);
        render.priority = Priority::Background;
        assert_eq!(frames(render, 1).len(), BACKGROUND_FRAMES_MAX);
    }
}
