//! The queue of requests that wait for the device: by turns of the players, the requests of one
//! client by frame, since the oldest is the next to be shown. They are traced in slices of
//! [`SLICE_SECS`], so that no player waits for another's whole request; one that takes longer than it
//! was priced at is cut when somebody waits, and its other tiles are queued again. A tile that takes longer
//! than a slice is traced in [parts](super::partial_tile); a denoised one, whose parts need a guard band each, where
//! other players use the node.
//!
//! A client's session admits at most `REQUESTS_QUEUED_MAX` of its requests. What a request costs is
//! known before it is traced, from [probes](Turn::Probe) and slices of its scene; one that costs too
//! much is refused. The player of this process has its node to itself: its requests are neither
//! priced, refused for their cost, nor divided.

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

/// A worker's turn at a request.
pub(super) struct Turn {
    pub(super) job: Arc<NodeJob>,
    pub(super) work: TurnWork,
    /// Ends the turn early: its request has been cancelled, or it takes too long.
    pub(super) stop: Arc<AtomicBool>,
}

/// What is to be done in a turn.
#[derive(Debug, PartialEq)]
pub(super) enum TurnWork {
    /// Some pixels of a request whose scene's cost is not known are to be traced for
    /// [`JobQueue::set_cost`].
    Probe,
    /// Tiles of a request are to be traced.
    Trace(TileRange),
    /// A part of a tile, of this number, is to be traced: the whole takes longer than a slice.
    TracePart(u32, Tile),
    /// A request is to be refused with a sentence.
    Refuse(String),
}

/// The queue of a node, shared by connections and workers.
#[derive(Default)]
pub(super) struct JobQueue {
    state: Mutex<QueueState>,
    changed: Condvar,
    /// Notified when a turn begins or a job is pushed: for [`JobQueue::watch`].
    watched: Condvar,
    pub(super) scenes: SceneCompiler,
    /// The jobs whose scenes have last had their updates applied, each a copy of its own.
    updated: Mutex<VecDeque<Weak<NodeJob>>>,
    /// The time at which the device last finished something.
    last_done: Mutex<Option<Instant>>,
}

#[derive(Default)]
struct QueueState {
    jobs: FairQueue<QueuedJob>,
    costs: VecDeque<Cost>,
    /// The turns that workers are at.
    running: Vec<RunningTurn>,
    load: LoadMeter,
    quota: Option<DeviceQuota>,
    workers: usize,
    closed: bool,
}

/// A job of which tiles are left to hand out.
struct QueuedJob {
    job: Arc<NodeJob>,
    left: VecDeque<TileRange>,
}

/// A turn that a worker is at.
struct RunningTurn {
    job: Arc<NodeJob>,
    stop: Arc<AtomicBool>,
    begun: Instant,
    /// The time after which it is stopped while nobody else waits; `None` if it can be divided.
    secs_max: Option<f64>,
    /// The time after which it is stopped when another player waits.
    secs_max_beside_others: f64,
}

impl JobQueue {
    /// Gives each player but that of this process at most so many seconds of the device an hour.
    pub(super) fn set_quota(&self, secs_per_hour: f64) {
        lock(&self.state).quota = Some(DeviceQuota::new(secs_per_hour));
    }

    /// Takes in a job; it waits for its scene first if that is not compiled yet.
    pub(super) fn push(&self, job: UncompiledJob) {
        match self.scenes.kept(job.request.scene) {
            Some(scene) => self.push_compiled(job, scene),
            None => self.scenes.push(job),
        }
    }

    /// Takes in a job whose scene is compiled.
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

    /// Notes that a job has a copy of its scene; the jobs that have had theirs for longest lose them, and make them
    /// again when they are traced again.
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

    /// Queues tiles of a job again that a turn has left.
    pub(super) fn put_back(&self, job: &Arc<NodeJob>, tiles: Vec<TileRange>) {
        let mut state = lock(&self.state);
        let jobs = state.jobs.jobs_mut(job.client.player);
        let queued = jobs.iter_mut().find(|queued| Arc::ptr_eq(&queued.job, job));
        match queued {
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

    /// Removes cancelled jobs, and stops the turns at them.
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
                self.watched.notify_all();
                return Some(turn);
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Ends a turn: its player has had `took` of the device.
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
            .retain(|running| !Arc::ptr_eq(&running.stop, &turn.stop));
    }

    /// What players other than `player` have of the device.
    pub(super) fn load(&self, player: PlayerId) -> NodeLoad {
        let state = lock(&self.state);
        let running = state.running.iter().map(|turn| turn.job.client.player);
        let waiting = running.chain(state.jobs.waiting());
        state.load.load(Instant::now(), player, waiting)
    }

    /// Notes what `samples` of a job's scene took: in a slice, or in a probe.
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
            // A device that compiles its kernels first, or is disturbed, is slower than it will be.
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

    /// Cancels everything and waits until the workers have ended, for `timeout` at most.
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
        // A device that hangs must not keep the program from ending.
        let ended = self.changed.wait_timeout_while(state, timeout, working);
        drop(ended);
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

    /// What to do for a job whose tiles from `next` on are the first in the queue.
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
        // A price holds only about as far as it was measured.
        let samples_max = GROWTH * cost.samples_max;
        if job.begun.get().is_none()
            && let Some(why) = too_costly(job, secs_per_sample)
        {
            if probes < PROBES_BEFORE_REFUSAL {
                return Some(TurnWork::Probe);
            }
            // The price is forgotten with the refusal: the next request of the scene is probed again, as
            // a price may have been measured while the device was disturbed.
            self.costs.retain(|cost| !cost.is_of(job));
            self.jobs.next_mut()?.pop_front();
            return Some(TurnWork::Refuse(why));
        }
        let fitting = SLICE_SECS / secs_per_sample.max(1e-12);
        let is_whole = fitting >= job.samples(TileRange { count: 1, ..next });
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
        // Whole messages, unless one takes too long.
        // Groups are sent when complete, and an incomplete one is traced again: slices end at their
        // borders.
        let whole = fitting - fitting % TILES_PER_MESSAGE_MAX;
        let count = if whole > 0 { whole } else { fitting.max(1) };
        self.take(count.min(next.count))
    }

    /// Whether other players wait, or have had the device lately and will probably come back.
    fn is_shared(&self, player: PlayerId) -> bool {
        let running = self.running.iter().map(|turn| turn.job.client.player);
        let waiting = running.chain(self.jobs.waiting());
        self.load.load(Instant::now(), player, waiting).players > 0
    }

    /// Takes the first tiles of the next job.
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

    /// Stops the turns that take too long, and returns when the next one will.
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

    /// The cost of a job's scene, unless its paths are deeper than those that were measured.
    fn cost(&self, job: &NodeJob) -> Option<&Cost> {
        let settings = job.request.settings;
        self.costs
            .iter()
            .find(|cost| cost.is_of(job) && cost.max_depth >= settings.max_depth)
    }
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

/// Jobs that keep their copies of scenes: those that are traced, and those whose turns come next.
const UPDATED_KEPT_MAX: usize = 16;
/// Scenes, denoised or not, whose cost a node remembers.
const COSTS_KEPT_MAX: usize = 32;
/// Device time of a slice: what another player's frame waits for. Denoised tiles that take longer are divided where
/// others use the node: a part has a guard band of a block on each side, so that quarters of a tile of 32 × 32 pixels
/// take 1.8 times as long as the whole. The least part is a block, for which 24 × 24 pixels are traced.
const SLICE_SECS: f64 = 0.05;
/// Device time after which a slice is cut if another player waits.
const SLICE_SECS_MAX: f64 = 2.0 * SLICE_SECS;
/// A slice has at most so many times the samples of any that was measured: where a probe's pixels were
/// cheap, the rest of the picture may be dear.
const GROWTH: f64 = 8.0;
/// Device time of a denoised block after which it is stopped if another player waits. Only thousands of samples a pixel
/// take so long, of which the denoiser leaves the picture as it is.
pub(super) const BLOCK_SECS_MAX: f64 = 2.0;
/// Stops of a denoised block after which its request is refused: the first may have been while a device compiled.
pub(super) const BLOCK_STOPS_MAX: u32 = 2;
/// The longest pause of [`JobQueue::watch`].
const WATCH_PAUSE_MAX: Duration = Duration::from_secs(3600);
/// A probe may have been disturbed.
const PROBES_BEFORE_REFUSAL: u32 = 2;

#[cfg(test)]
mod tests;
