//! The events that the tasks of a connection report to its driver.

use carom_protocol::session::{Packet, ReceivedScene};
use quinn::ConnectionError;

use crate::Error;

/// An arrival on a stream or as a datagram.
pub(crate) enum Arrival {
    /// A whole packet.
    Packet(Packet),
    /// A scene, decoded.
    Scene(Result<ReceivedScene, carom_protocol::Error>),
    /// A part of a scene, the next control packet.
    SceneProgress {
        received_bytes: usize,
        total_bytes: usize,
    },
}

/// The end of a connection.
pub(crate) enum ConnectionEnd {
    /// It is lost.
    Lost(ConnectionError),
    /// The other side broke a rule and is told which.
    Violation(Error),
    /// This side's owner closes it.
    Closed(Error),
}
