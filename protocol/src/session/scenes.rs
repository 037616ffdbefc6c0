//! Cache of the scenes that a node keeps, mirrored by the client.
//!
//! A node touches its scenes in the order of the scene and trace messages it receives, which is the order
//! in which the client sends them; a scene in chunks counts as sent, and as received, with its last message.
//! A client that touches a cache of its own at each message therefore knows which scenes the node has
//! evicted. A scene that the node refuses stays in the client's cache until the answer comes; if it evicted
//! others there and not at the node, these are sent once more.

use crate::limits::{SCENES_KEPT_BYTES_MAX, SCENES_KEPT_MAX};
use crate::message::SceneHash;

/// Cache of at most [`SCENES_KEPT_MAX`] scenes of [`SCENES_KEPT_BYTES_MAX`] bytes together, the least
/// recently used first.
#[derive(Debug)]
pub(super) struct SceneCache<T> {
    scenes: Vec<CachedScene<T>>,
}

#[derive(Debug)]
struct CachedScene<T> {
    hash: SceneHash,
    bytes: usize,
    scene: T,
}

impl<T> SceneCache<T> {
    pub(super) const fn new() -> Self {
        let scenes = Vec::new();
        Self { scenes }
    }

    /// The scene with that hash, which becomes the most recently used.
    pub(super) fn touch(&mut self, hash: SceneHash) -> Option<&mut T> {
        let index = self.scenes.iter().position(|kept| kept.hash == hash)?;
        // Moves the scene to the end; those used more recently keep their order before it.
        self.scenes[index..].rotate_left(1);
        self.scenes.last_mut().map(|kept| &mut kept.scene)
    }

    /// Inserts a scene of `bytes` bytes as the most recently used, evicting the least recently used as
    /// needed.
    pub(super) fn insert(&mut self, hash: SceneHash, bytes: usize, scene: T) {
        self.remove(hash);
        while self.scenes.len() == SCENES_KEPT_MAX
            || (!self.scenes.is_empty() && self.bytes() + bytes > SCENES_KEPT_BYTES_MAX)
        {
            self.scenes.remove(0);
        }
        self.scenes.push(CachedScene { hash, bytes, scene });
    }

    fn bytes(&self) -> usize {
        self.scenes.iter().map(|kept| kept.bytes).sum()
    }

    pub(super) fn remove(&mut self, hash: SceneHash) {
        self.scenes.retain(|kept| kept.hash != hash);
    }

    /// The scene with that hash, without marking it as used.
    pub(super) fn peek(&self, hash: SceneHash) -> Option<&T> {
        let mut scenes = self.scenes.iter();
        scenes
            .find(|kept| kept.hash == hash)
            .map(|kept| &kept.scene)
    }

    /// As [`Self::peek`], mutably.
    pub(super) fn peek_mut(&mut self, hash: SceneHash) -> Option<&mut T> {
        let mut scenes = self.scenes.iter_mut();
        scenes
            .find(|kept| kept.hash == hash)
            .map(|kept| &mut kept.scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A client inserts what it sends and later removes what is refused; a node inserts what it accepts. Both
    /// touch scenes in the same order.
    #[test]
    fn client_cache_holds_no_scene_the_node_evicted() {
        let (mut client, mut node) = (SceneCache::new(), SceneCache::new());
        let mut refused_late = Vec::new();
        let mut random = 1u32;
        for step in 0..20_000 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let number = (random >> 16) as u8 % 9;
            let hash = SceneHash([number; 32]);
            let bytes = usize::from(number) * SCENES_KEPT_BYTES_MAX / 12;
            if step % 3 == 0 {
                for hash in refused_late.drain(..) {
                    client.remove(hash);
                }
            }
            if client.touch(hash).is_some() {
                let refused = number == 0;
                assert!(refused || node.touch(hash).is_some(), "step {step}");
            } else {
                client.insert(hash, bytes, ());
                match number {
                    0 => refused_late.push(hash),
                    _ => node.insert(hash, bytes, ()),
                }
            }
            assert!(node.scenes.len() <= SCENES_KEPT_MAX);
            assert!(node.bytes() <= SCENES_KEPT_BYTES_MAX);
        }
    }
}
