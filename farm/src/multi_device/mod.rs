//! Tracer that uses several devices of one machine, all its GPUs and its CPU, for one frame.
//!
//! ```text
//! job ──device_model: water_fill──▶ a contiguous range of tiles per device ──Tracer::trace──▶ sink
//!                           └ what a failed device leaves is traced by the others
//! ```
//!
//! The split is that of frames among nodes ([`crate::balancer`]): each device's cost y = A + B·w, learned
//! from its own shares, and the earliest common finish over these costs. A device that does not make frames
//! shorter is left out ([`device_model`]). A failed device rests for a while, and the tracer's name states
//! the reason, so that a fallback is visible wherever the device is named.
//!
//! A device that is not ready, such as a GPU whose kernels for a scene are not compiled, is prepared in a
//! separate thread with a tile of the job while a ready one traces; what is left of the job then goes to
//! the first usable device.

mod device;
mod device_model;

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::limits::NODE_NAME_BYTES_MAX;
use carom_tracer::{
    CompiledScene, DeviceInfo, Error, RenderSettings, Tile, TileAovs, TileRadiance, TileSrgb8,
    TraceJob, TraceStats, Tracer,
};
use device::Device;
use device_model::{DeviceTiming, JobClass, JobModels};

use crate::lock::lock;

/// Tracer that divides each job among several devices.
pub struct MultiDeviceTracer {
    devices: Vec<Device>,
    models: Mutex<JobModels>,
    /// Reasons why other devices of the machine are not among these.
    absent: Vec<String>,
}

/// The tiles of a job for one device, as indices into the job's tiles.
struct DeviceShare {
    device: usize,
    tiles: Vec<usize>,
}

impl MultiDeviceTracer {
    /// Jobs of a class until the trials of one device and of all are finished.
    pub const JOBS_UNTIL_SETTLED: u32 = 2 * device_model::TRIAL_JOBS;

    /// Combines `devices`, the fastest first: it traces alone until the others are known. `absent` gives
    /// for each unusable device the reason.
    ///
    /// # Panics
    /// If `devices` is empty.
    pub fn new(devices: Vec<Arc<dyn Tracer>>, absent: Vec<String>) -> Self {
        assert!(!devices.is_empty(), "a tracer of no device");
        let models = Mutex::new(JobModels::new(devices.len()));
        Self {
            devices: devices.into_iter().map(Device::new).collect(),
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
        let is_ready = |&index: &usize| self.devices[index].tracer.is_ready(scene, &job.settings);
        let (ready, unready): (Vec<_>, Vec<_>) = usable.iter().partition(|index| is_ready(index));
        // While kernels compile, a ready device traces alone; with none ready, all have to wait for their
        // own.
        let is_meanwhile = !ready.is_empty() && !unready.is_empty();
        let begun = Instant::now();
        let mut stats = TraceStats::default();
        let mut parts = if is_meanwhile {
            let left;
            (stats, left) = self.trace_meanwhile(&work, ready[0], &unready)?;
            match self.usable().first() {
                Some(&device) if !left.is_empty() => vec![DeviceShare {
                    device,
                    tiles: left,
                }],
                Some(_) => Vec::new(),
                None => return Err(self.all_failed()),
            }
        } else {
            self.parts(&work, &usable)
        };
        let together = parts.len() > 1;
        // Each round passes what failed devices have left to another one, until nothing is left or no
        // device is usable.
        while !parts.is_empty() {
            stats = sum(stats, self.trace_parts(&work, &mut parts)?);
            let left: Vec<usize> = parts.into_iter().flat_map(|part| part.tiles).collect();
            if left.is_empty() {
                break;
            }
            parts = vec![self.retrace_failed(left)?];
        }
        // A job that waited for a compilation, or was cancelled, does not show how long such jobs take.
        if !is_meanwhile && !job.cancelled.load(Ordering::Relaxed) {
            let secs = begun.elapsed().as_secs_f64();
            lock(&self.models)
                .get_mut(work.class())
                .judge(work.total(), secs, together);
        }
        Ok(stats)
    }

    /// Indices of the devices that may be used now.
    fn usable(&self) -> Vec<usize> {
        let usable = |index: &usize| self.devices[*index].is_usable();
        (0..self.devices.len()).filter(usable).collect()
    }

    /// Traces with `device` until the `unready` ones are prepared for the job. Returns the tiles left then,
    /// none if the job is cancelled. Nothing is learned from it, as later jobs are divided differently.
    fn trace_meanwhile(
        &self,
        work: &JobProgress<'_>,
        device: usize,
        unready: &[usize],
    ) -> Result<(TraceStats, Vec<usize>), Error> {
        for &index in unready {
            self.devices[index].prepare(work.scene, work.job);
        }
        let are_prepared = || {
            let mut settled = unready
                .iter()
                .map(|&index| self.devices[index].is_prepared());
            settled.all(|is_prepared| is_prepared)
        };
        let is_cancelled = || work.job.cancelled.load(Ordering::Relaxed);
        // A watcher interrupts the trace once the other devices are prepared; `finished` ends the watcher
        // if the trace ends first.
        let [interrupted, finished] = [(), ()].map(|()| AtomicBool::new(false));
        let mut part = DeviceShare {
            device,
            tiles: (0..work.job.tiles.len()).collect(),
        };
        let stats = std::thread::scope(|scope| {
            scope.spawn(|| {
                while !finished.load(Ordering::Relaxed) && !is_cancelled() && !are_prepared() {
                    std::thread::sleep(PREPARATION_PAUSE);
                }
                interrupted.store(true, Ordering::Relaxed);
            });
            let stats = self.attempt(work, &mut part, &interrupted);
            finished.store(true, Ordering::Relaxed);
            stats
        })?;
        let mut left = part.tiles;
        left.retain(|&tile| !is_cancelled() && !work.done[tile].load(Ordering::Relaxed));
        Ok((stats.unwrap_or_default(), left))
    }

    /// Traces all parts concurrently. Tiles that a device has failed to trace remain in its part.
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
    /// Errors that are not the device's fault.
    fn trace_part(
        &self,
        work: &JobProgress<'_>,
        part: &mut DeviceShare,
    ) -> Result<TraceStats, Error> {
        let begun = Instant::now();
        let Some(stats) = self.attempt(work, part, work.job.cancelled)? else {
            return Ok(TraceStats::default());
        };
        if !work.job.cancelled.load(Ordering::Relaxed) {
            let secs = begun.elapsed().as_secs_f64();
            let timing = DeviceTiming::new(work.of(&part.tiles), secs, stats.device_nanos);
            lock(&self.models)
                .get_mut(work.class())
                .learn(part.device, &timing);
            self.devices[part.device].recover();
        }
        part.tiles.clear();
        Ok(stats)
    }

    /// Traces a part with its device until `cancelled`. `None` if the device fails: the untraced tiles then
    /// remain in the part.
    ///
    /// # Errors
    /// Errors that are not the device's fault.
    fn attempt(
        &self,
        work: &JobProgress<'_>,
        part: &mut DeviceShare,
        cancelled: &AtomicBool,
    ) -> Result<Option<TraceStats>, Error> {
        let device = &self.devices[part.device];
        match device.trace(work, &part.tiles, cancelled) {
            Ok(stats) => Ok(Some(stats)),
            Err(why @ Error::Device { .. }) => {
                device.fail(&why);
                part.tiles
                    .retain(|&tile| !work.done[tile].load(Ordering::Relaxed));
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// Divides a whole job among the `usable` devices.
    fn parts(&self, work: &JobProgress<'_>, usable: &[usize]) -> Vec<DeviceShare> {
        let shares = lock(&self.models)
            .get_mut(work.class())
            .divide(work.total(), usable);
        let runs = cut(work.job.tiles, &shares);
        let parts = usable.iter().zip(runs).map(|(&device, run)| DeviceShare {
            device,
            tiles: run.collect(),
        });
        parts.filter(|part| !part.tiles.is_empty()).collect()
    }

    /// Assigns the tiles that a failed device has left to the last usable device, which is the CPU where
    /// there is one.
    ///
    /// # Errors
    /// [`Error::Device`] with all faults if no device is left.
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
}

/// Destination and format of a job's tiles.
#[derive(Clone, Copy)]
enum JobSink<'a> {
    Radiance(&'a (dyn Fn(TileRadiance) + Sync)),
    /// sRGB of the given exposure.
    Srgb8(f32, &'a (dyn Fn(TileSrgb8) + Sync)),
}

/// A job and its progress.
struct JobProgress<'a> {
    scene: &'a CompiledScene,
    job: &'a TraceJob<'a>,
    sink: JobSink<'a>,
    /// By index of a tile in the job: whether it has been delivered.
    done: Vec<AtomicBool>,
}

impl JobProgress<'_> {
    /// Pixel samples of some of the tiles.
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
    /// Kind of the first healthy device, and the names of all with their faults.
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

    /// Whether all usable devices are ready.
    fn is_ready(&self, scene: &CompiledScene, settings: &RenderSettings) -> bool {
        let is_ready = |index: usize| self.devices[index].tracer.is_ready(scene, settings);
        self.usable().into_iter().all(is_ready)
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

    /// Traces the AOVs with the first device that succeeds.
    fn aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        for index in self.usable() {
            let device = &self.devices[index];
            // Collected first: a device that fails midway must not have passed anything to the sink.
            let found = Mutex::new(Vec::new());
            let keep = |tile| lock(&found).push(tile);
            match device.tracer.aovs(scene, job, &keep) {
                Ok(()) => {
                    let found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
                    found.into_iter().for_each(sink);
                    return Ok(());
                }
                Err(why @ Error::Device { .. }) => device.fail(&why),
                Err(error) => return Err(error),
            }
        }
        Err(self.all_failed())
    }
}

/// Cuts tiles into contiguous runs whose pixel counts are in proportion to `shares`.
fn cut(tiles: &[Tile], shares: &[f64]) -> Vec<Range<usize>> {
    let pixels: f64 = tiles.iter().map(|tile| tile.pixels() as f64).sum();
    let total: f64 = shares.iter().sum();
    let (mut begin, mut filled, mut wanted) = (0, 0.0, 0.0);
    let mut runs = Vec::with_capacity(shares.len());
    for share in shares {
        wanted += share / total * pixels;
        let mut end = begin;
        // A tile goes to the run that gets the larger part of it.
        while end < tiles.len() && filled + 0.5 * tiles[end].pixels() as f64 <= wanted {
            filled += tiles[end].pixels() as f64;
            end += 1;
        }
        runs.push(begin..end);
        begin = end;
    }
    if let Some(last) = runs.iter_mut().rev().find(|run| run.start < run.end) {
        last.end = tiles.len(); // rounding may leave tiles over
    }
    runs
}

fn sum(mut a: TraceStats, b: TraceStats) -> TraceStats {
    a += b;
    a
}

/// Polling interval of preparations.
const PREPARATION_PAUSE: Duration = Duration::from_millis(1);
