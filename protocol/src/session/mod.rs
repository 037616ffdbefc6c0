//! Sessions: the two ends of a connection as state machines. Packets go in and events come out; calls go
//! in and packets come out.
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
//! unaltered; those of [`Channel::Tiles`] may overtake each other and the others. It may also deliver
//! copies of a client's requests, as [`Channel::Copy`]. After each call of any other method, also after an
//! error, it sends what [`ClientSession::poll_transmit`] or [`NodeSession::poll_transmit`] returns; after
//! an error it then closes.

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

/// A whole message, with the channel that it travels on.
#[derive(Clone, Debug, PartialEq)]
pub struct Packet {
    /// Its channel.
    pub channel: Channel,
    /// Its bytes, unframed.
    pub bytes: Vec<u8>,
    /// The pixels of a tile message between sessions of one process; its bytes then hold none.
    pub pixels: Option<TilePixels>,
}

impl Packet {
    /// A packet without shared pixels, which any transport can carry.
    pub const fn new(channel: Channel, bytes: Vec<u8>) -> Self {
        Self {
            channel,
            bytes,
            pixels: None,
        }
    }

    /// Bytes that the packet occupies in memory.
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
    /// To a node: copies of [`Channel::Control`] packets with trace requests, which may arrive before the
    /// packet itself or after it, repeatedly or never. Whichever arrives first begins the request. Over
    /// QUIC: a datagram.
    Copy,
}

/// State of either session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SessionState {
    /// The peer's first message has not arrived.
    New,
    /// The peer's first message has arrived.
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

/// The reason for a request whose number does not ascend.
fn not_above(request: RequestId) -> Reason {
    format!("request {} is not above the one before", request.0).into()
}

const TRANSFER_NOT_OPEN: &str = "no scene's chunks are being sent";
