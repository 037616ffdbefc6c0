//! Traces runs, one after the other, and sends their tiles in groups as they are finished.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::tile_codec::Encoder;
use carom_protocol::{NodeTimes, RefusalReason, RequestReport, TilesDone};
use carom_tracer::{Error, Tile, TileRadiance, TileRange, TraceJob, Tracer};

use super::queue::{Job, Queue};

/// Starts a worker thread; it ends when the queue is closed.
pub(super) fn start(queue: Arc<Queue>, tracer: Arc<dyn Tracer>) {
    queue.worker_starts();
    let work = {
        let queue = Arc::clone(&queue);
        move || {
            let mut done = None;
            while let Some(job) = queue.next(done.as_ref()) {
                run(&queue, &*tracer, &job);
                done = Some(job.cancelled);
            }
            // A driver must not be torn down by a process that is exiting meanwhile.
            drop(tracer);
            queue.worker_ends();
        }
    };
    let thread = std::thread::Builder::new().name("carom-node".into());
    if let Err(why) = thread.spawn(work) {
        tracing::error!("no thread for a node's worker: {why}");
        queue.worker_ends();
    }
}

/// A run being traced.
struct Running<'a> {
    queue: &'a Queue,
    job: &'a Job,
    begun: Instant,
    tiles: Vec<Tile>,
    groups: Vec<Mutex<Group>>,
    encode_nanos: AtomicU64,
}

/// Tiles that travel together.
struct Group {
    radiance: Vec<Option<Vec<[f32; 3]>>>,
    missing: usize,
    dropped_samples: u32,
}

/// Traces a run and tells its client how it went.
fn run(queue: &Queue, tracer: &dyn Tracer, job: &Job) {
    let running = Running::new(queue, job);
    let traced = catch_unwind(AssertUnwindSafe(|| running.trace(tracer)));
    let id = job.request.id;
    match traced {
        Ok(Ok(())) if job.cancelled.load(Ordering::Relaxed) => {
            job.client.refuse(id, RefusalReason::Cancelled);
        }
        Ok(Ok(())) => job.client.request_done(running.report()),
        Ok(Err(why @ Error::InvalidScene(_) | why @ Error::InvalidUpdate(_))) => {
            job.client
                .refuse(id, RefusalReason::Invalid(why.to_string()));
        }
        Ok(Err(why)) => job
            .client
            .refuse(id, RefusalReason::Device(why.to_string())),
        Err(panic) => {
            let why = format!("the tracer panicked: {}", panic_message(&*panic));
            job.client.refuse(id, RefusalReason::Device(why));
        }
    }
}

impl<'a> Running<'a> {
    fn new(queue: &'a Queue, job: &'a Job) -> Self {
        let tiles: Vec<Tile> = job.request.grid.tiles(job.request.tiles).collect();
        let group = |tiles: &[Tile]| {
            Mutex::new(Group {
                radiance: vec![None; tiles.len()],
                missing: tiles.len(),
                dropped_samples: 0,
            })
        };
        Self {
            queue,
            job,
            begun: Instant::now(),
            groups: tiles.chunks(GROUP_TILES).map(group).collect(),
            tiles,
            encode_nanos: AtomicU64::new(0),
        }
    }

    /// One call of the tracer for the whole run, which is what a GPU is quick at; groups of tiles
    /// are encoded beside it, on rayon's threads, as they become whole.
    fn trace(&self, tracer: &dyn Tracer) -> Result<(), Error> {
        let request = &self.job.request;
        let mut scene = self.queue.compiled(request.scene, &self.job.scene)?;
        scene.apply(&request.update)?;
        let job = TraceJob {
            size: request.size(),
            tiles: &self.tiles,
            settings: request.settings,
            cancelled: &self.job.cancelled,
        };
        rayon::in_place_scope(|encoders| {
            let sink = |tile: TileRadiance| {
                if let Some((first, group)) = self.collect(tile) {
                    let traced = Instant::now();
                    self.job.client.wait_for_room(&self.job.cancelled);
                    encoders.spawn(move |_| self.send(first, &group, traced));
                }
            };
            tracer.trace(&scene, &job, &sink).map(drop)
        })
    }

    /// Puts a tile into its group; hands the group out when it is whole, with its first tile.
    fn collect(&self, tile: TileRadiance) -> Option<(usize, Group)> {
        let index = tile.index / GROUP_TILES;
        let mut group = self.groups[index]
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let slot = &mut group.radiance[tile.index % GROUP_TILES];
        if slot.is_some() {
            return None; // a tracer that hands a tile over twice: the first one counts
        }
        *slot = Some(tile.radiance);
        group.missing -= 1;
        group.dropped_samples = group.dropped_samples.saturating_add(tile.dropped_samples);
        if group.missing > 0 {
            return None;
        }
        let whole = Group {
            radiance: std::mem::take(&mut group.radiance),
            ..*group
        };
        Some((index * GROUP_TILES, whole))
    }

    /// Encodes and sends a group of tiles, the last of which was `traced` then.
    fn send(&self, first: usize, group: &Group, traced: Instant) {
        if self.job.cancelled.load(Ordering::Relaxed) {
            return;
        }
        let begun = Instant::now();
        let request = &self.job.request;
        let tiles = self.tiles[first..].iter().copied();
        let radiance = group
            .radiance
            .iter()
            .map(|tile| tile.as_deref().unwrap_or_default());
        let tiles: Vec<(Tile, &[[f32; 3]])> = tiles.zip(radiance).collect();
        let part = TileRange {
            first: request.tiles.first + first as u32,
            count: tiles.len() as u32,
        };
        let encode = |encoder: &mut Encoder| self.job.client.encode(encoder, request, part, &tiles);
        let pixels = ENCODER.with_borrow_mut(encode);
        let nanos = begun.elapsed().as_nanos() as u64;
        self.encode_nanos.fetch_add(nanos, Ordering::Relaxed);
        self.job.client.tiles(TilesDone {
            request: request.id,
            tiles: part,
            busy_micros: micros(self.queue.busy_since(self.begun)),
            times: NodeTimes {
                queue_micros: self.queue_micros(),
                trace_micros: micros(traced.saturating_duration_since(self.begun)),
                encode_micros: micros(traced.elapsed()),
            },
            dropped_samples: group.dropped_samples,
            pixels,
        });
    }

    fn queue_micros(&self) -> u32 {
        micros(self.begun.saturating_duration_since(self.job.arrived))
    }

    fn report(&self) -> RequestReport {
        let encode = Duration::from_nanos(self.encode_nanos.load(Ordering::Relaxed));
        RequestReport {
            request: self.job.request.id,
            queue_micros: self.queue_micros(),
            trace_micros: micros(self.begun.elapsed()),
            encode_micros: micros(encode),
        }
    }
}

thread_local! {
    /// Its buffers and its zstd context are used again.
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
