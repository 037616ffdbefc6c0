//! What can be wrong with bytes from a peer.

/// Always the peer's fault; a session that met one is closed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The peer speaks another version of the protocol.
    #[error("the peer speaks protocol version {theirs}, this program {ours}: update the older one")]
    Version {
        /// What the peer speaks.
        theirs: u16,
        /// What this program speaks.
        ours: u16,
    },
    /// More bytes than any right message has.
    #[error("the peer sent a {what} of {bytes} bytes: at most {max} are allowed")]
    TooLarge {
        /// Kind of message or field.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The limit, from [`crate::limits`].
        max: u64,
    },
    /// Bytes that are no message.
    #[error("the peer sent a malformed {what}: {why}")]
    Malformed {
        /// Kind of message or field.
        what: &'static str,
        /// What was expected.
        why: String,
    },
    /// A right message at the wrong time.
    #[error("the peer sent {what} out of order: {why}")]
    OutOfOrder {
        /// Kind of message.
        what: &'static str,
        /// What should have come before.
        why: String,
    },
}
