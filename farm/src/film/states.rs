//! States of a scene, one for each frame of a film: known from the start, or made as each is traced.

use std::sync::Arc;

use carom_tracer::{Scene, SceneUpdate};

use crate::error::Error;

/// What a frame of a film shows.
#[derive(Clone, Debug, Default)]
pub struct FilmState {
    /// A scene of the frame's own; absent, the film's.
    pub scene: Option<Arc<Scene>>,
    /// What has moved there.
    pub update: SceneUpdate,
}

/// Those of a whole film.
pub(super) enum FilmStates {
    Updates(Vec<SceneUpdate>),
    Made {
        frames: usize,
        /// Tells them from all others.
        key: String,
        make: MakeState,
    },
}

/// Makes the state of the frame of a number, the first being 0.
type MakeState = Box<dyn FnMut(u32) -> Result<FilmState, Error> + Send>;

impl FilmStates {
    pub(super) fn frames(&self) -> usize {
        match self {
            Self::Updates(updates) => updates.len(),
            Self::Made { frames, .. } => *frames,
        }
    }

    /// The updates that are known from the start, to be checked there.
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

    /// Adds what tells them from all others.
    pub(super) fn hash_into(&self, hash: &mut blake3::Hasher) {
        match self {
            // What Rust prints of a number tells it from all others.
            Self::Updates(updates) => updates.iter().for_each(|update| {
                hash.update(format!("{update:?}").as_bytes());
            }),
            Self::Made { key, .. } => {
                hash.update(key.as_bytes());
            }
        }
    }
}
