//! Encoded scene of a client: bytes made once for all nodes, and their division into chunks.
//!
//! Chunk boundaries are content-defined (FastCDC: Xia et al., "The Design of Fast Content-Defined Chunking
//! for Data Deduplication Based Storage Systems", 2020). Each mesh, texture and environment map is contiguous
//! in a scene's bytes, so two scenes that differ in one of them, or in the length of a list before it, share
//! all chunks but its own and one at either side. Boundaries at fixed offsets would shift with each inserted
//! byte.

use std::fmt;
use std::sync::Arc;

use carom_tracer::Scene;
use fastcdc::v2020::FastCDC;

use crate::codec;
use crate::error::{Error, Reason};
use crate::limits::{CHUNK_BYTES_MAX, SCENE_BYTES_MAX, SCENE_MESSAGE_BYTES_MAX};
use crate::message::{ChunkKey, SceneHash};

/// The encoded bytes of a scene, shared by sessions.
#[derive(PartialEq, Eq)]
pub struct EncodedScene {
    hash: SceneHash,
    bytes: Vec<u8>,
    /// Empty if the scene travels as one message.
    chunks: Vec<ChunkKey>,
}

impl EncodedScene {
    /// Encodes `scene`.
    ///
    /// # Errors
    /// [`Error::Unsendable`] if the scene cannot be drawn or has more than [`SCENE_BYTES_MAX`] bytes.
    pub fn new(scene: &Scene) -> Result<Arc<Self>, Error> {
        let invalid =
            |error: carom_tracer::Error| Error::unsendable("scene", Reason::tracer(error));
        scene.validate().map_err(invalid)?;
        let bytes = codec::encode_scene(scene);
        if bytes.len() > SCENE_BYTES_MAX {
            let reason = Reason::too_long(bytes.len(), SCENE_BYTES_MAX);
            return Err(Error::unsendable("scene", reason));
        }
        let chunks = match bytes.len() {
            0..=SCENE_MESSAGE_BYTES_MAX => Vec::new(),
            _ => cut(&bytes),
        };
        Ok(Arc::new(Self {
            hash: SceneHash::of_bytes(&bytes),
            bytes,
            chunks,
        }))
    }

    /// The hash under which nodes keep the scene.
    pub const fn hash(&self) -> SceneHash {
        self.hash
    }

    /// The number of encoded bytes.
    pub const fn bytes(&self) -> usize {
        self.bytes.len()
    }

    /// The chunks in order; empty if the scene travels as one message.
    pub fn chunks(&self) -> &[ChunkKey] {
        &self.chunks
    }

    /// The encoded message of a scene without chunks.
    pub(crate) fn message(&self) -> Vec<u8> {
        codec::scene_message(self.hash, &self.bytes)
    }

    pub(crate) fn chunk(&self, place: usize) -> &[u8] {
        let (before, rest) = self.chunks.split_at(place);
        let start: usize = before.iter().map(|chunk| chunk.bytes as usize).sum();
        &self.bytes[start..start + rest[0].bytes as usize]
    }
}

impl fmt::Debug for EncodedScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (bytes, chunks) = (self.bytes.len(), self.chunks.len());
        write!(f, "EncodedScene({bytes} bytes in {chunks} chunks)")
    }
}

fn cut(bytes: &[u8]) -> Vec<ChunkKey> {
    FastCDC::new(bytes, CHUNK_BYTES_MIN, CHUNK_BYTES_MEAN, CHUNK_BYTES_MAX)
        .map(|chunk| ChunkKey::of(&bytes[chunk.offset..chunk.offset + chunk.length]))
        .collect()
}

/// Minimum length of a chunk but a scene's last: [`crate::limits::CHUNKS_MAX`] of them make the longest
/// scene.
const CHUNK_BYTES_MIN: usize = 32 << 10;
/// Mean length of a chunk. Longer chunks send more unchanged bytes again, half a chunk at either side of a
/// change; shorter ones lengthen the manifest, of 28 kB for 100 MB, and add files to a node's cache.
const CHUNK_BYTES_MEAN: usize = 128 << 10;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::CHUNKS_MAX;

    fn noise(seed: u64, bytes: usize) -> Vec<u8> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 56) as u8
        };
        (0..bytes).map(|_| next()).collect()
    }

    #[test]
    fn chunks_join_to_the_whole_and_keep_their_limits() {
        for bytes in [noise(1, 3 << 20), vec![0; (3 << 20) + 5]] {
            let scene = EncodedScene {
                hash: SceneHash([0; 32]),
                chunks: cut(&bytes),
                bytes: bytes.clone(),
            };
            let chunks: Vec<&[u8]> = (0..scene.chunks.len())
                .map(|place| scene.chunk(place))
                .collect();
            assert!(chunks.concat() == bytes);
            let keys = chunks.iter().map(|chunk| ChunkKey::of(chunk));
            assert!(keys.eq(scene.chunks.iter().copied()));
            let (last, others) = chunks.split_last().unwrap();
            assert!((1..=CHUNK_BYTES_MAX).contains(&last.len()));
            let allowed = CHUNK_BYTES_MIN..=CHUNK_BYTES_MAX;
            assert!(others.iter().all(|chunk| allowed.contains(&chunk.len())));
        }
        assert!(SCENE_BYTES_MAX.div_ceil(CHUNK_BYTES_MIN) <= CHUNKS_MAX);
    }

    #[test]
    fn bytes_that_are_inserted_change_the_chunks_round_them_alone() {
        let before = noise(2, 8 << 20);
        let mut after = before.clone();
        after.splice(4 << 20..4 << 20, noise(3, 1000));
        let (held, chunks) = (cut(&before), cut(&after));
        let new: Vec<&ChunkKey> = chunks.iter().filter(|key| !held.contains(key)).collect();
        assert!((1..=3).contains(&new.len()), "{new:?} of {}", chunks.len());
    }
}
