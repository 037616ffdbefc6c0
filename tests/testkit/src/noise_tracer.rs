//! A tracer of incompressible noise, for benches of the network.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_tracer::{
    CompiledScene, DeviceInfo, DeviceKind, Error, ImageSize, Tile, TileGrid, TileRadiance,
    TileRange, TraceJob, TraceStats, Tracer,
};

use crate::random::SplitMix64;

/// A tracer of incompressible pixels, which delivers a message of tiles at a time and records when.
pub struct NoiseTracer {
    /// Interval between messages.
    pause: Duration,
    bank: Vec<Vec<[f32; 3]>>,
    /// Times of delivery, by seed and the message's first tile.
    handed_over: Mutex<BTreeMap<(u32, u32), Instant>>,
}

impl NoiseTracer {
    /// Messages in a frame, of 4056 bytes each.
    pub const MESSAGES: u32 = 16;

    /// A tracer that delivers a message every `pause`.
    pub fn new(pause: Duration) -> Self {
        Self {
            pause,
            bank: bank(),
            handed_over: Mutex::default(),
        }
    }

    /// Grid of a frame's tiles.
    pub const fn grid() -> TileGrid {
        let edge = TILE_EDGE as u32;
        let size = ImageSize::new(TILES_PER_MESSAGE_MAX * edge, Self::MESSAGES * edge);
        TileGrid::new(size, TILE_EDGE)
    }

    /// The tiles of the first message.
    pub fn message(&self) -> Vec<(Tile, Vec<[f32; 3]>)> {
        let grid = Self::grid();
        let run = TileRange {
            first: 0,
            count: TILES_PER_MESSAGE_MAX,
        };
        grid.tiles(run).zip(self.bank.iter().cloned()).collect()
    }

    /// Time at which the message of these tiles left the tracer.
    pub fn handed_over(&self, seed: u32, tiles: TileRange) -> Option<Instant> {
        let handed = self
            .handed_over
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        handed.get(&(seed, tiles.first)).copied()
    }
}

impl Tracer for NoiseTracer {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            kind: DeviceKind::Cpu,
            name: "noise".into(),
            width: 1,
            threads: 1,
        }
    }

    fn trace(
        &self,
        _: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        let group = TILES_PER_MESSAGE_MAX as usize;
        let mut due = Instant::now();
        for first in (0..job.tiles.len()).step_by(group) {
            if job.cancelled.load(Ordering::Relaxed) {
                break;
            }
            // Stands for the work of a device, which uses no processor.
            due += self.pause;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let key = (job.settings.seed, first as u32);
            let mut handed = self
                .handed_over
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            handed.insert(key, Instant::now());
            drop(handed);
            let tiles = job.tiles[first..].iter().take(group);
            for (index, _) in (first..).zip(tiles) {
                let noise = (index + 131 * job.settings.seed as usize) % BANK_TILES;
                sink(TileRadiance {
                    index,
                    radiance: self.bank[noise].clone(),
                    dropped_samples: 0,
                });
            }
        }
        Ok(TraceStats::default())
    }
}

/// Tiles of noise, nearly uniform over the levels of sRGB.
fn bank() -> Vec<Vec<[f32; 3]>> {
    let mut random = SplitMix64::new(1);
    let mut channel = || random.uniform().powf(2.2) as f32;
    let pixels = usize::from(TILE_EDGE) * usize::from(TILE_EDGE);
    let mut tile = || (0..pixels).map(|_| [(); 3].map(|()| channel())).collect();
    (0..BANK_TILES).map(|_| tile()).collect()
}

/// Number of different tiles: a prime, so that a place gets the same tile again only after many frames.
const BANK_TILES: usize = 509;
/// Edge of a tile: 8 tiles of 13 × 13 pixels are 4056 bytes.
const TILE_EDGE: u16 = 13;
