//! Texts that denote nodes on command lines and in configurations.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::{Directory, DnsDirectory, FileDirectory, Registry};
#[cfg(feature = "mdns")]
use super::{MdnsDirectory, MdnsRegistry};
#[cfg(feature = "nats")]
use super::{NatsBucket, NatsDirectory, NatsRegistry};
use crate::Error;
use crate::net::NodeAddress;

/// A node or a directory of nodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeSource {
    /// `host:port`: one node, at the first of the host's addresses that answers.
    Node(NodeAddress),
    /// `dns:host:port`: a node at each of the host's addresses.
    Dns(NodeAddress),
    /// `file:path`: a node as `host:port` in each line of a file.
    File(PathBuf),
    /// `mdns:`: the nodes that announce themselves on a local network.
    #[cfg(feature = "mdns")]
    Mdns,
    /// `nats://host:port/bucket`: the nodes that have registered in a bucket.
    #[cfg(feature = "nats")]
    Nats(NatsBucket),
}

impl NodeSource {
    /// Opens the directory; for a single node, a constant list of one.
    ///
    /// # Errors
    /// Those of starting the directory; none for a list, a file or a name.
    pub fn open(&self) -> Result<Box<dyn Directory>, Error> {
        Ok(match self {
            Self::Node(address) => Box::new(vec![address.clone()]),
            Self::Dns(name) => Box::new(DnsDirectory::new(name.clone())),
            Self::File(path) => Box::new(FileDirectory::new(path.clone())),
            #[cfg(feature = "mdns")]
            Self::Mdns => Box::new(MdnsDirectory::new()?),
            #[cfg(feature = "nats")]
            Self::Nats(bucket) => Box::new(NatsDirectory::new(bucket.clone())?),
        })
    }

    /// Opens the directory as a registry; `None` if nodes cannot register in it.
    ///
    /// # Errors
    /// Those of starting the registry.
    pub fn registry(&self) -> Result<Option<Box<dyn Registry>>, Error> {
        Ok(match self {
            Self::Node(_) | Self::Dns(_) | Self::File(_) => None,
            #[cfg(feature = "mdns")]
            Self::Mdns => Some(Box::new(MdnsRegistry::new()?)),
            #[cfg(feature = "nats")]
            Self::Nats(bucket) => Some(Box::new(NatsRegistry::new(bucket.clone())?)),
        })
    }

    /// The text of a source with its path, if it has a relative one, resolved against `folder`.
    pub(crate) fn in_folder(text: &str, folder: &Path) -> String {
        match text.strip_prefix(FILE) {
            Some(path) => format!("{FILE}{}", folder.join(path).display()),
            None => text.to_owned(),
        }
    }
}

const DNS: &str = "dns:";
const FILE: &str = "file:";
const MDNS: &str = "mdns:";

impl FromStr for NodeSource {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        // `dns:4433` is a host called `dns`.
        if let Some(name) = text.strip_prefix(DNS).filter(|rest| rest.contains(':')) {
            return Ok(Self::Dns(name.parse()?));
        }
        match text.strip_prefix(FILE) {
            Some("") => Err(Error::NodeAddress {
                text: text.to_owned(),
                fault: "`file:` must be followed by a path",
            }),
            Some(path) => Ok(Self::File(path.into())),
            None if text == MDNS => mdns(),
            None if text.starts_with("nats://") || text.starts_with("tls://") => nats(text),
            None => Ok(Self::Node(text.parse()?)),
        }
    }
}

#[cfg(feature = "mdns")]
fn mdns() -> Result<NodeSource, Error> {
    Ok(NodeSource::Mdns)
}

#[cfg(not(feature = "mdns"))]
fn mdns() -> Result<NodeSource, Error> {
    Err(Error::NodeAddress {
        text: MDNS.into(),
        fault: "this program was built without the feature `mdns`",
    })
}

#[cfg(feature = "nats")]
fn nats(text: &str) -> Result<NodeSource, Error> {
    text.parse().map(NodeSource::Nats)
}

#[cfg(not(feature = "nats"))]
fn nats(_text: &str) -> Result<NodeSource, Error> {
    Err(Error::NodeAddress {
        text: "nats://…".into(), // it may hold a password
        fault: "this program was built without the feature `nats`",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prefixes_tell_nodes_from_directories() {
        let source = |text: &str| text.parse::<NodeSource>().unwrap();
        let address = || "oak:4433".parse().unwrap();
        assert_eq!(source("oak:4433"), NodeSource::Node(address()));
        assert_eq!(source("dns:oak:4433"), NodeSource::Dns(address()));
        assert!(matches!(source("dns:4433"), NodeSource::Node(_)));
        assert_eq!(source("file:a b"), NodeSource::File("a b".into()));
        for text in ["dns:oak:0", "file:", "oak", ""] {
            let why = text.parse::<NodeSource>().unwrap_err().to_string();
            assert!(why.contains("is not a node address"), "{why}");
        }
    }
}
