//! Messages, sessions and tile payloads from the network.

use std::sync::Arc;

use carom_protocol::codec::{decode_to_client, decode_to_node, encode_to_client, encode_to_node};
use carom_protocol::framing::{Deframer, frame};
use carom_protocol::limits::REQUESTS_QUEUED_MAX;
use carom_protocol::message::VERSION;
use carom_protocol::particle_codec::{ParticleDecoder, ParticleEncoder};
use carom_protocol::tile_codec::{Decoder, Encoder, ReferenceTile, TileInput};
use carom_protocol::{
    Channel, ChunkKey, ClientSession, CodedParticles, EncodedScene, FrameId, NodeEvent, NodeInfo,
    NodeLoad, NodeSession, NodeTimes, Packet, PixelFormat, PixelPrecision, PrecisionRange,
    RequestId, RequestReport, SceneHash, TilesDone, ToClient, ToNode, TraceRequest,
};
use carom_tracer::glam::{U16Vec3, Vec3};
use carom_tracer::{
    CompiledScene, DeviceInfo, DeviceKind, ImageSize, Material, ParticleCloud, ParticleForm,
    RenderSettings, Scene, SceneUpdate, Tile, TileGrid, TileRange,
};

/// What decodes can be sent, and then decodes to the same.
pub fn to_node(bytes: &[u8]) {
    if let Ok(message) = decode_to_node(bytes) {
        let bytes = encode_to_node(&message).expect("a decoded message is valid");
        let again = decode_to_node(&bytes).expect("an encoded message is right");
        assert_eq!(encode_to_node(&again), Ok(bytes)); // as bytes: NaN differs from itself
    }
}

/// What decodes can be sent, and then decodes to the same.
pub fn to_client(bytes: &[u8]) {
    if let Ok(message) = decode_to_client(bytes) {
        let bytes = encode_to_client(&message).expect("a decoded message is valid");
        let again = decode_to_client(&bytes).expect("an encoded message is right");
        assert_eq!(encode_to_client(&again), Ok(bytes)); // as bytes: NaN differs from itself
    }
}

/// A payload of sRGB tiles, told from tiles that are held, is an error or a picture of the size
/// asked for, which then is held itself. The first two bytes say what was asked for, and whether all
/// tiles are held or all but the first.
pub fn srgb_tiles(bytes: &[u8]) {
    let Some(([width, height], payload)) = bytes.split_first_chunk() else {
        return;
    };
    let tile = small_tile(*width, *height);
    let range = PrecisionRange {
        finest: PixelPrecision::Exact,
        coarsest: PixelPrecision::Lossy50,
    };
    let held = held_tile(tile);
    let first = (*height >= ALL_HELD).then_some(&held);
    let tiles = [(tile, first), (tile, Some(&held)), (tile, Some(&held))];
    let Ok(decoded) = Decoder::new().decode_srgb(range, &tiles, payload) else {
        return;
    };
    assert_eq!(decoded.pixels.len(), 3 * tile.pixels());
    assert_eq!(decoded.references.len(), 3);
    assert!(
        decoded
            .references
            .iter()
            .all(|kept| kept.bytes() == 3 * tile.pixels())
    );
    let kept = [
        (tile, None),
        (tile, Some(&decoded.references[0])),
        (tile, None),
    ];
    drop(Decoder::new().decode_srgb(range, &kept, payload));
}

/// A payload is an error or a picture of the size asked for. The first three bytes say what was
/// asked for.
pub fn tile_codec(bytes: &[u8]) {
    let Some(([format, width, height], payload)) = bytes.split_first_chunk() else {
        return;
    };
    let format = format_of(*format);
    let tile = small_tile(*width, *height);
    if let Ok(pixels) = Decoder::new().decode(format, &[tile; 2], payload) {
        assert_eq!(pixels.len(), 2 * tile.pixels());
    }
}

/// Particles are an error or as many as were stated, and those that are read are sent and read again as they were, and
/// have a surface. The first byte is how many.
pub fn particles(bytes: &[u8]) {
    let Some((&count, places)) = bytes.split_first() else {
        return;
    };
    let reference = vec![small_cloud(usize::from(count))];
    let mut decoder = ParticleDecoder::default();
    decoder.remember(RequestId(1), &reference);
    let mut coded = ParticleEncoder::default().encode(&reference);
    coded.reference = Some(RequestId(1));
    coded.clouds[0].places = places.to_vec();
    if let Ok(read) = decoder.decode(&coded) {
        assert_eq!(read[0].places.len(), usize::from(count));
        let mut encoder = ParticleEncoder::default();
        encoder.remember(RequestId(1), reference);
        assert_eq!(decoder.decode(&encoder.encode(&read)).as_ref(), Ok(&read));
        let mut scene = CompiledScene::new(&Scene::new()).expect("a scene without anything");
        // Their surface is made, or a sentence says why not.
        let _ = scene.apply(&SceneUpdate::default().particles(read));
    }
}

/// Particles that lie on a curve.
fn small_cloud(count: usize) -> ParticleCloud {
    let place = |index: usize| {
        let at = index as u16;
        U16Vec3::new(at, at.wrapping_mul(at), at.wrapping_mul(997))
    };
    ParticleCloud {
        material: Material::grey(0.5),
        radius_m: 1e-3,
        form: ParticleForm::Surface {
            smoothing_m: 0.05,
            floor_m: 0.1,
        },
        min: Vec3::ZERO,
        max: Vec3::ONE,
        places: (0..count).map(place).collect(),
    }
}

/// Packets do not depend on the pieces in which a stream comes, and framed again they are the
/// stream's start. The first byte is the length of the pieces.
pub fn framing(bytes: &[u8]) {
    let Some((&piece, stream)) = bytes.split_first() else {
        return;
    };
    let whole = packets(stream, stream.len().max(1));
    assert_eq!(packets(stream, usize::from(piece).max(1)), whole);
    let again: Vec<u8> = whole.iter().flat_map(|packet| frame(packet)).collect();
    assert!(stream.starts_with(&again));
}

/// Both ends of a connection, each hearing what the bytes say and what the other says. See
/// [`session_seeds`] for the form of the bytes.
pub fn session(bytes: &[u8]) {
    let mut pair = Pair::new();
    let mut rest = bytes;
    while let Some(([what, low, high], after)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes([*low, *high])).min(after.len());
        let (bytes, after) = after.split_at(length);
        pair.step(*what, bytes.to_vec());
        rest = after;
    }
}

/// A right message of some kinds.
pub fn to_node_seeds() -> Vec<Vec<u8>> {
    let scene = Box::new(scene());
    let hash = SceneHash::of(&scene);
    let messages = [
        ToNode::Hello { version: VERSION },
        ToNode::Scene { hash, scene },
        ToNode::Trace(Box::new(request(1))),
        ToNode::CancelBefore(FrameId(3)),
        ToNode::Ping(7),
        ToNode::Manifest {
            hash,
            chunks: vec![ChunkKey::of(b"one"), ChunkKey::of(b"another")],
        },
        ToNode::Chunk {
            bytes: b"one".to_vec(),
        },
        ToNode::ChunksSent(hash),
    ];
    let bytes = messages.iter().map(encode_to_node);
    bytes.map(|bytes| bytes.expect("a right message")).collect()
}

/// A right message of some kinds.
pub fn to_client_seeds() -> Vec<Vec<u8>> {
    let node = node_info();
    let hash = SceneHash::of(&scene());
    let messages = [
        ToClient::Welcome {
            version: VERSION,
            node,
        },
        ToClient::SceneReady(hash),
        ToClient::Tiles(tiles(1, GRID.all())),
        ToClient::RequestDone(report(1)),
        ToClient::Pong {
            number: 7,
            load: NodeLoad::default(),
        },
        ToClient::SceneComing { bytes: 70_000 },
        ToClient::ChunksWanted {
            hash,
            chunks: vec![0, 1, 9],
        },
    ];
    let bytes = messages.iter().map(encode_to_client);
    bytes.map(|bytes| bytes.expect("a right message")).collect()
}

/// Payloads of each format.
pub fn tile_codec_seeds() -> Vec<Vec<u8>> {
    let (x, y, width, height) = (0, 0, 9, 5);
    let tile = Tile {
        x,
        y,
        width,
        height,
    };
    let ramp: Vec<[f32; 3]> = (0..45).map(|i| [i as f32 * 0.01, 0.5, 0.25]).collect();
    let payload =
        |format: u8| Encoder::new().encode(format_of(format), &[(tile, &ramp), (tile, &ramp)]);
    (0..3)
        .map(|format| [&[format, 8, 4], &payload(format)[..]].concat())
        .collect()
}

/// Payloads of each precision: of new tiles, of changed ones and of some that are as they were.
pub fn srgb_tiles_seeds() -> Vec<Vec<u8>> {
    let tile = small_tile(16, 11);
    let held = held_tile(tile);
    let new: Vec<[f32; 3]> = (0..tile.pixels()).map(|i| [i as f32 * 0.002; 3]).collect();
    let changed: Vec<[f32; 3]> = ramp(tile).map(|[r, g, b]| [r, g, b + 0.02]).collect();
    let same: Vec<[f32; 3]> = ramp(tile).collect();
    let input = |radiance, reference| TileInput {
        tile,
        radiance,
        reference,
    };
    let payload = |height: u8, first, precision| {
        let tiles = [
            input(&new, first),
            input(&changed, Some(&held)),
            input(&same, Some(&held)),
        ];
        let (payload, _) = Encoder::new().encode_srgb(1.0, precision, &tiles);
        [&[16, height], &payload[..]].concat()
    };
    let all = PixelPrecision::ALL.into_iter();
    all.flat_map(|precision| {
        [
            payload(11, None, precision),
            payload(ALL_HELD + 11, Some(&held), precision),
        ]
    })
    .collect()
}

/// Added to the height, it says that all tiles are held; a whole number of times what
/// [`small_tile`] takes heights modulo.
const ALL_HELD: u8 = 160;

fn small_tile(width: u8, height: u8) -> Tile {
    Tile {
        x: 0,
        y: 0,
        width: u32::from(width % 40) + 1,
        height: u32::from(height % 40) + 1,
    }
}

fn ramp(tile: Tile) -> impl Iterator<Item = [f32; 3]> {
    (0..tile.pixels()).map(|index| [index as f32 * 0.003, 0.5, 0.25])
}

fn held_tile(tile: Tile) -> Arc<ReferenceTile> {
    let radiance: Vec<[f32; 3]> = ramp(tile).collect();
    let input = TileInput {
        tile,
        radiance: &radiance,
        reference: None,
    };
    let (_, mut kept) = Encoder::new().encode_srgb(1.0, PixelPrecision::Exact, &[input]);
    kept.remove(0)
}

/// Whole, moved in part and the same, of 100 particles.
pub fn particles_seeds() -> Vec<Vec<u8>> {
    let reference = small_cloud(100);
    let mut moved = reference.clone();
    for place in moved.places.iter_mut().step_by(3) {
        *place = place.wrapping_add(U16Vec3::new(5, 65_000, 300));
    }
    let mut encoder = ParticleEncoder::default();
    let whole = encoder.encode(std::slice::from_ref(&moved));
    encoder.remember(RequestId(1), vec![reference.clone()]);
    let delta = encoder.encode(&[moved]);
    let same = encoder.encode(&[reference]);
    let seed = |coded: CodedParticles| [&[100], &coded.clouds[0].places[..]].concat();
    [whole, delta, same].map(seed).to_vec()
}

/// Some packets.
pub fn framing_seeds() -> Vec<Vec<u8>> {
    let stream = [frame(b"one"), frame(b"another")].concat();
    vec![
        [&[3], &stream[..]].concat(),
        [&[200], &stream[..7]].concat(),
    ]
}

/// Steps, each what to do, the length of its bytes and these: a whole request, and one whose client
/// sends it more than it asked for.
pub fn session_seeds() -> Vec<Vec<u8>> {
    let step = |what: u8, bytes: &[u8]| {
        let length = bytes.len() as u16;
        [&[what], &length.to_le_bytes()[..], bytes].concat()
    };
    let talk = [
        step(ASK, &[]),
        step(TALK, &[]),
        step(WORK, &[]),
        step(TALK, &[]),
    ]
    .concat();
    let stray = encode_to_client(&ToClient::Tiles(tiles(1, GRID.all()))).expect("a right message");
    let stray = [&talk[..], &step(TILES_TO_CLIENT, &stray)].concat();
    let pings: Vec<u8> = (0..9)
        .map(|number| encode_to_node(&ToNode::Ping(number)).expect("a right message"))
        .flat_map(|ping| step(TO_NODE, &ping))
        .collect();
    let hash = SceneHash::of(&scene());
    let manifest = ToNode::Manifest {
        hash,
        chunks: vec![ChunkKey::of(b"one"); 3],
    };
    let chunk = ToNode::Chunk {
        bytes: b"one".to_vec(),
    };
    let parts = [manifest, chunk, ToNode::ChunksSent(hash)];
    let parts = parts.map(|part| encode_to_node(&part).expect("a right message"));
    let transfer: Vec<u8> = parts.iter().flat_map(|part| step(TO_NODE, part)).collect();
    let again = ToClient::ChunksWanted {
        hash: SceneHash::of(&long_scene()),
        chunks: vec![0],
    };
    let again = encode_to_client(&again).expect("a right message");
    let twice = [&talk[..], &step(TO_CLIENT, &again)].concat();
    vec![talk, stray, pings, transfer, twice]
}

struct Pair {
    client: ClientSession,
    node: NodeSession,
    asked: u64,
    work: Vec<TraceRequest>,
    client_closed: bool,
    node_closed: bool,
}

impl Pair {
    fn new() -> Self {
        let mut client = ClientSession::new();
        let scene = scene();
        for scene in [scene, long_scene()] {
            let scene = EncodedScene::new(&scene).expect("a right scene");
            client.set_scene(&scene).expect("there is room");
        }
        let mut pair = Self {
            client,
            node: NodeSession::new(node_info()),
            asked: 0,
            work: Vec::new(),
            client_closed: false,
            node_closed: false,
        };
        pair.talk();
        pair
    }

    fn step(&mut self, what: u8, bytes: Vec<u8>) {
        let control = Channel::Control;
        match what % 7 {
            ASK => {
                self.asked += 1;
                // Refused when too many are open, or a stray request has closed the client.
                drop(self.client.trace(request(self.asked)));
            }
            TALK => self.talk(),
            WORK => self.work(),
            TO_NODE => self.node_hears(Packet::new(control, bytes)),
            TO_CLIENT => self.client_hears(Packet::new(control, bytes)),
            TO_NODE_COPY => self.node_hears(Packet::new(Channel::Copy, bytes)),
            _ => self.client_hears(Packet::new(Channel::Tiles, bytes)),
        }
        assert!(self.client.open_requests() <= REQUESTS_QUEUED_MAX);
        assert!(self.node.open_requests() <= REQUESTS_QUEUED_MAX);
    }

    fn talk(&mut self) {
        while let Some(packet) = self.client.poll_transmit() {
            self.node_hears(packet);
        }
        while let Some(packet) = self.node.poll_transmit() {
            decode_to_client(&packet.bytes).expect("a node's own message");
            self.client_hears(packet);
        }
    }

    fn work(&mut self) {
        for request in std::mem::take(&mut self.work) {
            let tiles = tiles(request.id.0, request.tiles);
            // Not wanted any more, or of tiles that only a stray request asked for.
            if self.node.tiles(tiles) == Ok(true) && !self.node.is_full() {
                drop(self.node.request_done(report(request.id.0)));
            }
        }
    }

    fn node_hears(&mut self, packet: Packet) {
        match self.node.handle(packet) {
            Ok(event) => {
                assert!(!self.node_closed);
                match event {
                    Some(NodeEvent::Trace { request, scene }) => {
                        assert_eq!(SceneHash::of(&scene), request.scene);
                        self.work.push(*request);
                    }
                    Some(NodeEvent::Ping(number)) => self.node.pong(number, NodeLoad::default()),
                    _ => {}
                }
            }
            Err(_) => self.node_closed = true,
        }
    }

    fn client_hears(&mut self, packet: Packet) {
        match self.client.handle(packet) {
            Ok(_) => assert!(!self.client_closed),
            Err(_) => self.client_closed = true,
        }
    }
}

fn packets(stream: &[u8], piece: usize) -> Vec<Vec<u8>> {
    let mut deframer = Deframer::new(1000);
    let mut packets = Vec::new();
    for bytes in stream.chunks(piece) {
        deframer.push(bytes);
        loop {
            match deframer.next_packet() {
                Ok(Some(packet)) => packets.push(packet),
                Ok(None) => break,
                Err(_) => return packets,
            }
        }
    }
    packets
}

fn format_of(byte: u8) -> PixelFormat {
    match byte % 3 {
        0 => PixelFormat::Srgb8 { exposure: 1.0 },
        1 => PixelFormat::LinearF16,
        _ => PixelFormat::LinearF32,
    }
}

fn scene() -> Scene {
    Scene::from_json(SCENE).expect("a right scene")
}

/// A scene of three chunks or so: its names are long.
fn long_scene() -> Scene {
    let mut scene = scene();
    let object = scene.objects[0].clone();
    scene.objects = vec![object; 3000];
    for (index, object) in scene.objects.iter_mut().enumerate() {
        object.name = format!("{index:0>60}");
    }
    scene
}

fn node_info() -> NodeInfo {
    NodeInfo {
        name: "node".into(),
        instance: 0,
        device: DeviceInfo {
            kind: DeviceKind::Cpu,
            name: "a processor".into(),
            width: 8,
            threads: 2,
        },
    }
}

fn request(id: u64) -> TraceRequest {
    TraceRequest {
        frame: FrameId(id),
        id: RequestId(id),
        scene: SceneHash::of(&scene()),
        update: SceneUpdate::default(),
        grid: GRID,
        tiles: GRID.all(),
        settings: RenderSettings::default(),
        format: format_of(id as u8),
        precision: carom_protocol::PrecisionRange::EXACT,
        references: Vec::new(),
        particles: CodedParticles::default(),
    }
}

/// Black tiles; wrong ones if a request asks for others than [`request`] does.
fn tiles(request: u64, tiles: TileRange) -> TilesDone {
    let black = [[0.0; 3]; 64];
    let lit: Vec<(Tile, &[[f32; 3]])> = GRID
        .tiles(GRID.all())
        .map(|tile| (tile, &black[..]))
        .collect();
    TilesDone {
        request: RequestId(request),
        tiles,
        busy_micros: 3,
        times: NodeTimes::default(),
        dropped_samples: 0,
        pixels: Encoder::new().encode(format_of(request as u8), &lit),
    }
}

fn report(request: u64) -> RequestReport {
    let request = RequestId(request);
    RequestReport {
        request,
        ..RequestReport::default()
    }
}

const GRID: TileGrid = TileGrid::new(ImageSize::new(16, 8), 8);
const ASK: u8 = 0;
const TALK: u8 = 1;
const WORK: u8 = 2;
const TO_NODE: u8 = 3;
const TO_CLIENT: u8 = 4;
const TILES_TO_CLIENT: u8 = 5;
const TO_NODE_COPY: u8 = 6;
const SCENE: &str = include_str!("../../../assets/scenes/pool.json");
