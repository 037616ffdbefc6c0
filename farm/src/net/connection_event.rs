//! Events that the tasks of a connection report to its driver.

use carom_protocol::session::{Packet, SceneProgress};
use quinn::ConnectionError;

use crate::Error;

/// Arrival on a stream or as a datagram.
pub(crate) enum Arrival {
    /// A complete packet.
    Packet(Packet),
    /// A scene or a part of one, already handled by the assembler.
    Scene(Result<SceneProgress, carom_protocol::Error>),
}

/// End of a connection.
pub(crate) enum ConnectionEnd {
    /// The connection was lost.
    Lost(ConnectionError),
    /// The peer violated a rule and is told which.
    Violation(Error),
    /// The owner of this side closed it.
    Closed(Error),
}
