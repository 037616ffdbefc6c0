//! Directories: sources of a farm's nodes, which are queried again and again while a farm runs.
//!
//! ```text
//! Directory (a thread each) ──Vec<ListedNode>──▶ Roster ──▶ nodes to call, nodes that have left
//! ```
//!
//! A directory states where nodes are, never who they are: each listed node has to present a certificate of
//! the farm. If a directory fails, the farm keeps the nodes that it has; a node that is no longer listed is
//! kept until its connection ends, since answers of directories may be incomplete or get lost.

mod dns;
mod file;
#[cfg(feature = "mdns")]
mod mdns;
#[cfg(feature = "nats")]
mod nats;
mod roster;
mod source;
pub(crate) mod watch;

use std::time::Duration;

pub use dns::DnsDirectory;
pub use file::FileDirectory;
#[cfg(feature = "mdns")]
pub use mdns::{MdnsDirectory, MdnsRegistry};
#[cfg(feature = "nats")]
pub use nats::{NatsBucket, NatsDirectory, NatsRegistry};
#[doc(hidden)]
pub use roster::Roster;
use serde::{Deserialize, Serialize};
pub use source::NodeSource;

use crate::Error;
use crate::net::NodeAddress;

/// A source of nodes, queried periodically on a thread of its own.
pub trait Directory: Send {
    /// The nodes at present; may block for some seconds.
    ///
    /// # Errors
    /// The reason why there is no answer; the farm goes on with the nodes of the last one.
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error>;

    /// The pause between an answer, or an error, and the next query.
    fn period(&self) -> Duration;
}

/// A directory in which a node registers itself.
pub trait Registry: Send {
    /// Writes a record, replacing the one before; may block for some seconds.
    ///
    /// # Errors
    /// The reason why it could not be written; the node goes on and tries again.
    fn register(&mut self, record: &NodeRecord) -> Result<(), Error>;

    /// Removes the record.
    ///
    /// # Errors
    /// The reason why it could not be removed; it expires eventually.
    fn leave(&mut self, record: &NodeRecord) -> Result<(), Error>;

    /// The period in which a record has to be written again.
    fn period(&self) -> Duration;
}

/// A node as a directory lists it.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedNode {
    /// The address at which it accepts connections.
    pub address: NodeAddress,
    /// What it has registered about itself, if the directory stores that.
    pub record: Option<NodeRecord>,
}

/// What a node registers about itself. It informs people, and proves nothing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct NodeRecord {
    /// The node's address as `host:port`.
    pub address: String,
    /// The fingerprint of its farm's authority.
    pub fingerprint: String,
    /// The name of its device.
    pub device: String,
    /// Speed when it last traced, in millions of pixel samples per second; 0 before.
    pub msamples_per_sec: f64,
    /// Share of the last period in which its device was busy, 0 to 1.
    pub load: f64,
    /// Whether it is about to end and should get no more connections.
    pub draining: bool,
}

impl ListedNode {
    /// A node of which only the address is known.
    pub const fn at(address: NodeAddress) -> Self {
        Self {
            address,
            record: None,
        }
    }

    fn is_draining(&self) -> bool {
        self.record.as_ref().is_some_and(|record| record.draining)
    }
}

/// A constant list.
impl Directory for Vec<NodeAddress> {
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error> {
        Ok(self.iter().cloned().map(ListedNode::at).collect())
    }

    fn period(&self) -> Duration {
        Duration::MAX
    }
}
