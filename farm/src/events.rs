//! Events of a farm as a stream: nodes that come and go, frames that are finished.

use std::sync::mpsc::{self, Receiver, SyncSender, TrySendError};
use std::time::Duration;

use carom_protocol::FrameId;

use crate::frame::Frame;
use crate::node_status::{NodeIndex, NodeState, NodeStatus};
use crate::stats::FrameStats;

/// Something that has happened.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum FarmEvent {
    /// A node is in another state than before.
    Node {
        /// Which.
        node: NodeIndex,
        /// Its address, or `local`.
        address: String,
        /// Its state now.
        state: NodeState,
    },
    /// A frame is whole.
    Frame {
        /// Which.
        id: FrameId,
        /// How it was made.
        stats: Box<FrameStats>,
    },
}

/// The events of a farm since [`crate::Farm::events`]. Those that nobody takes are kept up to
/// [`FarmEvents::QUEUE_MAX`]; further ones are dropped.
#[derive(Debug)]
pub struct FarmEvents {
    events: Receiver<FarmEvent>,
}

impl FarmEvents {
    /// The most events that wait to be taken.
    pub const QUEUE_MAX: usize = 1024;

    pub(crate) fn new() -> (EventSender, Self) {
        let (sender, events) = mpsc::sync_channel(Self::QUEUE_MAX);
        (EventSender(sender), Self { events })
    }

    /// The next event, if there is one now.
    pub fn poll(&self) -> Option<FarmEvent> {
        self.events.try_recv().ok()
    }

    /// The next event; waits for it, but not longer than `patience`.
    pub fn wait(&self, patience: Duration) -> Option<FarmEvent> {
        self.events.recv_timeout(patience).ok()
    }
}

/// Waits for each event; ends with the farm.
impl Iterator for FarmEvents {
    type Item = FarmEvent;

    fn next(&mut self) -> Option<FarmEvent> {
        self.events.recv().ok()
    }
}

/// The farm's end of a stream. Its calls return whether anybody listens.
pub(crate) struct EventSender(SyncSender<FarmEvent>);

impl EventSender {
    pub(crate) fn finished(&self, frame: &Frame) -> bool {
        self.send(FarmEvent::Frame {
            id: frame.id,
            stats: Box::new(frame.stats.clone()),
        })
    }

    /// Says which nodes are in another state than `before`.
    pub(crate) fn compare(&self, before: &[NodeStatus], now: &[NodeStatus]) -> bool {
        let word = |node: &NodeStatus| node.state.word();
        let changed = now.iter().enumerate().filter(|(index, node)| {
            let before = before.get(*index).map(word);
            before != Some(word(node))
        });
        let mut events = changed.map(|(index, node)| FarmEvent::Node {
            node: NodeIndex(index),
            address: node.address.clone(),
            state: node.state.clone(),
        });
        events.all(|event| self.send(event))
    }

    fn send(&self, event: FarmEvent) -> bool {
        !matches!(self.0.try_send(event), Err(TrySendError::Disconnected(_)))
    }
}
