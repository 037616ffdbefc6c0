//! Path tracing in compute shaders, through wgpu on Vulkan.
//!
//! ```text
//! CompiledScene ──Features──▶ shader::source ──▶ Kernel (cached)
//!       │                                           │
//!       └──scene_bytes──▶ FrameBuffers ──dispatch───┴──▶ film ──read back──▶ tiles to the sink
//! TraceJob ──Chunk::next────────┘
//! ```
//!
//! Denoised frames are filtered on the device too (`denoise`).
//!
//! A job is a single dispatch if it is short enough (`schedule`). Each frame in flight has its own
//! buffers, so that the device traces one while another is read back. The estimator is that of
//! [`crate::scalar`], with the same random numbers: the images differ from it by rounding only (and
//! by more where rounding changes a path), and not at all between partitions into tiles or
//! dispatches.

mod adapter;
mod aov;
mod buffer_cache;
mod coplanar;
mod denoise;
mod device;
mod features;
mod frame;
mod image_buffers;
mod layout;
mod mesh_buffer;
mod pipeline;
mod probe;
mod schedule;
mod shader;

#[cfg(test)]
mod leaf_tests;
#[cfg(test)]
mod tests;

use std::panic::resume_unwind;
use std::sync::OnceLock;
use std::sync::atomic::Ordering;
use std::thread;

use bytemuck::{bytes_of, cast_slice};
use rayon::prelude::*;

pub use adapter::{AdapterChoice, AdapterDescription, adapters};

use crate::{
    CompiledScene, DeviceInfo, DeviceKind, Error, RenderSettings, Tile, TileAovs, TileRadiance,
    TileSrgb8, TraceJob, TraceStats, Tracer,
};
use denoise::FilterKernels;
use device::Device;
use features::{Features, KernelOutput};
use frame::{BufferPool, FrameBuffers, Pass, ReadbackLayout, SUM_BYTES, groups};
use layout::TileEntry;
use mesh_buffer::{MeshBuffers, SceneUpload};
use pipeline::{Kernel, KernelCache};
use schedule::{Chunk, ChunkLimits, Pacer};

/// A tracer that runs on a GPU.
pub struct GpuTracer {
    device: Device,
    /// Result of the start-up probe, once it has been traced.
    proof: OnceLock<Result<(), String>>,
    kernels: KernelCache,
    /// Filter kernels, compiled for the first denoised frame.
    filter: OnceLock<FilterKernels>,
    pool: BufferPool,
    meshes: MeshBuffers,
    pacer: Pacer,
    pixels_max: u64,
}

/// Receives a chunk with the numbers of dropped samples by tile and the film by pixel.
type ChunkSink<'a> = dyn Fn(&Chunk, &[u32], &[f32]) + 'a;

/// What all dispatches of a job have in common.
struct Work<'a> {
    job: &'a TraceJob<'a>,
    output: KernelOutput,
    kernel: &'a Kernel,
    scene: &'a SceneUpload,
    /// See [`schedule::work_per_sample`].
    work_per_sample: f64,
    /// See [`ChunkLimits`].
    pixel_samples: u32,
}

impl GpuTracer {
    /// Maximum number of pixels of a chunk, if the device allows it: enough for a 4K frame.
    const CHUNK_PIXELS_MAX: u64 = 1 << 23;

    /// Opens a GPU and verifies it with the start-up probe.
    ///
    /// # Errors
    /// [`Error::Device`] if there is no such GPU, the driver refuses it, or it traces the probe
    /// wrongly.
    pub fn new(choice: &AdapterChoice) -> Result<Self, Error> {
        let tracer = Self::open(&adapter::find(choice)?)?;
        tracer.prove()?;
        Ok(tracer)
    }

    /// All real GPUs of this machine, the most capable first, or the reason why one cannot be used.
    /// Each is verified by the start-up probe before its first job, which fails if the probe does;
    /// this takes seconds if the driver has not compiled the kernels before.
    pub fn all() -> Vec<Result<Self, Error>> {
        adapter::real().iter().map(Self::open).collect()
    }

    fn open(adapter: &wgpu::Adapter) -> Result<Self, Error> {
        let device = Device::open(adapter)?;
        let limits = device.device.limits();
        let film_bytes_max = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size / 2);
        Ok(Self {
            device,
            proof: OnceLock::new(),
            kernels: KernelCache::default(),
            filter: OnceLock::new(),
            pool: BufferPool::default(),
            meshes: MeshBuffers::default(),
            pacer: Pacer::new(),
            pixels_max: film_bytes_max / SUM_BYTES,
        })
    }

    /// Traces the start-up probe, unless that has been done.
    ///
    /// # Errors
    /// [`Error::Device`] if the device refuses or traces it wrongly.
    fn prove(&self) -> Result<(), Error> {
        let message = |error| match error {
            Error::Device { message, .. } => message,
            other => other.to_string(),
        };
        let proof =
            (self.proof).get_or_init(|| probe::prove(&UnprovenTracer(self)).map_err(message));
        proof.clone().map_err(|message| self.device.error(message))
    }

    /// Destroys the device, so that all further work fails as after a device loss. For tests.
    pub fn destroy(&self) {
        self.device.device.destroy();
    }

    /// Compiles the kernels that a frame needs, concurrently with the start-up probe: each takes a
    /// second or more if the driver has not compiled it before.
    ///
    /// # Errors
    /// [`Error::Device`] if the device refuses or traces the probe wrongly.
    fn prepare(&self, scene: &CompiledScene, settings: &RenderSettings) -> Result<(), Error> {
        if self.is_ready(scene, settings) {
            return self.prove();
        }
        let kernel = |output| {
            let features = self.features(scene, output);
            self.kernels.kernel(&self.device, features).map(drop)
        };
        let compile = |output: Option<KernelOutput>| match output {
            Some(output) => kernel(output),
            None => self.filter_kernels().map(drop),
        };
        let filter = settings.denoise.then_some(None);
        let parts = outputs(settings).iter().copied().map(Some).chain(filter);
        // On dedicated threads: a rayon thread that waits may start another job, which would wait
        // for the probe that this very thread is tracing. Kernels for which no thread can be
        // spawned are compiled when needed.
        thread::scope(|scope| {
            let spawn = |part| thread::Builder::new().spawn_scoped(scope, move || compile(part));
            let threads: Vec<_> = parts.filter_map(|part| spawn(part).ok()).collect();
            let proof = self.prove();
            let compiled = threads
                .into_iter()
                .map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)));
            proof.and(compiled.collect())
        })
    }

    fn check(&self, job: &TraceJob<'_>) -> Result<(), Error> {
        job.validate()?;
        let is_too_large = |tile: &&Tile| tile.pixels() as u64 > self.pixels_max;
        job.tiles.iter().find(is_too_large).map_or(Ok(()), |tile| {
            Err(self.device.error(format!(
                "a tile of {}x{} pixels is asked for: at most {} pixels fit",
                tile.width, tile.height, self.pixels_max
            )))
        })
    }

    fn trace_chunks(
        &self,
        work: &Work<'_>,
        buffers: &mut FrameBuffers,
        sink: &ChunkSink<'_>,
    ) -> Result<TraceStats, Error> {
        // `self.pixels_max` is for the buffer of sums, which is the largest unless the output has
        // more bytes per pixel.
        let pixels_max = self.pixels_max * SUM_BYTES / work.output.pixel_bytes().max(SUM_BYTES);
        let mut stats = TraceStats::default();
        let mut next = 0;
        while next < work.job.tiles.len() {
            let limits = ChunkLimits {
                pixels: pixels_max.min(Self::CHUNK_PIXELS_MAX),
                ..self.limits(work)
            };
            let chunk = Chunk::next(work.job.tiles, next, work.job.settings.samples, limits);
            next = chunk.tiles.end;
            let is_done = self.trace_chunk(work, buffers, &chunk, &mut stats)?;
            if !is_done {
                break;
            }
            let layout = ReadbackLayout::new(&chunk, work.output);
            stats.rays += buffers.results(&self.device, &layout, |rays, dropped, film| {
                sink(&chunk, dropped, film);
                rays
            })?;
        }
        Ok(stats)
    }

    /// Limits of a dispatch of any number of pixels at the speed known so far.
    fn limits(&self, work: &Work<'_>) -> ChunkLimits {
        ChunkLimits {
            pixels: u64::MAX,
            samples: self.pacer.samples_per_dispatch(work.work_per_sample),
            pixel_samples: work.pixel_samples,
        }
    }

    /// Traces all samples of a chunk; returns false if cancelled.
    fn trace_chunk(
        &self,
        work: &Work<'_>,
        buffers: &mut FrameBuffers,
        chunk: &Chunk,
        stats: &mut TraceStats,
    ) -> Result<bool, Error> {
        let layout = ReadbackLayout::new(chunk, work.output);
        buffers.prepare(&self.device, work.scene, chunk, &layout)?;
        let mut pass = Pass {
            pipeline: &work.kernel.pipeline,
            bindings: (self.device).guarded(|wgpu| {
                buffers.bind(wgpu, work.kernel, 0, &buffers.tiles, &buffers.film)
            })?,
            groups: groups(chunk.blocks, work.kernel.workgroup_blocks),
            uniforms: Vec::new(),
        };
        let settings = &work.job.settings;
        let mut begin = 0;
        while begin < settings.samples {
            if work.job.cancelled.load(Ordering::Relaxed) {
                return Ok(false);
            }
            // By the speed of the dispatch before: the first one of a kernel may include its translation.
            let left = settings.samples - begin;
            let end = begin + chunk.samples_per_dispatch(left, self.limits(work));
            let data = chunk.dispatch(settings, begin..end);
            let samples = u64::from(end - begin) * chunk.pixels;
            pass.uniforms = bytes_of(&data).to_vec();
            let passes = std::slice::from_ref(&pass);
            let cleared = [&buffers.counters];
            // Counters accumulate over all dispatches of a chunk, as they are read once after the
            // last.
            let cleared = if begin == 0 { &cleared[..] } else { &[] };
            let is_last = end == settings.samples;
            let nanos = buffers.run(&self.device, passes, &layout, cleared, is_last)?;
            let nanos: f64 = nanos.iter().sum();
            self.pacer.learn(samples, work.work_per_sample, nanos);
            stats.samples += samples;
            stats.device_nanos += nanos as u64;
            begin = end;
        }
        Ok(true)
    }
}

impl Tracer for GpuTracer {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            kind: DeviceKind::Gpu,
            name: self.device.name.clone(),
            width: 1,
            threads: 1,
        }
    }

    fn is_ready(&self, scene: &CompiledScene, settings: &RenderSettings) -> bool {
        match self.proof.get() {
            None => return false,
            Some(Err(_)) => return true, // to say why it fails
            Some(Ok(())) => {}
        }
        let is_compiled = |output| self.kernels.has(&self.features(scene, output));
        let has_filter = !settings.denoise || self.filter.get().is_some();
        has_filter && outputs(settings).iter().all(|&output| is_compiled(output))
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        self.check(job)?;
        self.prepare(scene, &job.settings)?;
        if job.settings.denoise {
            return self.trace_denoised(scene, job, sink);
        }
        self.trace_radiance(scene, job, sink)
    }

    fn trace_srgb8(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        exposure: f32,
        sink: &(dyn Fn(TileSrgb8) + Sync),
    ) -> Result<TraceStats, Error> {
        if !job.settings.denoise {
            return self.trace(scene, job, &|tile| sink(tile.srgb8(exposure)));
        }
        self.check(job)?;
        self.prepare(scene, &job.settings)?;
        self.trace_denoised_srgb8(scene, job, exposure, sink)
    }

    fn aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        self.check(job)?;
        self.prove()?;
        self.trace_aovs(scene, job, sink)
    }
}

/// A GPU during its start-up probe: traces without waiting for the probe's result.
struct UnprovenTracer<'a>(&'a GpuTracer);

impl Tracer for UnprovenTracer<'_> {
    fn info(&self) -> DeviceInfo {
        self.0.info()
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        self.0.trace_radiance(scene, job, sink)
    }
}

impl GpuTracer {
    /// Traces radiance without denoising.
    fn trace_radiance(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        let sink = radiance_sink(0, sink);
        self.trace_output(scene, job, KernelOutput::Radiance, &sink)
    }

    /// Traces `output` chunk by chunk.
    fn trace_output(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        output: KernelOutput,
        sink: &ChunkSink<'_>,
    ) -> Result<TraceStats, Error> {
        if job.tiles.is_empty() {
            return Ok(TraceStats::default());
        }
        let features = self.features(scene, output);
        let work = Work {
            job,
            output,
            kernel: &*self.kernels.kernel(&self.device, features)?,
            scene: &self.meshes.upload(&self.device, scene, job.size)?,
            work_per_sample: schedule::work_per_sample(&job.settings, features.primitives()),
            pixel_samples: self.pixel_samples(job, &features)?,
        };
        let mut buffers = self.pool.take(&self.device)?;
        let stats = self.trace_chunks(&work, &mut buffers, sink)?;
        self.pool.put(buffers);
        Ok(stats)
    }

    /// Maximum number of samples per pixel in a dispatch.
    ///
    /// # Errors
    /// [`Error::Device`] if not even one sample can be traced.
    fn pixel_samples(&self, job: &TraceJob<'_>, features: &Features) -> Result<u32, Error> {
        if !self.device.is_software {
            return Ok(u32::MAX);
        }
        match schedule::software_samples(&job.settings, features.turns_per_ray()) {
            0 => Err(self.device.error(format!(
                "a scene of {} surfaces that each ray is tested against is too large at a maximum depth of {} for this \
                 driver, which ends long loops early; trace it on the CPU",
                features.primitives(),
                job.settings.max_depth
            ))),
            samples => Ok(samples),
        }
    }

    fn features(&self, scene: &CompiledScene, output: KernelOutput) -> Features {
        let uniform_bytes_max = self.device.device.limits().max_uniform_buffer_binding_size;
        let features = layout::features(scene, uniform_bytes_max);
        Features {
            output,
            workgroup_blocks: features.workgroup_blocks(self.device.workgroup_blocks),
            ..features
        }
    }
}

/// The outputs of the kernels that a frame needs.
const fn outputs(settings: &RenderSettings) -> &'static [KernelOutput] {
    match settings.denoise {
        true => &[KernelOutput::Reflected, KernelOutput::Aovs],
        false => &[KernelOutput::Radiance],
    }
}

/// A sink for chunks that passes their tiles on as radiance, with indices from `first` on.
fn radiance_sink(
    first: usize,
    sink: &(dyn Fn(TileRadiance) + Sync),
) -> impl Fn(&Chunk, &[u32], &[f32]) {
    move |chunk, dropped, film| {
        let film = cast_slice(film);
        deliver(chunk, dropped, film, |index, radiance, dropped_samples| {
            sink(TileRadiance {
                index: first + index,
                radiance: radiance.to_vec(),
                dropped_samples,
            });
        });
    }
}

/// Calls `sink` with each of a chunk's tiles, its pixels and its number of dropped samples, on all
/// rayon threads: a single thread copies 3–5 GB/s, which is slower than a large GPU traces.
fn deliver<P: Sync>(
    chunk: &Chunk,
    dropped: &[u32],
    film: &[P],
    sink: impl Fn(usize, &[P], u32) + Sync,
) {
    let deliver = |(place, entry): (usize, &TileEntry)| {
        let begin = entry.first_pixel as usize;
        let pixels = entry.width as usize * entry.height as usize;
        let pixels = &film[begin..begin + pixels];
        sink(chunk.tiles.start + place, pixels, dropped[place]);
    };
    let entries = chunk.entries.par_iter().with_min_len(DELIVERED_TOGETHER);
    entries.enumerate().for_each(deliver);
}

/// Minimum number of tiles per rayon task: 0.1 MB for tiles of 32 × 32 pixels.
const DELIVERED_TOGETHER: usize = 8;
