//! Event stream of a farm: nodes that come and go, frames that are finished.

use std::sync::mpsc::{self, Receiver, SyncSender, TrySendError};
use std::time::Duration;

use carom_protocol::FrameId;

use crate::frame::Frame;
use crate::node_status::{NodeIndex, NodeState, NodeStatus};
use crate::stats::FrameStats;

/// An event of a farm.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum FarmEvent {
    /// A node has changed its state.
    Node {
        /// Index of the node.
        node: NodeIndex,
        /// Its address, or `local`.
        address: String,
        /// Its new state.
        state: NodeState,
    },
    /// A frame is complete.
    Frame {
        /// Id of the frame.
        id: FrameId,
        /// Its statistics.
        stats: Box<FrameStats>,
    },
}

/// Events of a farm since [`crate::Farm::events`]. Up to [`FarmEvents::QUEUE_MAX`] are queued; further ones
/// are dropped.
#[derive(Debug)]
pub struct FarmEvents {
    events: Receiver<FarmEvent>,
}

impl FarmEvents {
    /// Maximum number of queued events.
    pub const QUEUE_MAX: usize = 1024;

    pub(crate) fn new() -> (EventSender, Self) {
        let (sender, events) = mpsc::sync_channel(Self::QUEUE_MAX);
        (EventSender(sender), Self { events })
    }

    /// The next event, if there is one now.
    pub fn poll(&self) -> Option<FarmEvent> {
        self.events.try_recv().ok()
    }

    /// Waits for the next event, at most for `patience`.
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

/// Sending end of the stream. Its methods return whether the receiver still exists.
pub(crate) struct EventSender(SyncSender<FarmEvent>);

impl EventSender {
    pub(crate) fn finished(&self, frame: &Frame) -> bool {
        self.send(FarmEvent::Frame {
            id: frame.id,
            stats: Box::new(frame.stats.clone()),
        })
    }

    /// Sends an event for each node whose state differs from `before`.
    pub(crate) fn compare(&self, before: &[NodeStatus], now: &[NodeStatus]) -> bool {
        // By name: the bytes of a transfer or the seconds to a retry are not a change of state.
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
