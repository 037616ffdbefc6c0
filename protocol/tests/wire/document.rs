//! The example of `protocol/WIRE.md`, encoded and compared byte for byte.

use std::sync::Arc;

use carom_protocol::framing::frame;
use carom_protocol::message::VERSION;
use carom_protocol::tile_codec::{Encoder, ReferenceTile, TileInput};
use carom_protocol::{
    CodedParticles, FrameId, NodeInfo, NodeTimes, PixelFormat, PixelPrecision, PrecisionRange,
    ReferenceRange, RequestId, RequestReport, SceneHash, TilesDone, ToClient, ToNode, TraceRequest,
    codec,
};
use carom_tracer::{
    DeviceInfo, DeviceKind, ImageSize, ObjectPose, RenderSettings, SceneUpdate, TileGrid, TileRange,
};
use glam::{Quat, Vec3};

const DOCUMENT: &str = include_str!("../../WIRE.md");
const GRID: TileGrid = TileGrid::new(ImageSize::new(4, 2), 2);

/// The bytes of the block called `name`: all before `;` in each of its lines.
fn documented(name: &str) -> Vec<u8> {
    let start = format!("```wire {name}\n");
    let (_, rest) = DOCUMENT.split_once(&start).expect(name);
    let (block, _) = rest.split_once("```").expect("a block ends");
    let bytes = block
        .lines()
        .flat_map(|line| line.split(';').next().unwrap_or("").split_whitespace());
    bytes
        .map(|byte| u8::from_str_radix(byte, 16).expect(byte))
        .collect()
}

fn assert_documented(name: &str, bytes: &[u8]) {
    assert_eq!(
        format!("{bytes:02x?}"),
        format!("{:02x?}", documented(name)),
        "{name}"
    );
}

fn request(id: u64, tiles: TileRange) -> TraceRequest {
    TraceRequest {
        frame: FrameId(6 + id),
        id: RequestId(id),
        scene: SceneHash([0x5c; 32]),
        update: SceneUpdate::default(),
        grid: GRID,
        tiles,
        settings: RenderSettings {
            samples: 4,
            first_sample: 0,
            max_depth: 8,
            seed: 42,
            denoise: false,
        },
        format: PixelFormat::Srgb8 { exposure: 1.0 },
        precision: PrecisionRange::EXACT,
        references: Vec::new(),
        particles: CodedParticles::default(),
    }
}

fn tiles(id: u64, tiles: TileRange, pixels: Vec<u8>) -> Vec<u8> {
    let message = ToClient::Tiles(TilesDone {
        request: RequestId(id),
        tiles,
        busy_micros: 900,
        times: NodeTimes {
            queue_micros: 100,
            trace_micros: 700,
            encode_micros: 50,
        },
        dropped_samples: 0,
        pixels,
    });
    codec::encode_to_client(&message).unwrap()
}

const BLACK: [f32; 3] = [0.0; 3];
/// Light without bound, which the tone curve shows as the full step.
const WHITE: [f32; 3] = [f32::INFINITY; 3];
const RED: [f32; 3] = [f32::INFINITY, 0.0, 0.0];

/// The light of a tile's pixels, and the tile's reference.
type TracedTile<'a> = ([[f32; 3]; 4], Option<&'a Arc<ReferenceTile>>);

/// The payload of tiles from the first on, and the references that they are to later ones.
fn payload(tiles: &[TracedTile]) -> (Vec<u8>, Vec<Arc<ReferenceTile>>) {
    let inputs = tiles.iter().zip(0..);
    let inputs: Vec<TileInput> = inputs
        .map(|((radiance, reference), index)| TileInput {
            tile: GRID.tile(index),
            radiance,
            reference: *reference,
        })
        .collect();
    Encoder::new().encode_srgb(1.0, PixelPrecision::Exact, &inputs)
}

#[test]
fn documented_greetings_are_encoded_so() {
    let hello = codec::encode_to_node(&ToNode::Hello { version: VERSION }).unwrap();
    assert_documented("hello", &frame(&hello));
    let welcome = ToClient::Welcome {
        version: VERSION,
        node: NodeInfo {
            name: "near".into(),
            instance: 7,
            device: DeviceInfo {
                kind: DeviceKind::Cpu,
                name: "cpu".into(),
                width: 8,
                threads: 2,
            },
        },
    };
    let welcome = codec::encode_to_client(&welcome).unwrap();
    assert_documented("welcome", &frame(&welcome));
}

#[test]
fn documented_requests_are_encoded_so() {
    let mut first = request(1, TileRange { first: 0, count: 1 });
    first.update.poses.push(ObjectPose {
        object: 3,
        position: Vec3::new(0.5, -0.25, 0.0),
        rotation: Quat::IDENTITY,
        visible: true,
    });
    let bytes = codec::encode_to_node(&ToNode::Trace(Box::new(first))).unwrap();
    assert_documented("request", &bytes);
    let mut second = request(2, TileRange { first: 0, count: 2 });
    second.references.push(ReferenceRange {
        request: RequestId(1),
        tiles: TileRange { first: 0, count: 1 },
    });
    let bytes = codec::encode_to_node(&ToNode::Trace(Box::new(second))).unwrap();
    assert_documented("request with references", &bytes);
}

#[test]
fn documented_tiles_are_encoded_so() {
    let (pixels, references) = payload(&[([BLACK, WHITE, WHITE, BLACK], None)]);
    let bytes = tiles(1, TileRange { first: 0, count: 1 }, pixels);
    assert_documented("tiles", &bytes);
    let report = RequestReport {
        request: RequestId(1),
        queue_micros: 100,
        trace_micros: 700,
        encode_micros: 50,
    };
    let bytes = codec::encode_to_client(&ToClient::RequestDone(report)).unwrap();
    assert_documented("done", &bytes);
    let (pixels, _) = payload(&[
        ([BLACK, WHITE, WHITE, RED], Some(&references[0])),
        ([WHITE; 4], None),
    ]);
    let bytes = tiles(2, TileRange { first: 0, count: 2 }, pixels);
    assert_documented("tiles with a delta", &bytes);
}
