//! Division of jobs into chunks of tiles, and of chunks into dispatches of some of their samples.
//!
//! A dispatch should take [`DISPATCH_NANOS`]: long enough for its launch overhead not to matter,
//! short enough for the watchdogs of display GPUs (2 s), for cancellation, and for other programs
//! that use the GPU. So its size follows from the speed measured before. A job whose samples fit is
//! one dispatch; otherwise its tiles are divided into chunks that are read back one by one; and
//! where even a chunk that just fills a GPU is too much, its samples are divided. A pixel's samples
//! are always added in the same order, so the image does not depend on the division.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::gpu::layout::{DispatchData, TileEntry};
use crate::gpu::shader::BLOCK_EDGE;
use crate::{RenderSettings, Tile};

/// Intended duration of a dispatch in nanoseconds.
const DISPATCH_NANOS: f64 = 30e6;
/// Duration in nanoseconds below which a dispatch tells more about launch overhead than about
/// speed, unless it was expected to take longer.
const LEARN_NANOS_MIN: f64 = 1e6;
/// Minimum number of samples that a dispatch is planned for: software Vulkan traces them in a tenth of
/// a second, and takes 20 ms to launch a dispatch, which would pass for a speed if it had fewer.
const PACED_SAMPLES_MIN: u64 = 4096;
/// Assumed speed in femtoseconds per unit of work before anything is measured: 30 Msample/s in a
/// pool scene.
const FEMTOS_PER_WORK: u64 = 100_000;
/// Number of blocks that fills a large GPU: 4096 × 64 pixels, 2000 threads on each of 132
/// multiprocessors.
const CHUNK_BLOCKS_MIN: u32 = 4096;
/// Number of blocks from which a chunk's samples are divided rather than its tiles: with eight
/// times what fills a GPU, the tail of a dispatch, when multiprocessors run out of work one by one,
/// is short compared with the rest.
const CHUNK_BLOCKS: u32 = 1 << 15;
/// Minimum number of samples per pixel of a dispatch that takes only a part of a chunk's samples.
const DISPATCH_SAMPLES_MIN: u32 = 8;
/// Maximum number of tiles of a chunk, so that their list stays small.
const CHUNK_TILES_MAX: usize = 1 << 16;
/// Pixels per block.
pub(crate) const BLOCK_PIXELS: u64 = (BLOCK_EDGE * BLOCK_EDGE) as u64;

/// The speed of a device, learned from the durations of its dispatches.
pub(crate) struct Pacer {
    femtos_per_work: AtomicU64,
}

impl Pacer {
    pub(crate) const fn new() -> Self {
        let femtos_per_work = AtomicU64::new(FEMTOS_PER_WORK);
        Self { femtos_per_work }
    }

    /// Number of samples for a dispatch of [`DISPATCH_NANOS`], at least [`PACED_SAMPLES_MIN`].
    pub(crate) fn samples_per_dispatch(&self, work_per_sample: f64) -> u64 {
        let samples = DISPATCH_NANOS / (self.nanos_per_work() * work_per_sample);
        (samples as u64).max(PACED_SAMPLES_MIN)
    }

    /// Updates the speed from a dispatch of `samples` samples that took `nanos` nanoseconds.
    /// Without timestamps `nanos` is 0 and the assumed speed stays: dispatches that are too short
    /// are preferred to a host clock, which this crate does not use. A lower speed is adopted at
    /// once, a higher one by half: too much work is worse than too little.
    pub(crate) fn learn(&self, samples: u64, work_per_sample: f64, nanos: f64) {
        if nanos == 0.0 {
            return;
        }
        let work = samples as f64 * work_per_sample;
        let known = self.nanos_per_work();
        // A dispatch that was short although it was expected to be long does tell about speed.
        if nanos.max(known * work) < LEARN_NANOS_MIN {
            return;
        }
        let seen = nanos / work;
        let femtos = 1e6 * seen.max(0.5 * (seen + known));
        self.femtos_per_work
            .store(femtos.max(1.0) as u64, Ordering::Relaxed);
    }

    fn nanos_per_work(&self) -> f64 {
        self.femtos_per_work.load(Ordering::Relaxed) as f64 * 1e-6
    }
}

/// An upper bound of a sample's work, in surfaces tested: path segments and shadow rays, each
/// against all primitives, and shading at the cost of about eight primitives.
pub(crate) fn work_per_sample(settings: &RenderSettings, primitives: u32) -> f64 {
    (1.0 + 2.0 * f64::from(settings.max_depth)) * f64::from(primitives + 8)
}

/// Total number of loop iterations in an invocation after which Mesa's llvmpipe silently ends its
/// loops (`LP_MAX_TGSI_LOOP_ITERATIONS`), so that the remaining light would be missing.
const SOFTWARE_TURNS_MAX: f64 = 65_535.0;

/// Maximum number of samples per pixel of a dispatch on software Vulkan; 0 if not even one is
/// possible. `turns_per_ray` is an upper bound on the loop iterations per ray, and each scattering
/// event takes up to four rays: to the surface, to an area light, to the area light that a coat
/// mirrors, and, while neighbouring pixels lag behind, to the next surface.
pub(crate) fn software_samples(settings: &RenderSettings, turns_per_ray: f64) -> u32 {
    let edges = 1.0 + f64::from(settings.max_depth);
    (SOFTWARE_TURNS_MAX / (4.0 * edges * (turns_per_ray + 8.0))) as u32
}

/// Limits of one chunk.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChunkLimits {
    /// Maximum number of pixels, given by buffer sizes.
    pub(crate) pixels: u64,
    /// Number of samples that a dispatch should take.
    pub(crate) samples: u64,
    /// Maximum number of samples per pixel of a dispatch.
    pub(crate) pixel_samples: u32,
}

/// Tiles that are traced and read back together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Chunk {
    /// Indices into the job's tiles.
    pub(crate) tiles: Range<usize>,
    /// The tiles in the kernel's format.
    pub(crate) entries: Vec<TileEntry>,
    pub(crate) blocks: u32,
    pub(crate) pixels: u64,
}

impl Chunk {
    /// The chunk of the next tiles from `first` on: at least one, even if it exceeds the limits.
    pub(crate) fn next(tiles: &[Tile], first: usize, samples: u32, limits: ChunkLimits) -> Self {
        let mut chunk = Self {
            tiles: first..first,
            entries: Vec::new(),
            blocks: 0,
            pixels: 0,
        };
        for tile in tiles[first..].iter().take(CHUNK_TILES_MAX) {
            let blocks = chunk.blocks + blocks(tile);
            let pixels = chunk.pixels + tile.pixels() as u64;
            let is_long = |samples: u32| {
                u64::from(blocks) * BLOCK_PIXELS * u64::from(samples) > limits.samples
            };
            // A chunk that fills a GPU ends where even its minimum number of samples would take too
            // long. If these do not, but all of its samples do, it grows to eight times that size
            // before its samples are divided instead.
            let is_long = is_long(samples.min(DISPATCH_SAMPLES_MIN)) && blocks > CHUNK_BLOCKS_MIN
                || is_long(samples) && blocks > CHUNK_BLOCKS;
            if !chunk.entries.is_empty() && (is_long || pixels > limits.pixels) {
                break;
            }
            chunk.push(tile);
        }
        chunk
    }

    /// A chunk of all of `tiles`, however many.
    pub(crate) fn new(tiles: &[Tile]) -> Self {
        let mut chunk = Self {
            tiles: 0..0,
            entries: Vec::with_capacity(tiles.len()),
            blocks: 0,
            pixels: 0,
        };
        tiles.iter().for_each(|tile| chunk.push(tile));
        chunk
    }

    /// The uniforms of a dispatch of some samples of all pixels.
    pub(crate) fn dispatch(&self, settings: &RenderSettings, samples: Range<u32>) -> DispatchData {
        DispatchData {
            tile_count: self.entries.len() as u32,
            block_count: self.blocks,
            sample_begin: samples.start,
            sample_end: samples.end,
            samples: settings.samples,
            first_half: 0,
            pixels: self.pixels as u32,
            first_sample: settings.first_sample,
            seed: settings.seed,
            max_depth: settings.max_depth,
            is_list: 0,
        }
    }

    fn push(&mut self, tile: &Tile) {
        self.entries.push(TileEntry {
            x: tile.x,
            y: tile.y,
            width: tile.width,
            height: tile.height,
            first_block: self.blocks,
            first_pixel: self.pixels as u32,
        });
        self.blocks += blocks(tile);
        self.pixels += tile.pixels() as u64;
        self.tiles.end += 1;
    }

    /// Number of samples of each dispatch over the whole chunk, evenly distributed so that the last
    /// one is not short.
    pub(crate) fn samples_per_dispatch(&self, samples: u32, limits: ChunkLimits) -> u32 {
        let most = limits.samples / (u64::from(self.blocks) * BLOCK_PIXELS).max(1);
        let most = most.clamp(1, u64::from(limits.pixel_samples)) as u32;
        // The minimum number of dispatches first, then an even division: 17 samples of which 16 fit
        // are divided into 9 and 8.
        samples.div_ceil(samples.div_ceil(most).max(1))
    }
}

fn blocks(tile: &Tile) -> u32 {
    tile.width.div_ceil(BLOCK_EDGE) * tile.height.div_ceil(BLOCK_EDGE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImageSize, TileGrid};

    fn chunks(tiles: &[Tile], samples: u32, limits: ChunkLimits) -> Vec<Chunk> {
        let mut chunks = Vec::<Chunk>::new();
        while let Some(tile) = chunks.last().map_or(Some(0), |last| {
            (last.tiles.end < tiles.len()).then_some(last.tiles.end)
        }) {
            chunks.push(Chunk::next(tiles, tile, samples, limits));
        }
        chunks
    }

    #[test]
    fn chunks_cover_all_tiles_in_order_within_the_limits() {
        let grid = TileGrid::new(ImageSize::new(3000, 2000), 32);
        let tiles: Vec<_> = grid.tiles(grid.all()).collect();
        let limits = ChunkLimits {
            pixels: 1 << 20,
            samples: 1 << 22,
            pixel_samples: u32::MAX,
        };
        let chunks = chunks(&tiles, 16, limits);
        let mut next = 0;
        for chunk in &chunks {
            assert_eq!(chunk.tiles.start, next);
            next = chunk.tiles.end;
            assert!(chunk.pixels <= limits.pixels);
            let dispatch = u64::from(chunk.samples_per_dispatch(16, limits)) * chunk.pixels;
            assert!(dispatch <= limits.samples, "{dispatch}");
        }
        assert_eq!(next, tiles.len());
        assert!(chunks.len() > 5);
    }

    #[test]
    fn a_frame_that_is_fast_enough_is_one_dispatch() {
        let grid = TileGrid::new(ImageSize::new(1920, 1080), 32);
        let tiles: Vec<_> = grid.tiles(grid.all()).collect();
        let limits = ChunkLimits {
            pixels: 1 << 23,
            samples: 1920 * 1088 * 16,
            pixel_samples: u32::MAX,
        };
        let chunk = Chunk::next(&tiles, 0, 16, limits);
        assert_eq!(chunk.tiles, 0..tiles.len());
        assert!(chunk.samples_per_dispatch(16, limits) >= 16);
    }

    #[test]
    fn a_tile_beyond_the_limits_is_a_chunk_of_its_own() {
        let tile = Tile {
            x: 0,
            y: 0,
            width: 999,
            height: 1001,
        };
        let limits = ChunkLimits {
            pixels: 1,
            samples: 1,
            pixel_samples: u32::MAX,
        };
        assert_eq!(chunks(&[tile; 3], 1000, limits).len(), 3);
        assert_eq!(
            chunks(&[tile], 1000, limits)[0].samples_per_dispatch(1000, limits),
            1
        );
    }

    #[test]
    fn dispatches_keep_the_device_s_sample_limit() {
        let chunk = Chunk::new(&[Tile {
            x: 0,
            y: 0,
            width: 8,
            height: 8,
        }]);
        let settings = RenderSettings::default();
        let pixel_samples = software_samples(&settings, 40.0);
        assert!((10..100).contains(&pixel_samples), "{pixel_samples}");
        let limits = ChunkLimits {
            pixels: 1 << 20,
            samples: u64::MAX,
            pixel_samples,
        };
        assert_eq!(
            chunk.samples_per_dispatch(5 * pixel_samples, limits),
            pixel_samples
        );
        assert_eq!(software_samples(&settings, 1e5), 0);
    }

    #[test]
    fn the_pacer_settles_on_the_device_s_speed() {
        let pacer = Pacer::new();
        for picos_per_sample in [3_000_000.0, 40.0, 900.0] {
            for _ in 0..60 {
                let samples = pacer.samples_per_dispatch(100.0);
                pacer.learn(samples, 100.0, samples as f64 * picos_per_sample * 1e-3);
            }
            let nanos = pacer.samples_per_dispatch(100.0) as f64 * picos_per_sample * 1e-3;
            assert!(
                (nanos - DISPATCH_NANOS).abs() < 0.6 * DISPATCH_NANOS,
                "{nanos}"
            );
        }
    }
}
