//! Directories: who is there. Sources of nodes that are asked again while a farm runs.
//!
//! ```text
//! Directory (a thread each) ──Vec<ListedNode>──▶ Roster ──▶ nodes to call, nodes that have left
//! ```
//!
//! A directory says where nodes are, never who they are: whatever it lists has to show a certificate
//! of the farm. When it fails the farm keeps the nodes that it has, and a node that is no longer
//! listed is kept until its connection ends: answers of directories may be partial, or lost.

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

/// A source of nodes, asked again and again on a thread of its own.
pub trait Directory: Send {
    /// The nodes that are there now; may wait for some seconds.
    ///
    /// # Errors
    /// Why there is no answer; the farm goes on with the nodes of the last one.
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error>;

    /// The pause after an answer, or an error, before it is asked again.
    fn period(&self) -> Duration;
}

/// A directory in which a node registers itself.
pub trait Registry: Send {
    /// Writes a record, in place of the one before; may wait for some seconds.
    ///
    /// # Errors
    /// Why it could not; the node goes on and tries again.
    fn register(&mut self, record: &NodeRecord) -> Result<(), Error>;

    /// Takes the record back.
    ///
    /// # Errors
    /// Why it could not; it is forgotten by and by.
    fn leave(&mut self, record: &NodeRecord) -> Result<(), Error>;

    /// The pause until a record has to be written again.
    fn period(&self) -> Duration;
}

/// A node as a directory lists it.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedNode {
    /// Where it can be called.
    pub address: NodeAddress,
    /// What it has said of itself, if the directory keeps that.
    pub record: Option<NodeRecord>,
}

/// What a node registers about itself. It is a hint to people, and no proof of anything.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct NodeRecord {
    /// `host:port`.
    pub address: String,
    /// That of its farm's authority.
    pub fingerprint: String,
    /// Its device.
    pub device: String,
    /// Speed while it traced last, in millions of pixel samples per second; 0 before.
    pub msamples_per_sec: f64,
    /// Share of the last period that its device was busy, 0 to 1.
    pub load: f64,
    /// Whether it is about to end, and is not to be called any more.
    pub draining: bool,
}

impl ListedNode {
    /// A node of which nothing but the address is known.
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

/// A list that never changes.
impl Directory for Vec<NodeAddress> {
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error> {
        Ok(self.iter().cloned().map(ListedNode::at).collect())
    }

    fn period(&self) -> Duration {
        Duration::MAX
    }
}
