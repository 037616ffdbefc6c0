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

use bytemuck::{bytes_of, cast_slice};

use super::kernels::{FilterBuffers, FilterJob, FilterKernels};
use crate::aov::smooth;
use crate::denoise::weights::PASSES;
use crate::denoise::{GuardedRegion, REGION_SAMPLES, RegionLimits, in_parts};
use crate::gpu::features::KernelOutput;
use crate::gpu::frame::{FrameBuffers, PASSES_MAX, Pass, ReadbackLayout, SUM_BYTES, groups};
use crate::gpu::layout::DispatchData;
use crate::gpu::pipeline::Kernel;
use crate::gpu::schedule::{self, Chunk, ChunkLimits};
use crate::gpu::{ChunkSink, GpuTracer, deliver};
use crate::{CompiledScene, Error, RenderSettings, TileRadiance, TileSrgb8, TraceJob, TraceStats};

/// Samples of every pixel that are traced into a buffer of their own.
struct TracedPart {
    kernel: Arc<Kernel>,
    settings: RenderSettings,
    target: PartTarget,
}

/// Of [`FilterBuffers`].
#[derive(Clone, Copy)]
enum PartTarget {
    Halves,
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
        in_parts(job, self.region_limits(scene, job), |first, part| {
            self.trace_region(scene, part, None, &|chunk, dropped, film| {
                deliver(
                    chunk,
                    dropped,
                    cast_slice(film),
                    |index, radiance, dropped_samples| {
                        sink(TileRadiance {
                            index: first + index,
                            radiance: radiance.to_vec(),
                            dropped_samples,
                        });
                    },
                );
            })
        })
    }

    /// The same, handing tiles over as they are shown.
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

    /// What is filtered together: as much as a dispatch traces of a device that is quick.
    fn region_limits(&self, scene: &CompiledScene, job: &TraceJob<'_>) -> RegionLimits {
        let features = self.features(scene, KernelOutput::Reflected);
        let work_per_sample = schedule::work_per_sample(&job.settings, features.primitives());
        RegionLimits {
            samples: REGION_SAMPLES.max(self.pacer.samples_per_dispatch(work_per_sample)),
            // The guard band is a part of what is traced: half of the room is for it.
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

    /// What the filter needs of each pixel.
    fn parts(&self, scene: &CompiledScene, job: &TraceJob<'_>) -> Result<Vec<TracedPart>, Error> {
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
        let mut parts = vec![
            part(&paths, settings, PartTarget::Halves),
            part(&aovs, settings, PartTarget::Hits(0)),
        ];
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
        let (film, kind, first_half) = match part.target {
            PartTarget::Halves => {
                let first_half = part.settings.samples / 2;
                (&self.filter.halves, PassKind::Paths(samples), first_half)
            }
            PartTarget::Hits(hits) => (&self.filter.hits[hits], PassKind::FirstHits, 0),
        };
        let data = DispatchData {
            tile_count: traced.entries.len() as u32,
            block_count: traced.blocks,
            sample_begin,
            sample_end,
            samples: part.settings.samples,
            first_half,
            pixels: traced.pixels as u32,
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

/// Of a pixel as it is shown.
const SRGB8_BYTES: u64 = 4;
/// Of a picture: taking in, the variance, the steps and the result.
const FILTER_PASSES: usize = PASSES.len() + 3;
