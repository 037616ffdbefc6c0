//! The events that the tasks of a connection report to its driver.

use carom_protocol::session::{Packet, SceneProgress};
use quinn::ConnectionError;

use crate::Error;

/// An arrival on a stream or as a datagram.
pub(crate) enum Arrival {
    /// A whole packet.
    Packet(Packet),
    /// A scene or a part of one, handled.
    Scene(Result<SceneProgress, carom_protocol::Error>),
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
