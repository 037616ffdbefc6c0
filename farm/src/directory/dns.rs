//! Directory of a domain name with an address per node, such as that of a headless Service of Kubernetes.

use std::net::ToSocketAddrs as _;
use std::time::Duration;

use super::{Directory, ListedNode};
use crate::Error;
use crate::net::NodeAddress;

/// Directory of a domain name, each of whose addresses is a node.
#[derive(Clone, Debug)]
pub struct DnsDirectory {
    name: NodeAddress,
}

impl DnsDirectory {
    /// The nodes at all addresses of the name, at its port.
    pub const fn new(name: NodeAddress) -> Self {
        Self { name }
    }
}

impl Directory for DnsDirectory {
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error> {
        let found = self.name.to_string().to_socket_addrs();
        let found =
            found.map_err(|why| Error::directory(format_args!("dns:{}", self.name), why))?;
        Ok(found.map(|at| ListedNode::at(at.into())).collect())
    }

    fn period(&self) -> Duration {
        PERIOD
    }
}

/// Period of queries, since Kubernetes' own name server gives answers a lifetime of five seconds.
const PERIOD: Duration = Duration::from_secs(5);

#[cfg(test)]
mod tests {
    use super::*;

    fn list(name: &str) -> Result<Vec<ListedNode>, Error> {
        DnsDirectory::new(name.parse().unwrap()).nodes()
    }

    #[test]
    fn each_address_is_a_node_at_the_names_port() {
        let addresses = list("localhost:4433").unwrap();
        assert!(!addresses.is_empty());
        for node in addresses {
            let address = node.address.to_string();
            assert!(["127.0.0.1:4433", "[::1]:4433"].contains(&address.as_str()));
        }
    }

    #[test]
    fn a_name_of_nobody_is_an_error_and_not_an_empty_list() {
        // RFC 6761: names under `invalid` are guaranteed not to exist.
        let why = list("nobody.invalid:4433").unwrap_err().to_string();
        assert!(why.starts_with("dns:nobody.invalid:4433: "), "{why}");
    }
}
