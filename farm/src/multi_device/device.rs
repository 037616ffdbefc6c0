//! One device of a [`super::MultiDeviceTracer`]: its faults, and its preparation.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use carom_tracer::{
    CompiledScene, Error, RenderSettings, Tile, TileRadiance, TileSrgb8, TraceJob, TraceStats,
    Tracer,
};

use super::{JobProgress, JobSink};
use crate::lock::lock;

/// A tracer that may fail temporarily.
pub(super) struct Device {
    pub(super) tracer: Arc<dyn Tracer>,
    fault: Mutex<Option<DeviceFault>>,
    preparation: Mutex<Option<Preparation>>,
}

/// Thread that prepares a device, or has finished.
type Preparation = JoinHandle<Result<(), Error>>;

/// Why and for how long a device is not used.
struct DeviceFault {
    why: String,
    since: Instant,
    rest: Duration,
}

impl Device {
    pub(super) fn new(tracer: Arc<dyn Tracer>) -> Self {
        Self {
            tracer,
            fault: Mutex::new(None),
            preparation: Mutex::new(None),
        }
    }

    /// Prepares the device for jobs like this one in a thread, unless one is running.
    pub(super) fn prepare(&self, scene: &CompiledScene, job: &TraceJob<'_>) {
        let mut preparation = lock(&self.preparation);
        if !self.end_preparation(&mut preparation) {
            return;
        }
        let tracer = Arc::clone(&self.tracer);
        let (scene, tile, size) = (scene.clone(), job.tiles[0], job.size);
        // One sample of one tile: only the compilation of the kernels matters.
        let settings = RenderSettings {
            samples: 1,
            ..job.settings
        };
        let prepare = move || {
            let job = TraceJob {
                size,
                tiles: &[tile],
                settings,
                cancelled: &AtomicBool::new(false),
            };
            catching(&*tracer, || tracer.trace(&scene, &job, &|_| {})).map(|_| ())
        };
        match std::thread::Builder::new()
            .name("prepare".to_owned())
            .spawn(prepare)
        {
            Ok(thread) => *preparation = Some(thread),
            Err(why) => tracing::error!("a device's thread cannot be started: {why}"),
        }
    }

    /// Whether no preparation is running. If the last one failed, the device is marked as faulty.
    pub(super) fn is_prepared(&self) -> bool {
        self.end_preparation(&mut lock(&self.preparation))
    }

    fn end_preparation(&self, preparation: &mut Option<Preparation>) -> bool {
        if preparation
            .as_ref()
            .is_some_and(|thread| !thread.is_finished())
        {
            return false;
        }
        if let Some(thread) = preparation.take()
            && let Err(why) = thread.join().expect("a device's panic has been caught")
        {
            self.fail(&why);
        }
        true
    }

    /// Traces some tiles of a job until `cancelled`. A panic becomes the device's error.
    pub(super) fn trace(
        &self,
        work: &JobProgress<'_>,
        places: &[usize],
        cancelled: &AtomicBool,
    ) -> Result<TraceStats, Error> {
        let tiles: Vec<Tile> = places.iter().map(|&place| work.job.tiles[place]).collect();
        let job = TraceJob {
            tiles: &tiles,
            cancelled,
            ..*work.job
        };
        // A device may deliver a tile twice, or fail after delivering: the first copy counts.
        let is_first = |index: usize| !work.done[index].swap(true, Ordering::Relaxed);
        catching(&*self.tracer, || match work.sink {
            JobSink::Radiance(sink) => self.tracer.trace(work.scene, &job, &|tile| {
                let index = places[tile.index];
                if is_first(index) {
                    sink(TileRadiance { index, ..tile });
                }
            }),
            JobSink::Srgb8(exposure, sink) => {
                let sink = |tile: TileSrgb8| {
                    let index = places[tile.index];
                    if is_first(index) {
                        sink(TileSrgb8 { index, ..tile });
                    }
                };
                self.tracer.trace_srgb8(work.scene, &job, exposure, &sink)
            }
        })
    }

    /// Whether the device may be used. A device is tried again after its rest, as memory may be free again;
    /// a lost one fails at once, and its tiles are traced elsewhere.
    pub(super) fn is_usable(&self) -> bool {
        let fault = lock(&self.fault);
        fault
            .as_ref()
            .is_none_or(|fault| fault.since.elapsed() >= fault.rest)
    }

    pub(super) fn fail(&self, why: &Error) {
        let why = why.to_string();
        let mut fault = lock(&self.fault);
        // A fault stays until the next success, so that repeated failures double the rest.
        let rest = match &*fault {
            Some(before) => (2 * before.rest).min(REST_MAX),
            None => {
                tracing::warn!("a device is left out: {why}");
                REST_MIN
            }
        };
        let since = Instant::now();
        *fault = Some(DeviceFault { why, since, rest });
    }

    pub(super) fn recover(&self) {
        if lock(&self.fault).take().is_some() {
            tracing::info!("{} is used again", self.tracer.info().name);
        }
    }

    pub(super) fn fault(&self) -> Option<String> {
        lock(&self.fault).as_ref().map(|fault| fault.why.clone())
    }
}

impl Drop for Device {
    /// Waits for the preparation: a compiling driver must not be torn down by the process exiting.
    fn drop(&mut self) {
        if let Some(thread) = lock(&self.preparation).take() {
            let _ = thread.join();
        }
    }
}

/// Runs `work` of a tracer and turns a panic into an error.
fn catching(
    tracer: &dyn Tracer,
    work: impl FnOnce() -> Result<TraceStats, Error>,
) -> Result<TraceStats, Error> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
        Err(Error::Device {
            device: tracer.info().name,
            message: "its tracer panicked".to_owned(),
        })
    })
}

/// Rest of a device after its first failure; it doubles with each further one, up to [`REST_MAX`].
const REST_MIN: Duration = Duration::from_secs(1);
const REST_MAX: Duration = Duration::from_secs(64);
