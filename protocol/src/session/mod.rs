//! Sessions: the two ends of a connection as state machines: packets in, events out; calls in, packets out.
//!
//! ```text
//!  application                 session                      transport
//!    set_scene, trace, … ──▶ ┌───────────────┐ ─ poll_transmit ─▶ bytes
//!                            │ ClientSession │
//!              ◀── events ── └───────────────┘ ◀──── handle ───── bytes
//!                            ┌─────────────┐
//!              ◀── events ── │ NodeSession │ ◀──── handle ─────── bytes
//!    tiles, request_done, … ───▶ └─────────────┘ ─ poll_transmit ───▶ bytes
//! ```
//!
//! A transport keeps the packets of [`Channel::Control`] in order and delivers all packets
//! unharmed; those of [`Channel::Tiles`] may overtake each other and the others. Of a client's
//! requests it may deliver copies besides, as [`Channel::Copy`]. It sends what
//! [`ClientSession::poll_transmit`] or [`NodeSession::poll_transmit`] hands out after each call of
//! any other method, also after an error, and then closes if there was one.

mod client;
mod node;
mod reference_tiles;
mod requests;
mod scene_assembler;
mod scene_transfers;
mod scenes;

pub use client::{ClientEvent, ClientSession, SceneStatus};
pub use node::{NodeEvent, NodeSession};
pub use reference_tiles::{References, SentReferences};
pub use scene_assembler::{ChunkStore, ReceivedScene, SceneAssembler, SceneProgress};

use crate::error::Reason;
use crate::message::RequestId;
use crate::tile_codec::TilePixels;

/// A whole message on its way.
#[derive(Clone, Debug, PartialEq)]
pub struct Packet {
    /// Its channel.
    pub channel: Channel,
    /// Its bytes, unframed.
    pub bytes: Vec<u8>,
    /// Between sessions of one process, the pixels of a tile message, whose bytes then hold none.
    pub pixels: Option<TilePixels>,
}

impl Packet {
    /// A packet that any transport can carry.
    pub const fn new(channel: Channel, bytes: Vec<u8>) -> Self {
        Self {
            channel,
            bytes,
            pixels: None,
        }
    }

    /// Bytes that it keeps in memory.
    fn memory_bytes(&self) -> usize {
        self.bytes.len() + self.pixels.as_ref().map_or(0, TilePixels::bytes)
    }
}

/// The channel that a packet travels on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Channel {
    /// In order. Over QUIC: one stream in both directions, framed by [`crate::framing`].
    Control,
    /// In any order. Over QUIC: a stream of one direction for each packet, unframed.
    Tiles,
    /// To a node, copies of [`Channel::Control`] packets with trace requests: before the packet
    /// itself or after, twice or not at all. A request is begun with whatever comes first. Over
    /// QUIC: a datagram.
    Copy,
}

/// State of either session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SessionState {
    /// The peer's first message has not come.
    New,
    /// Both have spoken.
    Open,
    /// The peer broke a rule.
    Closed,
}

impl Channel {
    /// The name of this channel's packets in errors.
    const fn packet_name(self) -> &'static str {
        match self {
            Self::Control => "control packet",
            Self::Tiles => "tile packet",
            Self::Copy => "copy of a packet",
        }
    }
}

/// Of a request whose number does not rise.
fn not_above(request: RequestId) -> Reason {
    format!("request {} is not above the one before", request.0).into()
}

const TRANSFER_NOT_OPEN: &str = "no scene's chunks are being sent";
