//! A client and a node over a network that delivers tiles in any order.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use carom_protocol::limits::{REQUESTS_QUEUED_MAX, SCENES_KEPT_MAX, TILES_PER_MESSAGE_MAX};
use carom_protocol::tile_codec::{Encoder, TilePixels};
use carom_protocol::{
    Channel, ClientEvent, ClientSession, CodedParticles, EncodedScene, FrameId, NodeEvent,
    NodeLoad, NodeSession, Packet, PixelFormat, RefusalReason, RequestId, RequestReport, SceneHash,
    SceneStatus, TilesDone, TraceRequest,
};
use carom_tracer::{ImageSize, RenderSettings, SceneUpdate, TileGrid, TileRange};
use proptest::prelude::*;

use crate::any;

/// 70 tiles, the last of each row narrower, the last row lower.
const GRID: TileGrid = TileGrid::new(ImageSize::new(77, 53), 8);
const SCENES: usize = SCENES_KEPT_MAX + 3;

struct Pair {
    client: ClientSession,
    node: NodeSession,
    encoder: Encoder,
    scenes: Vec<Arc<EncodedScene>>,
    to_node: VecDeque<Packet>,
    copies: Vec<Packet>,
    /// Requests that the node has been told to trace.
    begun: BTreeSet<RequestId>,
    to_client: VecDeque<Packet>,
    tiles_to_client: Vec<Packet>,
    /// The node's work: the request and the next tile.
    work: BTreeMap<RequestId, (TraceRequest, u32)>,
    requests: BTreeMap<RequestId, SentRequest>,
}

/// What the client has of a request.
struct SentRequest {
    tiles: TileRange,
    received: BTreeSet<u32>,
    cancelled: bool,
    ended: bool,
}

impl Pair {
    fn new() -> Self {
        // Every third travels in chunks.
        let scenes = (0..SCENES).map(|index| {
            let scene = match index % 3 {
                2 => any::long_row(4000 + index),
                _ => any::balls(index),
            };
            EncodedScene::new(&scene).unwrap()
        });
        let mut pair = Self {
            client: ClientSession::new(),
            node: NodeSession::new(any::node_info("near")),
            encoder: Encoder::new(),
            scenes: scenes.collect(),
            to_node: VecDeque::new(),
            copies: Vec::new(),
            begun: BTreeSet::new(),
            to_client: VecDeque::new(),
            tiles_to_client: Vec::new(),
            work: BTreeMap::new(),
            requests: BTreeMap::new(),
        };
        pair.drain(); // hello, welcome
        pair
    }

    /// One thing that can happen, chosen by `what`, its details by `detail`.
    fn step(&mut self, what: u8, detail: usize) {
        match what % 14 {
            0 | 1 => self.ask(detail),
            2 => self.cancel_request(detail),
            3 => self.cancel_before(detail),
            4 => self.client.ping(detail as u64).unwrap(),
            5 | 6 => self.deliver_to_node(),
            7 | 8 => self.work(detail),
            9 => self.refuse(detail),
            10 => self.deliver_to_client(),
            11 | 12 => self.deliver_copy(detail),
            _ => self.deliver_tiles(detail),
        }
        self.transmit();
    }

    fn transmit(&mut self) {
        while let Some(packet) = self.client.poll_transmit() {
            if carom_protocol::codec::is_trace(&packet.bytes) {
                let channel = Channel::Copy;
                let bytes = packet.bytes.clone();
                self.copies.push(Packet::new(channel, bytes));
            }
            self.to_node.push_back(packet);
        }
        while let Some(packet) = self.node.poll_transmit() {
            match packet.channel {
                Channel::Tiles => self.tiles_to_client.push(packet),
                _ => self.to_client.push_back(packet),
            }
        }
    }

    fn ask(&mut self, detail: usize) {
        if self.client.open_requests() == REQUESTS_QUEUED_MAX {
            return;
        }
        let scene = &self.scenes[detail % SCENES];
        let status = self.client.set_scene(scene).unwrap();
        if status == SceneStatus::Transferring {
            return;
        }
        let id = RequestId(self.requests.len() as u64 * 3);
        let first = detail as u32 % GRID.len();
        let count = 1 + detail as u32 / 7 % (GRID.len() - first);
        let tiles = TileRange { first, count };
        let request = TraceRequest {
            frame: frame_of(id),
            id,
            scene: scene.hash(),
            update: SceneUpdate::default(),
            grid: GRID,
            tiles,
            settings: RenderSettings::default(),
            format: PixelFormat::LinearF32,
            precision: carom_protocol::PrecisionRange::EXACT,
            references: Vec::new(),
            particles: CodedParticles::default(),
        };
        self.client.trace(request).unwrap();
        let (received, cancelled, ended) = (BTreeSet::new(), false, false);
        self.requests.insert(
            id,
            SentRequest {
                tiles,
                received,
                cancelled,
                ended,
            },
        );
    }

    fn cancel_request(&mut self, detail: usize) {
        let Some(request) = pick(self.requests.keys(), detail) else {
            return;
        };
        self.client.cancel_request(request).unwrap();
        self.requests.get_mut(&request).unwrap().cancelled = true;
    }

    fn cancel_before(&mut self, detail: usize) {
        let frame = FrameId((detail % (self.requests.len() + 1)) as u64 / 2);
        self.client.cancel_before(frame).unwrap();
        for (_, request) in self
            .requests
            .iter_mut()
            .filter(|(id, _)| frame_of(**id) < frame)
        {
            request.cancelled = true;
        }
    }

    fn deliver_to_node(&mut self) {
        if let Some(packet) = self.to_node.pop_front() {
            self.node_hears(packet);
        }
    }

    /// Any of the copies, which may come again.
    fn deliver_copy(&mut self, detail: usize) {
        if !self.copies.is_empty() {
            let index = detail % self.copies.len();
            self.node_hears(self.copies[index].clone());
        }
    }

    fn node_hears(&mut self, packet: Packet) {
        match self.node.handle(packet).unwrap() {
            Some(NodeEvent::Trace { request, scene }) => {
                assert_eq!(SceneHash::of(&scene), request.scene);
                let id = request.id;
                assert!(self.begun.insert(id), "{id:?} is begun twice");
                self.work.insert(id, (*request, 0));
            }
            Some(NodeEvent::Cancelled(requests)) => {
                for request in requests {
                    self.work
                        .remove(&request)
                        .expect("a cancelled request is one that was asked for");
                }
            }
            Some(NodeEvent::Scene { hash, scene }) => assert_eq!(SceneHash::of(&scene), hash),
            Some(NodeEvent::Ping(number)) => self.node.pong(number, NodeLoad::default()),
            None | Some(NodeEvent::Left) => {}
        }
    }

    /// Some tiles of a request, or its report after the last.
    fn work(&mut self, detail: usize) {
        let Some(id) = pick(self.work.keys(), detail) else {
            return;
        };
        let (request, next) = self.work.get_mut(&id).unwrap();
        let left = request.tiles.count - *next;
        if left == 0 {
            self.node.request_done(report(id)).unwrap();
            self.work.remove(&id);
            return;
        }
        let count = left.min(1 + detail as u32 % TILES_PER_MESSAGE_MAX);
        let first = request.tiles.first + *next;
        let tiles = TileRange { first, count };
        *next += count;
        let pixels = encode(&mut self.encoder, id, tiles);
        let (busy_micros, dropped_samples) = (count, first);
        let done = TilesDone {
            request: id,
            tiles,
            busy_micros,
            times: carom_protocol::NodeTimes::default(),
            dropped_samples,
            pixels,
        };
        assert!(self.node.tiles(done).unwrap());
    }

    fn refuse(&mut self, detail: usize) {
        if !detail.is_multiple_of(5) {
            return; // a device that fails all the time would leave little to test
        }
        let Some(request) = pick(self.work.keys(), detail) else {
            return;
        };
        assert!(
            self.node
                .refuse(request, RefusalReason::Device("it is on fire".into()))
        );
        self.work.remove(&request);
    }

    fn deliver_to_client(&mut self) {
        if let Some(packet) = self.to_client.pop_front() {
            self.hear(packet);
        }
    }

    fn deliver_tiles(&mut self, detail: usize) {
        if !self.tiles_to_client.is_empty() {
            let index = detail % self.tiles_to_client.len();
            let packet = self.tiles_to_client.swap_remove(index);
            self.hear(packet);
        }
    }

    fn hear(&mut self, packet: Packet) {
        for event in self.client.handle(packet).unwrap() {
            match event {
                ClientEvent::Tiles {
                    frame,
                    request,
                    tiles,
                    pixels,
                    ..
                } => {
                    assert_eq!(frame, frame_of(request));
                    assert!(!self.requests[&request].cancelled);
                    assert_eq!(
                        pixels,
                        TilePixels::Linear(radiance(request, tiles).concat())
                    );
                    self.receive(request, tiles);
                }
                ClientEvent::TilesStale { request, tiles, .. } => {
                    assert!(self.requests[&request].cancelled);
                    self.receive(request, tiles);
                }
                ClientEvent::RequestDone {
                    frame,
                    report: heard,
                } => {
                    assert_eq!(
                        (frame, heard),
                        (frame_of(heard.request), report(heard.request))
                    );
                    let request = self.end(heard.request);
                    let whole = request.received.len() == request.tiles.count as usize;
                    assert!(whole || request.cancelled);
                }
                ClientEvent::RequestRefused { refusal, .. } => {
                    let request = self.end(refusal.request);
                    match refusal.why {
                        RefusalReason::Cancelled => assert!(request.cancelled),
                        RefusalReason::Device(_) => {}
                        // The client never asks for more than the node takes, and knows which
                        // scenes it keeps.
                        why => panic!("{why:?}"),
                    }
                }
                ClientEvent::Welcome(_)
                | ClientEvent::SceneReady(_)
                | ClientEvent::Pong { .. }
                | ClientEvent::Leaving => {}
                ClientEvent::SceneComing { bytes, of, .. } => assert!(bytes <= of),
                ClientEvent::SceneRefused { why, .. } => panic!("{why}"),
            }
        }
    }

    fn receive(&mut self, request: RequestId, tiles: TileRange) {
        let request = self.requests.get_mut(&request).unwrap();
        assert!(!request.ended);
        for tile in tiles.indices() {
            assert!(request.tiles.indices().contains(&tile));
            assert!(request.received.insert(tile), "tile {tile} came twice");
        }
    }

    fn end(&mut self, request: RequestId) -> &SentRequest {
        let request = self.requests.get_mut(&request).unwrap();
        assert!(
            !std::mem::replace(&mut request.ended, true),
            "two last words"
        );
        request
    }

    /// Lets everything that is under way come to its end.
    fn drain(&mut self) {
        loop {
            self.transmit();
            if !self.to_node.is_empty() {
                self.deliver_to_node();
            } else if !self.to_client.is_empty() {
                self.deliver_to_client();
            } else if !self.tiles_to_client.is_empty() {
                self.deliver_tiles(0);
            } else if !self.work.is_empty() {
                self.work(0);
            } else {
                break;
            }
        }
    }
}

fn frame_of(request: RequestId) -> FrameId {
    FrameId(request.0 / 6)
}

fn report(request: RequestId) -> RequestReport {
    let queue_micros = request.0 as u32;
    RequestReport {
        request,
        queue_micros,
        ..RequestReport::default()
    }
}

/// Light that tells request, tile and pixel.
fn radiance(request: RequestId, tiles: TileRange) -> Vec<Vec<[f32; 3]>> {
    let tile = |index: u32| {
        let pixels = 0..GRID.tile(index).pixels();
        pixels
            .map(|pixel| [request.0 as f32, index as f32, pixel as f32])
            .collect()
    };
    tiles.indices().map(tile).collect()
}

fn encode(encoder: &mut Encoder, request: RequestId, tiles: TileRange) -> Vec<u8> {
    let radiance = radiance(request, tiles);
    let lit: Vec<_> = GRID
        .tiles(tiles)
        .zip(radiance.iter().map(|tile| &tile[..]))
        .collect();
    encoder.encode(PixelFormat::LinearF32, &lit)
}

fn pick<'a>(
    mut requests: impl ExactSizeIterator<Item = &'a RequestId>,
    detail: usize,
) -> Option<RequestId> {
    let count = requests.len().max(1);
    requests.nth(detail % count).copied()
}

proptest! {
    #![proptest_config(any::config(150))]

    #[test]
    fn each_request_ends_in_any_order_of_packets(
        steps in prop::collection::vec((any::<u8>(), 0..10_000usize), 0..500),
    ) {
        let mut pair = Pair::new();
        for (what, detail) in steps {
            pair.step(what, detail);
        }
        pair.drain();
        prop_assert_eq!((pair.client.open_requests(), pair.node.open_requests()), (0, 0));
        for (id, request) in &pair.requests {
            prop_assert!(request.ended || request.cancelled, "{:?} has not ended", id);
        }
    }
}

#[test]
fn a_scene_is_sent_once_while_the_node_keeps_it() {
    let mut pair = Pair::new();
    let scene_packets = |pair: &mut Pair, index: usize| {
        let scene = EncodedScene::new(&any::balls(index)).unwrap();
        pair.client.set_scene(&scene).unwrap();
        let sent = std::iter::from_fn(|| pair.client.poll_transmit());
        sent.filter(|packet| packet.bytes[0] == 1).count()
    };
    assert_eq!(scene_packets(&mut pair, 0), 1);
    assert_eq!(scene_packets(&mut pair, 0), 0);
    for index in 1..=SCENES_KEPT_MAX {
        assert_eq!(scene_packets(&mut pair, index), 1);
    }
    assert_eq!(scene_packets(&mut pair, SCENES_KEPT_MAX), 0);
    assert_eq!(
        scene_packets(&mut pair, 0),
        1,
        "it was the least recently used"
    );
}
