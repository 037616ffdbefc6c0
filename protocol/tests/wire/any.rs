//! Any right message, and runs of tests that are the same each time.

use std::collections::BTreeMap;

use carom_protocol::limits::{
    CHUNK_BYTES_MAX, POSES_MAX, SENTENCE_BYTES_MAX, TILE_EDGE_MAX, TILES_PER_MESSAGE_MAX,
};
use carom_protocol::{
    ChunkKey, CodedParticles, FrameId, NodeInfo, NodeLoad, NodeTimes, PixelFormat, Refusal,
    RefusalReason, RequestId, RequestReport, SceneHash, TilesDone, ToClient, ToNode, TraceRequest,
    message::VERSION,
};
use carom_tracer::{
    Camera, DeviceInfo, DeviceKind, Environment, ImageSize, ImageTexture, Layers, Lens, Material,
    MaterialTextures, Mesh, Object, ObjectPose, Opacity, RenderSettings, Scene, SceneUpdate, Shape,
    TileGrid, TileRange,
};
use glam::{Quat, Vec3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

pub(crate) fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(8),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

pub(crate) fn to_node() -> impl Strategy<Value = ToNode> {
    prop_oneof![
        Just(ToNode::Hello { version: VERSION }),
        scene().prop_map(|scene| ToNode::Scene {
            hash: SceneHash::of(&scene),
            scene: Box::new(scene),
        }),
        request().prop_map(|request| ToNode::Trace(Box::new(request))),
        any::<u64>().prop_map(|frame| ToNode::CancelBefore(FrameId(frame))),
        any::<u64>().prop_map(|request| ToNode::CancelRequest(RequestId(request))),
        any::<u64>().prop_map(ToNode::Ping),
        Just(ToNode::Leave),
        (hash(), prop::collection::vec(chunk(), 0..20))
            .prop_map(|(hash, chunks)| ToNode::Manifest { hash, chunks }),
        prop::collection::vec(any::<u8>(), 1..300).prop_map(|bytes| ToNode::Chunk { bytes }),
        hash().prop_map(ToNode::ChunksSent),
    ]
}

pub(crate) fn to_client() -> impl Strategy<Value = ToClient> {
    prop_oneof![
        node().prop_map(|node| ToClient::Welcome {
            version: VERSION,
            node
        }),
        hash().prop_map(ToClient::SceneReady),
        (hash(), sentence()).prop_map(|(hash, why)| ToClient::SceneRefused { hash, why }),
        tiles_done().prop_map(ToClient::Tiles),
        report().prop_map(ToClient::RequestDone),
        refusal().prop_map(ToClient::RequestRefused),
        (any::<u64>(), any::<u16>(), 0..=100_u8).prop_map(|(number, players, busy_percent)| {
            let load = NodeLoad {
                players,
                busy_percent,
            };
            ToClient::Pong { number, load }
        }),
        any::<u32>().prop_map(|bytes| ToClient::SceneComing { bytes }),
        Just(ToClient::Leaving),
        (hash(), prop::collection::btree_set(0..5000u32, 0..20)).prop_map(|(hash, chunks)| {
            let chunks = chunks.into_iter().collect();
            ToClient::ChunksWanted { hash, chunks }
        }),
    ]
}

pub(crate) fn node_info(name: &str) -> NodeInfo {
    NodeInfo {
        name: name.into(),
        instance: 0,
        device: DeviceInfo {
            kind: DeviceKind::Cpu,
            name: "a processor".into(),
            width: 8,
            threads: 2,
        },
    }
}

/// A scene of `balls` balls in a row, with names so long that 4,000 of them travel in chunks.
pub(crate) fn long_row(balls: usize) -> Scene {
    let mut scene = self::balls(balls);
    for (index, object) in scene.objects.iter_mut().enumerate() {
        object.name = format!("{index:0>60}");
    }
    scene
}

/// A scene of `balls` balls in a row.
pub(crate) fn balls(balls: usize) -> Scene {
    let albedo = Vec3::splat(0.5);
    let object = |index: usize| Object {
        name: format!("ball {index}"),
        material: "resin".into(),
        shape: Shape::Sphere {
            center: Vec3::X * index as f32,
            radius: 0.028_6,
            rotation: Quat::IDENTITY,
        },
    };
    Scene {
        camera: camera(Vec3::Y * 2.0),
        environment: Environment {
            radiance: Vec3::ONE,
        },
        materials: BTreeMap::from([("resin".into(), Material::Diffuse { albedo })]),
        objects: (0..balls).map(object).collect(),
        area_lights: Vec::new(),
        ..Scene::new()
    }
}

pub(crate) fn request() -> impl Strategy<Value = TraceRequest> {
    let ids = (any::<u64>(), any::<u64>(), hash(), any::<u32>());
    let work = (1..=64u32, any::<u32>(), 0..=64u32, any::<bool>());
    (ids, grid_and_run(), update(), work, format()).prop_map(
        |((frame, id, scene, seed), (grid, tiles), update, work, format)| TraceRequest {
            frame: FrameId(frame),
            id: RequestId(id),
            scene,
            update,
            grid,
            tiles,
            settings: RenderSettings {
                samples: work.0,
                first_sample: work.1,
                max_depth: work.2,
                seed,
                denoise: work.3,
            },
            format,
            precision: carom_protocol::PrecisionRange::EXACT,
            references: Vec::new(),
            particles: CodedParticles::default(),
        },
    )
}

pub(crate) fn format() -> impl Strategy<Value = PixelFormat> {
    prop_oneof![
        (1e-6..1e6f32).prop_map(|exposure| PixelFormat::Srgb8 { exposure }),
        Just(PixelFormat::LinearF16),
        Just(PixelFormat::LinearF32),
    ]
}

fn grid_and_run() -> impl Strategy<Value = (TileGrid, TileRange)> {
    let size = (1..2000u32, 1..2000u32);
    (size, 8..=TILE_EDGE_MAX, any::<[prop::sample::Index; 2]>()).prop_map(
        |((width, height), edge, [first, count])| {
            let grid = TileGrid::new(ImageSize::new(width, height), edge);
            let first = first.index(grid.len() as usize) as u32;
            let count = 1 + count.index((grid.len() - first) as usize) as u32;
            (grid, TileRange { first, count })
        },
    )
}

fn update() -> impl Strategy<Value = SceneUpdate> {
    let place = (-1e3..1e3f32, -1e3..1e3f32, -1e3..1e3f32, 0.0..6.2f32);
    let pose = (any::<u32>(), place, any::<bool>()).prop_map(|(object, place, visible)| {
        let (x, y, z, angle) = place;
        ObjectPose {
            object,
            position: Vec3::new(x, y, z),
            rotation: Quat::from_rotation_x(angle),
            visible,
        }
    });
    let eye = prop::option::of(1.0..100.0f32);
    (eye, prop::collection::vec(pose, 0..=POSES_MAX)).prop_map(|(eye, poses)| SceneUpdate {
        camera: eye.map(|distance| camera(Vec3::Y * distance)),
        poses,
        ..SceneUpdate::default()
    })
}

fn camera(eye: Vec3) -> Camera {
    Camera {
        eye,
        target: Vec3::ZERO,
        up: Vec3::Z,
        fov_x_deg: 60.0,
        lens: Lens::default(),
        near_m: 0.25,
    }
}

fn scene() -> impl Strategy<Value = Scene> {
    let file = prop::collection::vec(any::<u8>(), 0..300);
    (0..40usize, "[a-zé]{0,30}", file).prop_map(|(count, name, file)| {
        let mut scene = balls(count);
        if let Some(object) = scene.objects.first_mut() {
            object.name.clone_from(&name);
        }
        let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let uvs = corners
            .iter()
            .map(|corner| 3.0 * corner.truncate())
            .collect();
        let colors = corners.iter().map(|corner| corner.extend(0.5)).collect();
        let mesh = Mesh::new(corners, vec![[0, 1, 2]]).uvs(uvs).colors(colors);
        let base_color = Some(scene.add_texture(ImageTexture::new(name, file)));
        let textures = MaterialTextures {
            base_color,
            sheen: base_color,
            clearcoat_normal: base_color,
            clearcoat_normal_scale: -0.5,
            transmission: base_color,
            ..MaterialTextures::default()
        };
        let veil = Opacity::Blend { alpha: 0.5 };
        let material = Material::rough([0.5; 3], 0.4).textured(textures);
        let material = material.layered(Layers {
            transmission: 0.5,
            ..Layers::NONE
        });
        scene.add(mesh, material.with_opacity(veil));
        scene
    })
}

fn tiles_done() -> impl Strategy<Value = TilesDone> {
    let request = (any::<u64>(), 0..1000u32, 1..=TILES_PER_MESSAGE_MAX);
    let pixels = prop::collection::vec(any::<u8>(), 0..4000);
    (request, any::<u32>(), any::<u32>(), pixels).prop_map(
        |((request, first, count), busy_micros, dropped_samples, pixels)| TilesDone {
            request: RequestId(request),
            tiles: TileRange { first, count },
            busy_micros,
            times: NodeTimes {
                queue_micros: busy_micros / 2,
                trace_micros: dropped_samples,
                encode_micros: first,
            },
            dropped_samples,
            pixels,
        },
    )
}

fn node() -> impl Strategy<Value = NodeInfo> {
    (
        "[a-z.-]{0,100}",
        "[ -~é€🎱]{0,60}",
        any::<(u64, u32, u32)>(),
    )
        .prop_map(|(name, device, (instance, width, threads))| {
            let kind = DeviceKind::Gpu;
            let device = DeviceInfo {
                kind,
                name: device,
                width,
                threads,
            };
            NodeInfo {
                name,
                instance,
                device,
            }
        })
}

fn report() -> impl Strategy<Value = RequestReport> {
    any::<(u64, u32, u32, u32)>().prop_map(|(request, queue, trace, encode)| RequestReport {
        request: RequestId(request),
        queue_micros: queue,
        trace_micros: trace,
        encode_micros: encode,
    })
}

fn refusal() -> impl Strategy<Value = Refusal> {
    let why = prop_oneof![
        Just(RefusalReason::Cancelled),
        Just(RefusalReason::Busy),
        Just(RefusalReason::UnknownScene),
        sentence().prop_map(RefusalReason::Invalid),
        sentence().prop_map(RefusalReason::Device),
    ];
    (any::<u64>(), why).prop_map(|(request, why)| Refusal {
        request: RequestId(request),
        why,
    })
}

fn chunk() -> impl Strategy<Value = ChunkKey> {
    let length = 1..=CHUNK_BYTES_MAX as u32;
    (any::<[u8; 32]>(), length).prop_map(|(hash, bytes)| ChunkKey { hash, bytes })
}

fn hash() -> impl Strategy<Value = SceneHash> {
    any::<[u8; 32]>().prop_map(SceneHash)
}

fn sentence() -> impl Strategy<Value = String> {
    prop_oneof!["[ -~é€🎱]{0,80}", Just("x".repeat(SENTENCE_BYTES_MAX))]
}
