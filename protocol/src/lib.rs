//! Wire protocol between a client and its farm nodes.
//!
//! `protocol/WIRE.md` specifies every byte; the modules here write and read them.
//!
//! ```text
//! client                                      node
//!   Hello ──────────────────────────────────▶
//!         ◀────────────────────────── Welcome      both check the version
//!   Scene ──────────────────────────────────▶      once per content hash; a long one in chunks,
//!         ◀─────────────────────── SceneReady      of which the node gets those that it lacks
//!   Trace ──────────────────────────────────▶      camera, poses, a range of tiles
//!         ◀──────────────── Tiles … Tiles, RequestDone
//! ```
//!
//! The crate knows no socket, no clock and no thread: [`session`] turns packets into events and
//! calls into packets, [`codec`] packets into messages, [`tile_codec`] pixels into bytes.
//! [`limits`] bounds what a peer may send or make this program keep.
//!
//! ```
//! use carom_protocol::{tile_codec::Encoder, *};
//! use carom_tracer::{DeviceInfo, DeviceKind, ImageSize, RenderSettings, Scene, SceneUpdate, TileGrid};
//!
//! let scene = Scene::load("../assets/scenes/pool.json").expect("the pool table");
//! let grid = TileGrid::new(ImageSize::new(8, 8), 8);
//! let device = DeviceInfo { kind: DeviceKind::Cpu, name: "one".into(), width: 1, threads: 1 };
//!
//! let mut client = ClientSession::new();
//! let mut node = NodeSession::new(NodeInfo { name: "near".into(), instance: 0, device });
//! client.set_scene(&EncodedScene::new(&scene)?)?;
//! let mut pictures = 0;
//! while pictures == 0 {
//!     while let Some(packet) = client.poll_transmit() {
//!         let Some(NodeEvent::Trace { request, .. }) = node.handle(packet)? else { continue };
//!         let (id, tiles, tile) = (request.id, request.tiles, request.grid.tile(0));
//!         let radiance = vec![[1.0; 3]; tile.pixels()]; // here a tracer works
//!         let pixels = Encoder::new().encode(request.format, &[(tile, &radiance)]);
//!         node.tiles(TilesDone { request: id, tiles, busy_micros: 9, times: NodeTimes::default(),
//!             dropped_samples: 0, pixels })?;
//!         node.request_done(RequestReport { request: id, ..RequestReport::default() })?;
//!     }
//!     while let Some(packet) = node.poll_transmit() {
//!         for event in client.handle(packet)? {
//!             match event {
//!                 ClientEvent::SceneReady(scene) => client.trace(TraceRequest {
//!                     frame: FrameId(0), id: RequestId(0), scene, update: SceneUpdate::default(),
//!                     grid, tiles: grid.all(), settings: RenderSettings::default(),
//!                     format: PixelFormat::LinearF16,
//!                     precision: PrecisionRange::EXACT, references: Vec::new(),
//!                     particles: CodedParticles::default(),
//!                 })?,
//!                 ClientEvent::RequestDone { .. } => pictures += 1,
//!                 _ => {}
//!             }
//!         }
//!     }
//! }
//! # Ok::<(), Error>(())
//! ```

pub mod codec;
mod encoded_scene;
pub mod error;
pub mod framing;
pub mod limits;
pub mod message;
pub mod particle_codec;
pub mod precision;
pub mod session;
pub mod tile_codec;
mod validate;

pub use encoded_scene::EncodedScene;
pub use error::{Error, Reason};
pub use message::{
    ChunkKey, CodedCloud, CodedParticles, FrameId, NodeInfo, NodeLoad, NodeTimes, PixelFormat,
    ReferenceRange, Refusal, RefusalReason, RequestId, RequestReport, SceneHash, TilesDone,
    ToClient, ToNode, TraceRequest,
};
pub use precision::{PixelPrecision, PrecisionRange};
pub use session::{
    Channel, ChunkStore, ClientEvent, ClientSession, NodeEvent, NodeSession, Packet, ReceivedScene,
    SceneAssembler, SceneProgress, SceneStatus,
};
pub use tile_codec::TilePixels;
