//! One picture of many samples by a whole farm: frames of other samples each, merged in linear light.

use std::collections::VecDeque;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::PixelFormat;
use carom_tracer::film::Film;
use carom_tracer::{
    Aovs, CompiledScene, CpuTracer, ImageSize, RenderSettings, Scene, SceneUpdate, Tile, TraceJob,
    Tracer,
};

use crate::{Error, Farm, Frame, FrameSpec, NodeState, Pixels};

/// A picture to be traced.
#[derive(Clone, Debug, PartialEq)]
pub struct Still {
    /// What differs from the farm's scene.
    pub update: SceneUpdate,
    /// Columns and rows.
    pub size: ImageSize,
    /// How it is sampled; `samples` is that of the whole picture, and `first_sample` counts nothing.
    /// Denoised, samples come in as few frames as can be, each of which is filtered by itself.
    pub settings: RenderSettings,
}

impl Still {
    /// Traces the samples from `done` on into `film`, as many frames at a time as the farm takes. The
    /// farm must have no other frames in flight. After each frame, and a few times a second while
    /// none comes, `watch` is told of the film and how many samples of each pixel are in it; an error
    /// of its own ends the work.
    ///
    /// # Errors
    /// Those of [`Farm::submit`]; [`Error::NoNodes`] when all nodes have been lost for ten seconds;
    /// what `watch` says.
    pub fn trace<E: From<Error>>(
        &self,
        farm: &mut Farm,
        film: &mut Film,
        mut done: u32,
        watch: &mut dyn FnMut(&Film, u32) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut next = done;
        let mut in_flight = VecDeque::new();
        let mut lost_since = None;
        // How often the farm traces each tile of a frame: known with the first.
        let mut passes = None;
        while next < self.settings.samples || !in_flight.is_empty() {
            while next < self.settings.samples && (passes.is_some() || in_flight.is_empty()) {
                let samples = self.frame_samples(next, passes.unwrap_or(1));
                match farm.submit(self.spec(next, samples)) {
                    Ok(_) => in_flight.push_back(samples),
                    Err(Error::FramesInFlight { .. }) => break,
                    Err(why) => return Err(why.into()),
                }
                next += samples;
            }
            if let Some(frame) = farm.wait_frame(PATIENCE) {
                let samples = in_flight.pop_front().unwrap_or(0);
                add(film, &frame, samples)?;
                passes = Some(frame.stats.passes.max(1));
                done += samples;
                lost_since = None;
            } else {
                wait_for_nodes(farm, &mut lost_since)?;
            }
            watch(film, done)?;
        }
        Ok(())
    }

    /// What camera rays meet first in each pixel, row-major, for AOVs of a picture file: a matter of
    /// moments, which this machine's processor can spare.
    ///
    /// # Errors
    /// [`Error::Tracer`] if the update does not fit the scene.
    pub fn aovs(&self, scene: &Scene) -> Result<Vec<Aovs>, Error> {
        let ImageSize { width, height } = self.size;
        // Row by row, so that they come together without being moved.
        let rows: Vec<Tile> = (0..height)
            .map(|y| Tile {
                x: 0,
                y,
                width,
                height: 1,
            })
            .collect();
        let job = TraceJob {
            size: self.size,
            tiles: &rows,
            settings: RenderSettings {
                samples: self.settings.samples.min(AOV_SAMPLES_MAX),
                ..self.settings
            },
            cancelled: &AtomicBool::new(false),
        };
        let mut scene = CompiledScene::new(scene)?;
        scene.apply(&self.update)?;
        let hits = Mutex::new(vec![Vec::new(); rows.len()]);
        CpuTracer::new()?.aovs(&scene, &job, &|row| {
            let mut hits = hits.lock().unwrap_or_else(PoisonError::into_inner);
            hits[row.index] = row.pixels;
        })?;
        let hits = hits.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(hits.concat())
    }

    fn spec(&self, first_sample: u32, samples: u32) -> FrameSpec {
        FrameSpec {
            update: self.update.clone(),
            size: self.size,
            settings: RenderSettings {
                samples,
                first_sample,
                ..self.settings
            },
            format: PixelFormat::LinearF32,
        }
    }

    /// Samples of the frame that begins at `first_sample`, of whose tiles each is traced `passes` times:
    /// each pass is sent, so that there are as many times fewer frames. Of pictures that are denoised
    /// there are as few as can be: the filter does more with more samples.
    fn frame_samples(&self, first_sample: u32, passes: u32) -> u32 {
        let (pixels, spp) = (self.size.pixels(), self.settings.samples);
        let fewest = FRAME_SAMPLES_MIN.div_ceil(pixels);
        let most = (FRAME_SAMPLES_MAX / pixels).max(1);
        let frames = if self.settings.denoise { 1 } else { FRAMES };
        let samples = (spp.div_ceil(frames) as usize).max(fewest).min(most);
        let samples = samples.saturating_mul(passes as usize);
        samples.min((spp - first_sample) as usize) as u32
    }
}

fn add(film: &mut Film, frame: &Frame, samples: u32) -> Result<(), Error> {
    let ImageSize { width, height } = frame.size;
    let whole = Tile {
        x: 0,
        y: 0,
        width,
        height,
    };
    // A farm that answers in another format than it was asked for has no pixels for the film.
    let pixels: &[[f32; 3]] = match &frame.pixels {
        Pixels::Linear(pixels) => pixels,
        Pixels::Srgb8(_) => &[],
    };
    film.add(whole, pixels, samples)?;
    film.count_dropped(u32::try_from(frame.stats.dropped_samples).unwrap_or(u32::MAX));
    Ok(())
}

/// Nodes that are being called or that are late may still come; when all have been lost for a while,
/// nobody will.
fn wait_for_nodes(farm: &Farm, lost_since: &mut Option<Instant>) -> Result<(), Error> {
    let mut reasons = Vec::new();
    for node in farm.nodes() {
        match node.state {
            NodeState::Lost { why, .. } => reasons.push(format!("{}: {why}", node.address)),
            _ => {
                *lost_since = None;
                return Ok(());
            }
        }
    }
    if lost_since.get_or_insert_with(Instant::now).elapsed() < NODES_PATIENCE {
        return Ok(());
    }
    Err(Error::NoNodes(reasons.join("; ")))
}

/// A picture comes as so many frames of other samples, so that there is progress to show;
const FRAMES: u32 = 16;
/// but a frame of fewer samples is more transport than tracing,
const FRAME_SAMPLES_MIN: usize = 1 << 21;
/// and one of more is long to repeat when a node is lost. The bounds depend on the picture alone,
/// so that it is the same bit for bit whoever traces it.
const FRAME_SAMPLES_MAX: usize = 1 << 26;
/// Camera rays of a pixel of an AOV: their outlines are smooth then.
const AOV_SAMPLES_MAX: u32 = 16;
/// How long to wait for a frame before looking at what else there is.
const PATIENCE: Duration = Duration::from_millis(200);
/// How long to wait for nodes when none is left.
const NODES_PATIENCE: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;

    fn still(width: u32, height: u32, samples: u32, denoise: bool) -> Still {
        Still {
            update: SceneUpdate::default(),
            size: ImageSize::new(width, height),
            settings: RenderSettings {
                samples,
                denoise,
                ..RenderSettings::default()
            },
        }
    }

    /// Samples of each frame.
    fn frames(still: &Still, passes: u32) -> Vec<u32> {
        let mut next = 0;
        std::iter::from_fn(|| {
            let samples = still.frame_samples(next, passes);
            next += samples;
            (samples > 0).then_some(samples)
        })
        .collect()
    }

    #[test]
    fn frames_cover_each_sample_once() {
        for (width, height) in [(1, 1), (32, 18), (1280, 720), (16_384, 16_384)] {
            for samples in [1, 2, 15, 16, 17, 64, 4096, 65_536] {
                for denoise in [false, true] {
                    for passes in [1, 3, 1000] {
                        let frames = frames(&still(width, height, samples, denoise), passes);
                        assert_eq!(frames.iter().sum::<u32>(), samples);
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_sent_does_not_grow_with_the_nodes_that_trace_each_pixel() {
        let still = still(1280, 720, 1024, false);
        let alone = frames(&still, 1).len();
        for passes in 2..=16 {
            let sent = frames(&still, passes).len() * passes as usize;
            assert!(sent < alone + passes as usize, "{sent} of {passes} nodes");
        }
    }
}
