//! The queue of requests that wait for the device: by turns of the players, the requests of one
//! client by frame, since the oldest is the next to be shown. They are traced in slices of
//! [`SLICE_SECS`], so that no player waits for another's whole request.
//!
//! A client's session admits at most `REQUESTS_QUEUED_MAX` of its requests. What a request costs is
//! known before it is traced, from [probes](Turn::Probe) and slices of its scene; one that costs too
//! much is refused.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::{SceneHash, TraceRequest};
use carom_tracer::{CompiledScene, Error, Scene, TileRange};

use super::client_connection::ClientConnection;
use super::fair_queue::FairQueue;

/// A request to trace.
pub(super) struct NodeJob {
    pub(super) client: Arc<ClientConnection>,
    pub(super) request: Box<TraceRequest>,
    pub(super) scene: Arc<Scene>,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) arrived: Instant,
    /// The time at which its first slice was begun.
    pub(super) begun: OnceLock<Instant>,
    /// The scene with the request's update.
    pub(super) compiled: Mutex<Option<Arc<CompiledScene>>>,
    pub(super) encode_nanos: AtomicU64,
    /// Tiles that are not finished.
    unfinished: AtomicU32,
}

impl NodeJob {
    pub(super) fn new(
        client: Arc<ClientConnection>,
        request: Box<TraceRequest>,
        scene: Arc<Scene>,
        cancelled: Arc<AtomicBool>,
    ) -> Self {
        Self {
            client,
            unfinished: AtomicU32::new(request.tiles.count),
            request,
            scene,
            cancelled,
            arrived: Instant::now(),
            begun: OnceLock::new(),
            compiled: Mutex::default(),
            encode_nanos: AtomicU64::default(),
        }
    }

    /// Counts tiles as finished; whether they were the last.
    pub(super) fn finish(&self, tiles: TileRange) -> bool {
        self.unfinished.fetch_sub(tiles.count, Ordering::AcqRel) == tiles.count
    }

    /// Samples of so many of its tiles, if they are whole.
    fn samples(&self, tiles: u32) -> f64 {
        let edge = f64::from(self.request.grid.edge);
        f64::from(tiles) * edge * edge * f64::from(self.request.settings.samples)
    }
}

/// A worker's next piece of work.
pub(super) enum Turn {
    /// Some pixels of a request whose scene's cost is not known are to be traced for
    /// [`JobQueue::set_cost`].
    Probe(Arc<NodeJob>),
    /// A part of a request is to be traced.
    Trace(Arc<NodeJob>, TileRange),
    /// A request is to be refused with a sentence.
    Refuse(Arc<NodeJob>, String),
}

/// The queue of a node, shared by connections and workers.
pub(super) struct JobQueue {
    state: Mutex<QueueState>,
    changed: Condvar,
    scenes: Mutex<VecDeque<(SceneHash, Arc<CompiledScene>)>>,
    /// The time at which the device last finished something.
    last_done: Mutex<Option<Instant>>,
}

#[derive(Default)]
struct QueueState {
    jobs: FairQueue<QueuedJob>,
    costs: VecDeque<Cost>,
    /// Flags of the jobs that workers are tracing.
    running: Vec<Arc<AtomicBool>>,
    workers: usize,
    closed: bool,
}

/// A job of which tiles are left to hand out.
struct QueuedJob {
    job: Arc<NodeJob>,
    /// The next tile.
    next: u32,
}

/// The measured cost of a scene.
struct Cost {
    scene: SceneHash,
    /// The deepest paths that it was measured with.
    max_depth: u32,
    secs_per_sample: f64,
    /// Probes since the last slice.
    probes: u32,
}

impl JobQueue {
    pub(super) fn new() -> Self {
        Self {
            state: Mutex::default(),
            changed: Condvar::new(),
            scenes: Mutex::default(),
            last_done: Mutex::default(),
        }
    }

    pub(super) fn push(&self, job: NodeJob) {
        let mut state = lock(&self.state);
        let jobs = state.jobs.jobs_mut(job.client.player);
        jobs.push_back(QueuedJob {
            next: job.request.tiles.first,
            job: Arc::new(job),
        });
        sort_newest(jobs);
        drop(state);
        self.changed.notify_one();
    }

    /// Removes cancelled jobs.
    pub(super) fn drop_cancelled(&self) {
        let wanted = |queued: &QueuedJob| !queued.job.cancelled.load(Ordering::Relaxed);
        lock(&self.state).jobs.retain(wanted);
    }

    pub(super) fn worker_starts(&self) {
        lock(&self.state).workers += 1;
    }

    pub(super) fn worker_ends(&self) {
        lock(&self.state).workers -= 1;
        self.changed.notify_all();
    }

    /// The next piece of work; `None` when the node is dropped.
    pub(super) fn next(&self) -> Option<Turn> {
        let mut state = lock(&self.state);
        loop {
            if state.closed {
                return None;
            }
            if let Some(turn) = state.turn() {
                // Another worker may have a part of the same job.
                self.changed.notify_one();
                return Some(turn);
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Ends a probe or slice of `job` of so many samples: its player has had `took` of the device.
    pub(super) fn finish(&self, job: &NodeJob, took: Duration) {
        let mut state = lock(&self.state);
        state.jobs.charge(job.client.player, took.as_secs_f64());
        let running = |flag: &Arc<AtomicBool>| Arc::ptr_eq(flag, &job.cancelled);
        if let Some(index) = state.running.iter().position(running) {
            state.running.swap_remove(index);
        }
    }

    /// Notes what `samples` of a job's scene took: in a slice, or in a probe.
    pub(super) fn set_cost(&self, job: &NodeJob, samples: f64, took: Duration, is_probe: bool) {
        let secs_per_sample = took.as_secs_f64() / samples.max(1.0);
        let max_depth = job.request.settings.max_depth;
        let mut state = lock(&self.state);
        let known = state
            .cost(job)
            .map(|cost| (cost.secs_per_sample, cost.probes));
        state.costs.retain(|cost| cost.scene != job.request.scene);
        let (secs_per_sample, probes) = match known {
            // A device that compiles its kernels first, or is disturbed, is slower than it will be.
            Some((before, probes)) if is_probe => (secs_per_sample.min(before), probes + 1),
            _ => (secs_per_sample, u32::from(is_probe)),
        };
        state.costs.push_front(Cost {
            scene: job.request.scene,
            max_depth,
            secs_per_sample,
            probes,
        });
        state.costs.truncate(COSTS_KEPT_MAX);
    }

    /// Cancels everything and waits until the workers have ended, for `timeout` at most.
    pub(super) fn close(&self, timeout: Duration) {
        let mut state = lock(&self.state);
        state.closed = true;
        state.jobs = FairQueue::new();
        for running in &state.running {
            running.store(true, Ordering::Relaxed);
        }
        self.changed.notify_all();
        let working = |state: &mut QueueState| state.workers > 0;
        // A device that hangs must not keep the program from ending.
        let ended = self.changed.wait_timeout_while(state, timeout, working);
        drop(ended);
    }

    /// A scene compiled for tracers; [`COMPILED_KEPT_MAX`] are kept.
    pub(super) fn compiled(&self, hash: SceneHash, scene: &Scene) -> Result<CompiledScene, Error> {
        let mut scenes = lock(&self.scenes);
        if let Some((_, compiled)) = scenes.iter().find(|(kept, _)| *kept == hash) {
            // A copy, because each request applies its own update to it.
            return Ok(CompiledScene::clone(compiled));
        }
        // Without the lock, as compiling a large scene takes long: two workers may both do it.
        drop(scenes);
        let compiled = CompiledScene::new(scene)?;
        scenes = lock(&self.scenes);
        scenes.truncate(COMPILED_KEPT_MAX - 1);
        scenes.push_front((hash, Arc::new(compiled.clone())));
        Ok(compiled)
    }

    /// The time since `begun`, or since the device last finished something if that is later:
    /// requests that overlap on a device are not counted twice.
    pub(super) fn busy_since(&self, begun: Instant) -> Duration {
        let now = Instant::now();
        let mut last_done = lock(&self.last_done);
        let from = last_done.map_or(begun, |last| last.max(begun));
        *last_done = Some(now);
        now.saturating_duration_since(from)
    }
}

impl QueueState {
    /// The next piece of work, if there is any.
    fn turn(&mut self) -> Option<Turn> {
        let queued = self.jobs.next_mut()?.front()?;
        let (job, next) = (Arc::clone(&queued.job), queued.next);
        self.running.push(Arc::clone(&job.cancelled));
        let Some(cost) = self.cost(&job) else {
            return Some(Turn::Probe(job));
        };
        let (secs_per_sample, probes) = (cost.secs_per_sample, cost.probes);
        let end = job.request.tiles.end();
        if next == job.request.tiles.first
            && let Some(why) = too_costly(&job, secs_per_sample)
        {
            if probes < PROBES_BEFORE_REFUSAL {
                return Some(Turn::Probe(job));
            }
            self.costs.retain(|cost| cost.scene != job.request.scene);
            self.jobs.next_mut()?.pop_front();
            return Some(Turn::Refuse(job, why));
        }
        let fitting = (SLICE_SECS / (secs_per_sample * job.samples(1)).max(1e-9)) as u32;
        // Whole messages, unless one takes too long.
        let whole = fitting - fitting % TILES_PER_MESSAGE_MAX;
        let count = if whole > 0 { whole } else { fitting.max(1) }.min(end - next);
        let jobs = self.jobs.next_mut()?;
        match jobs.front_mut() {
            Some(queued) if next + count < end => queued.next += count,
            _ => drop(jobs.pop_front()),
        }
        Some(Turn::Trace(job, TileRange { first: next, count }))
    }

    /// The cost of a job's scene, unless its paths are deeper than those that were measured.
    fn cost(&self, job: &NodeJob) -> Option<&Cost> {
        let settings = job.request.settings;
        self.costs
            .iter()
            .find(|cost| cost.scene == job.request.scene && cost.max_depth >= settings.max_depth)
    }
}

/// The sentence for a request that takes longer than any may.
fn too_costly(job: &NodeJob, secs_per_sample: f64) -> Option<String> {
    let tile_secs = secs_per_sample * job.samples(1);
    let all_secs = secs_per_sample * job.samples(job.request.tiles.count);
    let advice = "ask for fewer samples, shallower paths or smaller tiles";
    if tile_secs > TILE_SECS_MAX {
        return Some(format!(
            "a tile of it takes some {tile_secs:.0} s here, of at most {TILE_SECS_MAX:.0} s: {advice}"
        ));
    }
    (all_secs > REQUEST_SECS_MAX).then(|| {
        format!("it takes some {all_secs:.0} s here, of at most {REQUEST_SECS_MAX:.0} s: {advice}")
    })
}

/// Swaps the newest job with those of the same client that are of later frames; jobs of the
/// player's other connections keep their places.
fn sort_newest(jobs: &mut VecDeque<QueuedJob>) {
    let mut index = jobs.len() - 1;
    for other in (0..index).rev() {
        let (job, before) = (&jobs[index].job, &jobs[other].job);
        if !Arc::ptr_eq(&job.client, &before.client) {
            continue;
        }
        if before.request.frame <= job.request.frame {
            return;
        }
        jobs.swap(index, other);
        index = other;
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Compiled scenes that a node keeps for all its clients.
const COMPILED_KEPT_MAX: usize = 8;
/// Scenes whose cost a node remembers.
const COSTS_KEPT_MAX: usize = 32;
/// Device time of a slice: what another player's frame waits for. A tile is not divided.
const SLICE_SECS: f64 = 0.05;
/// Device time of one tile, which nobody can interrupt.
const TILE_SECS_MAX: f64 = 10.0;
/// Device time of a request. A 4K picture of 4,096 samples takes an H200 a minute and four slow
/// cores the hour, but its requests are parts of it.
const REQUEST_SECS_MAX: f64 = 3600.0;
/// A probe may have been disturbed.
const PROBES_BEFORE_REFUSAL: u32 = 2;

#[cfg(test)]
mod tests {
    use carom_protocol::session::ClientSession;
    use carom_protocol::{FrameId, NodeInfo, PixelFormat, PrecisionRange, RequestId};
    use carom_tracer::{
        DeviceInfo, DeviceKind, ImageSize, RenderSettings, SceneUpdate, TileGrid, TileRange,
    };

    use super::super::NodeConnection;
    use super::super::client_connection::TileSharing;
    use super::super::fair_queue::PlayerId;
    use super::*;

    /// A client that is connected to a node of `queue`.
    struct Requester {
        session: ClientSession,
        connection: NodeConnection,
        runs: u64,
    }

    impl Requester {
        fn new(queue: &Arc<JobQueue>, player: PlayerId) -> Self {
            let device = DeviceInfo {
                kind: DeviceKind::Cpu,
                name: String::new(),
                width: 1,
                threads: 1,
            };
            let name = String::new();
            let info = NodeInfo { name, device };
            let queue = Arc::clone(queue);
            let connection = NodeConnection::new(info, player, queue, TileSharing::Encoded);
            let mut requester = Self {
                session: ClientSession::new(),
                connection,
                runs: 0,
            };
            requester.exchange();
            let scene = include_str!("../../../assets/scenes/pool.json");
            let scene = Scene::from_json(scene).unwrap();
            requester
                .session
                .set_scene(SceneHash::of(&scene), &scene)
                .unwrap();
            requester.exchange();
            requester
        }

        fn exchange(&mut self) {
            while let Some(packet) = self.session.poll_transmit() {
                self.connection.handle(packet).unwrap();
                while let Some(answer) = self.connection.poll_transmit() {
                    self.session.handle(answer).unwrap();
                }
            }
        }

        /// Asks for a picture in so many tiles.
        fn request(&mut self, frame: u64, tiles: u32) {
            let scene = include_str!("../../../assets/scenes/pool.json");
            let scene = Scene::from_json(scene).unwrap();
            let request = TraceRequest {
                frame: FrameId(frame),
                id: RequestId(self.runs),
                scene: SceneHash::of(&scene),
                update: SceneUpdate::default(),
                grid: TileGrid::new(ImageSize::new(8 * tiles.min(64), 8 * tiles.div_ceil(64)), 8),
                tiles: TileRange {
                    first: 0,
                    count: tiles,
                },
                settings: RenderSettings {
                    samples: 1,
                    ..RenderSettings::default()
                },
                format: PixelFormat::LinearF32,
                precision: PrecisionRange::EXACT,
                references: Vec::new(),
            };
            self.runs += 1;
            self.session.trace(request).unwrap();
            self.exchange();
        }
    }

    /// The player and request of a piece of work.
    fn traced(queue: &JobQueue) -> (PlayerId, u64, TileRange) {
        match queue.next() {
            Some(Turn::Trace(job, tiles)) => {
                let traced = (job.client.player, job.request.id.0, tiles);
                queue.finish(&job, Duration::from_secs_f64(SLICE_SECS));
                traced
            }
            _ => panic!("the price is known and low"),
        }
    }

    /// Has the queue believe that a sample of the pool table takes so long.
    fn price(queue: &JobQueue, secs_per_sample: f64, probes: u32) {
        for _ in 0..probes {
            let Some(Turn::Probe(job)) = queue.next() else {
                panic!("the price is not known");
            };
            queue.set_cost(&job, 1.0, Duration::from_secs_f64(secs_per_sample), true);
            queue.finish(&job, Duration::ZERO);
        }
    }

    #[test]
    fn each_clients_oldest_frame_runs_first_in_its_turn() {
        let queue = Arc::new(JobQueue::new());
        let [near_id, far_id] = [b"near", b"far!"].map(|key| PlayerId::of_key(key));
        let (mut near, mut far) = (
            Requester::new(&queue, near_id),
            Requester::new(&queue, far_id),
        );
        near.request(7, 1);
        far.request(2, 1);
        near.request(8, 1);
        near.request(8, 1);
        near.request(6, 1);
        far.request(3, 1);
        near.request(7, 1);
        price(&queue, 1e-6, 1);
        let order = (0..7)
            .map(|_| traced(&queue))
            .map(|(player, id, _)| (player, id));
        let order: Vec<_> = order.collect();
        let of = |player| {
            order
                .iter()
                .filter(move |(by, _)| *by == player)
                .map(|(_, id)| *id)
        };
        assert_eq!(of(near_id).collect::<Vec<_>>(), [3, 0, 4, 1, 2]);
        assert_eq!(of(far_id).collect::<Vec<_>>(), [0, 1]);
        let early = order[..4].iter().filter(|(player, _)| *player == far_id);
        assert_eq!(early.count(), 2, "{order:?}");
    }

    #[test]
    fn a_long_request_delays_others_by_a_slice() {
        let queue = Arc::new(JobQueue::new());
        let [greedy_id, honest_id] = [b"a", b"b"].map(|key| PlayerId::of_key(key));
        let mut greedy = Requester::new(&queue, greedy_id);
        greedy.request(0, 4096);
        // 64 samples a tile: eight tiles fill a slice.
        price(&queue, SLICE_SECS / (64.0 * 8.5), 1);
        let mut tiles = 0;
        for _ in 0..3 {
            tiles += traced(&queue).2.count;
        }
        assert_eq!(tiles, 3 * TILES_PER_MESSAGE_MAX);
        let mut honest = Requester::new(&queue, honest_id);
        honest.request(9, 1);
        assert_eq!(traced(&queue).0, honest_id);
        let rest = (0..)
            .map(|_| traced(&queue).2)
            .take_while(|part| part.end() < 4096);
        assert_eq!(
            rest.last().map(TileRange::end),
            Some(4096 - TILES_PER_MESSAGE_MAX)
        );
    }

    #[test]
    fn a_request_that_takes_days_is_refused() {
        let queue = Arc::new(JobQueue::new());
        let mut greedy = Requester::new(&queue, PlayerId::LOCAL);
        greedy.request(0, 4096);
        price(&queue, 1.0, PROBES_BEFORE_REFUSAL);
        let Some(Turn::Refuse(_, why)) = queue.next() else {
            panic!("a tile takes a minute");
        };
        assert!(why.contains("64 s here, of at most 10 s"), "{why}");
        greedy.request(1, 4096);
        price(&queue, 0.1, PROBES_BEFORE_REFUSAL);
        let Some(Turn::Refuse(_, why)) = queue.next() else {
            panic!("all tiles take hours");
        };
        assert!(why.contains("26214 s here, of at most 3600 s"), "{why}");
    }
}
