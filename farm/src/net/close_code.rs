//! Application error codes of QUIC connections and streams.

use quinn::VarInt;

/// Regular end.
pub(crate) const DONE: VarInt = VarInt::from_u32(0);
/// The node has as many players as it accepts.
pub(crate) const FULL: VarInt = VarInt::from_u32(1);
/// The node is shutting down.
pub(crate) const DRAINING: VarInt = VarInt::from_u32(2);
/// The peer violated the protocol; the close reason states how.
pub(crate) const PROTOCOL: VarInt = VarInt::from_u32(3);
/// The peer's certificate has been revoked.
pub(crate) const REVOKED: VarInt = VarInt::from_u32(5);
/// The tiles of a stream are no longer wanted.
pub(crate) const STALE: VarInt = VarInt::from_u32(4);
