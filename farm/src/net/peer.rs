//! The two sides of a connection in terms of errors: roles, certificate faults and reasons for a disconnect.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Maximum time from the first packet until both certificates are verified, and again until the greeting: 65
/// round trips of 46 ms. A slower peer occupies a place that another could have.
pub(crate) const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(3);
const DAY: Duration = Duration::from_secs(24 * 3600);
/// Validity of an authority, longer than any farm lasts: whoever can replace its certificate can replace the
/// rest.
pub(crate) const AUTHORITY_LIFE: Duration = Duration::from_secs(10 * 365 * 24 * 3600);
/// Validity of a node's certificate: short, since its key is on a rented machine that others will rent next.
const NODE_LIFE: Duration = DAY.saturating_mul(30);
/// Validity of a player's certificate: bounded, since a player may have left the farm.
const PLAYER_LIFE: Duration = DAY.saturating_mul(90);

/// Right that a certificate grants its holder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Requests pictures from nodes.
    Player,
    /// Traces for players.
    Node,
}

impl Role {
    /// The URI in the certificate's subject alternative names that grants the role.
    pub const fn uri(self) -> &'static str {
        match self {
            Self::Player => "carom://role/player",
            Self::Node => "carom://role/node",
        }
    }

    /// The validity of its certificates.
    pub const fn life(self) -> Duration {
        match self {
            Self::Player => PLAYER_LIFE,
            Self::Node => NODE_LIFE,
        }
    }

    /// The role of the other side.
    pub(crate) const fn peer(self) -> Self {
        match self {
            Self::Player => Self::Node,
            Self::Node => Self::Player,
        }
    }

    pub(crate) const fn certificate_file(self) -> &'static str {
        match self {
            Self::Player => "player.pem",
            Self::Node => "node.pem",
        }
    }

    pub(crate) const fn key_file(self) -> &'static str {
        match self {
            Self::Player => "player.key",
            Self::Node => "node.key",
        }
    }

    /// The command that creates credentials of the role.
    pub(crate) const fn creation_advice(self) -> &'static str {
        match self {
            Self::Player => {
                "create the farm's credentials with `carom-farm init`, or name their folder"
            }
            Self::Node => {
                "run `carom-farm token` on the machine that holds the farm's authority, and here the \
                 `carom-farm join` that it prints; or copy a folder of `carom-farm add-node NAME` \
                 here"
            }
        }
    }

    const fn renewal_advice(self) -> &'static str {
        match self {
            Self::Node => {
                "renew it with `carom-farm add-node NAME --renew` and copy it to the node, or run \
                 `carom-farm token` where the node joined"
            }
            Self::Player => {
                "renew it with `carom-farm add-player NAME --renew` where the farm's authority is"
            }
        }
    }
}

/// Writes `player` or `node`.
impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Player => "player",
            Self::Node => "node",
        })
    }
}

/// Reason why a certificate is not accepted; displays as a predicate: "has expired: …".
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CertificateFault {
    /// None was presented.
    #[error("is missing")]
    Missing,
    /// It has expired; its holder has this role.
    #[error("has expired: {}", _0.renewal_advice())]
    Expired(Role),
    /// The other side found it outside its validity, before or after; its holder has this role.
    #[error(
        "has expired or is not valid yet: compare the clocks of both machines, or {}",
        _0.renewal_advice()
    )]
    OutsideItsDays(Role),
    /// Its validity has not begun.
    #[error("is not valid yet: check this machine's clock, and that of the farm's authority")]
    NotYetValid,
    /// Its key is on the farm's deny list.
    #[error("has been revoked: ask whoever holds the farm's authority for another")]
    Revoked,
    /// It does not grant this role.
    #[error("does not have the role of a {0}")]
    WrongRole(Role),
    /// Another farm's authority issued it.
    #[error("belongs to another farm")]
    OtherFarm,
    /// The `ca.pem` in the same folder did not issue it.
    #[error("was not issued by the ca.pem beside it")]
    OtherAuthority,
    /// TLS raised another objection.
    #[error("cannot be used: {0}")]
    Unusable(String),
}

/// Reason why the other side ended a connection; displays as a predicate: "is shutting down".
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DisconnectReason {
    /// It closed the connection, with an explanation or an empty one.
    #[error("has closed the connection{}{_0}", if _0.is_empty() { "" } else { ": " })]
    Closed(String),
    /// It has no place for another player, or for another connection of this one; its sentence says which.
    #[error("has no place: {0}")]
    Full(String),
    /// It is shutting down.
    #[error("is shutting down")]
    Draining,
    /// It accepts no connection.
    #[error("accepts no connections at the moment")]
    Refusing,
    /// Its QUIC layer aborted the connection.
    #[error("broke the connection: {0}")]
    Broken(String),
    /// It has been silent for too long.
    #[error("no longer answers")]
    TimedOut,
    /// It has lost its state.
    #[error("has restarted")]
    Restarted,
    /// It supports no common version of QUIC.
    #[error("supports another version of QUIC")]
    QuicVersion,
}

/// Reason why a player gets no place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoPlace {
    /// All places are taken.
    #[error(
        "{players} of at most {players} players are served and {ahead} wait before this one: call \
         again, it is let in when one leaves"
    )]
    Full {
        /// Number of players that are served.
        players: usize,
        /// Number of players before it in the line.
        ahead: usize,
    },
    /// Its place has gone to another player.
    #[error("it asked for nothing while another player waited, who has its place now: call again")]
    Yielded,
    /// The line is full.
    #[error("{waiting} of at most {waiting} players wait in line: call again later")]
    LineFull {
        /// Number of players in the line.
        waiting: usize,
    },
    /// The player's address has changed too often.
    #[error("its address has changed too often: call again in {secs} s")]
    Moves {
        /// Seconds until it may connect again.
        secs: u64,
    },
    /// The player has as many connections as it may have.
    #[error("this player has {max} of at most {max} connections: close another of its programs")]
    Connections {
        /// Maximum connections of a player.
        max: usize,
    },
}
