//! A node's worker: traces requests one after the other, and sends their tiles in groups as they
//! are finished.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::tile_codec::{Encoder, TilePixels};
use carom_protocol::{NodeTimes, RefusalReason, RequestReport, TilesDone};
use carom_tracer::{Error, Tile, TileRadiance, TileRange, TraceJob, Tracer};

use super::client_connection::TileSharing;
use super::queue::{JobQueue, NodeJob};

/// Starts a worker thread; it ends when the queue is closed.
pub(super) fn start(queue: Arc<JobQueue>, tracer: Arc<dyn Tracer>) {
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
    if let Err(error) = thread.spawn(work) {
        tracing::error!("cannot start a worker's thread: {error}");
        queue.worker_ends();
    }
}

/// A request that is being traced.
struct ActiveJob<'a> {
    queue: &'a JobQueue,
    job: &'a NodeJob,
    begun: Instant,
    tiles: Vec<Tile>,
    groups: Vec<Mutex<TileGroup>>,
    encode_nanos: AtomicU64,
}

/// The tiles of one message.
struct TileGroup {
    radiance: Vec<Option<Vec<[f32; 3]>>>,
    missing: usize,
    dropped_samples: u32,
}

/// Traces a request and reports the outcome to its client.
fn run(queue: &JobQueue, tracer: &dyn Tracer, job: &NodeJob) {
    let active = ActiveJob::new(queue, job);
    // A bug in a tracer or a driver must cost one request, not the node of four players.
    let traced = catch_unwind(AssertUnwindSafe(|| active.trace(tracer)));
    let id = job.request.id;
    match traced {
        Ok(Ok(())) if job.cancelled.load(Ordering::Relaxed) => {
            job.client.refuse(id, RefusalReason::Cancelled);
        }
        Ok(Ok(())) => job.client.request_done(active.report()),
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

impl<'a> ActiveJob<'a> {
    fn new(queue: &'a JobQueue, job: &'a NodeJob) -> Self {
        let tiles: Vec<Tile> = job.request.grid.tiles(job.request.tiles).collect();
        let group = |tiles: &[Tile]| {
            Mutex::new(TileGroup {
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

    /// Traces the whole request in one call, as a GPU is fast only on many tiles; groups are
    /// encoded meanwhile, on rayon's threads, as they become complete.
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
        // The tracer stays on this thread; only encoding goes to rayon's.
        rayon::in_place_scope(|encoders| {
            let sink = |tile: TileRadiance| {
                if let Some((first, group)) = self.collect(tile) {
                    let traced = Instant::now();
                    // Backpressure: blocks the tracer, so that traced pixels cannot pile up.
                    self.job.client.wait_for_room(&self.job.cancelled);
                    encoders.spawn(move |_| self.send(first, &group, traced));
                }
            };
            tracer.trace(&scene, &job, &sink).map(drop)
        })
    }

    /// Adds a tile to its group; returns the group when it is complete, with the index of its first
    /// tile.
    fn collect(&self, tile: TileRadiance) -> Option<(usize, TileGroup)> {
        let index = tile.index / GROUP_TILES;
        let mut group = self.groups[index]
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let slot = &mut group.radiance[tile.index % GROUP_TILES];
        if slot.is_some() {
            return None; // a tracer that delivers a tile twice: the first one counts
        }
        *slot = Some(tile.radiance);
        group.missing -= 1;
        group.dropped_samples = group.dropped_samples.saturating_add(tile.dropped_samples);
        if group.missing > 0 {
            return None;
        }
        let complete = TileGroup {
            radiance: std::mem::take(&mut group.radiance),
            ..*group
        };
        Some((index * GROUP_TILES, complete))
    }

    /// Encodes and sends a group of tiles, the last of which was `traced` then.
    fn send(&self, first: usize, group: &TileGroup, traced: Instant) {
        // Encoding may start long after tracing if all of rayon's threads are busy.
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
        let client = &self.job.client;
        let encode = |encoder: &mut Encoder| client.encode(encoder, request, part, &tiles);
        let (pixels, shared) = match client.sharing {
            TileSharing::Encoded => (ENCODER.with_borrow_mut(encode), None),
            TileSharing::InMemory => (Vec::new(), Some(TilePixels::of(request.format, &tiles))),
        };
        let nanos = begun.elapsed().as_nanos() as u64;
        self.encode_nanos.fetch_add(nanos, Ordering::Relaxed);
        let done = TilesDone {
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
        };
        client.tiles(done, shared);
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
    /// One for each thread: its buffers and its zstd context are reused.
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
