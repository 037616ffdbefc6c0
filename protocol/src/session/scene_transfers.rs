//! Transfers of scenes that a client sends in chunks, one scene after the other.

use std::collections::VecDeque;
use std::sync::Arc;

use super::TRANSFER_NOT_OPEN;
use crate::encoded_scene::EncodedScene;
use crate::error::Error;
use crate::message::{SceneHash, ToNode};

/// Queue of the scenes that are or will be sent in chunks; the first is in progress.
#[derive(Debug, Default)]
pub(super) struct SceneTransfers {
    queue: VecDeque<SceneTransfer>,
}

#[derive(Debug)]
struct SceneTransfer {
    scene: Arc<EncodedScene>,
    state: TransferState,
}

#[derive(Debug)]
enum TransferState {
    Waiting,
    /// The node has been told the scene's chunks.
    Announced,
    /// The node wants these, each once; they are sent in order.
    Sending(VecDeque<u32>),
    /// All that the node wanted has been sent.
    Sent,
}

impl SceneTransfers {
    pub(super) fn push(&mut self, scene: Arc<EncodedScene>) {
        let state = TransferState::Waiting;
        self.queue.push_back(SceneTransfer { scene, state });
    }

    pub(super) fn len(&self) -> usize {
        self.queue.len()
    }

    /// Whether the scene is queued and not completely sent.
    pub(super) fn is_sending(&self, hash: SceneHash) -> bool {
        self.queue.iter().any(|transfer| {
            transfer.scene.hash() == hash && !matches!(transfer.state, TransferState::Sent)
        })
    }

    /// The next message of the first scene and that scene, if the node need not answer first.
    pub(super) fn next(&mut self) -> Option<(ToNode, &Arc<EncodedScene>)> {
        let SceneTransfer { scene, state } = self.queue.front_mut()?;
        let hash = scene.hash();
        let message = match state {
            TransferState::Waiting => {
                *state = TransferState::Announced;
                let chunks = scene.chunks().to_vec();
                ToNode::Manifest { hash, chunks }
            }
            TransferState::Sending(wanted) => match wanted.pop_front() {
                Some(place) => ToNode::Chunk {
                    bytes: scene.chunk(place as usize).to_vec(),
                },
                None => {
                    *state = TransferState::Sent;
                    ToNode::ChunksSent(hash)
                }
            },
            TransferState::Announced | TransferState::Sent => return None,
        };
        Some((message, scene))
    }

    /// Sets the chunks of the first scene that the node lacks, as ascending indices.
    pub(super) fn want(&mut self, hash: SceneHash, wanted: Vec<u32>) -> Result<(), Error> {
        const WHAT: &str = "list of wanted chunks";
        let Some(SceneTransfer { scene, state }) = self.first(hash) else {
            return Err(Error::out_of_order(WHAT, TRANSFER_NOT_OPEN));
        };
        let chunks = scene.chunks().len();
        // Validation has ensured ascending indices, so the last one is the largest.
        if let Some(&chunk) = wanted.last()
            && chunk as usize >= chunks
        {
            let rule = format!("chunk {chunk} of {chunks} is wanted");
            return Err(Error::out_of_order(WHAT, rule));
        }
        *state = TransferState::Sending(wanted.into());
        Ok(())
    }

    /// The first scene, if its chunks are being sent and it has at least `bytes` bytes.
    pub(super) fn coming(&self, bytes: usize) -> Option<&EncodedScene> {
        let first = self.queue.front().filter(|transfer| {
            let is_coming = matches!(
                transfer.state,
                TransferState::Sending(_) | TransferState::Sent
            );
            is_coming && bytes <= transfer.scene.bytes()
        });
        first.map(|transfer| transfer.scene.as_ref())
    }

    /// Ends the first transfer if it is of this scene.
    pub(super) fn end(&mut self, hash: SceneHash) {
        if self.first(hash).is_some() {
            self.queue.pop_front();
        }
    }

    fn first(&mut self, hash: SceneHash) -> Option<&mut SceneTransfer> {
        let first = self.queue.front_mut();
        first.filter(|transfer| transfer.scene.hash() == hash)
    }
}
