//! States of a scene, one for each frame of a film: known from the start, or created as each is traced.

use std::sync::Arc;

use carom_tracer::{Scene, SceneUpdate};

use crate::error::Error;

/// State of the scene in a frame of a film.
#[derive(Clone, Debug, Default)]
pub struct FilmState {
    /// The frame's own scene; absent, the film's.
    pub scene: Option<Arc<Scene>>,
    /// Update of that scene.
    pub update: SceneUpdate,
}

/// States of all frames of a film.
pub(super) enum FilmStates {
    Updates(Vec<SceneUpdate>),
    Made {
        frames: usize,
        /// Identifies the states.
        key: String,
        make: MakeState,
    },
}

/// Creates the state of a frame from its number, the first being 0.
type MakeState = Box<dyn FnMut(u32) -> Result<FilmState, Error> + Send>;

impl FilmStates {
    pub(super) fn frames(&self) -> usize {
        match self {
            Self::Updates(updates) => updates.len(),
            Self::Made { frames, .. } => *frames,
        }
    }

    /// The updates known from the start, for validation.
    pub(super) fn known(&self) -> &[SceneUpdate] {
        match self {
            Self::Updates(updates) => updates,
            Self::Made { .. } => &[],
        }
    }

    pub(super) fn state(&mut self, frame: u32) -> Result<FilmState, Error> {
        match self {
            Self::Updates(updates) => Ok(FilmState {
                scene: None,
                update: updates[frame as usize].clone(),
            }),
            Self::Made { make, .. } => make(frame),
        }
    }

    /// Adds what identifies the states.
    pub(super) fn hash_into(&self, hash: &mut blake3::Hasher) {
        match self {
            // Rust's shortest round-trip format of a float identifies its value.
            Self::Updates(updates) => updates.iter().for_each(|update| {
                hash.update(format!("{update:?}").as_bytes());
            }),
            Self::Made { key, .. } => {
                hash.update(key.as_bytes());
            }
        }
    }
}
