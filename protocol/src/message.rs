//! Messages as plain data. [`crate::codec`] turns them into bytes and back.

use carom_tracer::{
    DeviceInfo, ImageSize, Material, ParticleForm, RenderSettings, Scene, SceneUpdate, TileGrid,
    TileRange,
};
use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::precision::PrecisionRange;

/// Version of the protocol, raised by every change of a message; both ends must have the same.
/// [`ToNode::Hello`] and [`ToClient::Welcome`] begin with their variant, 0, and this number in every
/// version, so that ends of different versions can report it.
pub const VERSION: u16 = 20;

/// BLAKE3 of a scene's postcard bytes, under which nodes keep it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SceneHash(pub [u8; 32]);

/// Number of a frame of one client, in the order of submission.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
pub struct FrameId(pub u64);

impl FrameId {
    /// First id of background frames, which are served after all others: the upper half of all ids.
    pub const BACKGROUND_FIRST: Self = Self(1 << 63);

    /// Whether it is served after all frames below [`FrameId::BACKGROUND_FIRST`].
    pub const fn is_background(self) -> bool {
        self.0 >= Self::BACKGROUND_FIRST.0
    }
}

/// Number of a request of one client to one node; never used twice on a connection.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
pub struct RequestId(pub u64);

/// Message from the client to a node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToNode {
    /// The first message of a connection.
    Hello {
        /// [`VERSION`] of the client.
        version: u16,
    },
    /// A scene of at most [`crate::limits::SCENE_MESSAGE_BYTES_MAX`] bytes to keep; answered by
    /// [`ToClient::SceneReady`] or [`ToClient::SceneRefused`].
    Scene {
        /// The hash that the scene's bytes must have.
        hash: SceneHash,
        /// The scene.
        scene: Box<Scene>,
    },
    /// Tiles to trace.
    Trace(Box<TraceRequest>),
    /// Cancels all requests of frames before this one.
    CancelBefore(FrameId),
    /// Cancels one request.
    CancelRequest(RequestId),
    /// Answered at once by [`ToClient::Pong`] with the same number.
    Ping(u64),
    /// The client has received all that it asked for and will ask for nothing more, since the node is
    /// [`ToClient::Leaving`]. The node may then close the connection.
    Leave,
    /// The chunks of a longer scene; answered by [`ToClient::ChunksWanted`] or [`ToClient::SceneRefused`].
    /// No other manifest follows before the answer to [`ToNode::ChunksSent`].
    Manifest {
        /// BLAKE3 of all bytes of the scene.
        hash: SceneHash,
        /// Its chunks in order; one may occur several times.
        chunks: Vec<ChunkKey>,
    },
    /// The next of the chunks that are wanted.
    Chunk {
        /// Its bytes.
        #[serde(with = "byte_string")]
        bytes: Vec<u8>,
    },
    /// All wanted chunks have been sent, and the scene counts as sent; answered by [`ToClient::SceneReady`]
    /// or [`ToClient::SceneRefused`].
    ChunksSent(SceneHash),
}

/// Message from a node to the client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToClient {
    /// The answer to [`ToNode::Hello`].
    Welcome {
        /// [`VERSION`] of the node.
        version: u16,
        /// The node's description.
        node: NodeInfo,
    },
    /// The scene is checked and kept.
    SceneReady(SceneHash),
    /// The scene is not usable.
    SceneRefused {
        /// The scene's hash.
        hash: SceneHash,
        /// A sentence for the user.
        why: String,
    },
    /// Some tiles of a request, finished.
    Tiles(TilesDone),
    /// All tiles of a request have been sent.
    RequestDone(RequestReport),
    /// A request was not begun or not finished.
    RequestRefused(Refusal),
    /// The answer to [`ToNode::Ping`].
    Pong {
        /// The ping's number.
        number: u64,
        /// Load of the node by its other players.
        load: NodeLoad,
    },
    /// Progress of the scene whose chunks are being sent, reported from time to time.
    SceneComing {
        /// Bytes of it that the node has, at most the scene's length.
        bytes: u32,
    },
    /// The node is about to end: it answers the requests that it has, and should be sent no others.
    Leaving,
    /// The chunks of a scene that the node lacks.
    ChunksWanted {
        /// The scene's hash.
        hash: SceneHash,
        /// Ascending indices in its [`ToNode::Manifest`]; the first one of a chunk that occurs several times.
        chunks: Vec<u32>,
    },
}

/// Content address of a chunk of a scene's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ChunkKey {
    /// BLAKE3 of its bytes.
    pub hash: [u8; 32],
    /// Its length in bytes, 1 to [`crate::limits::CHUNK_BYTES_MAX`].
    pub bytes: u32,
}

impl ChunkKey {
    /// The key of a chunk with these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self {
            hash: *blake3::hash(bytes).as_bytes(),
            bytes: bytes.len() as u32,
        }
    }
}

/// Load of a node's device by its other players.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeLoad {
    /// Number of players that wait, or that it has traced for within the last second.
    pub players: u16,
    /// The share of the last second in which the device was busy for them, in percent: 0 to 100.
    pub busy_percent: u8,
}

/// Description of a node.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeInfo {
    /// The node's name, from its certificate; empty for a node in the client's process.
    pub name: String,
    /// Random number chosen at the node's start: two addresses that report the same one lead to one node. 0
    /// if the node has none.
    pub instance: u64,
    /// Its device.
    pub device: DeviceInfo,
}

/// Tiles to trace: the description of a whole frame, and one node's part of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TraceRequest {
    /// The frame. A request for a frame and tiles may be repeated under another id.
    pub frame: FrameId,
    /// This request.
    pub id: RequestId,
    /// Hash of a scene that was sent to the node and not refused.
    pub scene: SceneHash,
    /// Camera, poses and particles; the latter travel as [`TraceRequest::particles`].
    #[serde(with = "without_particles")]
    pub update: SceneUpdate,
    /// The whole frame and its tiles.
    pub grid: TileGrid,
    /// The node's part.
    pub tiles: TileRange,
    /// Samples, maximum depth and seed.
    pub settings: RenderSettings,
    /// The format of the pixels.
    pub format: PixelFormat,
    /// Their precision, if the format is [`PixelFormat::Srgb8`].
    pub precision: PrecisionRange,
    /// Tiles of earlier requests that the client holds. The session fills them in.
    pub references: Vec<ReferenceRange>,
    /// The encoded particles of the update. Sessions encode and decode them.
    pub particles: CodedParticles,
}

/// Encoded particles of a request.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CodedParticles {
    /// The request against whose particles clouds are coded: the one before, if any cloud is delta-coded.
    pub reference: Option<RequestId>,
    /// The clouds, in order.
    pub clouds: Vec<CodedCloud>,
}

/// Encoded cloud of particles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CodedCloud {
    /// See [`carom_tracer::ParticleCloud::material`].
    pub material: Material,
    /// See [`carom_tracer::ParticleCloud::radius_m`].
    pub radius_m: f32,
    /// See [`carom_tracer::ParticleCloud::form`].
    pub form: ParticleForm,
    /// See [`carom_tracer::ParticleCloud::min`].
    pub min: Vec3,
    /// See [`carom_tracer::ParticleCloud::max`].
    pub max: Vec3,
    /// Number of particles.
    pub count: u32,
    /// Their positions: a byte of flags, then planes, by [`crate::particle_codec`].
    #[serde(with = "byte_string")]
    pub places: Vec<u8>,
}

/// Range of tiles that a client has received and remembers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReferenceRange {
    /// The request that they came from.
    pub request: RequestId,
    /// Their range in the same grid.
    pub tiles: TileRange,
}

impl TraceRequest {
    /// Size of the whole frame.
    pub fn size(&self) -> ImageSize {
        self.grid.size
    }
}

/// Format of a pixel on the wire; [`PrecisionRange`] states its precision.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum PixelFormat {
    /// Three bytes: sRGB of `clamp(exposure · L, 0, 1)`. For the screen.
    Srgb8 {
        /// Factor on radiance, above 0.
        exposure: f32,
    },
    /// Three half floats of linear radiance, clamped to ±65504. For merging sample ranges.
    LinearF16,
    /// Three floats of linear radiance. For files and measurements.
    LinearF32,
}

impl PixelFormat {
    /// Bytes of a pixel.
    pub const fn bytes(self) -> usize {
        match self {
            Self::Srgb8 { .. } => 3,
            Self::LinearF16 => 6,
            Self::LinearF32 => 12,
        }
    }
}

/// Finished tiles of a request: at most [`crate::limits::TILES_PER_MESSAGE_MAX`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TilesDone {
    /// The request.
    pub request: RequestId,
    /// Part of the request's tiles.
    pub tiles: TileRange,
    /// Microseconds of tracing and encoding that these tiles took, by the node's clock.
    pub busy_micros: u32,
    /// Stages of the time since the request's arrival.
    pub times: NodeTimes,
    /// Samples that were not finite and count as black.
    pub dropped_samples: u32,
    /// The pixels, by [`crate::tile_codec`]: tile after tile, each row-major.
    #[serde(with = "byte_string")]
    pub pixels: Vec<u8>,
}

/// Consecutive stages of a tile message since its request arrived, by the node's own clock, in
/// microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeTimes {
    /// From the request's arrival until it was begun.
    pub queue_micros: u32,
    /// From then until the last of the message's tiles was traced.
    pub trace_micros: u32,
    /// From then until the message was encoded.
    pub encode_micros: u32,
}

/// Durations of a request at the node, by its own clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RequestReport {
    /// The request.
    pub request: RequestId,
    /// Microseconds from arrival until the first tile was begun.
    pub queue_micros: u32,
    /// Microseconds of tracing.
    pub trace_micros: u32,
    /// Microseconds of encoding.
    pub encode_micros: u32,
}

/// Refusal of a request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// The request.
    pub request: RequestId,
    /// The reason.
    pub why: RefusalReason,
}

/// Reason of a [`Refusal`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RefusalReason {
    /// The client cancelled it.
    Cancelled,
    /// The node's queue is full.
    Busy,
    /// The node does not hold the scene.
    UnknownScene,
    /// The request is out of range; the sentence says how.
    Invalid(String),
    /// The device failed; the sentence says how.
    Device(String),
}

/// Serialisation of an update without its particles: camera and poses alone.
mod without_particles {
    use carom_tracer::SceneUpdate;
    use serde::{Deserialize, Deserializer, Serialize as _, Serializer};

    pub(super) fn serialize<S: Serializer>(update: &SceneUpdate, to: S) -> Result<S::Ok, S::Error> {
        (&update.camera, &update.poses).serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<SceneUpdate, D::Error> {
        let (camera, poses) = Deserialize::deserialize(from)?;
        Ok(SceneUpdate {
            camera,
            poses,
            particles: Vec::new(),
        })
    }
}

/// Serialisation of bytes as one copy, where serde visits a `Vec<u8>` byte by byte. Same form on the wire.
mod byte_string {
    use std::fmt;

    use serde::de::{Error, Visitor};
    use serde::{Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(bytes: &[u8], to: S) -> Result<S::Ok, S::Error> {
        to.serialize_bytes(bytes)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
        from.deserialize_bytes(Bytes)
    }

    struct Bytes;

    impl Visitor<'_> for Bytes {
        type Value = Vec<u8>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("bytes")
        }

        fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Vec<u8>, E> {
            Ok(bytes.to_vec())
        }
    }
}
