//! Tracing and denoising of frames entirely on the device.
//!
//! ```text
//! tiles and guard band ─▶ halves of the samples ─▶ first hits ─▶ first hits at edges ─▶ filter ─▶ film ─▶ tiles
//! ```
//!
//! All of it is one submission where the device is fast enough; otherwise the samples are divided
//! among several dispatches as without denoising.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use bytemuck::{bytes_of, cast_slice};

use super::kernels::{FilterBuffers, FilterJob, FilterKernels, Step};
use crate::aov::further_rays;
use crate::denoise::{GuardedRegion, REGION_SAMPLES, RegionLimits, in_parts};
use crate::gpu::features::KernelOutput;
use crate::gpu::frame::{FrameBuffers, PASSES_MAX, Pass, ReadbackLayout, SUM_BYTES, groups};
use crate::gpu::layout::DispatchData;
use crate::gpu::pipeline::Kernel;
use crate::gpu::schedule::{self, BLOCK_PIXELS, Chunk, ChunkLimits};
use crate::gpu::{ChunkSink, GpuTracer, deliver, radiance_sink};
use crate::{CompiledScene, Error, RenderSettings, TileRadiance, TileSrgb8, TraceJob, TraceStats};

/// A run of samples of every pixel, traced into a buffer of its own.
struct TracedPart {
    kernel: Arc<Kernel>,
    settings: RenderSettings,
    target: PartTarget,
}

/// The buffer of [`FilterBuffers`] that a part is traced into.
#[derive(Clone, Copy)]
enum PartTarget {
    Halves,
    Hits,
    /// First hits of further rays, for the pixels that the filter's first steps have listed.
    EdgeHits,
}

/// All that is traced as the filter's input.
struct TracedParts {
    samples: [TracedPart; 2],
    /// First hits of further rays in pixels at edges; `None` if the samples suffice for smooth
    /// edges.
    edges: Option<TracedPart>,
}

/// Passes that have been recorded, but not submitted.
#[derive(Default)]
struct Submission<'a> {
    passes: Vec<Pass<'a>>,
    kinds: Vec<PassKind>,
    samples: u64,
}

/// What the device time of a pass is accounted to.
#[derive(Clone, Copy)]
enum PassKind {
    /// Path tracing, with the number of paths.
    Paths(u64),
    FirstHits,
    Filter,
}

/// A region (tiles and their guard band) while it is traced and filtered.
struct RegionFrame<'a> {
    tracer: &'a GpuTracer,
    job: &'a TraceJob<'a>,
    buffers: &'a FrameBuffers,
    filter: &'a FilterBuffers,
    filter_job: FilterJob<'a>,
    layout: ReadbackLayout,
    limits: ChunkLimits,
    work_per_sample: f64,
    stats: TraceStats,
    is_begun: bool,
}

impl GpuTracer {
    /// Traces the job's tiles and their guard band, and hands over the denoised tiles.
    pub(in crate::gpu) fn trace_denoised(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        in_parts(job, self.region_limits(scene, job), |first, part| {
            self.trace_region(scene, part, None, &radiance_sink(first, sink))
        })
    }

    /// As [`Self::trace_denoised`], but tone mapped on the device and handed over as 8-bit sRGB.
    pub(in crate::gpu) fn trace_denoised_srgb8(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        exposure: f32,
        sink: &(dyn Fn(TileSrgb8) + Sync),
    ) -> Result<TraceStats, Error> {
        in_parts(job, self.region_limits(scene, job), |first, part| {
            self.trace_region(scene, part, Some(exposure), &|chunk, dropped, film| {
                deliver(
                    chunk,
                    dropped,
                    cast_slice(film),
                    |index, shown, dropped_samples| {
                        let pixels = shown.iter().map(|&[r, g, b, _]: &[u8; 4]| [r, g, b]);
                        sink(TileSrgb8 {
                            index: first + index,
                            pixels: pixels.collect(),
                            dropped_samples,
                        });
                    },
                );
            })
        })
    }

    /// Limits of a region that is filtered at once: what a dispatch traces on a fast device.
    fn region_limits(&self, scene: &CompiledScene, job: &TraceJob<'_>) -> RegionLimits {
        let features = self.features(scene, KernelOutput::Reflected);
        let work_per_sample = schedule::work_per_sample(&job.settings, features.primitives());
        RegionLimits {
            samples: REGION_SAMPLES.max(self.pacer.samples_per_dispatch(work_per_sample)),
            // The traced pixels include the guard band, for which half of the space is reserved.
            pixels: self.filtered_pixels_max() / 2,
        }
    }

    fn filtered_pixels_max(&self) -> u64 {
        self.pixels_max * SUM_BYTES / FilterBuffers::PIXEL_BYTES_MAX
    }

    fn trace_region(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        exposure: Option<f32>,
        sink: &ChunkSink<'_>,
    ) -> Result<TraceStats, Error> {
        let region = GuardedRegion::around(job.tiles, job.size);
        let (traced, wanted) = (Chunk::new(&region.tiles), Chunk::new(job.tiles));
        if traced.pixels.max(region.bounds.pixels() as u64) > self.filtered_pixels_max() {
            return Err(self.device.error(format!(
                "a tile of {}x{} pixels is to be denoised: at most {} pixels fit",
                region.bounds.width,
                region.bounds.height,
                self.filtered_pixels_max()
            )));
        }
        let filter_job = FilterJob {
            bounds: region.bounds,
            samples: job.settings.samples,
            exposure,
            traced: &traced,
            wanted: &wanted,
        };
        let film = match exposure {
            None => KernelOutput::Radiance.pixel_bytes(),
            Some(_) => SRGB8_BYTES,
        };
        let layout = ReadbackLayout {
            tiles: traced.entries.len() as u64,
            film_bytes: film * wanted.pixels,
        };
        let mut buffers = self.pool.take(&self.device)?;
        let upload = self.meshes.upload(&self.device, scene, job.size)?;
        buffers.prepare(&self.device, &upload, &traced, &layout)?;
        let mut filter = match buffers.filter.take() {
            Some(filter) => filter,
            None => self.device.guarded(FilterBuffers::new)?,
        };
        self.device
            .guarded(|wgpu| filter.reserve(wgpu, filter_job))?;
        let features = self.features(scene, KernelOutput::Reflected);
        let work_per_sample = schedule::work_per_sample(&job.settings, features.primitives());
        let mut shot = RegionFrame {
            tracer: self,
            job,
            buffers: &buffers,
            filter: &filter,
            filter_job,
            layout,
            limits: ChunkLimits {
                pixels: u64::MAX,
                samples: self.pacer.samples_per_dispatch(work_per_sample),
                pixel_samples: self.pixel_samples(job, &features)?,
            },
            work_per_sample,
            stats: TraceStats::default(),
            is_begun: false,
        };
        let is_done = shot.trace(&self.parts(scene, job)?, self.filter_kernels()?)?;
        let RegionFrame {
            mut stats, layout, ..
        } = shot;
        if is_done {
            stats.rays = buffers.results(&self.device, &layout, |rays, dropped, film| {
                sink(&wanted, dropped, film);
                rays
            })?;
        }
        buffers.filter = Some(filter);
        self.pool.put(buffers);
        Ok(stats)
    }

    /// The parts that are traced as the filter's input.
    fn parts(&self, scene: &CompiledScene, job: &TraceJob<'_>) -> Result<TracedParts, Error> {
        let settings = job.settings;
        let kernel = |output: KernelOutput| {
            let features = self.features(scene, output);
            self.kernels.kernel(&self.device, features)
        };
        let (paths, aovs) = (
            kernel(KernelOutput::Reflected)?,
            kernel(KernelOutput::Aovs)?,
        );
        let part = |kernel: &Arc<Kernel>, settings, target| TracedPart {
            kernel: Arc::clone(kernel),
            settings,
            target,
        };
        let further = further_rays(settings);
        Ok(TracedParts {
            samples: [
                part(&paths, settings, PartTarget::Halves),
                part(&aovs, settings, PartTarget::Hits),
            ],
            edges: further.map(|settings| part(&aovs, settings, PartTarget::EdgeHits)),
        })
    }

    pub(in crate::gpu) fn filter_kernels(&self) -> Result<&FilterKernels, Error> {
        if let Some(kernels) = self.filter.get() {
            return Ok(kernels);
        }
        let kernels = FilterKernels::new(&self.device)?;
        Ok(self.filter.get_or_init(|| kernels))
    }
}

impl RegionFrame<'_> {
    /// Traces all parts and filters them; returns false if cancelled.
    fn trace(&mut self, parts: &TracedParts, kernels: &FilterKernels) -> Result<bool, Error> {
        let mut submission = Submission::default();
        let [paths, hits] = &parts.samples;
        let filter_job = self.filter_job;
        let is_done = self.push_part(&mut submission, paths)?
            && self.push_part(&mut submission, hits)?
            && self.push_steps(&mut submission, kernels, filter_job.input_steps(kernels))?
            && match &parts.edges {
                Some(edges) => self.push_part(&mut submission, edges)?,
                None => true,
            }
            && self.push_steps(&mut submission, kernels, filter_job.filter_steps(kernels))?
            && !self.job.cancelled.load(Ordering::Relaxed);
        if is_done {
            self.submit(&mut submission, true)?;
        }
        Ok(is_done)
    }

    /// Adds the passes of a part; returns false if cancelled.
    fn push_part<'k>(
        &mut self,
        submission: &mut Submission<'k>,
        part: &'k TracedPart,
    ) -> Result<bool, Error> {
        let traced = self.filter_job.traced;
        let mut begin = 0;
        while begin < part.settings.samples {
            let left = part.settings.samples - begin;
            let end = begin + traced.samples_per_dispatch(left, self.limits);
            let samples = u64::from(end - begin) * traced.pixels;
            if !self.make_room(submission, samples)? {
                return Ok(false);
            }
            let (pass, kind) = self.part_pass(part, begin..end, submission.passes.len())?;
            submission.passes.push(pass);
            submission.kinds.push(kind);
            submission.samples += samples;
            begin = end;
        }
        Ok(true)
    }

    /// Adds steps of the filter; returns false if cancelled.
    fn push_steps<'k>(
        &mut self,
        submission: &mut Submission<'k>,
        kernels: &FilterKernels,
        steps: Vec<Step<'k>>,
    ) -> Result<bool, Error> {
        for step in steps {
            if !self.make_room(submission, 0)? {
                return Ok(false);
            }
            let slot = submission.passes.len();
            let device = &self.tracer.device;
            let pass = device
                .guarded(|wgpu| kernels.pass(wgpu, self.buffers, self.filter, &step, slot))?;
            submission.passes.push(pass);
            submission.kinds.push(PassKind::Filter);
        }
        Ok(true)
    }

    /// Submits the recorded passes if another pass of `samples` samples would be too much for one
    /// submission; returns false if cancelled.
    fn make_room(&mut self, submission: &mut Submission<'_>, samples: u64) -> Result<bool, Error> {
        let is_full = submission.passes.len() == PASSES_MAX
            || submission.samples + samples > self.limits.samples;
        if is_full && !submission.passes.is_empty() {
            if self.job.cancelled.load(Ordering::Relaxed) {
                return Ok(false);
            }
            self.submit(submission, false)?;
        }
        Ok(true)
    }

    fn part_pass<'k>(
        &self,
        part: &'k TracedPart,
        samples: Range<u32>,
        slot: usize,
    ) -> Result<(Pass<'k>, PassKind), Error> {
        let FilterJob { traced, wanted, .. } = self.filter_job;
        let filter = self.filter;
        let tiles = &self.buffers.tiles;
        let (tiles, film, is_list) = match part.target {
            PartTarget::Halves => (tiles, &filter.halves, false),
            PartTarget::Hits => (tiles, &filter.hits[0], false),
            PartTarget::EdgeHits => (&filter.edges, &filter.hits[1], true),
        };
        let (tile_count, block_count) = match is_list {
            // The list's length is known only on the device, so the dispatch is as large as the
            // list can be.
            true => (1, wanted.pixels.div_ceil(BLOCK_PIXELS) as u32),
            false => (traced.entries.len() as u32, traced.blocks),
        };
        let (kind, first_half) = match part.target {
            PartTarget::Halves => {
                let paths = u64::from(samples.end - samples.start) * traced.pixels;
                (PassKind::Paths(paths), part.settings.samples / 2)
            }
            PartTarget::Hits | PartTarget::EdgeHits => (PassKind::FirstHits, 0),
        };
        let data = DispatchData {
            tile_count,
            block_count,
            first_half,
            is_list: u32::from(is_list),
            ..traced.dispatch(&part.settings, samples)
        };
        let bindings = (self.tracer.device)
            .guarded(|wgpu| self.buffers.bind(wgpu, &part.kernel, slot, tiles, film))?;
        let pass = Pass {
            pipeline: &part.kernel.pipeline,
            bindings,
            groups: groups(block_count, part.kernel.workgroup_blocks),
            uniforms: bytes_of(&data).to_vec(),
        };
        Ok((pass, kind))
    }

    fn submit(&mut self, submission: &mut Submission<'_>, is_last: bool) -> Result<(), Error> {
        let submission = std::mem::take(submission);
        let cleared = [&self.buffers.counters, &self.filter.guides];
        // The guides cover the whole bounds, of which the tiles may be only a part: 0 marks pixels
        // that are not traced. Later submissions continue with what the first one wrote, so only
        // that one clears.
        let cleared = if self.is_begun { &[] } else { &cleared[..] };
        self.is_begun = true;
        let tracer = self.tracer;
        let passes = &submission.passes;
        let nanos = (self.buffers).run(&tracer.device, passes, &self.layout, cleared, is_last)?;
        for (kind, nanos) in submission.kinds.into_iter().zip(nanos) {
            let stats = &mut self.stats;
            stats.device_nanos += nanos as u64;
            match kind {
                PassKind::Paths(samples) => {
                    stats.samples += samples;
                    tracer.pacer.learn(samples, self.work_per_sample, nanos);
                }
                PassKind::FirstHits => stats.first_hits_nanos += nanos as u64,
                PassKind::Filter => stats.filter_nanos += nanos as u64,
            }
        }
        self.limits.samples = (tracer.pacer).samples_per_dispatch(self.work_per_sample);
        Ok(())
    }
}

/// Bytes of a tone-mapped pixel.
const SRGB8_BYTES: u64 = 4;
