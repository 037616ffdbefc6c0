//! A tracer limited to a share of its device's time.
//!
//! ```text
//! run ─▶ pieces of a few ms ─▶ tracer ─▶ sleep, so that the piece has taken 1 / share as long ─▶ sink
//! ```

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use carom_tracer::{
    CompiledScene, DeviceInfo, DeviceKind, Error, RenderSettings, Tile, TileAovs, TileRadiance,
    TraceJob, TraceStats, Tracer,
};
use cpu_time::ProcessTime;

/// Share of a machine that may be used, above 0 and at most 1. Clones share one value, which may be
/// changed at any time. Lower leaves more of the machine to others; higher makes pictures sooner.
#[derive(Clone, Debug)]
pub struct DeviceShare(Arc<AtomicU64>);

impl DeviceShare {
    /// A share of a machine.
    ///
    /// # Errors
    /// [`crate::Error::DeviceShare`] if it is not above 0 and at most 1.
    pub fn new(share: f64) -> Result<Self, crate::Error> {
        let new = Self(Arc::new(AtomicU64::new(0)));
        new.set(share)?;
        Ok(new)
    }

    /// Sets the share, with effect from the next few milliseconds of work on.
    ///
    /// # Errors
    /// As [`DeviceShare::new`]; the share then stays as it was.
    pub fn set(&self, share: f64) -> Result<(), crate::Error> {
        if !(share > 0.0 && share <= 1.0) {
            return Err(crate::Error::DeviceShare(share));
        }
        self.0.store(share.to_bits(), Ordering::Relaxed);
        Ok(())
    }

    /// The current share.
    pub fn get(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }
}

/// A tracer that traces with another one and sleeps in between.
///
/// The work of a processor is measured in CPU time of this process, so that a machine that is busy with
/// other things does not slow it twice; that of a GPU in wall-clock time.
pub struct ThrottledTracer {
    tracer: Arc<dyn Tracer>,
    share: DeviceShare,
    /// Sleep that is still due. The lock also ensures that at most one run is traced at a time.
    debt: Mutex<RestDebt>,
}

#[derive(Default)]
struct RestDebt {
    /// Sleep that is due in s; below 0 if the last one was longer than required.
    owed_secs: f64,
    /// Seconds per pixel sample, once known.
    secs_per_sample: Option<f64>,
}

impl ThrottledTracer {
    /// `tracer`, limited to `share`.
    pub fn new(tracer: Arc<dyn Tracer>, share: DeviceShare) -> Self {
        Self {
            tracer,
            share,
            debt: Mutex::default(),
        }
    }

    /// Traces one piece and sleeps before its tiles are delivered, so that receivers see the throttled
    /// time.
    fn piece(
        &self,
        debt: &mut RestDebt,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
    ) -> Result<(Vec<TileRadiance>, TraceStats), Error> {
        let finished = Mutex::new(Vec::with_capacity(job.tiles.len()));
        let info = self.tracer.info();
        let (begun, used) = (Instant::now(), ProcessTime::now());
        let stats = self.tracer.trace(scene, job, &|tile| {
            let mut finished = finished.lock().unwrap_or_else(PoisonError::into_inner);
            finished.push(tile);
        })?;
        let wall_secs = begun.elapsed().as_secs_f64();
        let alone_secs = match info.kind {
            DeviceKind::Gpu => wall_secs,
            DeviceKind::Cpu | DeviceKind::Scalar => {
                used.elapsed().as_secs_f64() / f64::from(info.threads.max(1))
            }
        };
        debt.secs_per_sample = Some(alone_secs / samples(job, job.tiles).max(1.0));
        // A piece is to last 1/share of its time alone, of which the wall-clock time is over already.
        debt.owed_secs += (alone_secs / self.share.get() - wall_secs).max(0.0);
        debt.rest(job.cancelled);
        let finished = finished.into_inner();
        Ok((finished.unwrap_or_else(PoisonError::into_inner), stats))
    }

    /// Number of `tiles` in the next piece. A run is not split for a GPU, which is fast only on whole
    /// runs, nor for a denoiser, which traces a guard band around each piece.
    fn piece_len(&self, debt: &RestDebt, job: &TraceJob<'_>, tiles: &[Tile]) -> usize {
        if job.settings.denoise || self.tracer.info().kind == DeviceKind::Gpu {
            return tiles.len();
        }
        let Some(secs_per_sample) = debt.secs_per_sample else {
            return 1;
        };
        let tile_secs = secs_per_sample * samples(job, &tiles[..1]);
        ((PIECE_SECS / tile_secs) as usize).clamp(1, tiles.len())
    }
}

impl Tracer for ThrottledTracer {
    /// Information on the device, whose name includes the share.
    fn info(&self) -> DeviceInfo {
        let mut info = self.tracer.info();
        let share = self.share.get();
        if share < 1.0 {
            info.name = format!("{} % of {}", percent(share), info.name);
        }
        info
    }

    fn is_ready(&self, scene: &CompiledScene, settings: &RenderSettings) -> bool {
        self.tracer.is_ready(scene, settings)
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        if self.share.get() >= 1.0 {
            return self.tracer.trace(scene, job, sink);
        }
        let mut debt = self.debt.lock().unwrap_or_else(PoisonError::into_inner);
        let mut sum = TraceStats::default();
        let mut done = 0;
        while done < job.tiles.len() && !job.cancelled.load(Ordering::Relaxed) {
            let left = &job.tiles[done..];
            let tiles = &left[..self.piece_len(&debt, job, left)];
            let (finished, stats) = self.piece(&mut debt, scene, &TraceJob { tiles, ..*job })?;
            for tile in finished {
                sink(TileRadiance {
                    index: done + tile.index,
                    ..tile
                });
            }
            sum += stats;
            done += tiles.len();
        }
        Ok(sum)
    }

    fn aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        self.tracer.aovs(scene, job, sink)
    }
}

impl RestDebt {
    /// Sleeps as long as is due, or until `cancelled`.
    fn rest(&mut self, cancelled: &AtomicBool) {
        while self.owed_secs > REST_SECS_MIN && !cancelled.load(Ordering::Relaxed) {
            let begun = Instant::now();
            std::thread::sleep(Duration::from_secs_f64(self.owed_secs.min(REST_SECS_MAX)));
            self.owed_secs -= begun.elapsed().as_secs_f64();
        }
        // Clamped, so that neither the debt of a cancelled run nor the excess of a long sleep carries
        // over.
        self.owed_secs = self.owed_secs.clamp(-REST_SECS_MAX, REST_SECS_MIN);
    }
}

fn samples(job: &TraceJob<'_>, tiles: &[Tile]) -> f64 {
    let pixels: usize = tiles.iter().map(|tile| tile.pixels()).sum();
    pixels as f64 * f64::from(job.settings.samples)
}

/// The share in percent, rounded to one decimal.
fn percent(share: f64) -> f64 {
    (1000.0 * share).round() / 10.0
}

/// Work between two sleeps in s: short, so that tiles of a slow node come one by one, and longer than
/// the overhead of a call of a tracer.
const PIECE_SECS: f64 = 1e-3;
/// Shortest sleep in s; shorter ones accumulate, as the system sleeps a twentieth of a millisecond
/// longer.
const REST_SECS_MIN: f64 = 1e-4;
/// Longest sleep in s, within which a cancelled run ends.
const REST_SECS_MAX: f64 = 5e-3;

#[cfg(test)]
mod tests {
    use carom_tracer::{ImageSize, RenderSettings, Scene, TileGrid};
    use cpu_time::ThreadTime;

    use super::*;

    /// Works half a millisecond on each tile, and notes it.
    struct Busy(Mutex<Vec<Duration>>);

    impl Tracer for Busy {
        fn info(&self) -> DeviceInfo {
            DeviceInfo {
                kind: DeviceKind::Cpu,
                name: "busy".into(),
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
            for (index, tile) in job.tiles.iter().enumerate() {
                let used = ThreadTime::now();
                while used.elapsed() < Duration::from_micros(500) {}
                self.0.lock().unwrap().push(used.elapsed());
                sink(TileRadiance {
                    index,
                    radiance: vec![[tile.x as f32, tile.y as f32, 0.0]; tile.pixels()],
                    dropped_samples: 0,
                });
            }
            Ok(TraceStats::default())
        }
    }

    #[test]
    fn throttled_tracers_deliver_each_tile_once() {
        let pool = include_str!("../../../assets/scenes/pool.json");
        let scene = CompiledScene::new(&Scene::from_json(pool).unwrap()).unwrap();
        let grid = TileGrid::new(ImageSize::new(64, 40), 8);
        let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
        let job = TraceJob {
            size: grid.size,
            tiles: &tiles,
            settings: RenderSettings::default(),
            cancelled: &AtomicBool::new(false),
        };
        let busy = Arc::new(Busy(Mutex::default()));
        let throttled = ThrottledTracer::new(busy.clone(), DeviceShare::new(0.25).unwrap());
        assert!(throttled.info().name.starts_with("25 % of"));
        let come = Mutex::new(vec![0; tiles.len()]);
        let begun = Instant::now();
        let sink = |tile: TileRadiance| {
            let at = tiles[tile.index];
            assert_eq!(tile.radiance[0], [at.x as f32, at.y as f32, 0.0]);
            come.lock().unwrap()[tile.index] += 1;
        };
        throttled.trace(&scene, &job, &sink).unwrap();
        let took = begun.elapsed();
        assert_eq!(come.into_inner().unwrap(), vec![1; tiles.len()]);
        let used: Duration = busy.0.lock().unwrap().iter().sum();
        assert!(
            took >= 4 * used - Duration::from_millis(6),
            "{used:?} in {took:?}"
        );
    }

    #[test]
    fn a_share_is_a_part() {
        for wrong in [0.0, -1.0, 1.01, f64::NAN, f64::INFINITY] {
            assert!(DeviceShare::new(wrong).is_err(), "{wrong}");
        }
        let share = DeviceShare::new(0.25).unwrap();
        let copy = share.clone();
        assert!(copy.set(2.0).is_err());
        assert_eq!(share.get(), 0.25);
        copy.set(1.0).unwrap();
        assert_eq!(share.get(), 1.0);
    }

    #[test]
    fn rest_is_paid_to_the_end_or_until_cancelled() {
        let mut debt = RestDebt {
            owed_secs: 0.02,
            ..RestDebt::default()
        };
        let begun = Instant::now();
        debt.rest(&AtomicBool::new(false));
        assert!(begun.elapsed().as_secs_f64() >= 0.02 - REST_SECS_MIN);
        debt.owed_secs = 1e9;
        debt.rest(&AtomicBool::new(true));
        assert!(debt.owed_secs <= REST_SECS_MIN);
    }
}
