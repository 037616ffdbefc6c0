//! A simulated node: one device that works on one request after the other.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::limits::{REQUESTS_QUEUED_MAX, TILES_PER_MESSAGE_MAX};
use carom_protocol::session::ClientEvent;
use carom_protocol::{
    FrameId, NodeLoad, NodeTimes, PixelPrecision, Refusal, RefusalReason, RequestId, RequestReport,
    SceneHash, TraceRequest,
};
use carom_tracer::TileRange;

use super::random_environment::RandomEnvironment;
use super::tile_source::{TileSource, brighter, poison};
use super::{NodePlan, OpenRuns};
use carom_farm::NodeIndex;
use carom_farm::link::LinkCommand;

/// Reaction of a node to a message or to finished work.
pub(super) enum NodeOutput {
    /// Sends an event.
    Event(ClientEvent),
    /// Closes the connection.
    End,
    /// Requests a call of [`SimNode::step`] at this time.
    StepAt(Duration, u64),
}

pub(super) struct SimNode {
    /// Seconds per pixel sample.
    pub(super) pace: f64,
    pub(super) silent: bool,
    pub(super) failing: bool,
    /// Number of the connection; messages of an earlier one are void.
    pub(super) connection: u32,
    /// Time of arrival of the last message at the client, and at the node.
    pub(super) last_arrival: [Duration; 2],
    streams: bool,
    pub(super) honesty: f64,
    /// Whether it sends pixels that are not numbers.
    pub(super) poisoned: bool,
    /// One tile in this many is wrong, but as plausible as others.
    pub(super) forges: Option<u32>,
    scene: Option<SceneHash>,
    queue: VecDeque<QueuedRequest>,
    /// Number of the pending step; steps of other numbers are void.
    step: u64,
    /// Request on which the device works.
    working: Option<RequestId>,
    last_run: Option<RequestId>,
    /// Open requests, as the client sees them.
    open: OpenRuns,
    /// Latest frame that it has begun, whose pause is over.
    begun_frame: Option<FrameId>,
    index: NodeIndex,
    tile_source: Arc<TileSource>,
    /// Number of tiles that its device has worked on.
    pub(super) tiles_traced: u64,
}

struct QueuedRequest {
    request: TraceRequest,
    /// Finished tiles, sent or waiting for a full message.
    tiles_done: u32,
    tiles_sent: u32,
    arrived: Duration,
    begun: Duration,
    /// Time at which the device began with the tiles that have not been sent.
    message_begun: Duration,
}

impl SimNode {
    pub(super) fn new(index: NodeIndex, plan: &NodePlan, tile_source: Arc<TileSource>) -> Self {
        Self {
            pace: 1e-6 / plan.msamples_per_sec,
            silent: false,
            failing: false,
            connection: 0,
            last_arrival: [Duration::ZERO; 2],
            streams: plan.streams,
            honesty: plan.honesty,
            poisoned: false,
            forges: None,
            scene: None,
            queue: VecDeque::new(),
            step: 0,
            working: None,
            last_run: None,
            open: OpenRuns::new(),
            begun_frame: None,
            index,
            tile_source,
            tiles_traced: 0,
        }
    }

    /// Asserts the rules that a session enforces on the client.
    pub(super) fn check(&mut self, command: &LinkCommand) {
        if let LinkCommand::Trace(request) = command {
            assert!(request.tiles.count > 0 && request.tiles.end() <= request.grid.len());
            assert!(self.last_run.is_none_or(|last| request.id > last));
            self.last_run = Some(request.id);
            self.open.insert(request.id);
            assert!(self.open.len() <= REQUESTS_QUEUED_MAX, "{:?}", self.open);
        }
    }

    pub(super) fn die(&mut self) {
        self.connection += 1;
        self.queue.clear();
        self.scene = None;
        self.open.clear();
        self.working = None;
        self.step += 1;
    }

    pub(super) fn command(
        &mut self,
        now: Duration,
        environment: &RandomEnvironment,
        command: LinkCommand,
    ) -> Vec<NodeOutput> {
        if self.silent {
            return Vec::new();
        }
        match command {
            LinkCommand::Scene(scene) if self.scene == Some(scene.hash()) => Vec::new(),
            LinkCommand::Scene(scene) => {
                let hash = scene.hash();
                self.scene = Some(hash);
                vec![NodeOutput::Event(ClientEvent::SceneReady(hash))]
            }
            LinkCommand::Ping(number) => {
                let load = NodeLoad::default();
                vec![NodeOutput::Event(ClientEvent::Pong { number, load })]
            }
            LinkCommand::Leave => vec![NodeOutput::End],
            LinkCommand::Trace(request) => self.queue(now, environment, *request),
            LinkCommand::CancelRequest(run) => self.cancel(|job| job.request.id == run),
            LinkCommand::CancelBefore(frame) => self.cancel(|job| job.request.frame < frame),
        }
    }

    /// Handles the end of a piece of the device's work.
    pub(super) fn step(
        &mut self,
        step: u64,
        now: Duration,
        environment: &RandomEnvironment,
    ) -> Vec<NodeOutput> {
        if step != self.step || self.silent {
            return Vec::new();
        }
        let done = self.working.take();
        let mut answers = self.finish(now, done);
        answers.extend(self.work(now, environment));
        answers
    }

    fn queue(
        &mut self,
        now: Duration,
        environment: &RandomEnvironment,
        request: TraceRequest,
    ) -> Vec<NodeOutput> {
        if self.failing {
            let why = RefusalReason::Device("it was told to fail".into());
            return vec![self.refuse(&request, why)];
        }
        // Ordered by frame, but never before a request that has been begun.
        let later = |job: &QueuedRequest| {
            let begun = job.tiles_done > 0 || self.working == Some(job.request.id);
            !begun && job.request.frame > request.frame
        };
        let place = self.queue.iter().position(later);
        let job = QueuedRequest {
            request,
            tiles_done: 0,
            tiles_sent: 0,
            arrived: now,
            begun: now,
            message_begun: now,
        };
        self.queue.insert(place.unwrap_or(self.queue.len()), job);
        self.work(now, environment)
    }

    fn cancel(&mut self, unwanted: impl Fn(&QueuedRequest) -> bool) -> Vec<NodeOutput> {
        let queue = std::mem::take(&mut self.queue);
        let (gone, kept): (Vec<QueuedRequest>, Vec<QueuedRequest>) =
            queue.into_iter().partition(unwanted);
        self.queue = kept.into();
        let refuse = |job: &QueuedRequest| self.refuse(&job.request, RefusalReason::Cancelled);
        gone.iter().map(refuse).collect()
    }

    /// Begins the next piece of work, if there is any and the device is free. A cancelled piece is
    /// worked on to its end.
    fn work(&mut self, now: Duration, environment: &RandomEnvironment) -> Vec<NodeOutput> {
        let Some(job) = self.queue.front_mut().filter(|_| self.working.is_none()) else {
            return Vec::new();
        };
        let frame = job.request.frame;
        let mut secs = 0.0;
        if self.begun_frame.is_none_or(|begun| begun < frame) {
            self.begun_frame = Some(frame);
            secs += environment.stall_secs(self.index, frame);
        }
        if job.tiles_done == 0 {
            job.begun = now + Duration::from_secs_f64(secs);
            job.message_begun = job.begun;
        }
        let piece = piece(job, self.streams);
        let grid = job.request.grid;
        let samples = f64::from(job.request.settings.samples);
        let work = |tile| samples * grid.tile(tile).pixels() as f64 * environment.cost(frame, tile);
        let work: f64 = piece.indices().map(work).sum();
        secs += work * self.pace * environment.pace(self.index, frame);
        self.tiles_traced += u64::from(piece.count);
        self.working = Some(job.request.id);
        self.step += 1;
        let done = now + Duration::from_secs_f64(secs);
        vec![NodeOutput::StepAt(done, self.step)]
    }

    /// Sends finished tiles, in messages as full as possible.
    fn finish(&mut self, now: Duration, done: Option<RequestId>) -> Vec<NodeOutput> {
        // If the request was cancelled meanwhile, another one is at the front.
        let front = self.queue.front_mut();
        let Some(job) = front.filter(|job| Some(job.request.id) == done) else {
            return Vec::new();
        };
        job.tiles_done += piece(job, self.streams).count;
        let whole = job.tiles_done == job.request.tiles.count;
        let busy = (now - job.message_begun).as_secs_f64() * self.honesty;
        let mut busy_micros = (busy * 1e6) as u32;
        let mut answers = Vec::new();
        while job.tiles_sent + TILES_PER_MESSAGE_MAX <= job.tiles_done
            || whole && job.tiles_sent < job.tiles_done
        {
            let tiles = TileRange {
                first: job.request.tiles.first + job.tiles_sent,
                count: TILES_PER_MESSAGE_MAX.min(job.tiles_done - job.tiles_sent),
            };
            answers.push(NodeOutput::Event(ClientEvent::Tiles {
                frame: job.request.frame,
                request: job.request.id,
                tiles,
                pixels: match self.forges {
                    _ if self.poisoned => poison(&job.request, tiles),
                    Some(one_in) if tiles.first.is_multiple_of(one_in) => {
                        brighter(self.tile_source.pixels(&job.request, tiles))
                    }
                    _ => self.tile_source.pixels(&job.request, tiles),
                },
                busy_micros: std::mem::take(&mut busy_micros),
                times: NodeTimes {
                    queue_micros: (job.begun - job.arrived).as_micros() as u32,
                    trace_micros: (now - job.begun).as_micros() as u32,
                    encode_micros: 0,
                },
                dropped_samples: 0,
                payload_bytes: 1,
                precision: PixelPrecision::Exact,
            }));
            job.tiles_sent += tiles.count;
            job.message_begun = now;
        }
        if whole {
            let report = RequestReport {
                request: job.request.id,
                queue_micros: (job.begun - job.arrived).as_micros() as u32,
                ..RequestReport::default()
            };
            let frame = job.request.frame;
            self.open.remove(&report.request);
            self.queue.pop_front();
            answers.push(NodeOutput::Event(ClientEvent::RequestDone {
                frame,
                report,
            }));
        }
        answers
    }

    fn refuse(&mut self, request: &TraceRequest, why: RefusalReason) -> NodeOutput {
        self.open.remove(&request.id);
        let frame = request.frame;
        let refusal = Refusal {
            request: request.id,
            why,
        };
        NodeOutput::Event(ClientEvent::RequestRefused { frame, refusal })
    }
}

/// The next piece of the device's work: one tile, or all that are left.
fn piece(job: &QueuedRequest, streams: bool) -> TileRange {
    let left = job.request.tiles.count - job.tiles_done;
    TileRange {
        first: job.request.tiles.first + job.tiles_done,
        count: if streams { left.min(1) } else { left },
    }
}
