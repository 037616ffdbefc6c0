//! Division of work into chunks of tiles, and of chunks into dispatches of some samples.
//!
//! A dispatch should take [`DISPATCH_NANOS`]: long enough that starting it costs nothing, short
//! enough for the watchdogs of display GPUs (2 s), for cancelling, and for other programs that
//! use the GPU. So its work is what the device did in that time before. Where a job's samples
//! fit, it is one dispatch; else its tiles are cut into chunks that are read back one by one; and
//! where even a chunk just large enough to fill a GPU is too much, its samples are cut. A pixel's
//! samples are added in their order however they are cut, so the picture does not depend on it.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::gpu::layout::{DispatchData, TileEntry};
use crate::gpu::shader::BLOCK_EDGE;
use crate::{RenderSettings, Tile};

/// What a dispatch should take.
const DISPATCH_NANOS: f64 = 30e6;
/// Dispatches that are shorter, and should be, say more about starting them than about speed.
const LEARN_NANOS_MIN: f64 = 1e6;
/// Femtoseconds per unit of work before anything is known: 30 Msample/s in a pool scene.
const FEMTOS_PER_WORK: u64 = 100_000;
/// Blocks that fill a large GPU: 4096 × 64 pixels, 2000 threads on each of 132 processors.
const CHUNK_BLOCKS_MIN: u32 = 4096;
/// Blocks of which a dispatch takes some samples rather than a chunk some tiles: the end of a dispatch, where processors
/// run out of work one by one, is short beside the rest of eight times what fills a GPU.
const CHUNK_BLOCKS: u32 = 1 << 15;
/// Samples that such a dispatch takes at least.
const DISPATCH_SAMPLES_MIN: u32 = 8;
/// Tiles of a chunk: their list stays small.
const CHUNK_TILES_MAX: usize = 1 << 16;
/// Pixels of a block.
pub(crate) const BLOCK_PIXELS: u64 = (BLOCK_EDGE * BLOCK_EDGE) as u64;

/// The device's speed, learned from what it did.
pub(crate) struct Pacer {
    femtos_per_work: AtomicU64,
}

impl Pacer {
    pub(crate) const fn new() -> Self {
        let femtos_per_work = AtomicU64::new(FEMTOS_PER_WORK);
        Self { femtos_per_work }
    }

    /// Samples for a dispatch, at least 1.
    pub(crate) fn samples_per_dispatch(&self, work_per_sample: f64) -> u64 {
        (DISPATCH_NANOS / (self.nanos_per_work() * work_per_sample)).max(1.0) as u64
    }

    /// Learns from a dispatch; `nanos` is 0 where the device has no timestamps, and then its speed
    /// stays the assumed one: short dispatches cost less than a clock in here. A slower one is believed at once, a faster one by half: too much
    /// work is worse than too little.
    pub(crate) fn learn(&self, samples: u64, work_per_sample: f64, nanos: f64) {
        if nanos == 0.0 {
            return;
        }
        let work = samples as f64 * work_per_sample;
        let known = self.nanos_per_work();
        // A dispatch that was short although a long one had been expected does tell of speed.
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

/// An upper bound of a sample's work, in surfaces tested: path edges and shadow rays, each against
/// all primitives, and about eight primitives' worth of shading.
pub(crate) fn work_per_sample(settings: &RenderSettings, primitives: u32) -> f64 {
    (1.0 + 2.0 * f64::from(settings.max_depth)) * f64::from(primitives + 8)
}

/// Turns of a kernel's loops, all together, after which Mesa's llvmpipe ends them without a word
/// (`LP_MAX_TGSI_LOOP_ITERATIONS`): the rest of the light would be missing.
const SOFTWARE_TURNS_MAX: f64 = 65_535.0;

/// How many of a pixel's samples a dispatch of software Vulkan gets through, if `turns_per_ray` is an
/// upper bound: each scattering comes with four rays at most, to the surface, to its area light, to its
/// mirror's and, while neighbours are not so far, to the next.
pub(crate) fn software_samples(settings: &RenderSettings, turns_per_ray: f64) -> u32 {
    let edges = 1.0 + f64::from(settings.max_depth);
    (SOFTWARE_TURNS_MAX / (4.0 * edges * (turns_per_ray + 8.0))) as u32
}

/// The most that one chunk may hold.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChunkLimits {
    /// Pixels that a buffer holds.
    pub(crate) pixels: u64,
    /// Samples that a dispatch should take.
    pub(crate) samples: u64,
    /// Of one pixel, samples that it can take.
    pub(crate) pixel_samples: u32,
}

/// Tiles that are traced and read back together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Chunk {
    /// Indices into the job's tiles.
    pub(crate) tiles: Range<usize>,
    /// The tiles as the kernel wants them.
    pub(crate) entries: Vec<TileEntry>,
    pub(crate) blocks: u32,
    pub(crate) pixels: u64,
}

impl Chunk {
    /// The next tiles from `first` on: at least one, whatever the limits say.
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
            // A chunk that fills a GPU ends where a few samples of it take too long; where all of its
            // samples do, but those few do not, it grows eight times as large before its samples are cut
            // instead.
            let is_long = is_long(samples.min(DISPATCH_SAMPLES_MIN)) && blocks > CHUNK_BLOCKS_MIN
                || is_long(samples) && blocks > CHUNK_BLOCKS;
            if !chunk.entries.is_empty() && (is_long || pixels > limits.pixels) {
                break;
            }
            chunk.push(tile);
        }
        chunk
    }

    /// All of `tiles`, whatever their number.
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

    /// A run of samples of all its pixels.
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

    /// Samples of each dispatch over the whole chunk, about as many in all: so the last is no short one.
    pub(crate) fn samples_per_dispatch(&self, samples: u32, limits: ChunkLimits) -> u32 {
        let most = limits.samples / (u64::from(self.blocks) * BLOCK_PIXELS).max(1);
        let most = most.clamp(1, u64::from(limits.pixel_samples)) as u32;
        // As few dispatches as there can be, and then as even ones: 17 samples of which 16 fit are 9 and
        // 8.
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
