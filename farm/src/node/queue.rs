//! Queue of the requests that wait for the device: players in turn by fair queueing, and the requests of
//! one client by frame, since the oldest is the next to be shown. Requests are traced in slices of
//! [`SLICE_SECS`], so that no player waits for another's whole request; a slice that takes longer than
//! estimated is stopped when another player waits, and its remaining tiles are queued again. A tile that
//! takes longer than a slice is traced in [parts](super::partial_tile); a denoised one, each part of which
//! needs a guard band, only where other players use the node.
//!
//! A client's session admits at most `REQUESTS_QUEUED_MAX` of its requests. A request's cost is known
//! before it is traced, from [probes](TurnWork::Probe) and earlier slices of its scene; one that costs too
//! much is refused. The player of this process has the node to itself: its requests are not probed, refused
//! for their cost, or divided.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

use carom_protocol::NodeLoad;
use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_tracer::{CompiledScene, Tile, TileRange};

use super::cost::{Cost, UNDIVIDED_SECS_MAX, too_costly};
use super::device_quota::DeviceQuota;
use super::fair_queue::{FairQueue, PlayerId};
use super::job::{NodeJob, UncompiledJob};
use super::load_meter::LoadMeter;
use super::scene_compiler::SceneCompiler;
use crate::lock::lock;

/// A worker's turn: one piece of work of a request.
pub(super) struct Turn {
    pub(super) job: Arc<NodeJob>,
    pub(super) work: TurnWork,
    /// Ends the turn early: its request has been cancelled, or it takes too long.
    pub(super) stop: Arc<AtomicBool>,
}

/// Work of a turn.
#[derive(Debug, PartialEq)]
pub(super) enum TurnWork {
    /// Trace some pixels of a request whose scene's cost is unknown, for [`JobQueue::set_cost`].
    Probe,
    /// Trace tiles of a request.
    Trace(TileRange),
    /// Trace a part of the tile of this index, as the whole takes longer than a slice.
    TracePart(u32, Tile),
    /// Refuse a request with an explanation.
    Refuse(String),
}

/// The queue of a node, shared by its connections and workers.
#[derive(Default)]
pub(super) struct JobQueue {
    state: Mutex<QueueState>,
    changed: Condvar,
    /// Notified when a turn begins or a job is pushed: for [`JobQueue::watch`].
    watched: Condvar,
    pub(super) scenes: SceneCompiler,
    /// Jobs with a copy of their scene for their update, the latest first.
    updated: Mutex<VecDeque<Weak<NodeJob>>>,
    /// When the device last finished a piece of work.
    last_done: Mutex<Option<Instant>>,
}

#[derive(Default)]
struct QueueState {
    jobs: FairQueue<QueuedJob>,
    costs: VecDeque<Cost>,
    /// Turns in progress.
    running: Vec<RunningTurn>,
    load: LoadMeter,
    quota: Option<DeviceQuota>,
    workers: usize,
    closed: bool,
}

/// A job with the tiles that have not been handed out.
struct QueuedJob {
    job: Arc<NodeJob>,
    left: VecDeque<TileRange>,
}

/// A turn in progress.
struct RunningTurn {
    job: Arc<NodeJob>,
    stop: Arc<AtomicBool>,
    begun: Instant,
    /// Seconds after which it is stopped while no other player waits; `None` if it can be divided.
    secs_max: Option<f64>,
    /// Seconds after which it is stopped when another player waits.
    secs_max_beside_others: f64,
}

impl JobQueue {
    /// Limits each player, except that of this process, to so many seconds of the device per hour.
    pub(super) fn set_quota(&self, secs_per_hour: f64) {
        lock(&self.state).quota = Some(DeviceQuota::new(secs_per_hour));
    }

    /// Queues a job, for its scene's compilation first if that is needed.
    pub(super) fn push(&self, job: UncompiledJob) {
        match self.scenes.kept(job.request.scene) {
            Some(scene) => self.push_compiled(job, scene),
            None => self.scenes.push(job),
        }
    }

    /// Queues a job whose scene is compiled.
    pub(super) fn push_compiled(&self, job: UncompiledJob, scene: Arc<CompiledScene>) {
        let job = NodeJob::new(job, scene);
        let mut state = lock(&self.state);
        let jobs = state.jobs.jobs_mut(job.client.player);
        jobs.push_back(QueuedJob {
            left: VecDeque::from([job.request.tiles]),
            job: Arc::new(job),
        });
        sort_newest(jobs);
        drop(state);
        self.changed.notify_one();
        self.watched.notify_all();
    }

    /// Records that a job holds a copy of its scene. Beyond [`UPDATED_KEPT_MAX`], the oldest copies are
    /// dropped, and made again if their jobs are traced again.
    pub(super) fn note_updated(&self, job: &Arc<NodeJob>) {
        let mut updated = lock(&self.updated);
        updated.push_front(Arc::downgrade(job));
        let kept = updated.len().min(UPDATED_KEPT_MAX);
        for old in updated.split_off(kept) {
            if let Some(old) = old.upgrade() {
                *lock(&old.compiled) = None;
            }
        }
    }

    /// Queues the tiles that a turn has left unfinished again, before the job's other tiles.
    pub(super) fn put_back(&self, job: &Arc<NodeJob>, tiles: Vec<TileRange>) {
        let mut state = lock(&self.state);
        let jobs = state.jobs.jobs_mut(job.client.player);
        let queued = jobs.iter_mut().find(|queued| Arc::ptr_eq(&queued.job, job));
        match queued {
            // In reverse, so that the ranges keep their order at the front.
            Some(queued) => tiles
                .into_iter()
                .rev()
                .for_each(|range| queued.left.push_front(range)),
            None => {
                jobs.push_back(QueuedJob {
                    left: tiles.into(),
                    job: Arc::clone(job),
                });
                sort_newest(jobs);
            }
        }
        drop(state);
        self.changed.notify_one();
    }

    /// Removes cancelled jobs, and stops their turns.
    pub(super) fn drop_cancelled(&self) {
        self.scenes.drop_cancelled();
        let is_cancelled = |job: &NodeJob| job.cancelled.load(Ordering::Relaxed);
        let mut state = lock(&self.state);
        state.jobs.retain(|queued| !is_cancelled(&queued.job));
        for turn in state.running.iter().filter(|turn| is_cancelled(&turn.job)) {
            turn.stop.store(true, Ordering::Relaxed);
        }
    }

    /// Stops turns that take too long, until the queue is closed.
    pub(super) fn watch(&self) {
        let mut state = lock(&self.state);
        while !state.closed {
            let now = Instant::now();
            let due = state.stop_overdue(now);
            let pause = due.map_or(WATCH_PAUSE_MAX, |due| due.saturating_duration_since(now));
            let waited = self.watched.wait_timeout(state, pause);
            (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        }
    }

    pub(super) fn worker_starts(&self) {
        lock(&self.state).workers += 1;
    }

    pub(super) fn worker_ends(&self) {
        lock(&self.state).workers -= 1;
        self.changed.notify_all();
    }

    /// Waits for the next turn; `None` when the node is dropped.
    pub(super) fn next(&self) -> Option<Turn> {
        let mut state = lock(&self.state);
        loop {
            if state.closed {
                return None;
            }
            if let Some(turn) = state.turn() {
                // Another worker may take a part of the same job.
                self.changed.notify_one();
                self.watched.notify_all();
                return Some(turn);
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Ends a turn and charges its player with `took` of the device.
    pub(super) fn finish(&self, turn: &Turn, took: Duration) {
        let mut state = lock(&self.state);
        let player = turn.job.client.player;
        state.jobs.charge(player, took.as_secs_f64());
        let now = Instant::now();
        state.load.note(now, player, took);
        if let Some(quota) = &mut state.quota {
            quota.charge(now, player, took.as_secs_f64());
        }
        state
            .running
            // The stop flag identifies the turn.
            .retain(|running| !Arc::ptr_eq(&running.stop, &turn.stop));
    }

    /// The use of the device by players other than `player`.
    pub(super) fn load(&self, player: PlayerId) -> NodeLoad {
        let state = lock(&self.state);
        let running = state.running.iter().map(|turn| turn.job.client.player);
        let waiting = running.chain(state.jobs.waiting());
        state.load.load(Instant::now(), player, waiting)
    }

    /// Records how long `samples` of a job's scene took, in a slice or in a probe.
    pub(super) fn set_cost(&self, job: &NodeJob, samples: f64, took: Duration, is_probe: bool) {
        let secs_per_sample = took.as_secs_f64() / samples.max(1.0);
        let max_depth = job.request.settings.max_depth;
        let mut state = lock(&self.state);
        let known = state
            .cost(job)
            .map(|cost| (cost.secs_per_sample, cost.probes));
        let before_max = state.cost(job).map_or(0.0, |cost| cost.samples_max);
        state.costs.retain(|cost| !cost.is_of(job));
        let (secs_per_sample, probes) = match known {
            // The minimum of the probes: a device that compiles kernels first, or is disturbed, is slower
            // than it will be.
            Some((before, probes)) if is_probe => (secs_per_sample.min(before), probes + 1),
            _ => (secs_per_sample, u32::from(is_probe)),
        };
        state.costs.push_front(Cost {
            scene: job.request.scene,
            is_denoised: job.is_denoised(),
            max_depth,
            secs_per_sample,
            samples_max: samples.max(before_max),
            probes,
        });
        state.costs.truncate(COSTS_KEPT_MAX);
    }

    /// Cancels everything and waits until the workers have ended, at most for `timeout`.
    pub(super) fn close(&self, timeout: Duration) {
        self.scenes.close();
        let mut state = lock(&self.state);
        state.closed = true;
        state.jobs = FairQueue::new();
        for turn in &state.running {
            turn.job.cancelled.store(true, Ordering::Relaxed);
            turn.stop.store(true, Ordering::Relaxed);
        }
        self.changed.notify_all();
        self.watched.notify_all();
        let working = |state: &mut QueueState| state.workers > 0;
        // A hanging device must not keep the process from exiting.
        let ended = self.changed.wait_timeout_while(state, timeout, working);
        drop(ended);
    }

    /// Time since `begun`, or since the device last finished something if that is later, so that requests
    /// that overlap on a device are not counted twice.
    pub(super) fn busy_since(&self, begun: Instant) -> Duration {
        let now = Instant::now();
        let mut last_done = lock(&self.last_done);
        // A GPU's two workers overlap: each counts only the time since the other's last result.
        let from = last_done.map_or(begun, |last| last.max(begun));
        *last_done = Some(now);
        now.saturating_duration_since(from)
    }
}

impl QueueState {
    /// The next turn, if there is any work.
    fn turn(&mut self) -> Option<Turn> {
        let queued = self.jobs.next_mut()?.front()?;
        let (job, next) = (Arc::clone(&queued.job), *queued.left.front()?);
        let work = self.work(&job, next)?;
        let stop = Arc::new(AtomicBool::new(job.cancelled.load(Ordering::Relaxed)));
        let is_divisible = match work {
            TurnWork::Trace(tiles) => {
                tiles.count > 1 || job.is_divisible(job.request.grid.tile(tiles.first))
            }
            TurnWork::TracePart(_, part) => job.is_divisible(part),
            TurnWork::Probe | TurnWork::Refuse(_) => false,
        };
        let is_block = work != TurnWork::Probe && job.is_denoised();
        self.running.push(RunningTurn {
            job: Arc::clone(&job),
            stop: Arc::clone(&stop),
            begun: Instant::now(),
            secs_max: (!is_divisible).then_some(UNDIVIDED_SECS_MAX),
            secs_max_beside_others: match is_divisible {
                true => SLICE_SECS_MAX,
                false if is_block => BLOCK_SECS_MAX,
                false => UNDIVIDED_SECS_MAX,
            },
        });
        Some(Turn { job, work, stop })
    }

    /// The work for a job whose first queued tiles are `next`.
    fn work(&mut self, job: &NodeJob, next: TileRange) -> Option<TurnWork> {
        if job.client.player == PlayerId::LOCAL {
            return self.take(next.count);
        }
        let quota = self.quota.as_mut();
        if let Some(why) = quota.and_then(|quota| quota.refusal(Instant::now(), job.client.player))
        {
            self.jobs.next_mut()?.pop_front();
            return Some(TurnWork::Refuse(why));
        }
        let Some(cost) = self.cost(job) else {
            return Some(TurnWork::Probe);
        };
        let (secs_per_sample, probes) = (cost.secs_per_sample, cost.probes);
        // A measured cost is extrapolated only so far.
        let samples_max = GROWTH * cost.samples_max;
        if job.begun.get().is_none()
            && let Some(why) = too_costly(job, secs_per_sample)
        {
            if probes < PROBES_BEFORE_REFUSAL {
                return Some(TurnWork::Probe);
            }
            // The cost is dropped with the refusal, so that the next request of the scene is probed again:
            // it may have been measured while the device was disturbed.
            self.costs.retain(|cost| !cost.is_of(job));
            self.jobs.next_mut()?.pop_front();
            return Some(TurnWork::Refuse(why));
        }
        let fitting = SLICE_SECS / secs_per_sample.max(1e-12);
        let is_whole = fitting >= job.samples(TileRange { count: 1, ..next });
        // Dividing a denoised tile repeats its guard bands, which only pays where another player would
        // wait.
        let divides = !is_whole && (!job.is_denoised() || self.is_shared(job.client.player));
        let fitting = fitting.min(samples_max);
        let pixels = match is_whole {
            true => u32::MAX,
            false => (fitting / job.samples_per_pixel()) as u32,
        };
        if let Some(part) = job.next_part(next.first, divides, pixels) {
            self.take(1)?;
            return Some(TurnWork::TracePart(next.first, part));
        }
        let fitting = job.tiles_within(next, fitting);
        // Whole messages, unless one takes too long: a group is sent when complete, and the tiles of an
        // incomplete one are traced again, so slices end at group borders.
        let whole = fitting - fitting % TILES_PER_MESSAGE_MAX;
        let count = if whole > 0 { whole } else { fitting.max(1) };
        self.take(count.min(next.count))
    }

    /// Whether other players wait, or have used the device recently and will probably return.
    fn is_shared(&self, player: PlayerId) -> bool {
        let running = self.running.iter().map(|turn| turn.job.client.player);
        let waiting = running.chain(self.jobs.waiting());
        self.load.load(Instant::now(), player, waiting).players > 0
    }

    /// Takes up to `count` of the first tiles of the next job.
    fn take(&mut self, count: u32) -> Option<TurnWork> {
        let jobs = self.jobs.next_mut()?;
        let left = &mut jobs.front_mut()?.left;
        let range = left.pop_front()?;
        if count < range.count {
            left.push_front(TileRange {
                first: range.first + count,
                count: range.count - count,
            });
        }
        if left.is_empty() {
            jobs.pop_front();
        }
        let first = range.first;
        Some(TurnWork::Trace(TileRange { first, count }))
    }

    /// Stops overdue turns, and returns when the next one becomes overdue.
    fn stop_overdue(&self, now: Instant) -> Option<Instant> {
        let mut next = None::<Instant>;
        for turn in &self.running {
            let player = turn.job.client.player;
            if player == PlayerId::LOCAL || turn.stop.load(Ordering::Relaxed) {
                continue;
            }
            let secs_max = match self.jobs.others_wait(player) {
                true => Some(turn.secs_max_beside_others),
                false => turn.secs_max,
            };
            let Some(secs_max) = secs_max else { continue };
            let due = turn.begun + Duration::from_secs_f64(secs_max);
            match due <= now {
                true => turn.stop.store(true, Ordering::Relaxed),
                false => next = Some(next.map_or(due, |next| next.min(due))),
            }
        }
        next
    }

    /// The cost of a job's scene, unless its paths are deeper than those measured.
    fn cost(&self, job: &NodeJob) -> Option<&Cost> {
        let settings = job.request.settings;
        self.costs
            .iter()
            .find(|cost| cost.is_of(job) && cost.max_depth >= settings.max_depth)
    }
}

/// Moves the newest job before those of the same client with later frames; jobs of the player's other
/// connections keep their places.
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

/// Jobs that keep their copies of scenes: those in progress, and those whose turns come next.
const UPDATED_KEPT_MAX: usize = 16;
/// Number of scenes, counted separately with and without denoising, whose cost is kept.
const COSTS_KEPT_MAX: usize = 32;
/// Target device seconds of a slice, which another player's frame may have to wait for. Denoised tiles that
/// take longer are divided where others use the node: a part has a guard band of a block on each side, so
/// that the quarters of a tile of 32 × 32 pixels take 1.8 times as long as the whole. The smallest part is
/// a block, for which 24 × 24 pixels are traced.
const SLICE_SECS: f64 = 0.05;
/// Device seconds after which a slice is stopped if another player waits.
const SLICE_SECS_MAX: f64 = 2.0 * SLICE_SECS;
/// Maximum samples of a slice relative to any measured before: where a probe's pixels were cheap, the rest
/// of the picture may be expensive.
const GROWTH: f64 = 8.0;
/// Device seconds after which a denoised block is stopped if another player waits. Only thousands of
/// samples per pixel take so long, at which the denoiser leaves the picture unchanged.
pub(super) const BLOCK_SECS_MAX: f64 = 2.0;
/// Stops of a denoised block after which its request is refused: the device may have been compiling during
/// the first one.
pub(super) const BLOCK_STOPS_MAX: u32 = 2;
/// Maximum pause of [`JobQueue::watch`].
const WATCH_PAUSE_MAX: Duration = Duration::from_secs(3600);
/// Number of probes before a refusal, as one may have been disturbed.
const PROBES_BEFORE_REFUSAL: u32 = 2;

#[cfg(test)]
mod tests;
