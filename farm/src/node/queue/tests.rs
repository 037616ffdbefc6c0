//! Tests of the queue by the work that it hands out.

use carom_protocol::session::ClientSession;
use carom_protocol::{
    CodedParticles, EncodedScene, FrameId, NodeInfo, PixelFormat, PrecisionRange, RequestId,
    SceneHash, TraceRequest,
};
use carom_tracer::{
    DeviceInfo, DeviceKind, ImageSize, RenderSettings, Scene, SceneUpdate, TileGrid, TileRange,
};

use super::super::client_connection::TileSharing;
use super::super::{NodeConnection, PacketHandler as _};
use super::*;

/// A client that is connected to a node of `queue`.
struct Requester {
    session: ClientSession,
    connection: NodeConnection,
    queue: Arc<JobQueue>,
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
        let info = NodeInfo {
            name,
            instance: 0,
            device,
        };
        let queue = Arc::clone(queue);
        let connection =
            NodeConnection::new(info, player, Arc::clone(&queue), TileSharing::Encoded);
        let mut requester = Self {
            session: ClientSession::new(),
            connection,
            queue,
            runs: 0,
        };
        requester.exchange();
        let scene = include_str!("../../../../assets/scenes/pool.json");
        let scene = Scene::from_json(scene).unwrap();
        requester
            .session
            .set_scene(&EncodedScene::new(&scene).unwrap())
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

    /// Queues a request for a picture of so many tiles.
    fn request(&mut self, frame: u64, tiles: u32) {
        self.request_with(frame, tiles, RenderSettings::default());
    }

    /// Queues a request for a picture of so many tiles with one sample per pixel.
    fn request_with(&mut self, frame: u64, tiles: u32, settings: RenderSettings) {
        let size = ImageSize::new(8 * tiles.min(64), 8 * tiles.div_ceil(64));
        self.request_grid(frame, TileGrid::new(size, 8), tiles, settings);
    }

    /// Queues a request for the first tiles of a picture with one sample per pixel.
    fn request_grid(&mut self, frame: u64, grid: TileGrid, tiles: u32, settings: RenderSettings) {
        let scene = include_str!("../../../../assets/scenes/pool.json");
        let scene = Scene::from_json(scene).unwrap();
        let request = TraceRequest {
            frame: FrameId(frame),
            id: RequestId(self.runs),
            scene: SceneHash::of(&scene),
            update: SceneUpdate::default(),
            grid,
            tiles: TileRange {
                first: 0,
                count: tiles,
            },
            settings: RenderSettings {
                samples: 1,
                ..settings
            },
            format: PixelFormat::LinearF32,
            precision: PrecisionRange::EXACT,
            references: Vec::new(),
            particles: CodedParticles::default(),
        };
        self.runs += 1;
        self.session.trace(request).unwrap();
        self.exchange();
        while let Some(job) = self.queue.scenes.try_next() {
            let scene = self.queue.scenes.compile(&job).unwrap();
            self.queue.push_compiled(job, scene);
        }
    }
}

/// The player and request of a piece of work.
fn traced(queue: &JobQueue) -> (PlayerId, u64, TileRange) {
    let turn = queue.next().unwrap();
    let TurnWork::Trace(tiles) = turn.work else {
        panic!("the price is known and low");
    };
    queue.finish(&turn, Duration::from_secs_f64(SLICE_SECS));
    (turn.job.client.player, turn.job.request.id.0, tiles)
}

/// The explanation of a refusal.
fn refused(queue: &JobQueue) -> String {
    let turn = queue.next().unwrap();
    let TurnWork::Refuse(why) = &turn.work else {
        panic!("the request is too dear");
    };
    queue.finish(&turn, Duration::ZERO);
    why.clone()
}

/// Samples that are measured at once.
const SAMPLES: f64 = 1e6;
const DENOISED: RenderSettings = RenderSettings {
    samples: 1,
    first_sample: 0,
    max_depth: 5,
    seed: 0,
    denoise: true,
};

/// Sets the cost of a sample of the pool table's scene.
fn price(queue: &JobQueue, secs_per_sample: f64, probes: u32) {
    for _ in 0..probes {
        let turn = queue.next().unwrap();
        assert_eq!(turn.work, TurnWork::Probe, "the price is not known");
        let took = Duration::from_secs_f64(SAMPLES * secs_per_sample);
        queue.set_cost(&turn.job, SAMPLES, took, true);
        queue.finish(&turn, Duration::ZERO);
    }
}

#[test]
fn each_clients_oldest_frame_runs_first_in_its_turn() {
    let queue = Arc::new(JobQueue::default());
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
    let queue = Arc::new(JobQueue::default());
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
fn the_player_of_this_process_is_neither_priced_nor_sliced() {
    let queue = Arc::new(JobQueue::default());
    let mut stranger = Requester::new(&queue, PlayerId::of_key(b"stranger"));
    stranger.request(0, 4096);
    price(&queue, 100.0, PROBES_BEFORE_REFUSAL);
    refused(&queue);
    let mut local = Requester::new(&queue, PlayerId::LOCAL);
    for frame in 0..2 {
        local.request(frame, 4096);
        let whole = TileRange {
            first: 0,
            count: 4096,
        };
        assert_eq!(traced(&queue), (PlayerId::LOCAL, frame, whole));
    }
}

#[test]
fn a_player_that_has_had_its_hour_is_refused_and_others_are_not() {
    let queue = Arc::new(JobQueue::default());
    queue.set_quota(2.5 * SLICE_SECS);
    let [near_id, far_id] = [b"near", b"far!"].map(|key| PlayerId::of_key(key));
    let (mut near, mut far) = (
        Requester::new(&queue, near_id),
        Requester::new(&queue, far_id),
    );
    near.request(1, 1);
    price(&queue, 1e-6, 1);
    for _ in 0..3 {
        assert_eq!(traced(&queue).0, near_id);
        near.request(1, 1);
    }
    let why = refused(&queue);
    assert!(why.contains("ask again in"), "{why}");
    far.request(1, 1);
    assert_eq!(traced(&queue).0, far_id);
}

#[test]
fn a_request_that_takes_days_is_refused() {
    let queue = Arc::new(JobQueue::default());
    let mut greedy = Requester::new(&queue, PlayerId::of_key(b"greedy"));
    greedy.request_with(0, 32, DENOISED);
    price(&queue, 1.0, PROBES_BEFORE_REFUSAL);
    let why = refused(&queue);
    // The guard band of the first block is the one beside it.
    let expected = "8x8 denoised pixels of it take some 128 s here, of at most 10 s";
    assert!(why.contains(expected), "{why}");
    greedy.request(1, 4096);
    price(&queue, 0.1, PROBES_BEFORE_REFUSAL);
    let why = refused(&queue);
    assert!(why.contains("26214 s here, of at most 3600 s"), "{why}");
}

#[test]
fn slices_grow_from_what_was_measured() {
    let queue = Arc::new(JobQueue::default());
    let mut player = Requester::new(&queue, PlayerId::of_key(b"player"));
    player.request(0, 4096);
    let probe = queue.next().unwrap();
    queue.set_cost(&probe.job, 64.0, Duration::from_micros(1), true);
    queue.finish(&probe, Duration::ZERO);
    // 64 samples per tile: a slice whose cost was measured on one tile may have eight.
    assert_eq!(traced(&queue).2.count, 8);
    queue.set_cost(&probe.job, 512.0, Duration::from_micros(8), false);
    assert_eq!(traced(&queue).2.count, 64);
}

#[test]
fn a_slice_that_takes_longer_than_its_price_is_cut_when_somebody_waits() {
    let queue = Arc::new(JobQueue::default());
    let [greedy_id, honest_id] = [b"a", b"b"].map(|key| PlayerId::of_key(key));
    let mut greedy = Requester::new(&queue, greedy_id);
    greedy.request(0, 4096);
    price(&queue, SLICE_SECS / (64.0 * 64.5), 1);
    let turn = queue.next().unwrap();
    let stops_at = |secs: f64| {
        let begun = lock(&queue.state).running[0].begun;
        lock(&queue.state).stop_overdue(begun + Duration::from_secs_f64(secs));
        turn.stop.load(Ordering::Relaxed)
    };
    // Alone it may take its time.
    assert!(!stops_at(9.0 * SLICE_SECS_MAX));
    let mut honest = Requester::new(&queue, honest_id);
    honest.request(9, 1);
    assert!(!stops_at(0.9 * SLICE_SECS_MAX));
    assert!(stops_at(1.1 * SLICE_SECS_MAX));
    let left = TileRange {
        first: 8,
        count: 56,
    };
    queue.put_back(&turn.job, vec![left]);
    queue.finish(&turn, Duration::from_secs_f64(SLICE_SECS_MAX));
    assert_eq!(traced(&queue).0, honest_id);
    assert_eq!(traced(&queue), (greedy_id, 0, left));
    assert_eq!(traced(&queue).2.first, 64);
}

/// Ends a turn as if its tiles had been traced.
fn end_traced(queue: &JobQueue, turn: &Turn) {
    if let TurnWork::TracePart(tile, part) = turn.work {
        let mut partial = turn.job.take_partial(tile).unwrap();
        let traced = carom_tracer::TileRadiance {
            index: 0,
            radiance: vec![[0.0; 3]; part.pixels()],
            dropped_samples: 0,
        };
        partial.put(part, &traced);
        if let Err(partial) = partial.whole() {
            turn.job.keep_partial(partial);
            let (first, count) = (tile, 1);
            queue.put_back(&turn.job, vec![TileRange { first, count }]);
        }
    }
    queue.finish(turn, Duration::from_secs_f64(SLICE_SECS));
}

#[test]
fn a_tile_longer_than_a_slice_is_traced_in_parts() {
    let queue = Arc::new(JobQueue::default());
    let mut greedy = Requester::new(&queue, PlayerId::of_key(b"a"));
    greedy.request(0, 2);
    // A column of eight samples fills a slice, three times.
    price(&queue, SLICE_SECS / (3.0 * 8.5), 1);
    let mut parts = Vec::new();
    for _ in 0..6 {
        let turn = queue.next().unwrap();
        let TurnWork::TracePart(tile, part) = turn.work else {
            panic!("{:?}", turn.work);
        };
        parts.push((tile, part.x, part.width, part.height));
        end_traced(&queue, &turn);
    }
    let columns =
        |tile: u32| [(0, 3), (3, 3), (6, 2)].map(|(x, width)| (tile, 8 * tile + x, width, 8));
    assert_eq!(parts, [columns(0), columns(1)].concat());
}

/// Tiles of 64 × 64 pixels, for which 80 × 80 are traced where they are denoised.
const LARGE_TILES: TileGrid = TileGrid::new(ImageSize::new(640, 640), 64);
/// Device time of such a tile, in seconds.
const DENOISED_SECS: f64 = 5.0;

/// Two players, the first of whom has requested a picture of denoised tiles that take [`DENOISED_SECS`]
/// each.
fn greedy_and_honest(queue: &Arc<JobQueue>) -> [Requester; 2] {
    let mut players = [b"a", b"b"].map(|key| Requester::new(queue, PlayerId::of_key(key)));
    players[0].request_grid(0, LARGE_TILES, LARGE_TILES.len(), DENOISED);
    price(queue, DENOISED_SECS / (80.0 * 80.0), 1);
    players
}

#[test]
fn dear_denoised_tiles_are_whole_while_nobody_waits_and_slices_otherwise() {
    let queue = Arc::new(JobQueue::default());
    let [_greedy, mut honest] = greedy_and_honest(&queue);
    let first = TileRange { first: 0, count: 1 };
    let alone = queue.next().unwrap();
    assert_eq!(alone.work, TurnWork::Trace(first));
    end_traced(&queue, &alone);
    // Non-denoised samples of the same scene have a cost of their own.
    honest.request(9, 4096);
    let probe = queue.next().unwrap();
    assert_eq!(probe.work, TurnWork::Probe);
    queue.set_cost(&probe.job, SAMPLES, Duration::from_secs(10), true);
    queue.finish(&probe, Duration::from_millis(1));
    let (mut parts, mut of_honest) = (0, 0);
    for _ in 0..40 {
        let turn = queue.next().unwrap();
        match turn.work {
            TurnWork::TracePart(_, part) => {
                let secs = turn.job.samples_of_part(part) * DENOISED_SECS / (80.0 * 80.0);
                let is_least = part.width == 8 && part.height == 8;
                assert!(secs <= SLICE_SECS || is_least, "{part:?} takes {secs} s");
                assert!(secs <= 10.0 * SLICE_SECS, "{part:?} takes {secs} s");
                parts += 1;
            }
            TurnWork::Trace(_) => {
                assert_eq!(turn.job.client.player, PlayerId::of_key(b"b"));
                of_honest += 1;
            }
            _ => panic!("{:?}", turn.work),
        }
        end_traced(&queue, &turn);
    }
    assert!(parts >= 15 && of_honest >= 15, "{parts} and {of_honest}");
}

#[test]
fn a_denoised_tile_stopped_for_another_player_goes_on_in_parts() {
    let queue = Arc::new(JobQueue::default());
    let [_greedy, mut honest] = greedy_and_honest(&queue);
    let turn = queue.next().unwrap();
    assert_eq!(turn.work, TurnWork::Trace(TileRange { first: 0, count: 1 }));
    let begun = lock(&queue.state).running[0].begun;
    let stops_at = |secs: f64| {
        lock(&queue.state).stop_overdue(begun + Duration::from_secs_f64(secs));
        turn.stop.load(Ordering::Relaxed)
    };
    assert!(!stops_at(2.0 * UNDIVIDED_SECS_MAX), "nobody waits");
    honest.request(9, 1);
    assert!(!stops_at(0.9 * SLICE_SECS_MAX));
    assert!(stops_at(1.1 * SLICE_SECS_MAX));
    assert_eq!(turn.job.note_stop(0), 1);
    queue.put_back(&turn.job, vec![TileRange { first: 0, count: 1 }]);
    queue.finish(&turn, Duration::from_secs_f64(SLICE_SECS_MAX));
    // Even when the other player has left, traced parts must not be lost.
    drop(honest);
    queue.drop_cancelled();
    lock(&queue.state)
        .jobs
        .retain(|queued| queued.job.is_denoised());
    lock(&queue.state).load = LoadMeter::default();
    for _ in 0..4 {
        let turn = queue.next().unwrap();
        assert!(
            matches!(turn.work, TurnWork::TracePart(0, _)),
            "{:?}",
            turn.work
        );
        end_traced(&queue, &turn);
    }
}

#[test]
fn a_denoised_block_beside_others_is_stopped_in_seconds() {
    let queue = Arc::new(JobQueue::default());
    let [greedy_id, honest_id] = [b"a", b"b"].map(|key| PlayerId::of_key(key));
    let mut greedy = Requester::new(&queue, greedy_id);
    greedy.request_with(0, 1, DENOISED);
    price(&queue, 1e-6, 1);
    let turn = queue.next().unwrap();
    let mut honest = Requester::new(&queue, honest_id);
    honest.request(9, 1);
    let state = lock(&queue.state);
    let begun = state.running[0].begun;
    state.stop_overdue(begun + Duration::from_secs_f64(0.9 * BLOCK_SECS_MAX));
    assert!(!turn.stop.load(Ordering::Relaxed));
    state.stop_overdue(begun + Duration::from_secs_f64(BLOCK_SECS_MAX));
    assert!(turn.stop.load(Ordering::Relaxed));
}

#[test]
fn a_tile_without_end_is_stopped() {
    let queue = Arc::new(JobQueue::default());
    let mut greedy = Requester::new(&queue, PlayerId::of_key(b"a"));
    greedy.request_with(0, 1, DENOISED);
    price(&queue, 1e-6, 1);
    let turn = queue.next().unwrap();
    let state = lock(&queue.state);
    let begun = state.running[0].begun;
    state.stop_overdue(begun + Duration::from_secs_f64(0.9 * UNDIVIDED_SECS_MAX));
    assert!(!turn.stop.load(Ordering::Relaxed));
    state.stop_overdue(begun + Duration::from_secs_f64(UNDIVIDED_SECS_MAX));
    assert!(turn.stop.load(Ordering::Relaxed));
}
