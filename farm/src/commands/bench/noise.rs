//! A tracer of noise, for benches of the network.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_tracer::{
    CompiledScene, DeviceInfo, DeviceKind, Error, ImageSize, Tile, TileGrid, TileRadiance, TileRun,
    TraceJob, TraceStats, Tracer,
};

/// Hands out pixels that no codec makes smaller, a message of tiles at a time, and remembers when.
pub(super) struct Noise {
    /// After each message.
    pause: Duration,
    /// By seed and the message's first tile.
    handed_over: Mutex<BTreeMap<(u32, u32), Instant>>,
}

impl Noise {
    /// Messages of 4056 bytes in a frame.
    pub(super) const MESSAGES: u32 = 16;

    pub(super) fn new(pause: Duration) -> Self {
        Self {
            pause,
            handed_over: Mutex::default(),
        }
    }

    /// The frame.
    pub(super) const fn grid() -> TileGrid {
        let edge = TILE_EDGE as u32;
        let size = ImageSize::new(TILES_PER_MESSAGE_MAX * edge, Self::MESSAGES * edge);
        TileGrid::new(size, TILE_EDGE)
    }

    /// When the message of these tiles left the tracer.
    pub(super) fn handed_over(&self, seed: u32, tiles: TileRun) -> Option<Instant> {
        let handed = self
            .handed_over
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        handed.get(&(seed, tiles.first)).copied()
    }
}

impl Tracer for Noise {
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
        for first in (0..job.tiles.len()).step_by(group) {
            if job.cancelled.load(Ordering::Relaxed) {
                break;
            }
            std::thread::sleep(self.pause); // the work of a device
            let key = (job.settings.seed, first as u32);
            let mut handed = self
                .handed_over
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            handed.insert(key, Instant::now());
            drop(handed);
            let tiles = job.tiles[first..].iter().take(group);
            for (index, tile) in (first..).zip(tiles) {
                sink(TileRadiance {
                    index,
                    radiance: noise(job.settings.seed, *tile),
                    dropped_samples: 0,
                });
            }
        }
        Ok(TraceStats::default())
    }
}

fn noise(seed: u32, tile: Tile) -> Vec<[f32; 3]> {
    let mut state = u64::from(seed) << 32 | u64::from(tile.y) << 16 | u64::from(tile.x);
    let mut uniform = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        // Evenly over the levels of sRGB, nearly.
        let level = (state >> 40) as f32 / (1 << 24) as f32;
        level.powf(2.2)
    };
    let pixel = |_| [(); 3].map(|()| uniform());
    (0..tile.pixels()).map(pixel).collect()
}

/// 8 tiles of 13 pixels are 4056 bytes.
const TILE_EDGE: u16 = 13;
