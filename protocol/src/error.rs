//! What can be wrong with a peer's bytes, or with what this program asks to send.

/// The peer's fault, and a session that met one is closed; but for [`Error::Unsendable`], which is
/// the caller's and changes nothing.
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
    /// The caller asked for a message that no right peer would take. Nothing was sent, and the
    /// session goes on.
    #[error("a {what} cannot be sent: {why}")]
    Unsendable {
        /// Kind of message.
        what: &'static str,
        /// Which rule it breaks.
        why: String,
    },
}

impl Error {
    pub(crate) fn malformed(what: &'static str, why: impl Into<String>) -> Self {
        let why = why.into();
        Self::Malformed { what, why }
    }

    pub(crate) fn out_of_order(what: &'static str, why: impl Into<String>) -> Self {
        let why = why.into();
        Self::OutOfOrder { what, why }
    }

    pub(crate) fn unsendable(what: &'static str, why: impl Into<String>) -> Self {
        let why = why.into();
        Self::Unsendable { what, why }
    }
}
