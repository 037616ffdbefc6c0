//! CPU path tracer: wavefront streams of rays, 16 SIMD lanes wide, over a thread pool.
//!
//! ```text
//! tile → strips → batches of paths:  generate → (extend → shade → connect)* → accumulate
//!                                                  │        │        └ shadow rays to the lights
//!                                                  │        └ BSDF, next direction
//!                                                  └ nearest hit; terminated paths leave the stream
//! ```
//!
//! One generic source is compiled to SSE2, AVX2, AVX-512 or NEON code, chosen at run time. The random
//! numbers of a sample are a function of its pixel and index, and each pixel sums its samples in order,
//! so that an image is bit-identical for any tiling and number of threads. Instruction sets differ in
//! rounding: those with fused multiply-add round once where others round twice.
//!
//! SIMD code stays in functions marked `#[inline(always)]`, never in closures: the compiler may
//! leave closures out of line, compiled for the baseline instruction set, at a third of the speed.
//! Throughput of the pool scene, max depth 5: 10 Msample and 29 Mray per core-second with AVX2 on a
//! 2.4 GHz EPYC of 2021 (`examples/trace_speed.rs`); three quarters of it is intersection.

mod aov;
mod area_light;
mod batch;
mod beam;
mod bsdf;
mod bvh16;
mod csg;
mod emissive_surface;
mod environment;
mod extend;
mod first_hit;
mod fresnel;
mod geometry;
mod image_texture;
mod integrator;
mod lanes;
mod light_sampling;
mod math;
mod medium;
mod metallic_roughness;
mod microfacet;
mod motion_vectors;
mod prepared;
mod punctual_light;
mod rays;
mod refracted_nee;
mod regularisation;
mod rows;
mod sampling;
mod shade;
mod shapes;
mod shared_edges;
mod sheen;
mod stream;
mod surface;
mod texture;
mod triangle;
mod triangle_surface;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::ThreadPool;
use rayon::prelude::*;

pub use first_hit::FirstHits;
pub(crate) use motion_vectors::{Footprint, Motion, MotionVectors};

use crate::denoise::{DenoiseInputTile, DenoiseSource, FilterMemory, trace_denoised};
use crate::simd::{Level, dispatch};
use crate::{
    Aovs, CompiledScene, DeviceInfo, DeviceKind, Error, ImageSize, RenderSettings, Tile, TileAovs,
    TileRadiance, TraceJob, TraceStats, Tracer,
};
use batch::{Scratch, Traced};
use prepared::Prepared;

/// Path tracer on the CPU, with its own thread pool and instruction set.
pub struct CpuTracer {
    level: Level,
    pool: ThreadPool,
    processor: String,
    /// Buffers that no thread is using at present.
    scratch: Mutex<Vec<Scratch>>,
    filter_memory: FilterMemory,
}

impl CpuTracer {
    /// A tracer with one thread per core and the best instruction set available.
    ///
    /// # Errors
    /// [`Error::Device`] if the system refuses threads.
    pub fn new() -> Result<Self, Error> {
        Self::with_threads(0)
    }

    /// A tracer with `threads` threads; 0 means one per core.
    ///
    /// # Errors
    /// [`Error::Device`] if the system refuses threads.
    pub fn with_threads(threads: usize) -> Result<Self, Error> {
        Self::with_level(threads, Level::new())
    }

    /// A tracer with `threads` threads and the instruction set `level`, one of
    /// [`CpuTracer::levels_available`].
    ///
    /// # Errors
    /// [`Error::Device`] if the system refuses threads.
    pub fn with_level(threads: usize, level: Level) -> Result<Self, Error> {
        let processor = processor_name();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|index| format!("tracer-{index}"))
            .build();
        match pool {
            Ok(pool) => Ok(Self {
                level,
                pool,
                processor,
                scratch: Mutex::default(),
                filter_memory: FilterMemory::default(),
            }),
            Err(why) => Err(Error::Device {
                device: processor,
                message: format!("{threads} threads could not be started: {why}"),
            }),
        }
    }

    /// All instruction sets for which this processor has code, the best first.
    pub fn levels_available() -> Vec<Level> {
        let best = Level::new();
        let mut levels = vec![best];
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        {
            use fearless_simd::Simd;
            let weaker = [
                best.as_avx512().map(Simd::level),
                best.as_avx2().map(Simd::level),
                best.as_sse2().map(Simd::level),
            ];
            levels.extend(weaker.into_iter().flatten());
            levels.dedup_by_key(|level| level_name(*level));
        }
        levels
    }

    /// The instruction set in use.
    pub fn level(&self) -> Level {
        self.level
    }

    fn trace_tiles(
        &self,
        scene: &Prepared,
        job: &TraceJob<'_>,
        sink: impl Fn(usize, Traced) + Sync,
    ) -> TraceStats {
        let strips = strips_per_tile(job.tiles.len(), self.pool.current_num_threads());
        let (samples, rays) = (AtomicU64::new(0), AtomicU64::new(0));
        self.pool.install(|| {
            // Without a maximum rayon would give a task a run of adjacent tiles, which would finish one
            // after another instead of in parallel.
            let tiles = job.tiles.par_iter().with_max_len(1).enumerate();
            tiles.for_each(|(index, &tile)| {
                let Some(traced) = self.trace_tile(scene, job, tile, strips) else {
                    return;
                };
                let begun = tile.pixels() as u64 * u64::from(job.settings.samples);
                samples.fetch_add(begun, Ordering::Relaxed);
                rays.fetch_add(traced.rays, Ordering::Relaxed);
                sink(index, traced);
            });
        });
        TraceStats {
            samples: samples.into_inner(),
            rays: rays.into_inner(),
            ..TraceStats::default()
        }
    }

    fn pixel_aovs(&self, scene: &Prepared, pixels: &[(u32, u32)]) -> Vec<Aovs> {
        dispatch!(self.level, simd => scene.aovs(simd, pixels))
    }

    fn trace_tile(
        &self,
        scene: &Prepared,
        job: &TraceJob<'_>,
        tile: Tile,
        strips: u32,
    ) -> Option<Traced> {
        if strips <= 1 {
            return self.trace_area(scene, job, tile);
        }
        let rows = tile.height.div_ceil(strips);
        let strips: Option<Vec<Traced>> = (0..tile.height.div_ceil(rows))
            .into_par_iter()
            .map(|strip| {
                let y = strip * rows;
                let height = rows.min(tile.height - y);
                let area = Tile {
                    y: tile.y + y,
                    height,
                    ..tile
                };
                self.trace_area(scene, job, area)
            })
            .collect();
        strips.map(Traced::joined)
    }

    fn trace_area(&self, scene: &Prepared, job: &TraceJob<'_>, area: Tile) -> Option<Traced> {
        // As many buffers exist as threads have ever traced at the same time; the lock is not held meanwhile.
        let mut scratch = self.lock_scratch().pop().unwrap_or_else(Scratch::new);
        let (settings, cancelled) = (job.settings, job.cancelled);
        let traced = dispatch!(self.level, simd => {
            scratch.trace(simd, scene, settings, area, cancelled)
        });
        self.lock_scratch().push(scratch);
        traced
    }

    fn lock_scratch(&self) -> std::sync::MutexGuard<'_, Vec<Scratch>> {
        // A panic while the lock is held cannot leave the vector inconsistent.
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Tracer for CpuTracer {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            kind: DeviceKind::Cpu,
            name: format!("{} ({})", self.processor, level_name(self.level)),
            width: lanes::LANES as u32,
            threads: self.pool.current_num_threads() as u32,
        }
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        job.validate()?;
        if job.settings.denoise {
            let level = self.level;
            let memory = &self.filter_memory;
            let traced = || trace_denoised(self, level, memory, scene, job, sink);
            return self.pool.install(traced);
        }
        let prepared = Prepared::new(scene, job.size, job.settings);
        Ok(self.trace_tiles(&prepared, job, |index, traced| {
            sink(TileRadiance {
                index,
                radiance: traced.radiance,
                dropped_samples: traced.dropped_samples,
            });
        }))
    }

    fn aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        job.validate()?;
        let prepared = Prepared::new(scene, job.size, job.settings);
        self.pool.install(|| {
            job.tiles.par_iter().enumerate().for_each(|(index, &tile)| {
                if !job.cancelled.load(Ordering::Relaxed) {
                    let rows = tile.y..tile.y + tile.height;
                    let columns = |y| (tile.x..tile.x + tile.width).map(move |x| (x, y));
                    let pixels: Vec<_> = rows.flat_map(columns).collect();
                    let pixels = self.pixel_aovs(&prepared, &pixels);
                    sink(TileAovs { index, pixels });
                }
            });
        });
        Ok(())
    }
}

impl DenoiseSource for CpuTracer {
    fn trace_denoise_input(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(DenoiseInputTile) + Sync),
    ) -> Result<TraceStats, Error> {
        let prepared = Prepared::new(scene, job.size, job.settings);
        Ok(self.trace_tiles(&prepared, job, |index, traced| {
            sink(DenoiseInputTile {
                index,
                tile: job.tiles[index],
                pixels: traced.denoise_input,
                dropped_samples: traced.dropped_samples,
            });
        }))
    }

    fn trace_hits(
        &self,
        scene: &CompiledScene,
        size: ImageSize,
        settings: RenderSettings,
        pixels: &[(u32, u32)],
    ) -> Vec<Aovs> {
        let prepared = Prepared::new(scene, size, settings);
        let parts = pixels.par_chunks(HITS_TOGETHER);
        parts
            .flat_map_iter(|pixels| self.pixel_aovs(&prepared, pixels))
            .collect()
    }
}

/// Number of pixels whose AOVs one rayon task computes: 40 kB of sums.
const HITS_TOGETHER: usize = 1024;

impl Traced {
    fn joined(parts: Vec<Self>) -> Self {
        let mut whole = Self::default();
        for mut part in parts {
            whole.radiance.append(&mut part.radiance);
            whole.denoise_input.append(part.denoise_input);
            whole.dropped_samples += part.dropped_samples;
            whole.rays += part.rays;
        }
        whole
    }
}

/// Number of strips per tile with which every thread stays busy until the end.
fn strips_per_tile(tiles: usize, threads: usize) -> u32 {
    /// Minimum pieces of work per thread: idle time at the end is about 1/PIECES of a thread's work.
    const PIECES: usize = 4;
    if threads == 1 || tiles >= threads * PIECES {
        return 1;
    }
    // Strips are runs of rows of the tile, so that results are joined by appending.
    (threads * PIECES).div_ceil(tiles.max(1)) as u32
}

fn level_name(level: Level) -> &'static str {
    match level {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx512(_) => "AVX-512",
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx2(_) => "AVX2",
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Sse4_2(_) | Level::Sse2(_) => "SSE2",
        #[cfg(target_arch = "aarch64")]
        Level::Neon(_) => "NEON",
        _ => "portable",
    }
}

/// Processor name as the system reports it; "CPU" where it reports none.
fn processor_name() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info
        .lines()
        .find_map(|line| line.strip_prefix("model name"));
    let model = model.and_then(|rest| rest.split_once(':'));
    model.map_or("CPU", |(_, name)| name.trim()).to_owned()
}
