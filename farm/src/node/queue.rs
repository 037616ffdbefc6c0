//! Runs that wait for the device: in the order in which they came, but of each client the oldest
//! frame first, which is the next to be shown.
//!
//! A client's session lets no more than `REQUESTS_QUEUED_MAX` of its runs in.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::{SceneHash, TraceRequest};
use carom_tracer::{CompiledScene, Error, Scene};

use super::connection::Client;

/// A run to trace.
pub(super) struct Job {
    pub(super) client: Arc<Client>,
    pub(super) request: Box<TraceRequest>,
    pub(super) scene: Arc<Scene>,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) arrived: Instant,
}

/// Shared by connections and workers.
pub(super) struct Queue {
    state: Mutex<State>,
    changed: Condvar,
    scenes: Mutex<VecDeque<(SceneHash, Arc<CompiledScene>)>>,
    /// When the device was last through with something.
    last_done: Mutex<Option<Instant>>,
}

#[derive(Default)]
struct State {
    jobs: VecDeque<Job>,
    /// What workers are at.
    running: Vec<Arc<AtomicBool>>,
    workers: usize,
    closed: bool,
}

impl Queue {
    pub(super) fn new() -> Self {
        Self {
            state: Mutex::default(),
            changed: Condvar::new(),
            scenes: Mutex::default(),
            last_done: Mutex::default(),
        }
    }

    pub(super) fn push(&self, job: Job) {
        let mut state = lock(&self.state);
        state.jobs.push_back(job);
        state.put_in_order();
        drop(state);
        self.changed.notify_one();
    }

    /// Takes cancelled jobs out.
    pub(super) fn sweep(&self) {
        let wanted = |job: &Job| !job.cancelled.load(Ordering::Relaxed);
        lock(&self.state).jobs.retain(wanted);
    }

    pub(super) fn worker_starts(&self) {
        lock(&self.state).workers += 1;
    }

    pub(super) fn worker_ends(&self) {
        lock(&self.state).workers -= 1;
        self.changed.notify_all();
    }

    /// The next job for a worker, which is through with the one whose flag is `done`; `None` when
    /// the node is gone.
    pub(super) fn next(&self, done: Option<&Arc<AtomicBool>>) -> Option<Job> {
        let mut state = lock(&self.state);
        if let Some(done) = done {
            state.running.retain(|running| !Arc::ptr_eq(running, done));
        }
        loop {
            if state.closed {
                return None;
            }
            if let Some(job) = state.jobs.pop_front() {
                state.running.push(Arc::clone(&job.cancelled));
                return Some(job);
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Cancels everything and waits until the workers have ended, but not longer than `patience`.
    pub(super) fn close(&self, patience: Duration) {
        let mut state = lock(&self.state);
        state.closed = true;
        state.jobs.clear();
        for running in &state.running {
            running.store(true, Ordering::Relaxed);
        }
        self.changed.notify_all();
        let working = |state: &mut State| state.workers > 0;
        let ended = self.changed.wait_timeout_while(state, patience, working);
        drop(ended);
    }

    /// A scene in the form that tracers read; a few are kept.
    pub(super) fn compiled(&self, hash: SceneHash, scene: &Scene) -> Result<CompiledScene, Error> {
        let mut scenes = lock(&self.scenes);
        if let Some((_, compiled)) = scenes.iter().find(|(kept, _)| *kept == hash) {
            return Ok(CompiledScene::clone(compiled));
        }
        drop(scenes);
        let compiled = CompiledScene::new(scene)?;
        scenes = lock(&self.scenes);
        scenes.truncate(COMPILED_KEPT_MAX - 1);
        scenes.push_front((hash, Arc::new(compiled.clone())));
        Ok(compiled)
    }

    /// Seconds since `begun`, or since the device was last through with something if that is
    /// later: what has been done until now took it no longer.
    pub(super) fn busy_since(&self, begun: Instant) -> Duration {
        let now = Instant::now();
        let mut last_done = lock(&self.last_done);
        let from = last_done.map_or(begun, |last| last.max(begun));
        *last_done = Some(now);
        now.saturating_duration_since(from)
    }
}

impl State {
    /// Lets the newest job change places with those of the same client that are of later frames: other
    /// clients keep theirs.
    fn put_in_order(&mut self) {
        let mut place = self.jobs.len() - 1;
        for other in (0..place).rev() {
            let (job, before) = (&self.jobs[place], &self.jobs[other]);
            if !Arc::ptr_eq(&job.client, &before.client) {
                continue;
            }
            if before.request.frame <= job.request.frame {
                return;
            }
            self.jobs.swap(place, other);
            place = other;
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Compiled scenes that a node keeps for all its clients.
const COMPILED_KEPT_MAX: usize = 8;

#[cfg(test)]
mod tests {
    use carom_protocol::session::ClientSession;
    use carom_protocol::{FrameId, NodeInfo, PixelFormat, PrecisionRange, RequestId};
    use carom_tracer::{
        DeviceInfo, DeviceKind, ImageSize, RenderSettings, SceneUpdate, TileGrid, TileRange,
    };

    use super::super::NodeConnection;
    use super::*;

    /// A client that has greeted a node of `queue` and asks it for frames, by the runs' numbers.
    struct Asker {
        session: ClientSession,
        connection: NodeConnection,
        runs: u64,
    }

    impl Asker {
        fn new(queue: &Arc<Queue>) -> Self {
            let device = DeviceInfo {
                kind: DeviceKind::Cpu,
                name: String::new(),
                width: 1,
                threads: 1,
            };
            let name = String::new();
            let connection = NodeConnection::new(NodeInfo { name, device }, Arc::clone(queue));
            let mut asker = Self {
                session: ClientSession::new(),
                connection,
                runs: 0,
            };
            asker.exchange();
            let scene = include_str!("../../../assets/scenes/pool.json");
            let scene = Scene::from_json(scene).unwrap();
            asker
                .session
                .set_scene(SceneHash::of(&scene), &scene)
                .unwrap();
            asker.exchange();
            asker
        }

        fn exchange(&mut self) {
            while let Some(packet) = self.session.poll_transmit() {
                self.connection.handle(packet).unwrap();
                while let Some(answer) = self.connection.poll_transmit() {
                    self.session.handle(answer).unwrap();
                }
            }
        }

        fn ask(&mut self, frame: u64) {
            let scene = include_str!("../../../assets/scenes/pool.json");
            let scene = Scene::from_json(scene).unwrap();
            let request = TraceRequest {
                frame: FrameId(frame),
                id: RequestId(self.runs),
                scene: SceneHash::of(&scene),
                update: SceneUpdate::default(),
                grid: TileGrid::new(ImageSize::new(8, 8), 8),
                tiles: TileRange { first: 0, count: 1 },
                settings: RenderSettings::default(),
                format: PixelFormat::LinearF32,
                precision: PrecisionRange::EXACT,
                references: Vec::new(),
            };
            self.runs += 1;
            self.session.trace(request).unwrap();
            self.exchange();
        }
    }

    #[test]
    fn each_client_has_its_oldest_frame_traced_first_and_takes_no_turn_of_another() {
        let queue = Arc::new(Queue::new());
        let (mut near, mut far) = (Asker::new(&queue), Asker::new(&queue));
        near.ask(7);
        far.ask(2);
        near.ask(8);
        near.ask(8);
        near.ask(6);
        far.ask(3);
        near.ask(7);
        let next = || {
            queue
                .next(None)
                .map(|job| (job.request.frame.0, job.request.id.0))
        };
        let order: Vec<_> = (0..7).filter_map(|_| next()).collect();
        let (nears, fars) = ([(6, 3), (7, 0), (7, 4), (8, 1), (8, 2)], [(2, 0), (3, 1)]);
        assert_eq!(
            order,
            [
                nears[0], fars[0], nears[1], nears[2], nears[3], fars[1], nears[4]
            ]
        );
    }
}
