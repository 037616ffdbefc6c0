//! Bounds on what a peer may send or make this program keep, each with its reason.

/// Bytes of a control message other than a scene or a trace request.
pub const CONTROL_BYTES_MAX: usize = 64 * 1024;
/// Bytes of a trace request: with 64 poses it has 2.3 kB, plus 6 bytes for each of
/// [`carom_tracer::scene::validate::PARTICLES_MAX`] particles.
pub const TRACE_BYTES_MAX: usize =
    CONTROL_BYTES_MAX + 6 * carom_tracer::scene::validate::PARTICLES_MAX;
/// Bytes of a scene: 131,072 objects with the longest names take 22 MB, five million triangles with half as
/// many vertices and their normals 105 MB, a dozen photographs as JPEG files of 2048 pixels a side 20 MB.
pub const SCENE_BYTES_MAX: usize = 128 << 20;
/// Bytes of a scene that travels as one message, without a round trip before it: 20 ms at 100 Mbit/s. The
/// pool room has 5 kB. Longer scenes travel in chunks.
pub const SCENE_MESSAGE_BYTES_MAX: usize = 256 << 10;
/// Bytes of a chunk. A longer one would delay requests behind it by more than 40 ms at 100 Mbit/s.
pub const CHUNK_BYTES_MAX: usize = 512 << 10;
/// Chunks of a scene: [`SCENE_BYTES_MAX`] bytes in chunks of a quarter of their mean length.
pub const CHUNKS_MAX: usize = SCENE_BYTES_MAX >> 15;
/// Bytes of a manifest of [`CHUNKS_MAX`] chunks.
pub const MANIFEST_BYTES_MAX: usize = 64 + 36 * CHUNKS_MAX;
/// Bytes of any message to a node.
pub const TO_NODE_BYTES_MAX: usize = CHUNK_BYTES_MAX + 64;
/// Bytes of the textures of a peer's scene once decoded: forty of 2048×2048 texels with all their mip levels.
/// A megabyte of PNG can expand to a gigabyte, and a node keeps [`SCENES_KEPT_MAX`] scenes of a player.
pub const SCENE_TEXTURE_BYTES_MAX: u64 = 1 << 30;
/// Poses in an update: fewer than 64 balls lie on any table.
pub const POSES_MAX: usize = 64;
/// Pixels along a tile's edge: larger ones balance badly.
pub const TILE_EDGE_MAX: u16 = 128;
/// Tiles in one message: eight of 32 pixels are a compression unit of 8192 pixels.
pub const TILES_PER_MESSAGE_MAX: u32 = 8;
/// Pixels in one tile message.
pub const PIXELS_PER_MESSAGE_MAX: usize =
    TILES_PER_MESSAGE_MAX as usize * TILE_EDGE_MAX as usize * TILE_EDGE_MAX as usize;
/// Bytes of a tile message: incompressible floats and the header.
pub const TILES_BYTES_MAX: usize = PIXELS_PER_MESSAGE_MAX * 12 + 4096;
/// Requests that a node holds for a client; more are refused as busy. Eight frames in flight, each
/// with as many re-issued requests again, twice over. A client that needs more asks other nodes, or
/// waits until a request ends.
pub const REQUESTS_QUEUED_MAX: usize = 32;
/// Scenes that a node keeps for a connection; the least recently used goes first.
pub const SCENES_KEPT_MAX: usize = 4;
/// Encoded bytes of those scenes together.
pub const SCENES_KEPT_BYTES_MAX: usize = SCENE_BYTES_MAX;
/// Samples of one request: some 20 s of 16 cores with AVX-512, an hour of one slow core.
pub const REQUEST_SAMPLES_MAX: u64 = 1 << 32;
/// Bytes of a sentence from a peer.
pub const SENTENCE_BYTES_MAX: usize = carom_tracer::text::SENTENCE_BYTES_MAX;
/// Frames that a client has in flight.
pub const FRAMES_IN_FLIGHT_MAX: usize = 8;
/// Nodes of one farm.
pub const NODES_MAX: usize = 1024;
/// Bytes of a file that lists nodes: 1024 nodes with the longest names take a quarter of it.
pub const DIRECTORY_FILE_BYTES_MAX: u64 = 1 << 20;
/// Bytes of a node's record in a directory: 700 with the longest names.
pub const NODE_RECORD_BYTES_MAX: usize = 1024;
/// Records kept from a directory that others write to: all nodes of a farm, and as many that have left
/// and whose records have not expired.
pub const NODE_RECORDS_MAX: usize = 2 * NODES_MAX;
/// Health probes that are answered concurrently: a cluster sends two, and a person may send some too.
pub const PROBES_MAX: usize = 16;
/// Seconds that a probe may take: Kubernetes gives up after one by default.
pub const PROBE_SECS_MAX: u64 = 5;
/// Bytes of an answer over HTTP: a node's metrics have 1,500, a cloud's termination notice 60.
pub const HTTP_ANSWER_BYTES_MAX: usize = 16 << 10;
/// Tiles of one request: a 4K picture in tiles of 8 pixels has 129,600. Bounds the lists that a node
/// allocates for a request of 200 bytes.
pub const REQUEST_TILES_MAX: u32 = 1 << 17;
/// Bytes of a node's or a device's name: a domain name has at most 253.
pub const NODE_NAME_BYTES_MAX: usize = 255;
/// Requests of one connection whose tiles a client keeps as references: twice the frames in flight.
/// Bounds what it keeps for a node that has since been asked for other tiles.
pub const REFERENCE_REQUESTS_MAX: usize = 2 * FRAMES_IN_FLIGHT_MAX;
/// Ranges of references that a request names: one if all tiles of the request before have come; each
/// late tile message splits a range.
pub const REFERENCE_RANGES_MAX: usize = 64;
/// Bytes of sent tiles that a node remembers for a client: twelve 720p frames or five of 1080p.
/// Tiles without a reference are coded by themselves.
pub const SENT_REFERENCES_BYTES_MAX: usize = 32 * 1024 * 1024;
/// Bytes of tiles that wait in a node's session for the network: a 4K picture of half floats.
pub const TILES_QUEUED_BYTES_MAX: usize = 64 * 1024 * 1024;
/// Control packets that wait in a session for the network; a peer that keeps asking for answers
/// without reading any is disconnected.
pub const CONTROL_QUEUED_MAX: usize = 1024;
/// Requests refused by a node that the client remembers, so as to distinguish their late tiles from tiles
/// that were never asked for: four seconds of frames.
pub const REQUESTS_REFUSED_KEPT: usize = 256;
