//! Connections of a player to nodes: from names to addresses, and from addresses to authenticated
//! connections.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use quinn::{ClientConfig, Connection, Endpoint};

use crate::Error;
use crate::lock::lock;
use crate::net::address::NodeAddress;
use crate::net::connection_driver::ConnectionStreams;
use crate::net::credentials::Credentials;
use crate::net::peer::Role;
use crate::net::player_account::PlayerAccount;
use crate::net::{close_code, connection_error, endpoint};

/// Sockets of a player, one for each address family in use.
pub(crate) struct Connector {
    config: ClientConfig,
    sockets: Mutex<Sockets>,
    claims: NodeClaims,
}

/// Registry of the nodes that a player's links hold, with the addresses that led to them: two names or
/// addresses of one node must not count as two nodes.
#[derive(Clone, Default)]
pub(crate) struct NodeClaims(Arc<Mutex<HashMap<NodeIdentity, NodeAddress>>>);

/// Property that only one node can have.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum NodeIdentity {
    Address(SocketAddr),
    /// [`NodeInfo::instance`](carom_protocol::NodeInfo::instance).
    Instance(u64),
}

/// Hold of a link on a node, released when dropped.
pub(crate) struct NodeClaim {
    claims: NodeClaims,
    identity: NodeIdentity,
    address: SocketAddr,
    node: NodeAddress,
}

impl NodeClaims {
    /// # Errors
    /// [`Error::SameNode`] if another link holds the address.
    fn claim(&self, address: SocketAddr, node: &NodeAddress) -> Result<NodeClaim, Error> {
        self.claim_as(NodeIdentity::Address(address), address, node)
    }

    fn claim_as(
        &self,
        identity: NodeIdentity,
        address: SocketAddr,
        node: &NodeAddress,
    ) -> Result<NodeClaim, Error> {
        let mut claims = lock(&self.0);
        if let Some(holder) = claims.get(&identity) {
            let node = holder.to_string();
            return Err(Error::SameNode { address, node });
        }
        claims.insert(identity, node.clone());
        Ok(NodeClaim {
            claims: self.clone(),
            identity,
            address,
            node: node.clone(),
        })
    }
}

impl NodeClaim {
    /// Claims the same node by the number that it has reported, unless that is 0.
    ///
    /// # Errors
    /// [`Error::SameNode`] if another link holds it, under another address.
    pub(crate) fn claim_instance(&self, instance: u64) -> Result<Option<Self>, Error> {
        let identity = NodeIdentity::Instance(instance);
        let claim = || self.claims.claim_as(identity, self.address, &self.node);
        (instance != 0).then(claim).transpose()
    }
}

impl Drop for NodeClaim {
    fn drop(&mut self) {
        let mut claims = lock(&self.claims.0);
        claims.remove(&self.identity);
    }
}

#[derive(Default)]
struct Sockets {
    v4: Option<Endpoint>,
    v6: Option<Endpoint>,
}

impl Connector {
    /// # Errors
    /// [`Error::KeyPair`] if the credentials cannot be used.
    pub(crate) fn new(credentials: &Credentials, claims: NodeClaims) -> Result<Self, Error> {
        Ok(Self {
            config: endpoint::client_config(credentials)?,
            sockets: Mutex::default(),
            claims,
        })
    }

    /// Connects to the first of the node's addresses that answers.
    pub(crate) async fn connect(
        &self,
        node: &NodeAddress,
    ) -> Result<(ConnectionStreams, NodeClaim), Error> {
        let mut errors = Vec::new();
        for address in node.resolve().await?.into_iter().take(ADDRESSES_MAX) {
            // Claimed before connecting, so that two links to one address cannot both connect.
            let claim = self.claims.claim(address, node)?;
            match self.connect_address(address).await {
                Ok(streams) => return Ok((streams, claim)),
                Err(error) => errors.push(error),
            }
        }
        // Both address families of a host often fail alike.
        errors.dedup_by_key(|error| error.to_string());
        Err(Error::NoAddressConnects(errors))
    }

    async fn connect_address(&self, address: SocketAddr) -> Result<ConnectionStreams, Error> {
        let endpoint = self.socket(address).map_err(Error::socket(address))?;
        let config = self.config.clone();
        let connection = endpoint::connect(&endpoint, config, address, Role::Player).await?;
        open(connection)
            .await
            .map_err(|error| connection_error::connection(&error, Role::Player))
    }

    fn socket(&self, peer: SocketAddr) -> Result<Endpoint, std::io::Error> {
        let mut sockets = lock(&self.sockets);
        let socket = match peer {
            SocketAddr::V4(_) => &mut sockets.v4,
            SocketAddr::V6(_) => &mut sockets.v6,
        };
        if let Some(endpoint) = socket {
            return Ok(endpoint.clone());
        }
        let endpoint = endpoint::open_client(peer)?;
        Ok(socket.insert(endpoint).clone())
    }

    /// Closes all connections and waits until the nodes have acknowledged it.
    pub(crate) async fn close(&self) {
        let endpoints = {
            let sockets = lock(&self.sockets);
            [sockets.v4.clone(), sockets.v6.clone()]
        };
        for endpoint in endpoints.into_iter().flatten() {
            endpoint.close(close_code::DONE, b"");
            endpoint.wait_idle().await;
        }
    }
}

/// Addresses of a host that are tried. A host with more of them is a list of hosts, each of which may take
/// a whole handshake timeout to fail.
const ADDRESSES_MAX: usize = 4;

async fn open(connection: Connection) -> Result<ConnectionStreams, quinn::ConnectionError> {
    let (send, receive) = connection.open_bi().await?;
    Ok(ConnectionStreams {
        connection,
        send,
        receive,
        role: Role::Player,
        account: Arc::new(PlayerAccount::new(Instant::now())),
    })
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;
    use std::sync::Arc;
    use std::time::{Duration, Instant, SystemTime};

    use quinn::ServerConfig;
    use quinn::crypto::rustls::QuicServerConfig;
    use rustls::pki_types::pem::PemObject;
    use rustls::pki_types::{CertificateDer, PrivateKeyDer};

    use super::*;
    use crate::net::authority::{Authority, IssuedCertificate};
    use crate::net::endpoint::TransportOptions;
    use crate::net::handshakes::Handshakes;
    use crate::net::tls;
    use carom_testkit::link_emulator::LinkConfig;
    use carom_testkit::udp_proxy::UdpProxy;

    const DAY: Duration = Duration::from_secs(24 * 3600);

    /// A node that presents this certificate and accepts any player.
    fn impostor(shown: &IssuedCertificate, alpn: &[u8]) -> Endpoint {
        let certificate = CertificateDer::from_pem_slice(shown.certificate_pem.as_bytes());
        let key = PrivateKeyDer::from_pem_slice(shown.key_pem.as_bytes()).unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let mut tls = rustls::ServerConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&rustls::version::TLS13])
            .unwrap()
            .with_no_client_auth()
            .with_single_cert(vec![certificate.unwrap()], key)
            .unwrap();
        tls.alpn_protocols = vec![alpn.to_vec()];
        let crypto = Arc::new(QuicServerConfig::try_from(tls).unwrap());
        let any_port = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        Endpoint::server(ServerConfig::with_crypto(crypto), any_port).unwrap()
    }

    /// The error with which a player of `farm` refuses an impostor; panics if it accepts it.
    fn refusal_of(farm: &Authority, shown: &IssuedCertificate, alpn: &[u8]) -> String {
        let today = SystemTime::now() - DAY..SystemTime::now() + DAY;
        let player = farm.credentials(Role::Player, "player", today).unwrap();
        let connector = Connector::new(&player, NodeClaims::default()).unwrap();
        runtime().block_on(async {
            let impostor = impostor(shown, alpn);
            let address = impostor.local_addr().unwrap().to_string().parse().unwrap();
            let (connected, answered) = tokio::join!(connector.connect(&address), async {
                impostor.accept().await.unwrap().await
            });
            assert!(answered.is_err(), "the player finished the handshake");
            let error = connected.err().expect("the player accepts an impostor");
            error.to_string()
        })
    }

    #[test]
    fn players_accept_nodes_of_their_farm_only() {
        let (farm, other) = (
            Authority::generate().unwrap(),
            Authority::generate().unwrap(),
        );
        let now = SystemTime::now();
        let (today, past) = (now - DAY..now + DAY, now - 3 * DAY..now - DAY);
        let alien = other.issue(Role::Node, "oak", today.clone()).unwrap();
        let player = farm.issue(Role::Player, "oak", today.clone()).unwrap();
        let expired = farm.issue(Role::Node, "oak", past).unwrap();
        let early = farm.issue(Role::Node, "oak", now + DAY..now + 3 * DAY);
        let early = early.unwrap();
        let key = rcgen::KeyPair::generate().unwrap();
        let own = rcgen::CertificateParams::default()
            .self_signed(&key)
            .unwrap();
        let own = IssuedCertificate {
            certificate_pem: own.pem(),
            key_pem: key.serialize_pem(),
        };
        for (shown, sentence) in [
            (&alien, "its certificate belongs to another farm"),
            (&own, "its certificate belongs to another farm"),
            (&player, "its certificate does not have the role of a node"),
            (&expired, "its certificate has expired"),
            (&early, "its certificate has expired or is not valid yet"),
        ] {
            let why = refusal_of(&farm, shown, tls::ALPN);
            assert!(why.starts_with(sentence), "{why}");
        }
        let node = farm.issue(Role::Node, "oak", today).unwrap();
        let why = refusal_of(&farm, &node, b"carom/2");
        assert!(why.contains("speak different protocols"), "{why}");
    }

    /// The path MTU, once it exceeds `least`, between a player and a node over loopback or a path.
    fn packet_bytes(path: Option<LinkConfig>, least: u16) -> u16 {
        let farm = Authority::generate().unwrap();
        let today = SystemTime::now() - DAY..SystemTime::now() + DAY;
        let issue = |role, name| farm.credentials(role, name, today.clone()).unwrap();
        let (node, player) = (issue(Role::Node, "node"), issue(Role::Player, "player"));
        let any_port = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        runtime().block_on(async {
            let config = endpoint::server_config(&node, TransportOptions::default()).unwrap();
            let node = endpoint::open_server(any_port, config, &Handshakes::default()).unwrap();
            let address = node.local_addr().unwrap();
            let proxy = path.map(|path| UdpProxy::start(any_port, address, path, 1).unwrap());
            let address = proxy.as_ref().map_or(address, UdpProxy::local_addr);
            let connector = Connector::new(&player, NodeClaims::default()).unwrap();
            let address = address.to_string().parse().unwrap();
            let answer = async { node.accept().await.unwrap().await.unwrap() };
            let (connected, answered) = tokio::join!(connector.connect(&address), answer);
            let _streams = connected.unwrap_or_else(|error| panic!("{error}"));
            let deadline = Instant::now() + TIMEOUT;
            while answered.stats().path.current_mtu <= least && Instant::now() < deadline {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
            answered.stats().path.current_mtu
        })
    }

    #[test]
    fn packets_grow_to_the_path_mtu() {
        // The search ends within 20 bytes of the MTU.
        assert!((6500..=6544).contains(&packet_bytes(None, 6500)));
        let ethernet = LinkConfig::default();
        let bytes = packet_bytes(Some(ethernet), 1452);
        assert!((1453..=1472).contains(&bytes), "{bytes}");
    }

    fn runtime() -> tokio::runtime::Runtime {
        crate::net::runtime::waiting_thread().unwrap()
    }

    /// Far longer than the MTU discovery takes.
    const TIMEOUT: Duration = Duration::from_secs(60);

    #[test]
    fn an_address_is_held_by_one_link_at_a_time() {
        let claims = NodeClaims::default();
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, 4433));
        let name = |text: &str| text.parse::<NodeAddress>().unwrap();
        let held = claims.claim(address, &name("oak:4433")).unwrap();
        let refused = claims.claim(address, &name("127.0.0.1:4433"));
        let why = refused.err().unwrap().to_string();
        assert!(why.contains("the same node as oak:4433"), "{why}");
        drop(held);
        claims.claim(address, &name("127.0.0.1:4433")).unwrap();
    }

    #[test]
    fn a_node_at_two_addresses_is_held_by_one_link() {
        let claims = NodeClaims::default();
        let claim = |last: u8| {
            let address = SocketAddr::from(([127, 0, 0, last], 4433));
            claims.claim(address, &address.to_string().parse().unwrap())
        };
        let (first, second) = (claim(1).unwrap(), claim(2).unwrap());
        let held = first.claim_instance(7).unwrap();
        let why = second.claim_instance(7).err().unwrap().to_string();
        assert!(
            why.contains("127.0.0.2:4433 is the same node as 127.0.0.1:4433"),
            "{why}"
        );
        assert!(second.claim_instance(8).unwrap().is_some());
        drop(held);
        assert!(second.claim_instance(7).unwrap().is_some());
        // Nodes that report no instance number are distinguished by their addresses alone.
        assert!(first.claim_instance(0).unwrap().is_none());
    }

    #[test]
    fn unresolvable_names_are_reported() {
        let farm = Authority::generate().unwrap();
        let now = SystemTime::now();
        let player = farm.credentials(Role::Player, "player", now - DAY..now + DAY);
        let connector = Connector::new(&player.unwrap(), NodeClaims::default()).unwrap();
        // RFC 6761: names under `invalid` are guaranteed not to exist.
        let nobody = "nobody.invalid:4433".parse().unwrap();
        let error = runtime()
            .block_on(connector.connect(&nobody))
            .err()
            .unwrap();
        let error = error.to_string();
        assert!(error.contains("the name `nobody.invalid`"), "{error}");
    }
}
