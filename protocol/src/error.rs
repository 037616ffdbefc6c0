//! Errors of the protocol, by who is at fault, and the rules that a message can break.

use std::borrow::Cow;

/// Error of the protocol. The peer is at fault, and the session that returned the error is closed, except
/// for [`Error::Unsendable`]: there the caller is at fault, and nothing has changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The peer speaks another version of the protocol.
    #[error("the peer speaks protocol version {theirs}, this program {ours}: update the older one")]
    Version {
        /// The peer's version.
        theirs: u16,
        /// This program's version.
        ours: u16,
    },
    /// A packet or field is longer than any valid one.
    #[error("the peer sent a {what} of {bytes} bytes: at most {max} are allowed")]
    TooLarge {
        /// Kind of message or field.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The limit, from [`crate::limits`].
        max: u64,
    },
    /// The bytes are no message, or the message breaks a rule.
    #[error("the peer sent a malformed {what}: {reason}")]
    Malformed {
        /// Kind of message or field.
        what: &'static str,
        /// The rule that it breaks.
        reason: Reason,
    },
    /// A valid message came at the wrong time.
    #[error("the peer sent {what} out of order: {reason}")]
    OutOfOrder {
        /// Kind of message.
        what: &'static str,
        /// The rule of order that it breaks.
        reason: Reason,
    },
    /// The caller asked for a message that no valid peer would accept. Nothing was sent, and the
    /// session goes on.
    #[error("a {what} cannot be sent: {reason}")]
    Unsendable {
        /// Kind of message.
        what: &'static str,
        /// The rule that it breaks.
        reason: Reason,
    },
}

/// The rule that a message breaks: a sentence with the values that break it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Reason(Cow<'static, str>);

impl Reason {
    /// The reason for a request whose scene the node was never given or has evicted for others.
    pub const SCENE_NOT_HELD: Self = Self(Cow::Borrowed("the node does not hold its scene"));

    pub(crate) fn too_long(bytes: usize, max: usize) -> Self {
        format!("it has {bytes} bytes: at most {max} are allowed").into()
    }

    /// The reason that the tracer states.
    pub(crate) fn tracer(error: impl ToString) -> Self {
        error.to_string().into()
    }
}

impl From<&'static str> for Reason {
    fn from(rule: &'static str) -> Self {
        Self(Cow::Borrowed(rule))
    }
}

impl From<String> for Reason {
    fn from(rule: String) -> Self {
        Self(Cow::Owned(rule))
    }
}

impl Error {
    pub(crate) fn malformed(what: &'static str, reason: impl Into<Reason>) -> Self {
        let reason = reason.into();
        Self::Malformed { what, reason }
    }

    pub(crate) fn out_of_order(what: &'static str, reason: impl Into<Reason>) -> Self {
        let reason = reason.into();
        Self::OutOfOrder { what, reason }
    }

    pub(crate) fn unsendable(what: &'static str, reason: impl Into<Reason>) -> Self {
        let reason = reason.into();
        Self::Unsendable { what, reason }
    }
}

/// The reason for bytes that are empty where at least one is required.
pub(crate) const EMPTY: &str = "it has no bytes";
/// The reason for a second message of a kind that may come once.
pub(crate) const REPEATED: &str = "there has been one";
/// The reason for a scene, in one message or in chunks, whose bytes do not match its hash.
pub(crate) const SCENE_HASH: &str = "it does not hash to its hash";
/// The reason for a packet after the end of a session.
pub(crate) const SESSION_CLOSED: &str = "the session is closed";
