//! Worker of a node: traces requests slice by slice, and sends their tiles in groups as they finish.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::tile_codec::{Encoder, TilePixels};
use carom_protocol::{NodeTimes, PixelFormat, RefusalReason, RequestReport, TilesDone};
use carom_tracer::{
    CompiledScene, Error, RenderSettings, SceneUpdate, Tile, TileRadiance, TileRange, TraceJob,
    Tracer,
};

use super::client_connection::TileSharing;
use super::cost::{COST_ADVICE, UNDIVIDED_SECS_MAX};
use super::job::NodeJob;
use super::queue::{BLOCK_SECS_MAX, BLOCK_STOPS_MAX, JobQueue, Turn, TurnWork};
use crate::lock::lock;

/// Starts a worker thread; it ends when the queue is closed.
pub(super) fn start(queue: Arc<JobQueue>, tracer: Arc<dyn Tracer>) {
    queue.worker_starts();
    let work = {
        let queue = Arc::clone(&queue);
        move || {
            while let Some(turn) = queue.next() {
                run(&queue, &*tracer, &turn);
            }
            // The tracer is dropped before the worker counts as ended: its driver must not be torn down
            // while the process exits.
            drop(tracer);
            queue.worker_ends();
        }
    };
    let thread = std::thread::Builder::new().name("carom-node".into());
    if let Err(error) = thread.spawn(work) {
        tracing::error!("cannot start a worker's thread: {error}");
        queue.worker_ends();
    }
}

/// Starts the watchdog thread, which stops turns that take too long; it ends when the queue is closed.
pub(super) fn start_watch(queue: Arc<JobQueue>) {
    let thread = std::thread::Builder::new().name("carom-node-watch".into());
    if let Err(error) = thread.spawn(move || queue.watch()) {
        tracing::error!("cannot start the thread that stops long requests: {error}");
    }
}

/// Starts the thread that compiles scenes; it ends when the queue is closed.
pub(super) fn start_compiler(queue: Arc<JobQueue>) {
    let compile = move || {
        while let Some(job) = queue.scenes.next() {
            let compiled = catch_unwind(AssertUnwindSafe(|| queue.scenes.compile(&job)));
            let compiled = compiled.unwrap_or_else(|panic| {
                let why = format!("its scene: a panic: {}", panic_message(&*panic));
                Err(RefusalReason::Device(why))
            });
            match compiled {
                Ok(scene) => queue.push_compiled(job, scene),
                Err(why) => job.client.refuse(job.request.id, why),
            }
        }
    };
    let thread = std::thread::Builder::new().name("carom-compile".into());
    if let Err(error) = thread.spawn(compile) {
        tracing::error!("cannot start the thread that compiles scenes: {error}");
    }
}

/// Executes a turn and reports a failure to its client.
fn run(queue: &JobQueue, tracer: &dyn Tracer, turn: &Turn) {
    let begun = Instant::now();
    let job = &turn.job;
    // A bug in a tracer or a driver must cost one request, not the node of all players.
    let done = catch_unwind(AssertUnwindSafe(|| match &turn.work {
        TurnWork::Probe => probe(queue, tracer, turn),
        TurnWork::Trace(tiles) => trace(queue, tracer, turn, *tiles, None),
        TurnWork::TracePart(tile, part) => {
            let (first, count) = (*tile, 1);
            trace(queue, tracer, turn, TileRange { first, count }, Some(*part))
        }
        TurnWork::Refuse(why) => {
            let why = RefusalReason::Invalid(why.clone());
            job.client.refuse(job.request.id, why);
            Ok(())
        }
    }));
    let why = match done {
        Ok(Ok(())) => None,
        Ok(Err(why @ Error::InvalidScene(_) | why @ Error::InvalidUpdate(_))) => {
            Some(RefusalReason::Invalid(why.to_string()))
        }
        Ok(Err(why)) => Some(RefusalReason::Device(why.to_string())),
        Err(panic) => {
            let why = format!("the tracer panicked: {}", panic_message(&*panic));
            Some(RefusalReason::Device(why))
        }
    };
    if let Some(why) = why {
        give_up(queue, job, why);
    }
    queue.finish(turn, begun.elapsed());
}

/// Refuses the rest of a job.
fn give_up(queue: &JobQueue, job: &NodeJob, why: RefusalReason) {
    job.client.refuse(job.request.id, why);
    job.cancelled.store(true, Ordering::Relaxed);
    queue.drop_cancelled();
}

/// Refuses a job of which an indivisible piece takes too long.
fn give_up_piece(queue: &JobQueue, job: &NodeJob, piece: &str, secs_max: f64) {
    let why = format!("{piece} of it takes longer than {secs_max} s here: {COST_ADVICE}");
    give_up(queue, job, RefusalReason::Invalid(why));
}

/// Whether a stopped tile, or part of one, may be traced again: in smaller parts, or as it is.
fn may_resume(job: &NodeJob, tile: u32, part: Tile) -> bool {
    let stops = job.note_stop(tile);
    job.is_divisible(part) || (job.is_denoised() && stops < BLOCK_STOPS_MAX)
}

/// Traces a slice: a range of tiles, or a part of one. What it leaves unfinished is queued again.
fn trace(
    queue: &JobQueue,
    tracer: &dyn Tracer,
    turn: &Turn,
    tiles: TileRange,
    part: Option<Tile>,
) -> Result<(), Error> {
    let job = &turn.job;
    let slice = ActiveSlice::new(queue, turn, tiles, part);
    slice.trace(tracer)?;
    let is_cancelled = job.cancelled.load(Ordering::Relaxed);
    let left = slice.left();
    if !is_cancelled && !left.is_empty() {
        let is_part_done = slice.part_is_done.load(Ordering::Relaxed);
        let is_stopped = turn.stop.load(Ordering::Relaxed) && !is_part_done;
        // A stopped slice of several tiles is simply queued again; a single tile or part must become
        // smaller, or may be retried if it is an indivisible block.
        let lone = part.or((tiles.count == 1).then_some(slice.tiles[0]));
        if is_stopped && lone.is_some_and(|part| !may_resume(job, tiles.first, part)) {
            match job.is_denoised() {
                true => give_up_piece(queue, job, "a block of 8x8 pixels", BLOCK_SECS_MAX),
                false => give_up_piece(queue, job, "a pixel", UNDIVIDED_SECS_MAX),
            }
        } else {
            let left_tiles = left.iter().map(|range| range.count).sum::<u32>();
            job.finish(tiles.count - left_tiles);
            queue.put_back(job, left);
        }
    } else if job.finish(tiles.count) {
        match is_cancelled {
            // Its client has cancelled it, or accepted no tiles and may request them again.
            true => job.client.refuse(job.request.id, RefusalReason::Busy),
            false => job.client.request_done(job.report()),
        }
    }
    Ok(())
}

/// Traces a few pixels in the middle of a request with one sample each, to estimate its cost.
fn probe(queue: &JobQueue, tracer: &dyn Tracer, turn: &Turn) -> Result<(), Error> {
    let job = &turn.job;
    let scene = job.updated(queue)?;
    let tiles = job.request.tiles;
    let tile = job.request.grid.tile(tiles.first + tiles.count / 2);
    let tile = Tile {
        width: tile.width.min(PROBE_EDGE),
        height: tile.height.min(PROBE_EDGE),
        ..tile
    };
    let trace_job = TraceJob {
        size: job.request.size(),
        tiles: &[tile],
        settings: RenderSettings {
            samples: 1,
            denoise: false,
            ..job.request.settings
        },
        cancelled: &turn.stop,
    };
    let begun = Instant::now();
    tracer.trace(&scene, &trace_job, &|_| ())?;
    match turn.stop.load(Ordering::Relaxed) {
        false => queue.set_cost(job, tile.pixels() as f64, begun.elapsed(), true),
        true if job.cancelled.load(Ordering::Relaxed) => {}
        true => give_up_piece(queue, job, "a probe", UNDIVIDED_SECS_MAX),
    }
    Ok(())
}

impl NodeJob {
    /// The scene with the request's update, created for the first slice.
    fn updated(self: &Arc<Self>, queue: &JobQueue) -> Result<Arc<CompiledScene>, Error> {
        if self.request.update == SceneUpdate::default() {
            return Ok(Arc::clone(&self.base));
        }
        let mut compiled = lock(&self.compiled);
        if let Some(scene) = &*compiled {
            return Ok(Arc::clone(scene));
        }
        let mut scene = CompiledScene::clone(&self.base);
        scene.apply(&self.request.update)?;
        let scene = Arc::clone(compiled.insert(Arc::new(scene)));
        drop(compiled);
        queue.note_updated(self);
        Ok(scene)
    }

    /// Start of its first slice; set to now on the first call.
    fn begin(&self) -> Instant {
        *self.begun.get_or_init(Instant::now)
    }

    fn queue_micros(&self) -> u32 {
        micros(self.begin().saturating_duration_since(self.arrived))
    }

    fn report(&self) -> RequestReport {
        let encode = Duration::from_nanos(self.encode_nanos.load(Ordering::Relaxed));
        RequestReport {
            request: self.request.id,
            queue_micros: self.queue_micros(),
            trace_micros: micros(self.begin().elapsed()),
            encode_micros: micros(encode),
        }
    }
}

/// A part of a request while it is traced.
struct ActiveSlice<'a> {
    queue: &'a JobQueue,
    job: &'a Arc<NodeJob>,
    stop: &'a AtomicBool,
    begun: Instant,
    first: u32,
    tiles: Vec<Tile>,
    /// The part of the only tile that is traced, if not all of it.
    part: Option<Tile>,
    part_is_done: AtomicBool,
    groups: Vec<Mutex<TileGroup>>,
    /// Whether backpressure of the network has blocked the tracer.
    stalled: AtomicBool,
}

/// The tiles of one message, while they complete.
struct TileGroup {
    pixels: Vec<Option<TracedPixels>>,
    missing: usize,
    dropped_samples: u32,
}

/// Pixels of a tile: encoded by the tracer as sRGB where the client shares this process's memory, else
/// radiance.
#[derive(Clone)]
enum TracedPixels {
    Radiance(Vec<[f32; 3]>),
    Srgb8(Vec<[u8; 3]>),
}

impl<'a> ActiveSlice<'a> {
    fn new(queue: &'a JobQueue, turn: &'a Turn, tiles: TileRange, part: Option<Tile>) -> Self {
        let (job, first) = (&turn.job, tiles.first);
        let tiles: Vec<Tile> = job.request.grid.tiles(tiles).collect();
        let group = |tiles: &[Tile]| {
            Mutex::new(TileGroup {
                pixels: vec![None; tiles.len()],
                missing: tiles.len(),
                dropped_samples: 0,
            })
        };
        job.begin();
        Self {
            queue,
            job,
            stop: &turn.stop,
            begun: Instant::now(),
            first,
            groups: tiles.chunks(GROUP_TILES).map(group).collect(),
            tiles,
            part,
            part_is_done: AtomicBool::new(false),
            stalled: AtomicBool::new(false),
        }
    }

    /// Traces the whole slice in one call, as a GPU is efficient only on many tiles; complete groups are
    /// encoded concurrently on rayon's threads.
    fn trace(&self, tracer: &dyn Tracer) -> Result<(), Error> {
        if self.stop.load(Ordering::Relaxed) {
            return Ok(());
        }
        let request = &self.job.request;
        let scene = self.job.updated(self.queue)?;
        let job = TraceJob {
            size: request.size(),
            tiles: self.part.as_ref().map_or(&self.tiles, std::slice::from_ref),
            settings: request.settings,
            cancelled: self.stop,
        };
        let begun = Instant::now();
        // The tracer stays on this thread; only encoding moves to rayon's.
        rayon::in_place_scope(|encoders| {
            let take = |index: usize, pixels: TracedPixels, dropped_samples: u32| {
                // Called from the tracer's threads in any order; the call that completes a group sends it.
                if let Some((first, group)) = self.collect(index, pixels, dropped_samples) {
                    let traced = Instant::now();
                    // Backpressure: blocks the tracer, so that traced pixels cannot pile up.
                    if self.job.client.wait_for_room(&self.job.cancelled) {
                        self.stalled.store(true, Ordering::Relaxed);
                    }
                    if self.job.cancelled.load(Ordering::Relaxed) {
                        self.stop.store(true, Ordering::Relaxed);
                    }
                    encoders.spawn(move |_| self.send(first, &group, traced));
                }
            };
            let traced = match (request.format, self.job.client.sharing) {
                (PixelFormat::Srgb8 { exposure }, TileSharing::InMemory) if self.part.is_none() => {
                    tracer.trace_srgb8(&scene, &job, exposure, &|tile| {
                        take(
                            tile.index,
                            TracedPixels::Srgb8(tile.pixels),
                            tile.dropped_samples,
                        );
                    })
                }
                _ => tracer.trace(&scene, &job, &|tile| {
                    if let Some(tile) = self.completed(tile) {
                        let pixels = TracedPixels::Radiance(tile.radiance);
                        take(tile.index, pixels, tile.dropped_samples);
                    }
                }),
            };
            traced?;
            let is_wanted = !self.job.cancelled.load(Ordering::Relaxed);
            // Time blocked by the network does not belong to the scene's cost.
            if is_wanted && !self.stalled.load(Ordering::Relaxed) {
                let samples = self.samples_done();
                self.queue
                    .set_cost(self.job, samples, begun.elapsed(), false);
            }
            Ok(())
        })
    }

    /// The whole tile once its last part has been traced, `None` before.
    fn completed(&self, traced: TileRadiance) -> Option<TileRadiance> {
        let Some(part) = self.part else {
            return Some(traced);
        };
        // Relaxed suffices: only one call sees false, and the pixels are handed over under a lock.
        if self.part_is_done.swap(true, Ordering::Relaxed) {
            return None;
        }
        let mut partial = self.job.take_partial(self.first)?;
        partial.put(part, &traced);
        match partial.whole() {
            Ok((radiance, dropped_samples)) => Some(TileRadiance {
                index: 0,
                radiance,
                dropped_samples,
            }),
            Err(partial) => {
                self.job.keep_partial(partial);
                None
            }
        }
    }

    /// Samples that the measured time was spent on.
    fn samples_done(&self) -> f64 {
        let count = self.tiles.len() as u32;
        let all = match self.part {
            Some(part) => self.job.samples_of_part(part),
            None => self.job.samples(TileRange {
                first: self.first,
                count,
            }),
        };
        (all * self.share_done()).max(self.job.samples_per_pixel())
    }

    /// Share of the slice that has been traced: for a stopped one, the finished groups or an estimate of
    /// what was begun.
    fn share_done(&self) -> f64 {
        if self.part.is_some() {
            let is_done = self.part_is_done.load(Ordering::Relaxed);
            return if is_done { 1.0 } else { STOPPED_SHARE };
        }
        let pixels = |tile: &Tile| tile.pixels() as f64;
        let finished: f64 = self.finished().map(pixels).sum();
        let all: f64 = self.tiles.iter().map(pixels).sum();
        // A stopped slice has at least begun its first tile: without this floor its cost would be
        // unbounded.
        let begun = match self.tiles.len() {
            1 => STOPPED_SHARE * all,
            _ => pixels(&self.tiles[0]),
        };
        finished.max(begun) / all
    }

    /// Adds a tile to its group; returns the group when it is complete, with the index of its first
    /// tile.
    fn collect(
        &self,
        tile: usize,
        pixels: TracedPixels,
        dropped_samples: u32,
    ) -> Option<(usize, TileGroup)> {
        let index = tile / GROUP_TILES;
        let mut group = lock(&self.groups[index]);
        let slot = &mut group.pixels[tile % GROUP_TILES];
        if slot.is_some() {
            return None; // the tracer has delivered the tile twice: the first copy counts
        }
        *slot = Some(pixels);
        group.missing -= 1;
        group.dropped_samples = group.dropped_samples.saturating_add(dropped_samples);
        if group.missing > 0 {
            return None;
        }
        let complete = TileGroup {
            pixels: std::mem::take(&mut group.pixels),
            ..*group
        };
        Some((index * GROUP_TILES, complete))
    }

    /// Whether each group is complete, in order.
    fn complete(&self) -> impl Iterator<Item = bool> {
        self.groups.iter().map(|group| lock(group).missing == 0)
    }

    /// Tiles of the complete groups.
    fn finished(&self) -> impl Iterator<Item = &Tile> {
        let groups = self.tiles.chunks(GROUP_TILES).zip(self.complete());
        groups
            .filter(|(_, is_complete)| *is_complete)
            .flat_map(|(tiles, _)| tiles)
    }

    /// Tiles of the incomplete groups.
    fn left(&self) -> Vec<TileRange> {
        let mut first = self.first;
        let mut left = Vec::new();
        for (tiles, is_complete) in self.tiles.chunks(GROUP_TILES).zip(self.complete()) {
            let count = tiles.len() as u32;
            if !is_complete {
                left.push(TileRange { first, count });
            }
            first += count;
        }
        left
    }

    /// Encodes and sends a group of tiles, the last of which finished at `traced`.
    fn send(&self, first: usize, group: &TileGroup, traced: Instant) {
        // Encoding may start long after tracing if all of rayon's threads are busy.
        if self.job.cancelled.load(Ordering::Relaxed) {
            return;
        }
        let begun = Instant::now();
        let request = &self.job.request;
        let part = TileRange {
            first: self.first + first as u32,
            count: group.pixels.len() as u32,
        };
        let client = &self.job.client;
        let (mut radiance, mut shown) = (Vec::new(), Vec::new());
        for (tile, pixels) in self.tiles[first..].iter().zip(&group.pixels) {
            match pixels {
                Some(TracedPixels::Radiance(pixels)) => radiance.push((*tile, &pixels[..])),
                Some(TracedPixels::Srgb8(pixels)) => shown.push(&pixels[..]),
                None => {}
            }
        }
        let encode = |encoder: &mut Encoder| client.encode(encoder, request, part, &radiance);
        let (pixels, shared) = match client.sharing {
            TileSharing::Encoded => (ENCODER.with_borrow_mut(encode), None),
            TileSharing::InMemory if radiance.is_empty() => {
                (Vec::new(), Some(TilePixels::Srgb8(shown.concat())))
            }
            TileSharing::InMemory => {
                let pixels = TilePixels::of(request.format, &radiance);
                (Vec::new(), Some(pixels))
            }
        };
        let nanos = begun.elapsed().as_nanos() as u64;
        self.job.encode_nanos.fetch_add(nanos, Ordering::Relaxed);
        let done = TilesDone {
            request: request.id,
            tiles: part,
            busy_micros: micros(self.queue.busy_since(self.begun)),
            times: NodeTimes {
                queue_micros: self.job.queue_micros(),
                trace_micros: micros(traced.saturating_duration_since(self.job.begin())),
                encode_micros: micros(traced.elapsed()),
            },
            dropped_samples: group.dropped_samples,
            pixels,
        };
        client.tiles(done, shared);
    }
}

thread_local! {
    /// One per thread, to reuse its buffers and its zstd context.
    static ENCODER: RefCell<Encoder> = RefCell::new(Encoder::new());
}

fn micros(duration: Duration) -> u32 {
    u32::try_from(duration.as_micros()).unwrap_or(u32::MAX)
}

fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("it gave no reason")
}

const GROUP_TILES: usize = TILES_PER_MESSAGE_MAX as usize;
/// Assumed share of a stopped tile that has been traced: small, so that its estimated cost rises quickly.
const STOPPED_SHARE: f64 = 0.125;
/// Edge of a probe in pixels: a quarter of a millisecond of one core for most scenes.
const PROBE_EDGE: u32 = 16;
