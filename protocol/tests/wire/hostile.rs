//! Peers that break the rules are told which, and cost no more than the limits say.

use std::sync::Arc;

use carom_protocol::codec::{decode_to_client, encode_to_client, encode_to_node};
use carom_protocol::limits::{CONTROL_QUEUED_MAX, REQUESTS_QUEUED_MAX, REQUESTS_REFUSED_KEPT};
use carom_protocol::message::VERSION;
use carom_protocol::tile_codec::Encoder;
use carom_protocol::{
    Channel, ClientEvent, ClientSession, CodedParticles, EncodedScene, Error, FrameId, NodeEvent,
    NodeLoad, NodeSession, Packet, PixelFormat, Refusal, RefusalReason, RequestId, RequestReport,
    SceneAssembler, SceneHash, TilesDone, ToClient, ToNode, TraceRequest,
};
use carom_tracer::{
    ImageSize, ObjectPose, RenderSettings, Scene, SceneUpdate, Tile, TileGrid, TileRange,
};
use glam::{Quat, Vec3};

use crate::any;

const GRID: TileGrid = TileGrid::new(ImageSize::new(64, 64), 16);

fn pong(number: u64) -> ToClient {
    let load = NodeLoad::default();
    ToClient::Pong { number, load }
}

fn control(message: &ToClient) -> Packet {
    let (channel, bytes) = (Channel::Control, encode_to_client(message).unwrap());
    Packet::new(channel, bytes)
}

fn to_node(message: &ToNode) -> Packet {
    let (channel, bytes) = (Channel::Control, encode_to_node(message).unwrap());
    Packet::new(channel, bytes)
}

fn request(scene: &Scene, id: u64) -> TraceRequest {
    TraceRequest {
        frame: FrameId(id),
        id: RequestId(id),
        scene: SceneHash::of(scene),
        update: SceneUpdate::default(),
        grid: GRID,
        tiles: TileRange { first: 4, count: 8 },
        settings: RenderSettings::default(),
        format: PixelFormat::Srgb8 { exposure: 1.0 },
        precision: carom_protocol::PrecisionRange::EXACT,
        references: Vec::new(),
        particles: CodedParticles::default(),
    }
}

fn encoded(scene: &Scene) -> Arc<EncodedScene> {
    EncodedScene::new(scene).unwrap()
}

fn welcome() -> ToClient {
    ToClient::Welcome {
        version: VERSION,
        node: any::node_info("evil"),
    }
}

/// A client that has been welcomed and waits for tiles 4 to 11, by requests 5 and 7.
fn waiting_client() -> ClientSession {
    let mut client = ClientSession::new();
    client.handle(control(&welcome())).unwrap();
    let scene = any::balls(2);
    client.set_scene(&encoded(&scene)).unwrap();
    client.trace(request(&scene, 5)).unwrap();
    client.trace(request(&scene, 7)).unwrap();
    client
}

fn tiles_of(request: u64, first: u32, pixels: Vec<u8>, count: u32) -> Packet {
    let message = ToClient::Tiles(TilesDone {
        request: RequestId(request),
        tiles: TileRange { first, count },
        busy_micros: 1,
        times: carom_protocol::NodeTimes::default(),
        dropped_samples: 0,
        pixels,
    });
    let (channel, bytes) = (Channel::Tiles, encode_to_client(&message).unwrap());
    Packet::new(channel, bytes)
}

fn black(count: u32) -> Vec<u8> {
    let tile = Tile {
        x: 0,
        y: 0,
        width: 16,
        height: 16,
    };
    let radiance = [[0.0; 3]; 256];
    let lit = vec![(tile, &radiance[..]); count as usize];
    Encoder::new().encode(PixelFormat::Srgb8 { exposure: 1.0 }, &lit)
}

fn tiles(request: u64, first: u32, count: u32) -> Packet {
    tiles_of(request, first, black(count), count)
}

fn done(request: u64) -> Packet {
    control(&ToClient::RequestDone(RequestReport {
        request: RequestId(request),
        ..RequestReport::default()
    }))
}

fn refused(request: u64, why: RefusalReason) -> Packet {
    let request = RequestId(request);
    control(&ToClient::RequestRefused(Refusal { request, why }))
}

/// The client closes on the last of these packets and not before, and stays closed.
fn assert_closes(mut client: ClientSession, packets: impl IntoIterator<Item = Packet>) {
    let mut packets = packets.into_iter().peekable();
    while let Some(packet) = packets.next() {
        let heard = client.handle(packet);
        assert_eq!(heard.is_err(), packets.peek().is_none(), "{heard:?}");
    }
    assert!(client.handle(control(&pong(1))).is_err());
}

/// The packet of a message whose text holds `a` with `by` in its place: no sender lets it pass.
fn with_text(message: &ToClient, by: &[u8; 1]) -> Packet {
    let mut packet = control(message);
    let place = packet.bytes.windows(4).position(|text| text == b"evil");
    packet.bytes[place.unwrap()] = by[0];
    packet
}

#[test]
fn text_with_control_characters_is_refused() {
    let mut device = welcome();
    if let ToClient::Welcome { node, .. } = &mut device {
        node.name.clear();
        node.device.name = "evil".into();
    }
    for message in [welcome(), device] {
        for letter in *b"\x1b\r\n\x7f" {
            let hostile = with_text(&message, &[letter]);
            assert_closes(ClientSession::new(), [hostile]);
        }
    }
    let why = RefusalReason::Device("evil".into());
    let refusal = Refusal {
        request: RequestId(5),
        why,
    };
    let hostile = with_text(&ToClient::RequestRefused(refusal), b"\x1b");
    assert_closes(waiting_client(), [hostile]);
}

#[test]
fn a_node_sends_its_text_printable() {
    let mut info = any::node_info("oak\u{1b}[2J\r\n");
    info.device.name = "\u{9b}x".repeat(300);
    let mut node = NodeSession::new(info);
    let hello = ToNode::Hello { version: VERSION };
    node.handle(to_node(&hello)).unwrap();
    let Some(ToClient::Welcome { node, .. }) = answer(&mut node) else {
        panic!("no welcome");
    };
    assert_eq!(node.name, "oak[2J  ");
    assert_eq!(node.device.name, "x".repeat(255));
}

#[test]
fn tiles_that_were_not_asked_for_are_refused() {
    assert_closes(waiting_client(), [tiles(6, 4, 1)]); // a request of another node
    assert_closes(waiting_client(), [tiles(8, 4, 1)]);
    assert_closes(waiting_client(), [tiles(5, 3, 1)]);
    assert_closes(waiting_client(), [tiles(5, 11, 2)]);
    assert_closes(waiting_client(), [tiles(5, u32::MAX - 1, 1)]);
}

#[test]
fn a_tile_comes_once() {
    assert_closes(waiting_client(), [tiles(5, 4, 2), tiles(5, 4, 2)]);
    assert_closes(waiting_client(), [tiles(5, 4, 2), tiles(5, 5, 2)]);
    let all = [tiles(5, 4, 8), done(5)];
    assert_closes(waiting_client(), all.into_iter().chain([tiles(5, 4, 1)]));
}

#[test]
fn pixels_must_be_those_of_the_tiles() {
    assert_closes(waiting_client(), [tiles_of(5, 4, black(2), 1)]);
    assert_closes(waiting_client(), [tiles_of(5, 4, black(1), 2)]);
    assert_closes(waiting_client(), [tiles_of(5, 4, Vec::new(), 1)]);
}

#[test]
fn early_report_waits_for_its_tiles() {
    let mut client = waiting_client();
    assert_eq!(client.handle(done(5)), Ok(vec![]));
    assert_eq!(client.handle(tiles(5, 4, 4)).unwrap().len(), 1);
    let events = client.handle(tiles(5, 8, 4)).unwrap();
    assert!(matches!(
        events[..],
        [ClientEvent::Tiles { .. }, ClientEvent::RequestDone { .. }]
    ));
    assert_closes(client, [done(5)]);
}

#[test]
fn request_ends_once() {
    assert_closes(waiting_client(), [done(5), done(5)]);
    assert_closes(waiting_client(), [done(6)]);
    let busy = || refused(5, RefusalReason::Busy);
    assert_closes(waiting_client(), [busy(), busy()]);
    assert_closes(waiting_client(), [busy(), done(5)]);
    assert_closes(waiting_client(), [done(5), busy()]);
    assert_closes(waiting_client(), [refused(5, RefusalReason::Cancelled)]);
}

#[test]
fn answers_without_requests_are_faults() {
    let hash = SceneHash([1; 32]);
    let ready = ToClient::SceneReady(SceneHash::of(&any::balls(2)));
    assert_closes(waiting_client(), [control(&ToClient::SceneReady(hash))]);
    assert_closes(waiting_client(), [control(&ready), control(&ready)]);
    assert_closes(waiting_client(), [control(&pong(1))]);
    assert_closes(waiting_client(), [control(&welcome())]);
    assert_closes(ClientSession::new(), [control(&ready)]);
    assert_closes(ClientSession::new(), [tiles(5, 4, 1)]);
}

#[test]
fn messages_keep_to_their_channel() {
    let channel = Channel::Control;
    assert_closes(
        waiting_client(),
        [Packet {
            channel,
            ..tiles(5, 4, 1)
        }],
    );
    let channel = Channel::Tiles;
    assert_closes(waiting_client(), [Packet { channel, ..done(5) }]);
    let mut node = NodeSession::new(any::node_info("near"));
    let hello = to_node(&ToNode::Hello { version: VERSION });
    assert!(node.handle(Packet { channel, ..hello }).is_err());
}

#[test]
fn stale_tiles_of_cancelled_requests_are_no_fault() {
    let mut client = waiting_client();
    client.cancel_request(RequestId(5)).unwrap();
    let events = client.handle(tiles(5, 4, 2)).unwrap();
    assert!(matches!(events[..], [ClientEvent::TilesStale { .. }]));
    client.handle(refused(5, RefusalReason::Cancelled)).unwrap();
    assert_eq!(client.handle(tiles(5, 6, 2)), Ok(vec![]));
    assert_eq!(client.stale_tiles(), 1);
    // A report had come, so the node says no more: the request ends with its cancellation.
    client.handle(done(7)).unwrap();
    client.cancel_before(FrameId(8)).unwrap();
    assert_eq!(client.open_requests(), 0);
    assert_eq!(client.handle(tiles(7, 4, 1)), Ok(vec![]));
    assert_closes(client, [done(7)]);
}

#[test]
fn refused_requests_are_remembered_within_bounds() {
    let mut client = waiting_client();
    let scene = any::balls(2);
    let requests = REQUESTS_REFUSED_KEPT as u64 + 10;
    for id in 100..100 + requests {
        client.trace(request(&scene, id)).unwrap();
        client.handle(refused(id, RefusalReason::Busy)).unwrap();
    }
    assert_eq!(
        client.handle(tiles(100, 4, 1)),
        Ok(vec![]),
        "forgotten, hence forgiven"
    );
    assert_eq!(
        client.handle(tiles(99 + requests, 4, 1)),
        Ok(vec![]),
        "remembered"
    );
    assert_closes(client, [tiles(100 + requests, 4, 1)]);
}

#[test]
fn unsendable_calls_change_nothing() {
    let mut client = waiting_client();
    while client.poll_transmit().is_some() {}
    let (held, other) = (any::balls(2), any::balls(3));
    let mut without_tiles = request(&held, 9);
    without_tiles.tiles.count = 0;
    for request in [request(&other, 9), request(&held, 7), without_tiles] {
        assert!(matches!(
            client.trace(request),
            Err(Error::Unsendable { .. })
        ));
    }
    let mut broken = any::balls(1);
    broken.camera.fov_x_deg = 0.0;
    assert!(EncodedScene::new(&broken).is_err());
    assert_eq!((client.poll_transmit(), client.open_requests()), (None, 2));
    assert!(client.trace(request(&held, 8)).is_ok());
}

/// A node that has said and heard hello and holds a scene of two balls.
fn open_node() -> (NodeSession, Scene) {
    let mut node = NodeSession::new(any::node_info("near"));
    let scene = any::balls(2);
    let hash = SceneHash::of(&scene);
    node.handle(to_node(&ToNode::Hello { version: VERSION }))
        .unwrap();
    let message = ToNode::Scene {
        hash,
        scene: Box::new(scene.clone()),
    };
    assert!(matches!(
        node.handle(to_node(&message)),
        Ok(Some(NodeEvent::Scene { .. }))
    ));
    while node.poll_transmit().is_some() {}
    (node, scene)
}

fn ask(node: &mut NodeSession, request: TraceRequest) -> Result<Option<NodeEvent>, Error> {
    node.handle(to_node(&ToNode::Trace(Box::new(request))))
}

fn answer(node: &mut NodeSession) -> Option<ToClient> {
    let packet = node.poll_transmit()?;
    Some(decode_to_client(&packet.bytes).unwrap())
}

#[test]
fn nothing_comes_before_hello_and_hello_comes_once() {
    for message in [ToNode::Ping(1), ToNode::CancelRequest(RequestId(1))] {
        let mut node = NodeSession::new(any::node_info("near"));
        assert!(matches!(
            node.handle(to_node(&message)),
            Err(Error::OutOfOrder { .. })
        ));
        assert_eq!(node.poll_transmit(), None);
    }
    let (mut node, _) = open_node();
    let hello = to_node(&ToNode::Hello { version: VERSION });
    assert!(node.handle(hello).is_err());
    assert!(node.handle(to_node(&ToNode::Ping(1))).is_err());
}

#[test]
fn both_ends_of_different_versions_say_so() {
    let mut node = NodeSession::new(any::node_info("near"));
    let hello = to_node(&ToNode::Hello {
        version: VERSION + 1,
    });
    let (theirs, ours) = (VERSION + 1, VERSION);
    assert_eq!(node.handle(hello), Err(Error::Version { theirs, ours }));
    assert!(matches!(answer(&mut node), Some(ToClient::Welcome { .. })));
    assert!(node.handle(to_node(&ToNode::Ping(1))).is_err());

    let version = VERSION + 1;
    let node = any::node_info("new");
    let mut client = ClientSession::new();
    assert_eq!(
        client.handle(control(&ToClient::Welcome { version, node })),
        Err(Error::Version { theirs, ours })
    );
}

#[test]
fn unfit_requests_are_refused_without_an_event() {
    let (mut node, scene) = open_node();
    let mut unknown = request(&scene, 1);
    unknown.scene = SceneHash([9; 32]);
    let mut unfit = request(&scene, 2);
    unfit.update.poses = vec![ObjectPose {
        object: 2,
        position: Vec3::ZERO,
        rotation: Quat::IDENTITY,
        visible: true,
    }];
    for request in [unknown, unfit] {
        assert_eq!(ask(&mut node, request), Ok(None));
    }
    let why = |message| match message {
        Some(ToClient::RequestRefused(refusal)) => refusal.why,
        other => panic!("{other:?}"),
    };
    assert_eq!(why(answer(&mut node)), RefusalReason::UnknownScene);
    assert!(matches!(why(answer(&mut node)), RefusalReason::Invalid(_)));
    assert_eq!(node.open_requests(), 0);
}

#[test]
fn a_scene_that_cannot_be_drawn_is_refused() {
    let (mut node, mut scene) = open_node();
    scene.camera.fov_x_deg = f32::NAN;
    let hash = SceneHash::of(&scene);
    let message = ToNode::Scene {
        hash,
        scene: Box::new(scene),
    };
    assert_eq!(node.handle(to_node(&message)), Ok(None));
    assert!(matches!(
        answer(&mut node),
        Some(ToClient::SceneRefused { .. })
    ));
}

#[test]
fn full_queue_refuses_as_busy() {
    let (mut node, scene) = open_node();
    for id in 0..REQUESTS_QUEUED_MAX as u64 {
        assert!(ask(&mut node, request(&scene, id)).unwrap().is_some());
    }
    let next = REQUESTS_QUEUED_MAX as u64;
    assert_eq!(ask(&mut node, request(&scene, next)), Ok(None));
    let busy = Refusal {
        request: RequestId(next),
        why: RefusalReason::Busy,
    };
    assert_eq!(answer(&mut node), Some(ToClient::RequestRefused(busy)));
    assert!(
        ask(&mut node, request(&scene, next)).is_err(),
        "a request used twice"
    );
}

fn copy_of(request: TraceRequest) -> Packet {
    let packet = to_node(&ToNode::Trace(Box::new(request)));
    Packet::new(Channel::Copy, packet.bytes)
}

#[test]
fn a_copys_request_obeys_cancellations() {
    let (mut node, scene) = open_node();
    for (id, cancel) in [
        (1, ToNode::CancelBefore(FrameId(9))),
        (2, ToNode::CancelRequest(RequestId(2))),
    ] {
        let begun = node.handle(copy_of(request(&scene, id)));
        assert!(matches!(begun, Ok(Some(NodeEvent::Trace { .. }))));
        let stopped = node.handle(to_node(&cancel)).unwrap();
        assert_eq!(stopped, Some(NodeEvent::Cancelled(vec![RequestId(id)])));
        assert_eq!(node.open_requests(), 0);
        // The copy comes again, then the packet: it may have been sent after the cancellation.
        assert_eq!(node.handle(copy_of(request(&scene, id))), Ok(None));
        assert_eq!(ask(&mut node, request(&scene, id)), Ok(None));
        let refusal = Refusal {
            request: RequestId(id),
            why: RefusalReason::Busy,
        };
        assert_eq!(answer(&mut node), Some(ToClient::RequestRefused(refusal)));
    }
}

#[test]
fn a_packet_equals_its_copy() {
    let (mut node, scene) = open_node();
    node.handle(copy_of(request(&scene, 1))).unwrap();
    assert_eq!(ask(&mut node, request(&scene, 1)), Ok(None));
    node.handle(copy_of(request(&scene, 2))).unwrap();
    let other = TraceRequest {
        frame: FrameId(77),
        ..request(&scene, 2)
    };
    let error = ask(&mut node, other).unwrap_err();
    assert!(
        error.to_string().contains("differs from its copy"),
        "{error}"
    );
}

#[test]
fn a_scene_decoded_elsewhere_counts_like_its_packet() {
    let (mut node, mut scene) = open_node();
    scene.objects[0].name = "another".into();
    let hash = SceneHash::of(&scene);
    let bytes = to_node(&ToNode::Scene {
        hash,
        scene: Box::new(scene),
    })
    .bytes;
    let mut elsewhere = SceneAssembler::default();
    let mut stranger = NodeSession::new(any::node_info("near"));
    let greeted_late = stranger.handle_scene(elsewhere.handle(&bytes));
    assert!(greeted_late.is_err());
    let kept = node.handle_scene(elsewhere.handle(&bytes)).unwrap();
    assert!(matches!(kept, Some(NodeEvent::Scene { hash: kept, .. }) if kept == hash));
    assert_eq!(answer(&mut node), Some(ToClient::SceneReady(hash)));
    let mut altered = bytes;
    *altered.last_mut().unwrap() ^= 1;
    assert!(node.handle_scene(elsewhere.handle(&altered)).is_err());
    assert!(node.handle(to_node(&ToNode::Ping(1))).is_err());
}

#[test]
fn a_client_that_reads_no_answers_is_cut_off() {
    let (mut node, _) = open_node();
    let ping = to_node(&ToNode::Ping(1));
    for number in 0..CONTROL_QUEUED_MAX as u64 {
        node.handle(ping.clone()).unwrap();
        node.pong(number, NodeLoad::default());
    }
    assert!(node.handle(ping).is_err());
}

/// Tiles of the first request.
fn part(first: u32, count: u32) -> TilesDone {
    TilesDone {
        request: RequestId(1),
        tiles: TileRange { first, count },
        busy_micros: 1,
        times: carom_protocol::NodeTimes::default(),
        dropped_samples: 0,
        pixels: black(count),
    }
}

#[test]
fn cancelled_request_sends_no_more() {
    let (mut node, scene) = open_node();
    ask(&mut node, request(&scene, 1)).unwrap();
    assert_eq!(node.tiles(part(4, 4)), Ok(true));
    let cancelled = node.handle(to_node(&ToNode::CancelBefore(FrameId(2))));
    assert_eq!(
        cancelled,
        Ok(Some(NodeEvent::Cancelled(vec![RequestId(1)])))
    );
    assert_eq!(node.tiles(part(8, 4)), Ok(false));
    assert_eq!(
        node.request_done(RequestReport {
            request: RequestId(1),
            ..RequestReport::default()
        }),
        Ok(false)
    );
    assert!(!node.refuse(RequestId(1), RefusalReason::Busy));
    let (request, why) = (RequestId(1), RefusalReason::Cancelled);
    assert_eq!(
        answer(&mut node),
        Some(ToClient::RequestRefused(Refusal { request, why }))
    );
    assert_eq!(node.poll_transmit(), None);
}

/// On a link that is too slow, what is two frames old would only come too late, and make all that
/// follows late.
#[test]
fn stale_frames_wait_for_newer_ones() {
    let (mut node, scene) = open_node();
    for id in 1..=3 {
        ask(&mut node, request(&scene, id)).unwrap();
    }
    let tiles = |request| TilesDone {
        request: RequestId(request),
        tiles: TileRange { first: 4, count: 8 },
        busy_micros: 1,
        times: carom_protocol::NodeTimes::default(),
        dropped_samples: 0,
        pixels: black(8),
    };
    let done = |request| RequestReport {
        request: RequestId(request),
        ..RequestReport::default()
    };
    let bytes = |node: &NodeSession| node.waiting_bytes();
    assert_eq!(node.tiles(tiles(1)), Ok(true));
    let one = bytes(&node);
    assert_eq!(node.tiles(tiles(2)), Ok(true));
    assert_eq!(bytes(&node), 2 * one);
    assert_eq!(node.tiles(tiles(3)), Ok(true));
    assert_eq!(bytes(&node), 2 * one);
    assert_eq!(node.request_done(done(1)), Ok(true));
    let sent: Vec<RequestId> = std::iter::from_fn(|| answer(&mut node))
        .map(|message| match message {
            ToClient::Tiles(tiles) => tiles.request,
            ToClient::RequestDone(report) => report.request,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(sent, [2, 3, 1, 1].map(RequestId));
    assert_eq!((bytes(&node), node.open_requests()), (0, 2));
    // Cancelled, none of it is left.
    ask(&mut node, request(&scene, 5)).unwrap();
    node.tiles(TilesDone {
        request: RequestId(5),
        ..tiles(5)
    })
    .unwrap();
    node.tiles(tiles(3)).unwrap_err();
    let cancelled = node.handle(to_node(&ToNode::CancelBefore(FrameId(9))));
    assert!(matches!(cancelled, Ok(Some(NodeEvent::Cancelled(_)))));
    assert_eq!(bytes(&node), 0);
}

#[test]
fn node_answers_only_what_was_asked() {
    let (mut node, scene) = open_node();
    ask(&mut node, request(&scene, 1)).unwrap();
    let report = RequestReport {
        request: RequestId(1),
        ..RequestReport::default()
    };
    assert!(node.tiles(part(3, 1)).is_err());
    assert!(node.request_done(report).is_err());
    assert_eq!(node.tiles(part(4, 6)), Ok(true));
    assert!(node.tiles(part(9, 3)).is_err(), "only two are left");
    assert_eq!(node.tiles(part(10, 2)), Ok(true));
    assert_eq!(node.request_done(report), Ok(true));
    assert!(node.request_done(report).is_err());
}
