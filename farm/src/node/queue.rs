//! The queue of requests that wait for the device: in order of arrival, but the requests of one
//! client by frame, since the oldest is the next to be shown.
//!
//! A client's session admits at most `REQUESTS_QUEUED_MAX` of its requests.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::{SceneHash, TraceRequest};
use carom_tracer::{CompiledScene, Error, Scene};

use super::client_connection::ClientConnection;

/// A request to trace.
pub(super) struct NodeJob {
    pub(super) client: Arc<ClientConnection>,
    pub(super) request: Box<TraceRequest>,
    pub(super) scene: Arc<Scene>,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) arrived: Instant,
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
    jobs: VecDeque<NodeJob>,
    /// Flags of the jobs that workers are tracing.
    running: Vec<Arc<AtomicBool>>,
    workers: usize,
    closed: bool,
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
        state.jobs.push_back(job);
        state.sort_newest();
        drop(state);
        self.changed.notify_one();
    }

    /// Removes cancelled jobs.
    pub(super) fn drop_cancelled(&self) {
        let wanted = |job: &NodeJob| !job.cancelled.load(Ordering::Relaxed);
        lock(&self.state).jobs.retain(wanted);
    }

    pub(super) fn worker_starts(&self) {
        lock(&self.state).workers += 1;
    }

    pub(super) fn worker_ends(&self) {
        lock(&self.state).workers -= 1;
        self.changed.notify_all();
    }

    /// The next job for a worker that has finished the one with the flag `done`; `None` when the
    /// node is dropped.
    pub(super) fn next(&self, done: Option<&Arc<AtomicBool>>) -> Option<NodeJob> {
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

    /// Cancels everything and waits until the workers have ended, for `timeout` at most.
    pub(super) fn close(&self, timeout: Duration) {
        let mut state = lock(&self.state);
        state.closed = true;
        state.jobs.clear();
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
    /// Swaps the newest job with those of the same client that are of later frames; jobs of other
    /// clients keep their places.
    fn sort_newest(&mut self) {
        let mut index = self.jobs.len() - 1;
        for other in (0..index).rev() {
            let (job, before) = (&self.jobs[index], &self.jobs[other]);
            if !Arc::ptr_eq(&job.client, &before.client) {
                continue;
            }
            if before.request.frame <= job.request.frame {
                return;
            }
            self.jobs.swap(index, other);
            index = other;
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
    use super::super::client_connection::TileSharing;
    use super::*;

    /// A client that is connected to a node of `queue`.
    struct Requester {
        session: ClientSession,
        connection: NodeConnection,
        runs: u64,
    }

    impl Requester {
        fn new(queue: &Arc<JobQueue>) -> Self {
            let device = DeviceInfo {
                kind: DeviceKind::Cpu,
                name: String::new(),
                width: 1,
                threads: 1,
            };
            let name = String::new();
            let info = NodeInfo { name, device };
            let connection = NodeConnection::new(info, Arc::clone(queue), TileSharing::Encoded);
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

        fn request(&mut self, frame: u64) {
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
    fn each_clients_oldest_frame_runs_first_in_its_turn() {
        let queue = Arc::new(JobQueue::new());
        let (mut near, mut far) = (Requester::new(&queue), Requester::new(&queue));
        near.request(7);
        far.request(2);
        near.request(8);
        near.request(8);
        near.request(6);
        far.request(3);
        near.request(7);
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
