//! Tracer made of several devices of one machine: all its GPUs and its CPU for one frame.
//!
//! ```text
//! job ──device_model: water_fill──▶ a contiguous range of tiles per device ──Tracer::trace──▶ sink
//!                           └ what a failed device leaves is traced by the others
//! ```
//!
//! The split is that of frames among nodes ([`crate::balancer`]): each device's cost
//! y = A + B·w, learned from its own shares, and the earliest common finish over these costs. A
//! device that does not make frames shorter is left out ([`device_model`]). A device that fails rests,
//! and its name says why, so that a fallback is seen wherever the device is named.

mod device_model;

use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::limits::NODE_NAME_BYTES_MAX;
use carom_tracer::{
    CompiledScene, DeviceInfo, Error, Tile, TileAovs, TileRadiance, TileSrgb8, TraceJob,
    TraceStats, Tracer,
};
use device_model::{DeviceTiming, JobClass, JobModels};

/// Traces with several devices at once.
pub struct MultiDeviceTracer {
    devices: Vec<Device>,
    models: Mutex<JobModels>,
    /// Why devices that the machine has are not among these.
    absent: Vec<String>,
}

struct Device {
    tracer: Arc<dyn Tracer>,
    fault: Mutex<Option<DeviceFault>>,
}

/// Why a device is not used now.
struct DeviceFault {
    why: String,
    since: Instant,
    rest: Duration,
}

/// Tiles of a job that one device is to trace, by their places in the job.
struct DeviceShare {
    device: usize,
    tiles: Vec<usize>,
}

impl MultiDeviceTracer {
    /// Jobs of a class until it is known whether the devices are better used together for it.
    pub const JOBS_UNTIL_SETTLED: u32 = 2 * device_model::TRIAL_JOBS;

    /// `devices` as one, the quickest first: it traces alone until the others are known. `absent`
    /// says of each device that cannot be used why.
    ///
    /// # Panics
    /// If there is no device.
    pub fn new(devices: Vec<Arc<dyn Tracer>>, absent: Vec<String>) -> Self {
        assert!(!devices.is_empty(), "a tracer of no device");
        let models = Mutex::new(JobModels::new(devices.len()));
        let device = |tracer| Device {
            tracer,
            fault: Mutex::new(None),
        };
        Self {
            devices: devices.into_iter().map(device).collect(),
            models,
            absent,
        }
    }

    fn trace_into(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: JobSink<'_>,
    ) -> Result<TraceStats, Error> {
        job.validate()?;
        let work = JobProgress {
            scene,
            job,
            sink,
            done: job.tiles.iter().map(|_| AtomicBool::new(false)).collect(),
        };
        if job.tiles.is_empty() {
            return Ok(TraceStats::default());
        }
        let usable = self.usable();
        if usable.is_empty() {
            return Err(self.all_failed());
        }
        let mut parts = self.parts(&work, &usable);
        let together = parts.len() > 1;
        let begun = Instant::now();
        let mut stats = TraceStats::default();
        while !parts.is_empty() {
            stats = sum(stats, self.trace_parts(&work, &mut parts)?);
            let left: Vec<usize> = parts.into_iter().flat_map(|part| part.tiles).collect();
            if left.is_empty() {
                break;
            }
            parts = vec![self.retrace_failed(left)?];
        }
        if !job.cancelled.load(Ordering::Relaxed) {
            let secs = begun.elapsed().as_secs_f64();
            self.lock()
                .get_mut(work.class())
                .judge(work.total(), secs, together);
        }
        Ok(stats)
    }

    /// The devices that may be used now.
    fn usable(&self) -> Vec<usize> {
        let usable = |index: &usize| self.devices[*index].is_usable();
        (0..self.devices.len()).filter(usable).collect()
    }

    /// Traces each part with its device, all at once. What a device has failed to trace is left
    /// in its part.
    fn trace_parts(
        &self,
        work: &JobProgress<'_>,
        parts: &mut [DeviceShare],
    ) -> Result<TraceStats, Error> {
        let (first, others) = parts.split_first_mut().expect("there is work");
        std::thread::scope(|scope| {
            let others: Vec<_> = others
                .iter_mut()
                .map(|part| scope.spawn(|| self.trace_part(work, part)))
                .collect();
            let mut stats = self.trace_part(work, first);
            for other in others {
                let other = other.join().expect("a device's panic has been caught");
                stats = stats.and_then(|stats| Ok(sum(stats, other?)));
            }
            stats
        })
    }

    /// # Errors
    /// What is no fault of the device.
    fn trace_part(
        &self,
        work: &JobProgress<'_>,
        part: &mut DeviceShare,
    ) -> Result<TraceStats, Error> {
        let device = &self.devices[part.device];
        let begun = Instant::now();
        let traced = device.trace(work, &part.tiles);
        let secs = begun.elapsed().as_secs_f64();
        match traced {
            Ok(stats) => {
                if !work.job.cancelled.load(Ordering::Relaxed) {
                    let done = work.of(&part.tiles);
                    let timing = DeviceTiming::new(done, secs, stats.device_nanos);
                    self.lock()
                        .get_mut(work.class())
                        .learn(part.device, &timing);
                    device.recover();
                }
                part.tiles.clear();
                Ok(stats)
            }
            Err(Error::Device {
                device: name,
                message,
            }) => {
                device.fail(format!("{name}: {message}"));
                part.tiles
                    .retain(|&tile| !work.done[tile].load(Ordering::Relaxed));
                Ok(TraceStats::default())
            }
            Err(error) => Err(error),
        }
    }

    /// Divides all of a job.
    fn parts(&self, work: &JobProgress<'_>, usable: &[usize]) -> Vec<DeviceShare> {
        let shares = self
            .lock()
            .get_mut(work.class())
            .divide(work.total(), usable);
        let runs = cut(work.job.tiles, &shares);
        let parts = usable.iter().zip(runs).map(|(&device, run)| DeviceShare {
            device,
            tiles: run.collect(),
        });
        parts.filter(|part| !part.tiles.is_empty()).collect()
    }

    /// Another device for tiles that a failed one has left: the last that is usable, which is the
    /// CPU where there is one.
    ///
    /// # Errors
    /// [`Error::Device`] with all that has failed if none is left.
    fn retrace_failed(&self, tiles: Vec<usize>) -> Result<DeviceShare, Error> {
        if let Some(&device) = self.usable().last() {
            return Ok(DeviceShare { device, tiles });
        }
        Err(self.all_failed())
    }

    fn all_failed(&self) -> Error {
        let faults: Vec<_> = self.devices.iter().filter_map(Device::fault).collect();
        Error::Device {
            device: "every device of this machine has failed".to_owned(),
            message: faults.join("; "),
        }
    }

    fn lock(&self) -> MutexGuard<'_, JobModels> {
        lock(&self.models)
    }
}

/// Where tiles of a job go, and as what.
#[derive(Clone, Copy)]
enum JobSink<'a> {
    Radiance(&'a (dyn Fn(TileRadiance) + Sync)),
    /// Of that exposure.
    Srgb8(f32, &'a (dyn Fn(TileSrgb8) + Sync)),
}

/// A job and what has been done of it.
struct JobProgress<'a> {
    scene: &'a CompiledScene,
    job: &'a TraceJob<'a>,
    sink: JobSink<'a>,
    /// By a tile's place in the job.
    done: Vec<AtomicBool>,
}

impl JobProgress<'_> {
    /// Pixel samples of some tiles.
    fn of(&self, places: &[usize]) -> f64 {
        let pixels = places
            .iter()
            .map(|&place| self.job.tiles[place].pixels() as f64);
        pixels.sum::<f64>() * f64::from(self.job.settings.samples)
    }

    fn total(&self) -> f64 {
        self.pixels() as f64 * f64::from(self.job.settings.samples)
    }

    fn pixels(&self) -> usize {
        self.job.tiles.iter().map(|tile| tile.pixels()).sum()
    }

    fn class(&self) -> JobClass {
        JobClass {
            samples: self.job.settings.samples,
            max_depth: self.job.settings.max_depth,
            pixels_log2: self.pixels().max(1).ilog2(),
        }
    }
}

impl Tracer for MultiDeviceTracer {
    /// The first healthy device's kind, and the names of all with what is wrong with them.
    fn info(&self) -> DeviceInfo {
        let healthy: Vec<_> = self
            .devices
            .iter()
            .filter(|device| device.fault().is_none())
            .collect();
        let first = healthy.first().copied().unwrap_or(&self.devices[0]);
        let names = healthy.iter().map(|device| device.tracer.info().name);
        let mut name = names.collect::<Vec<_>>().join(" + ");
        if name.is_empty() {
            name = "no device".to_owned();
        }
        let faults = self.devices.iter().filter_map(Device::fault);
        for why in faults.chain(self.absent.iter().cloned()) {
            name = format!("{name}; not used: {why}");
        }
        name.truncate(name.floor_char_boundary(NODE_NAME_BYTES_MAX));
        DeviceInfo {
            name,
            ..first.tracer.info()
        }
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        self.trace_into(scene, job, JobSink::Radiance(sink))
    }

    fn trace_srgb8(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        exposure: f32,
        sink: &(dyn Fn(TileSrgb8) + Sync),
    ) -> Result<TraceStats, Error> {
        self.trace_into(scene, job, JobSink::Srgb8(exposure, sink))
    }

    /// The first device that can finds all of them.
    fn aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        for index in self.usable() {
            let device = &self.devices[index];
            let found = Mutex::new(Vec::new());
            let keep = |tile| lock(&found).push(tile);
            match device.tracer.aovs(scene, job, &keep) {
                Ok(()) => {
                    let found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
                    found.into_iter().for_each(sink);
                    return Ok(());
                }
                Err(Error::Device {
                    device: name,
                    message,
                }) => device.fail(format!("{name}: {message}")),
                Err(error) => return Err(error),
            }
        }
        Err(self.all_failed())
    }
}

impl Device {
    /// Traces some tiles of a job. A panic is the device's fault.
    fn trace(&self, work: &JobProgress<'_>, places: &[usize]) -> Result<TraceStats, Error> {
        let tiles: Vec<Tile> = places.iter().map(|&place| work.job.tiles[place]).collect();
        let job = TraceJob {
            tiles: &tiles,
            ..*work.job
        };
        // A device that hands a tile over twice, or has failed after it did: the first counts.
        let is_first = |index: usize| !work.done[index].swap(true, Ordering::Relaxed);
        let traced = catch_unwind(AssertUnwindSafe(|| match work.sink {
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
        }));
        traced.unwrap_or_else(|_| {
            Err(Error::Device {
                device: self.tracer.info().name,
                message: "its tracer panicked".to_owned(),
            })
        })
    }

    /// A device that has rested is tried again: memory may be free again. A lost device fails at
    /// once, and its tiles are traced elsewhere again.
    fn is_usable(&self) -> bool {
        let fault = self.lock();
        fault
            .as_ref()
            .is_none_or(|fault| fault.since.elapsed() >= fault.rest)
    }

    fn fail(&self, why: String) {
        let mut fault = self.lock();
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

    fn recover(&self) {
        if self.lock().take().is_some() {
            tracing::info!("{} is used again", self.tracer.info().name);
        }
    }

    fn fault(&self) -> Option<String> {
        self.lock().as_ref().map(|fault| fault.why.clone())
    }

    fn lock(&self) -> MutexGuard<'_, Option<DeviceFault>> {
        lock(&self.fault)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Cuts tiles into contiguous runs whose pixels are in the proportion of `shares`.
fn cut(tiles: &[Tile], shares: &[f64]) -> Vec<Range<usize>> {
    let pixels: f64 = tiles.iter().map(|tile| tile.pixels() as f64).sum();
    let total: f64 = shares.iter().sum();
    let (mut begin, mut filled, mut wanted) = (0, 0.0, 0.0);
    let mut runs = Vec::with_capacity(shares.len());
    for share in shares {
        wanted += share / total * pixels;
        let mut end = begin;
        // A tile goes to whoever gets the larger part of it.
        while end < tiles.len() && filled + 0.5 * tiles[end].pixels() as f64 <= wanted {
            filled += tiles[end].pixels() as f64;
            end += 1;
        }
        runs.push(begin..end);
        begin = end;
    }
    if let Some(last) = runs.iter_mut().rev().find(|run| run.start < run.end) {
        last.end = tiles.len(); // rounding
    }
    runs
}

fn sum(mut a: TraceStats, b: TraceStats) -> TraceStats {
    a += b;
    a
}

/// How long a device rests after its first failure; it doubles with each further one.
const REST_MIN: Duration = Duration::from_secs(1);
const REST_MAX: Duration = Duration::from_secs(64);
