//! Which scenes a node keeps, the same at both ends.
//!
//! A node uses its scenes in the order of the scene and trace messages it gets, which is the order
//! in which the client sends them. So a client that uses a cache of its own at each message knows
//! what the node has thrown away. A scene that the node refuses is in the client's cache until the
//! answer comes; all that it pushed out there and not at the node is a scene sent once more.

use crate::limits::SCENES_KEPT_MAX;
use crate::message::SceneHash;

/// At most [`SCENES_KEPT_MAX`] scenes, the most recently used last.
#[derive(Debug)]
pub(super) struct SceneCache<T> {
    scenes: Vec<(SceneHash, T)>,
}

impl<T> SceneCache<T> {
    pub(super) const fn new() -> Self {
        let scenes = Vec::new();
        Self { scenes }
    }

    /// The scene of that hash, from now on the most recently used.
    pub(super) fn touch(&mut self, hash: SceneHash) -> Option<&mut T> {
        let index = self.scenes.iter().position(|(kept, _)| *kept == hash)?;
        self.scenes[index..].rotate_left(1);
        self.scenes.last_mut().map(|(_, scene)| scene)
    }

    /// Puts a scene in as the most recently used, in place of the least recently used if all
    /// places are taken.
    pub(super) fn insert(&mut self, hash: SceneHash, scene: T) {
        self.remove(hash);
        if self.scenes.len() == SCENES_KEPT_MAX {
            self.scenes.remove(0);
        }
        self.scenes.push((hash, scene));
    }

    pub(super) fn remove(&mut self, hash: SceneHash) {
        self.scenes.retain(|(kept, _)| *kept != hash);
    }

    /// The scene of that hash, without using it.
    pub(super) fn peek_mut(&mut self, hash: SceneHash) -> Option<&mut T> {
        let mut scenes = self.scenes.iter_mut();
        scenes
            .find(|(kept, _)| *kept == hash)
            .map(|(_, scene)| scene)
    }
}
