//! Network layer of a build without the feature `net`: every attempt to use it fails.

mod address;
#[allow(dead_code, reason = "words of errors that only a network has")]
pub(crate) mod peer;

use std::path::Path;

use carom_protocol::PrecisionRange;

use crate::Error;
use crate::link::{LinkCommand, LinkEvent};

pub use address::NodeAddress;
pub use peer::{CertificateFault, DisconnectReason, NoPlace, Role};

/// Credentials; never constructed in this build.
pub(crate) struct Credentials;

/// Network side of a player; never constructed in this build.
pub(crate) struct Client;

/// Link to a node; never constructed in this build.
pub(crate) struct NodeLink;

impl Credentials {
    pub(crate) fn load(_: &Path, _: Role) -> Result<Self, Error> {
        Err(Error::NoNetwork)
    }
}

impl Client {
    pub(crate) fn new(_: &Credentials) -> Result<Self, Error> {
        Err(Error::NoNetwork)
    }

    pub(crate) fn link(
        &self,
        _: NodeAddress,
        _: PrecisionRange,
        _: impl FnMut(Vec<LinkEvent>) + Send + 'static,
    ) -> NodeLink {
        NodeLink
    }
}

impl NodeLink {
    pub(crate) fn send(&self, _: LinkCommand) -> bool {
        false
    }
}
