//! Assembly of scenes at a node, from messages and from chunks in its store.
//!
//! An assembler hashes and decodes, and its store accesses files: a transport calls it on another thread
//! than that of its sockets, and hands the result to the session.

use std::collections::{HashSet, VecDeque};
use std::fmt;
use std::sync::Arc;

use carom_tracer::Scene;
use carom_tracer::text::printable;

use super::TRANSFER_NOT_OPEN;
use crate::codec;
use crate::error::{Error, SCENE_HASH};
use crate::limits::{SCENE_BYTES_MAX, SCENE_TEXTURE_BYTES_MAX, SENTENCE_BYTES_MAX};
use crate::message::{ChunkKey, SceneHash, ToNode};

/// A store of chunks that outlives connections.
///
/// A peer that names a chunk knows the hash of its bytes, which it can only have computed from them or
/// learnt from someone who has them.
pub trait ChunkStore: Send + Sync {
    /// The chunk's bytes, if the store has them; [`ChunkKey::of`] them must be `chunk`.
    fn read(&self, chunk: &ChunkKey) -> Option<Vec<u8>>;

    /// Stores a chunk, if possible.
    fn write(&self, chunk: &ChunkKey, bytes: &[u8]);
}

/// A received scene, decoded and checked.
#[derive(Debug)]
pub struct ReceivedScene {
    pub(super) hash: SceneHash,
    /// Number of its encoded bytes.
    pub(super) bytes: usize,
    /// The scene, or a sentence for its sender.
    pub(super) scene: Result<Arc<Scene>, String>,
}

impl ReceivedScene {
    fn new(hash: SceneHash, bytes: usize, scene: Scene) -> Self {
        let scene = match check_scene(&scene) {
            Ok(()) => Ok(Arc::new(scene)),
            Err(sentence) => Err(printable(&sentence, SENTENCE_BYTES_MAX)),
        };
        Self { hash, bytes, scene }
    }
}

/// State of a scene after a packet of it.
#[derive(Debug)]
pub enum SceneProgress {
    /// It is complete, or is refused.
    Received(ReceivedScene),
    /// Some of its chunks are missing.
    Wanted {
        /// The scene's hash.
        hash: SceneHash,
        /// The indices of the missing chunks in its manifest.
        chunks: Vec<u32>,
        /// Bytes of the chunks that are not missing.
        bytes: usize,
        /// Bytes of all chunks.
        of: usize,
    },
    /// Another chunk has arrived.
    Coming {
        /// Bytes of the chunks that are not missing.
        bytes: usize,
    },
}

/// Assembler of the scenes of one connection from their packets.
pub struct SceneAssembler {
    store: Option<Arc<dyn ChunkStore>>,
    bytes_max: usize,
    assembly: Option<Assembly>,
}

impl Default for SceneAssembler {
    /// An assembler without a store.
    fn default() -> Self {
        Self::new(None, SCENE_BYTES_MAX)
    }
}

impl SceneAssembler {
    /// An assembler with a store of chunks, for scenes in chunks of at most `bytes_max` bytes.
    pub fn new(store: Option<Arc<dyn ChunkStore>>, bytes_max: usize) -> Self {
        Self {
            store,
            bytes_max,
            assembly: None,
        }
    }

    /// Whether a scene in memory is waiting for chunks.
    pub const fn is_under_way(&self) -> bool {
        self.assembly.is_some()
    }

    /// Handles a packet that [`codec::is_of_scene`].
    ///
    /// # Errors
    /// As [`codec::decode_to_node`]; [`Error::OutOfOrder`] for a part of a scene that was not expected.
    pub fn handle(&mut self, packet: &[u8]) -> Result<SceneProgress, Error> {
        let message = codec::decode_to_node(packet)?;
        self.handle_message(message, packet.len())
    }

    pub(super) fn handle_message(
        &mut self,
        message: ToNode,
        packet_bytes: usize,
    ) -> Result<SceneProgress, Error> {
        let what = codec::to_node_kind(&message);
        let out_of_order = |reason| Err(Error::out_of_order(what, reason));
        match (message, &mut self.assembly) {
            (ToNode::Scene { hash, scene }, _) => {
                let bytes = packet_bytes - codec::SCENE_OFFSET;
                let received = ReceivedScene::new(hash, bytes, *scene);
                Ok(SceneProgress::Received(received))
            }
            (ToNode::Manifest { .. }, Some(_)) => out_of_order("a scene's chunks are being sent"),
            (ToNode::Manifest { hash, chunks }, None) => Ok(self.begin(hash, chunks)),
            (ToNode::Chunk { bytes }, Some(assembly)) => {
                assembly.add(&bytes, self.store.as_deref())
            }
            (ToNode::Chunk { .. }, None) => out_of_order(CHUNK_NOT_WANTED),
            (ToNode::ChunksSent(sent), assembly) => {
                // The transfer ends here, whatever the outcome.
                match assembly.take().filter(|assembly| assembly.hash == sent) {
                    Some(assembly) => assembly.finish().map(SceneProgress::Received),
                    None => out_of_order(TRANSFER_NOT_OPEN),
                }
            }
            _ => Err(Error::malformed(what, codec::UNKNOWN_MESSAGE)),
        }
    }

    /// Begins a scene with the chunks that the store has, and lists the others.
    fn begin(&mut self, hash: SceneHash, chunks: Vec<ChunkKey>) -> SceneProgress {
        let of: usize = chunks.iter().map(|chunk| chunk.bytes as usize).sum();
        // Refused before any memory is allocated for the announced bytes.
        if of > self.bytes_max {
            let why = format!(
                "it has {} MB, and a player's scenes may take {} MB of memory here: use smaller textures and fewer \
                 triangles, or give the node more (`carom-farm node --scene-memory`)",
                of.div_ceil(1_000_000),
                self.bytes_max / 1_000_000
            );
            let (bytes, scene) = (of, Err(why));
            return SceneProgress::Received(ReceivedScene { hash, bytes, scene });
        }
        let assembly = Assembly::new(hash, chunks, of, self.store.as_deref());
        let progress = SceneProgress::Wanted {
            hash,
            chunks: assembly.wanted.iter().copied().collect(),
            bytes: assembly.bytes_there,
            of,
        };
        self.assembly = Some(assembly);
        progress
    }
}

impl fmt::Debug for SceneAssembler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let there = self.assembly.as_ref().map(|assembly| assembly.bytes_there);
        write!(f, "SceneAssembler({there:?} bytes)")
    }
}

/// A scene that waits for chunks.
struct Assembly {
    hash: SceneHash,
    chunks: Vec<ChunkKey>,
    /// Zeros where chunks are missing. Allocated zeroed, so that pages take memory only once written.
    bytes: Vec<u8>,
    bytes_there: usize,
    /// Missing chunks in the order in which they will come, each at its first index.
    wanted: VecDeque<u32>,
}

impl Assembly {
    /// An assembly with all chunks that the store has.
    fn new(
        hash: SceneHash,
        chunks: Vec<ChunkKey>,
        bytes: usize,
        store: Option<&dyn ChunkStore>,
    ) -> Self {
        let mut assembly = Self {
            hash,
            chunks,
            bytes: vec![0; bytes],
            bytes_there: 0,
            wanted: VecDeque::new(),
        };
        let mut known = HashSet::new();
        for place in 0..assembly.chunks.len() {
            let chunk = assembly.chunks[place];
            // A chunk that occurs several times is read or requested once; `put` copies it to all its places.
            if known.insert(chunk) {
                match store.and_then(|store| store.read(&chunk)) {
                    Some(bytes) => assembly.put(chunk, &bytes),
                    None => assembly.wanted.push_back(place as u32),
                }
            }
        }
        assembly
    }

    /// Adds the next missing chunk.
    fn add(
        &mut self,
        bytes: &[u8],
        store: Option<&dyn ChunkStore>,
    ) -> Result<SceneProgress, Error> {
        const WHAT: &str = "chunk";
        let Some(place) = self.wanted.pop_front() else {
            return Err(Error::out_of_order(WHAT, CHUNK_NOT_WANTED));
        };
        let chunk = self.chunks[place as usize];
        // Verified before it is stored, since other players may get it from the store.
        if ChunkKey::of(bytes) != chunk {
            return Err(Error::malformed(
                WHAT,
                "it hashes to another one than was wanted",
            ));
        }
        if let Some(store) = store {
            store.write(&chunk, bytes);
        }
        self.put(chunk, bytes);
        let bytes = self.bytes_there;
        Ok(SceneProgress::Coming { bytes })
    }

    /// Copies a chunk to each place where the scene has it.
    fn put(&mut self, chunk: ChunkKey, bytes: &[u8]) {
        let mut start = 0;
        for other in &self.chunks {
            let end = start + other.bytes as usize;
            if *other == chunk {
                self.bytes[start..end].copy_from_slice(bytes);
                self.bytes_there += bytes.len();
            }
            start = end;
        }
    }

    fn finish(self) -> Result<ReceivedScene, Error> {
        const WHAT: &str = "end of a scene";
        if !self.wanted.is_empty() {
            let rule = format!("{} chunks are still to come", self.wanted.len());
            return Err(Error::out_of_order(WHAT, rule));
        }
        // Each chunk matches its own hash, but the manifest need not belong to the announced scene.
        if SceneHash::of_bytes(&self.bytes) != self.hash {
            return Err(Error::malformed(WHAT, SCENE_HASH));
        }
        let scene = codec::decode_scene(&self.bytes)?;
        Ok(ReceivedScene::new(self.hash, self.bytes.len(), scene))
    }
}

const CHUNK_NOT_WANTED: &str = "no chunk is wanted";

/// Checks that a node can draw a scene. Returns a sentence for its sender if not.
fn check_scene(scene: &Scene) -> Result<(), String> {
    scene.validate().map_err(|error| error.to_string())?;
    let bytes = scene.texture_bytes().map_err(|fault| fault.to_string())?;
    if bytes <= SCENE_TEXTURE_BYTES_MAX {
        return Ok(());
    }
    Err(format!(
        "its textures take {bytes} bytes once decoded: a node keeps at most {SCENE_TEXTURE_BYTES_MAX}"
    ))
}
