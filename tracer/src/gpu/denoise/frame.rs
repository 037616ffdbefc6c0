//! Denoised pictures, traced and filtered without leaving the device.
//!
//! ```text
//! tiles and guard band ─▶ halves of the samples ─▶ first hits ─▶ filter ─▶ film ─▶ tiles
//! ```
//!
//! All of it is one submission where the device is fast enough; else the samples are cut as those of
//! other pictures are.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use bytemuck::bytes_of;

use super::kernels::{FilterBuffers, FilterJob, FilterKernels};
use crate::aov::smooth;
use crate::denoise::weights::STEPS;
use crate::denoise::{GuardedRegion, in_parts};
use crate::gpu::features::KernelOutput;
use crate::gpu::frame::{FrameBuffers, PASSES_MAX, Pass, ReadbackLayout, SUM_BYTES, groups};
use crate::gpu::layout::DispatchData;
use crate::gpu::pipeline::Kernel;
use crate::gpu::schedule::{self, Chunk, ChunkLimits};
use crate::gpu::{GpuTracer, deliver};
use crate::{CompiledScene, Error, RenderSettings, TileRadiance, TraceJob, TraceStats};

/// Samples of every pixel that are traced into a buffer of their own.
struct TracedPart {
    kernel: Arc<Kernel>,
    settings: RenderSettings,
    target: PartTarget,
}

/// Of [`FilterBuffers`].
#[derive(Clone, Copy)]
enum PartTarget {
    Half(usize),
    Hits(usize),
}

/// Passes that are not submitted yet.
#[derive(Default)]
struct Submission<'a> {
    passes: Vec<Pass<'a>>,
    kinds: Vec<PassKind>,
    samples: u64,
}

/// Whose time a pass's is.
#[derive(Clone, Copy)]
enum PassKind {
    /// Of so many paths.
    Paths(u64),
    FirstHits,
    Filter,
}

/// A region on its way.
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
        // The guard band is a part of what is traced: half of the room is for it.
        let pixels_max = self.filtered_pixels_max() / 2;
        in_parts(job, pixels_max, sink, |part, sink| {
            self.trace_region(scene, part, sink)
        })
    }

    fn filtered_pixels_max(&self) -> u64 {
        self.pixels_max * SUM_BYTES / FilterBuffers::PIXEL_BYTES_MAX
    }

    fn trace_region(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
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
            traced: &traced,
            wanted: &wanted,
        };
        let layout = ReadbackLayout {
            tiles: traced.entries.len() as u64,
            ..ReadbackLayout::new(&wanted, KernelOutput::Radiance)
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
                deliver(&wanted, dropped, film, sink);
                rays
            })?;
        }
        buffers.filter = Some(filter);
        self.pool.put(buffers);
        Ok(stats)
    }

    /// What the filter needs of each pixel.
    fn parts(&self, scene: &CompiledScene, job: &TraceJob<'_>) -> Result<Vec<TracedPart>, Error> {
        let settings = job.settings;
        let half = settings.samples / 2;
        let range = |begin: u32, end: u32| RenderSettings {
            first_sample: settings.first_sample.wrapping_add(begin),
            samples: end - begin,
            ..settings
        };
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
        let mut parts = vec![part(
            &paths,
            range(half, settings.samples),
            PartTarget::Half(0),
        )];
        if half > 0 {
            parts.push(part(&paths, range(0, half), PartTarget::Half(1)));
        }
        parts.push(part(&aovs, settings, PartTarget::Hits(0)));
        if let Some(smoother) = smooth(settings) {
            parts.push(part(&aovs, smoother, PartTarget::Hits(1)));
        }
        Ok(parts)
    }

    fn filter_kernels(&self) -> Result<&FilterKernels, Error> {
        if let Some(kernels) = self.filter.get() {
            return Ok(kernels);
        }
        let kernels = FilterKernels::new(&self.device)?;
        Ok(self.filter.get_or_init(|| kernels))
    }
}

impl RegionFrame<'_> {
    /// Traces all parts and filters them, unless cancelled: then it returns false.
    fn trace<'k>(
        &mut self,
        parts: &'k [TracedPart],
        kernels: &'k FilterKernels,
    ) -> Result<bool, Error> {
        let mut submission = Submission::default();
        for part in parts {
            let step = self.filter_job.traced.samples_per_dispatch(self.limits);
            for begin in (0..part.settings.samples).step_by(step as usize) {
                let end = begin.saturating_add(step).min(part.settings.samples);
                let samples = u64::from(end - begin) * self.filter_job.traced.pixels;
                let is_full = submission.passes.len() + FILTER_PASSES == PASSES_MAX
                    || submission.samples + samples > self.limits.samples;
                if is_full && !submission.passes.is_empty() {
                    if self.job.cancelled.load(Ordering::Relaxed) {
                        return Ok(false);
                    }
                    self.submit(std::mem::take(&mut submission), false)?;
                }
                self.push(&mut submission, part, begin, end)?;
            }
        }
        if self.job.cancelled.load(Ordering::Relaxed) {
            return Ok(false);
        }
        let slot = submission.passes.len();
        let device = &self.tracer.device;
        let passes = device.guarded(|wgpu| {
            kernels.passes(wgpu, self.buffers, self.filter, self.filter_job, slot)
        })?;
        submission
            .kinds
            .extend(passes.iter().map(|_| PassKind::Filter));
        submission.passes.extend(passes);
        self.submit(submission, true)?;
        Ok(true)
    }

    fn push<'k>(
        &self,
        submission: &mut Submission<'k>,
        part: &'k TracedPart,
        sample_begin: u32,
        sample_end: u32,
    ) -> Result<(), Error> {
        let traced = self.filter_job.traced;
        let samples = u64::from(sample_end - sample_begin) * traced.pixels;
        let (film, kind) = match part.target {
            PartTarget::Half(half) => (&self.filter.halves[half], PassKind::Paths(samples)),
            PartTarget::Hits(hits) => (&self.filter.hits[hits], PassKind::FirstHits),
        };
        let data = DispatchData {
            tile_count: traced.entries.len() as u32,
            block_count: traced.blocks,
            sample_begin,
            sample_end,
            samples: part.settings.samples,
            first_sample: part.settings.first_sample,
            seed: part.settings.seed,
            max_depth: part.settings.max_depth,
        };
        let slot = submission.passes.len();
        let bindings = (self.tracer.device)
            .guarded(|wgpu| self.buffers.bind(wgpu, &part.kernel, slot, film))?;
        submission.passes.push(Pass {
            pipeline: &part.kernel.pipeline,
            bindings,
            groups: groups(traced.blocks, part.kernel.workgroup_blocks),
            uniforms: bytes_of(&data).to_vec(),
        });
        submission.kinds.push(kind);
        submission.samples += samples;
        Ok(())
    }

    fn submit(&mut self, submission: Submission<'_>, is_last: bool) -> Result<(), Error> {
        let cleared = [&self.buffers.counters, &self.filter.guides];
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
        Ok(())
    }
}

/// Of a picture: taking in, the variance, the steps and the result.
const FILTER_PASSES: usize = STEPS.len() + 3;
