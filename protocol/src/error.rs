//! Errors of the protocol, by who is at fault, and the rules that a message can break.

use carom_tracer::TileRange;

/// The peer is at fault, and a session that met one is closed, but for [`Error::Unsendable`], where
/// the caller is, and which changes nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The peer speaks another version of the protocol.
    #[error("the peer speaks protocol version {theirs}, this program {ours}: update the older one")]
    Version {
        /// The peer's version.
        theirs: u16,
        /// This program's version.
        ours: u16,
    },
    /// A packet or field is longer than any valid one.
    #[error("the peer sent a {what} of {bytes} bytes: at most {max} are allowed")]
    TooLarge {
        /// Kind of message or field.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The limit, from [`crate::limits`].
        max: u64,
    },
    /// Bytes are no message, or the message breaks a rule.
    #[error("the peer sent a malformed {what}: {reason}")]
    Malformed {
        /// Kind of message or field.
        what: &'static str,
        /// The rule that it breaks.
        reason: Reason,
    },
    /// A valid message came at the wrong time.
    #[error("the peer sent {what} out of order: {reason}")]
    OutOfOrder {
        /// Kind of message.
        what: &'static str,
        /// The rule of order that it breaks.
        reason: Reason,
    },
    /// The caller asked for a message that no valid peer would accept. Nothing was sent, and the
    /// session goes on.
    #[error("a {what} cannot be sent: {reason}")]
    Unsendable {
        /// Kind of message.
        what: &'static str,
        /// The rule that it breaks.
        reason: Reason,
    },
}

/// A rule that a message breaks, with the values that break it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(
    missing_docs,
    reason = "each variant and its fields are described by its sentence"
)]
pub enum Reason {
    // The form of a message.
    #[error("{0}")]
    Postcard(#[from] postcard::Error),
    #[error("there is no such message")]
    UnknownMessage,
    #[error("it has no bytes")]
    Empty,
    #[error("{bytes} bytes follow its end")]
    TrailingBytes { bytes: usize },
    #[error("it has {bytes} bytes: at most {max} are allowed")]
    TooLong { bytes: usize, max: usize },
    #[error("it does not hash to its hash")]
    SceneHash,

    #[error("a chunk has {bytes} bytes: it must be from 1 to {max}")]
    ChunkBytes { bytes: usize, max: usize },
    #[error("it hashes to another one than was wanted")]
    ChunkHash,
    #[error("its chunks are not in rising order")]
    ChunkOrder,

    // The values of a message.
    #[error("there are {count} {what}: at most {max} are allowed")]
    TooMany {
        what: &'static str,
        count: usize,
        max: usize,
    },
    #[error(
        "its {what} has {bytes} bytes: at most {bytes_max} are allowed, without control characters"
    )]
    Text {
        what: &'static str,
        bytes: usize,
        bytes_max: usize,
    },
    #[error("it has {count} tiles: it must be from 1 to {max}")]
    TileCount { count: u32, max: u32 },
    #[error("tiles of {edge} pixels are asked for: it must be from 1 to {max}")]
    TileEdge { edge: u16, max: u16 },
    #[error("{} tiles from {} on are asked for: the picture has {all}", .tiles.count, .tiles.first)]
    TilesOutsideGrid { tiles: TileRange, all: u32 },
    #[error("there is no tile {} + {}", .tiles.first, .tiles.count)]
    TileOverflow { tiles: TileRange },
    #[error(
        "{pixels} pixels of {samples} samples are asked for: at most {max} samples are allowed in \
         one request"
    )]
    Samples { pixels: u64, samples: u32, max: u64 },
    #[error(
        "{tiles:?} of request {request} are references: ranges must be in order, in {requested:?} \
         and of earlier requests than {id}"
    )]
    ReferenceRange {
        tiles: TileRange,
        request: u64,
        requested: TileRange,
        id: u64,
    },
    #[error("the exposure is {exposure}: it must be finite and above 0")]
    Exposure { exposure: f32 },
    #[error("the finest precision, {finest}, is coarser than the coarsest, {coarsest}")]
    PrecisionOrder {
        finest: &'static str,
        coarsest: &'static str,
    },
    #[error("it must be one of {known}")]
    PrecisionName { known: String },
    #[error("{message}")]
    Tracer { message: String },
    #[error("object {object} is posed, but it is neither a sphere nor a truncated cone nor a mesh")]
    PoseOfImmovable { object: u32 },
    #[error("object {object} is posed, but the scene has {objects} objects")]
    PoseOutsideScene { object: u32, objects: usize },

    #[error(
        "its particles are coded against request {id}, which is not the last one with particles"
    )]
    ParticleReference { id: u64 },
    #[error("its particles become {bytes} bytes of too few: store them")]
    ParticleExpansion { bytes: usize },
    #[error("its {count} particles are too many, or other bytes are theirs")]
    ParticleCount { count: usize },

    // The payload of a tile message.
    #[error("its first byte names no precision: {byte:#04x}")]
    PrecisionByte { byte: u8 },
    #[error("its first byte names no way of storing")]
    Storage,
    #[error("it is {sent}: from {finest} to {coarsest} was asked for")]
    PrecisionNotAsked {
        sent: &'static str,
        finest: &'static str,
        coarsest: &'static str,
    },
    #[error("its modes are cut short")]
    ModesCutShort,
    #[error("there is no mode {mode}")]
    TileMode { mode: u8 },
    #[error("its masks do not fit")]
    DeltaMasks,
    #[error("a tile is delta-coded against one that is not held")]
    MissingReference,
    #[error("its range coder does not end where it does")]
    RangeCoderEnd,
    #[error("it has planes of {bytes} bytes: it must be from {min} to {max}")]
    PlaneBytes {
        bytes: usize,
        min: usize,
        max: usize,
    },
    #[error("it is no zstd frame")]
    ZstdMagic,
    #[error("it asks for a zstd dictionary")]
    ZstdDictionary,
    #[error("its zstd frame states no size")]
    ZstdNoSize,
    #[error("its zstd frame is cut short")]
    ZstdCutShort,
    #[error("its zstd frame cannot be decompressed: {message}")]
    Zstd { message: String },
    #[error("it is no JPEG scan")]
    JpegStorage,
    #[error("its JPEG scan cannot be decoded: {message}")]
    Jpeg { message: String },
    #[error("its JPEG scan is a picture of another size")]
    JpegSize,

    // The order of messages.
    #[error("the session is closed")]
    SessionClosed,
    #[error("the first must be {first}")]
    NotFirst { first: &'static str },
    #[error("there has been one")]
    Repeated,
    #[error("it came as a {channel}")]
    WrongChannel { channel: &'static str },
    #[error("clients send none")]
    NotForNodes,
    #[error("only requests have copies")]
    CopyOfNoRequest,
    #[error("it differs from its copy")]
    CopyDiffers,
    #[error("the node has not answered, or is at fault")]
    NotOpen,
    #[error("request {id} is not above the one before")]
    RequestNotAbove { id: u64 },
    #[error("{max} requests are open")]
    RequestsOpen { max: usize },
    #[error("request {id} is not open")]
    RequestNotOpen { id: u64 },
    #[error("request {id} was not cancelled")]
    RequestNotCancelled { id: u64 },
    #[error("{tiles:?} was not asked for: the request is {requested:?}")]
    TilesNotAsked {
        tiles: TileRange,
        requested: TileRange,
    },
    #[error("some of {tiles:?} have come before")]
    TilesRepeated { tiles: TileRange },
    #[error("{tiles:?} is not in the {left} tiles that are left of {requested:?}")]
    TilesNotLeft {
        tiles: TileRange,
        left: u32,
        requested: TileRange,
    },
    #[error("{count} tiles are missing")]
    TilesMissing { count: u32 },
    #[error("the node does not hold its scene")]
    SceneNotHeld,
    #[error("the scene was not sent")]
    SceneNotSent,
    #[error("a scene's chunks are being sent")]
    TransferOpen,
    #[error("no scene's chunks are being sent")]
    TransferNotOpen,
    #[error("no chunk is wanted")]
    ChunkNotWanted,
    #[error("{count} chunks are still to come")]
    ChunksMissing { count: usize },
    #[error("chunk {chunk} of {chunks} is wanted")]
    NoSuchChunk { chunk: u32, chunks: usize },
    #[error("no scene of {bytes} bytes was sent")]
    SceneProgress { bytes: usize },
    #[error("it answers no ping")]
    NoPing,
    #[error("the node answers none")]
    NoAnswers,
    #[error("the answers are not being read")]
    AnswersUnread,
    #[error("the network takes no packet")]
    NetworkFull,
}

impl Reason {
    /// The reason that the tracer gives.
    pub(crate) fn tracer(error: impl ToString) -> Self {
        let message = error.to_string();
        Self::Tracer { message }
    }
}

impl Error {
    pub(crate) fn malformed(what: &'static str, reason: impl Into<Reason>) -> Self {
        let reason = reason.into();
        Self::Malformed { what, reason }
    }

    pub(crate) const fn out_of_order(what: &'static str, reason: Reason) -> Self {
        Self::OutOfOrder { what, reason }
    }

    pub(crate) const fn unsendable(what: &'static str, reason: Reason) -> Self {
        Self::Unsendable { what, reason }
    }
}
