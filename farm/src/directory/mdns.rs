//! Directory of nodes on the local network, which announce themselves by multicast DNS (RFC 6762, RFC 6763).

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

use carom_protocol::limits::NODE_RECORDS_MAX;
use mdns_sd::{Receiver, ServiceDaemon, ServiceEvent, ServiceInfo};

use super::{Directory, ListedNode, NodeRecord, Registry};
use crate::Error;

/// Directory of the nodes that announce themselves.
pub struct MdnsDirectory {
    daemon: ServiceDaemon,
    events: Receiver<ServiceEvent>,
    found: BTreeMap<String, ListedNode>,
}

/// Registry by which a node announces itself.
pub struct MdnsRegistry {
    daemon: ServiceDaemon,
    name: Option<String>,
}

fn fault(why: impl std::fmt::Display) -> Error {
    Error::directory("mdns:", why)
}

impl MdnsDirectory {
    /// Begins to query all networks of this machine.
    ///
    /// # Errors
    /// [`Error::Directory`] if the system provides no socket for it.
    pub fn new() -> Result<Self, Error> {
        Self::of(ServiceDaemon::new().map_err(fault)?)
    }

    fn of(daemon: ServiceDaemon) -> Result<Self, Error> {
        let events = daemon.browse(SERVICE).map_err(fault)?;
        Ok(Self {
            daemon,
            events,
            found: BTreeMap::new(),
        })
    }
}

impl Directory for MdnsDirectory {
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error> {
        for event in self.events.try_iter() {
            match event {
                ServiceEvent::ServiceResolved(node) if self.found.len() < NODE_RECORDS_MAX => {
                    // IPv4 addresses sort first: a link-local IPv6 address is useless without its interface.
                    let mut addresses: Vec<_> = node
                        .addresses
                        .iter()
                        .map(mdns_sd::ScopedIp::to_ip_addr)
                        .collect();
                    addresses.sort();
                    if let Some(address) = addresses.first() {
                        let address = SocketAddr::new(*address, node.port).into();
                        self.found.insert(node.fullname, ListedNode::at(address));
                    }
                }
                ServiceEvent::ServiceRemoved(_, name) => {
                    self.found.remove(&name);
                }
                _ => {}
            }
        }
        Ok(self.found.values().cloned().collect())
    }

    fn period(&self) -> Duration {
        PERIOD
    }
}

impl Drop for MdnsDirectory {
    fn drop(&mut self) {
        let _ = self.daemon.shutdown(); // its thread may have ended already
    }
}

impl MdnsRegistry {
    /// A registry without an announcement yet.
    ///
    /// # Errors
    /// [`Error::Directory`] if the system provides no socket for it.
    pub fn new() -> Result<Self, Error> {
        Ok(Self::of(ServiceDaemon::new().map_err(fault)?))
    }

    const fn of(daemon: ServiceDaemon) -> Self {
        Self { daemon, name: None }
    }
}

impl Registry for MdnsRegistry {
    fn register(&mut self, record: &NodeRecord) -> Result<(), Error> {
        if record.draining {
            return self.leave(record);
        }
        if self.name.is_some() {
            return Ok(()); // the announcement is repeated by its own thread
        }
        let (host, port) = record.address.rsplit_once(':').unwrap_or_default();
        let port: u16 = port.parse().map_err(fault)?;
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        // Derived from the address, the instance name is unique in the network.
        let name: String = record.address.chars().map(plain).collect();
        let host_name = format!("{name}.local.");
        let host = host.trim_matches(['[', ']']);
        let properties: &[(&str, &str)] = &[];
        let service = ServiceInfo::new(SERVICE, &name, &host_name, host, port, properties);
        let service = service.map_err(fault)?;
        self.name = Some(service.get_fullname().to_owned());
        self.daemon.register(service).map_err(fault)
    }

    fn leave(&mut self, _record: &NodeRecord) -> Result<(), Error> {
        let Some(name) = self.name.take() else {
            return Ok(());
        };
        let left = self.daemon.unregister(&name).map_err(fault)?;
        let _ = left.recv_timeout(GOODBYE); // the answer tells that the goodbye has been sent
        Ok(())
    }

    fn period(&self) -> Duration {
        PERIOD
    }
}

const SERVICE: &str = "_carom._udp.local.";
/// Period of evaluating received events.
const PERIOD: Duration = Duration::from_secs(1);
/// Maximum time of sending a goodbye.
const GOODBYE: Duration = Duration::from_millis(500);

#[cfg(test)]
mod tests {
    use mdns_sd::IfKind;

    use super::*;

    /// A daemon on the loopback interface alone, and on a port of its own.
    fn daemon() -> ServiceDaemon {
        let daemon = ServiceDaemon::new_with_port(45_353).unwrap();
        daemon.disable_interface(IfKind::All).unwrap();
        daemon.enable_interface(IfKind::LoopbackV4).unwrap();
        daemon.set_multicast_loop_v4(true).unwrap();
        daemon
    }

    #[test]
    fn a_node_is_found_and_says_goodbye() {
        let mut registry = MdnsRegistry::of(daemon());
        let mut directory = MdnsDirectory::of(daemon()).unwrap();
        let record = NodeRecord {
            address: "127.0.0.1:4433".into(),
            ..NodeRecord::default()
        };
        registry.register(&record).unwrap();
        let mut wait = |count: usize| {
            for _ in 0..500 {
                let nodes = directory.nodes().unwrap();
                if nodes.len() == count {
                    return nodes;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            panic!("there are not {count} nodes");
        };
        assert_eq!(wait(1)[0].address.to_string(), record.address);
        registry.leave(&record).unwrap();
        wait(0);
    }
}
