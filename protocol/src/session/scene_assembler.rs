//! Assembly of scenes at a node, from messages and from chunks that it has kept.
//!
//! An assembler hashes and decodes, and its store may read and write files: a transport calls it on
//! another thread than that of its sockets, and hands what it says to the session.

use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::sync::Arc;

use carom_tracer::Scene;
use carom_tracer::text::printable;

use crate::codec;
use crate::error::{Error, Reason};
use crate::limits::{SCENE_BYTES_MAX, SCENE_TEXTURE_BYTES_MAX, SENTENCE_BYTES_MAX};
use crate::message::{ChunkKey, SceneHash, ToNode};

/// A place where chunks stay longer than a connection.
///
/// Whoever names a chunk knows the hash of its bytes, which only who has them can tell.
pub trait ChunkStore: Send + Sync {
    /// Whether it has the chunk, which will soon be read.
    fn contains(&self, chunk: &ChunkKey) -> bool;

    /// The chunk's bytes, which hash to its key, if it has them.
    fn read(&self, chunk: &ChunkKey) -> Option<Vec<u8>>;

    /// Keeps a chunk, if it can.
    fn write(&self, chunk: &ChunkKey, bytes: &[u8]);
}

/// A scene that has come, decoded and checked.
#[derive(Debug)]
pub struct ReceivedScene {
    pub(super) hash: SceneHash,
    /// How many there were of its bytes.
    pub(super) bytes: usize,
    /// The scene, or a sentence for its sender.
    pub(super) scene: Result<Arc<Scene>, String>,
}

impl ReceivedScene {
    /// Bytes of the scene as it was sent.
    pub const fn bytes(&self) -> usize {
        self.bytes
    }

    fn new(hash: SceneHash, bytes: usize, scene: Scene) -> Self {
        let scene = match check_scene(&scene) {
            Ok(()) => Ok(Arc::new(scene)),
            Err(sentence) => Err(printable(&sentence, SENTENCE_BYTES_MAX)),
        };
        Self { hash, bytes, scene }
    }
}

/// What has become of a scene after a packet of it.
#[derive(Debug)]
pub enum SceneProgress {
    /// It is there.
    Received(ReceivedScene),
    /// It is too long for this node.
    TooLong {
        /// Its hash.
        hash: SceneHash,
        /// A sentence for its sender.
        why: String,
    },
    /// These of its chunks are not there.
    Wanted {
        /// Its hash.
        hash: SceneHash,
        /// Their places in its manifest.
        chunks: Vec<u32>,
        /// Bytes of those that are.
        bytes: usize,
        /// Bytes of all.
        of: usize,
    },
    /// Another part of it has come.
    Coming {
        /// Bytes that are there.
        bytes: usize,
        /// Bytes of all.
        of: usize,
        /// Whether that is to be told: some have come since it was.
        is_news: bool,
    },
}

/// Scenes of one connection, as their packets come.
pub struct SceneAssembler {
    store: Option<Arc<dyn ChunkStore>>,
    bytes_max: usize,
    under_way: Option<Assembly>,
}

impl Default for SceneAssembler {
    /// An assembler that keeps no chunks.
    fn default() -> Self {
        Self::new(None, SCENE_BYTES_MAX)
    }
}

impl SceneAssembler {
    /// An assembler with a store of chunks, for scenes of at most `bytes_max` bytes.
    pub fn new(store: Option<Arc<dyn ChunkStore>>, bytes_max: usize) -> Self {
        Self {
            store,
            bytes_max,
            under_way: None,
        }
    }

    /// Whether chunks of a scene are awaited.
    pub const fn is_under_way(&self) -> bool {
        self.under_way.is_some()
    }

    /// Handles a packet that [`codec::is_of_scene`]. Keeps no more in memory than has come, or has been read of the
    /// store.
    ///
    /// # Errors
    /// As [`codec::decode_to_node`]; [`Error::OutOfOrder`] for a part of a scene that was not awaited.
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
        match message {
            ToNode::Scene { hash, scene } => {
                let bytes = packet_bytes - codec::SCENE_OFFSET;
                let received = ReceivedScene::new(hash, bytes, *scene);
                Ok(SceneProgress::Received(received))
            }
            ToNode::Manifest { .. } if self.under_way.is_some() => {
                Err(Error::out_of_order(what, Reason::TransferOpen))
            }
            ToNode::Manifest { hash, chunks } => self.begin(hash, chunks),
            ToNode::Chunk { bytes } => match &mut self.under_way {
                Some(assembly) => assembly.add(bytes, self.store.as_deref()),
                None => Err(Error::out_of_order(what, Reason::ChunkNotWanted)),
            },
            ToNode::ChunksSent(hash) => match &mut self.under_way {
                Some(assembly) if assembly.hash == hash => self.finish(),
                _ => Err(Error::out_of_order(what, Reason::TransferNotOpen)),
            },
            _ => Err(Error::malformed(what, Reason::UnknownMessage)),
        }
    }

    fn begin(&mut self, hash: SceneHash, chunks: Vec<ChunkKey>) -> Result<SceneProgress, Error> {
        let mut assembly = Assembly::new(hash, chunks)?;
        if assembly.bytes_of_all > self.bytes_max {
            let why = format!(
                "it has {} MB, and a player's scenes may take {} MB of memory here: use smaller textures and fewer \
                 triangles, or give the node more (`carom-farm node --scene-memory`)",
                assembly.bytes_of_all.div_ceil(1_000_000),
                self.bytes_max / 1_000_000
            );
            return Ok(SceneProgress::TooLong { hash, why });
        }
        let is_missing = |chunk: &ChunkKey| {
            let store = self.store.as_ref();
            store.is_none_or(|store| !store.contains(chunk))
        };
        assembly.want(is_missing);
        let wanted = assembly.wanted();
        self.under_way = Some(assembly);
        Ok(wanted)
    }

    /// Ends the scene, if the chunks that the store had are still there and right.
    fn finish(&mut self) -> Result<SceneProgress, Error> {
        const WHAT: &str = "end of a scene";
        let Some(assembly) = &mut self.under_way else {
            return Err(Error::out_of_order(WHAT, Reason::TransferNotOpen));
        };
        if !assembly.wanted.is_empty() {
            let count = assembly.wanted.len();
            return Err(Error::out_of_order(WHAT, Reason::ChunksMissing { count }));
        }
        if let Some(store) = &self.store {
            assembly.read(store.as_ref());
        }
        assembly.want(|_| true);
        if !assembly.wanted.is_empty() {
            return Ok(assembly.wanted());
        }
        let (hash, bytes) = (assembly.hash, assembly.join());
        self.under_way = None;
        if SceneHash::of_bytes(&bytes) != hash {
            return Err(Error::malformed(WHAT, Reason::SceneHash));
        }
        let scene = codec::decode_scene(&bytes)?;
        let received = ReceivedScene::new(hash, bytes.len(), scene);
        Ok(SceneProgress::Received(received))
    }
}

impl fmt::Debug for SceneAssembler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SceneAssembler({:?})", self.under_way)
    }
}

/// A scene whose chunks are awaited.
struct Assembly {
    hash: SceneHash,
    chunks: Vec<ChunkKey>,
    /// For each chunk the place of the first and of the last one that is the same.
    places: Vec<(usize, usize)>,
    /// Those in memory, each at the first of its places.
    held: Vec<Option<Vec<u8>>>,
    /// Those that will come, in order.
    wanted: VecDeque<u32>,
    bytes_of_all: usize,
    /// Bytes of those that are wanted.
    bytes_wanted: usize,
    /// How many were there when that was told last.
    bytes_told: usize,
}

impl Assembly {
    fn new(hash: SceneHash, chunks: Vec<ChunkKey>) -> Result<Self, Error> {
        let mut ends: HashMap<[u8; 32], (usize, usize)> = HashMap::new();
        for (index, chunk) in chunks.iter().enumerate() {
            let (first, last) = ends.entry(chunk.hash).or_insert((index, index));
            *last = index;
            if chunks[*first].bytes != chunk.bytes {
                return Err(Error::malformed(
                    "manifest of a scene",
                    Reason::ChunkLengths,
                ));
            }
        }
        Ok(Self {
            hash,
            places: chunks.iter().map(|chunk| ends[&chunk.hash]).collect(),
            held: vec![None; chunks.len()],
            wanted: VecDeque::new(),
            bytes_of_all: chunks.iter().map(|chunk| chunk.bytes as usize).sum(),
            bytes_wanted: 0,
            bytes_told: 0,
            chunks,
        })
    }

    /// Wants those of the chunks that are not in memory which `is_missing` chooses.
    fn want(&mut self, is_missing: impl Fn(&ChunkKey) -> bool) {
        let first = self.chunks.iter().enumerate().filter(|(index, chunk)| {
            self.places[*index].0 == *index && self.held[*index].is_none() && is_missing(chunk)
        });
        self.wanted = first.map(|(index, _)| index as u32).collect();
        let wanted = self
            .places
            .iter()
            .zip(&self.chunks)
            .filter(|((first, _), _)| self.wanted.binary_search(&(*first as u32)).is_ok());
        self.bytes_wanted = wanted.map(|(_, chunk)| chunk.bytes as usize).sum();
    }

    fn wanted(&mut self) -> SceneProgress {
        self.bytes_told = self.bytes();
        SceneProgress::Wanted {
            hash: self.hash,
            chunks: self.wanted.iter().copied().collect(),
            bytes: self.bytes_told,
            of: self.bytes_of_all,
        }
    }

    const fn bytes(&self) -> usize {
        self.bytes_of_all - self.bytes_wanted
    }

    /// Takes the next chunk that is wanted.
    fn add(
        &mut self,
        bytes: Vec<u8>,
        store: Option<&dyn ChunkStore>,
    ) -> Result<SceneProgress, Error> {
        const WHAT: &str = "chunk";
        let Some(&index) = self.wanted.front() else {
            return Err(Error::out_of_order(WHAT, Reason::ChunkNotWanted));
        };
        let index = index as usize;
        let key = self.chunks[index];
        if ChunkKey::of(&bytes) != key {
            return Err(Error::malformed(WHAT, Reason::ChunkHash));
        }
        self.wanted.pop_front();
        let same = self.places.iter().filter(|(first, _)| *first == index);
        self.bytes_wanted -= same.count() * bytes.len();
        if let Some(store) = store {
            store.write(&key, &bytes);
        }
        self.held[index] = Some(bytes);
        let is_news = self.bytes() >= self.bytes_told + self.bytes_of_all / REPORTS_MAX;
        if is_news {
            self.bytes_told = self.bytes();
        }
        Ok(SceneProgress::Coming {
            bytes: self.bytes(),
            of: self.bytes_of_all,
            is_news,
        })
    }

    /// Reads what is not in memory.
    fn read(&mut self, store: &dyn ChunkStore) {
        for (index, chunk) in self.chunks.iter().enumerate() {
            if self.places[index].0 == index && self.held[index].is_none() {
                self.held[index] = store.read(chunk);
            }
        }
    }

    /// The scene's bytes; each chunk is dropped where it is last needed, so that memory does not hold them twice.
    fn join(&mut self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.bytes_of_all);
        for (index, &(first, last)) in self.places.iter().enumerate() {
            bytes.extend_from_slice(self.held[first].as_deref().unwrap_or_default());
            if index == last {
                self.held[first] = None;
            }
        }
        bytes
    }
}

impl fmt::Debug for Assembly {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} bytes", self.bytes(), self.bytes_of_all)
    }
}

/// Whether a node draws a scene, or a sentence.
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

/// Reports of a scene's progress, but for the first.
const REPORTS_MAX: usize = 16;
