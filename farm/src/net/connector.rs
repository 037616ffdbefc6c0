//! Calls nodes: names to addresses, addresses to authenticated connections.

use std::net::SocketAddr;
use std::sync::Mutex;

use quinn::{ClientConfig, ConnectError, Connection, Endpoint};

use crate::Error;
use crate::net::address::NodeAddress;
use crate::net::connection_driver::Streams;
use crate::net::credentials::{Credentials, Role};
use crate::net::{connection_error, endpoint, tls};

/// A player's sockets, one for each address family that is needed.
pub(crate) struct Caller {
    config: ClientConfig,
    sockets: Mutex<Sockets>,
}

#[derive(Default)]
struct Sockets {
    v4: Option<Endpoint>,
    v6: Option<Endpoint>,
}

impl Caller {
    /// # Errors
    /// [`Error::Credentials`] if the credentials are no player's.
    pub(crate) fn new(credentials: &Credentials) -> Result<Self, Error> {
        Ok(Self {
            config: endpoint::client_config(credentials)?,
            sockets: Mutex::default(),
        })
    }

    /// Connects to the first of the node's addresses that answers. The error is a sentence.
    pub(crate) async fn call(&self, node: &NodeAddress) -> Result<Streams, String> {
        let mut refusals = Vec::new();
        for address in node.resolve().await?.into_iter().take(ADDRESSES_MAX) {
            match self.call_address(address).await {
                Ok(streams) => return Ok(streams),
                Err(why) => refusals.push(why),
            }
        }
        refusals.dedup();
        Err(refusals.join("; "))
    }

    async fn call_address(&self, address: SocketAddr) -> Result<Streams, String> {
        let endpoint = self
            .socket(address)
            .map_err(|why| format!("{address}: {why}"))?;
        let config = self.config.clone();
        let connecting = endpoint
            .connect_with(config, address, tls::SERVER_NAME)
            .map_err(|why| unreachable(address, &why))?;
        let connection = match tokio::time::timeout(endpoint::HANDSHAKE, connecting).await {
            Ok(connected) => connected.map_err(|why| first_refusal(address, &why))?,
            Err(_) => return Err(silent(address)),
        };
        open(connection)
            .await
            .map_err(|why| connection_error::connection(&why, Role::Player))
    }

    fn socket(&self, peer: SocketAddr) -> std::io::Result<Endpoint> {
        let mut sockets = self.sockets.lock().unwrap_or_else(|held| held.into_inner());
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

    /// Tells all nodes that this player is gone, and waits until they know.
    pub(crate) async fn close(&self) {
        let endpoints = {
            let sockets = self.sockets.lock().unwrap_or_else(|held| held.into_inner());
            [sockets.v4.clone(), sockets.v6.clone()]
        };
        for endpoint in endpoints.into_iter().flatten() {
            endpoint.close(endpoint::code::DONE, b"");
            endpoint.wait_idle().await;
        }
    }
}

/// A host of more addresses than that is a list of hosts.
const ADDRESSES_MAX: usize = 4;

async fn open(connection: Connection) -> Result<Streams, quinn::ConnectionError> {
    let (send, receive) = connection.open_bi().await?;
    Ok(Streams {
        connection,
        send,
        receive,
        role: Role::Player,
    })
}

fn first_refusal(address: SocketAddr, why: &quinn::ConnectionError) -> String {
    match why {
        quinn::ConnectionError::TimedOut => silent(address),
        why => connection_error::connection(why, Role::Player),
    }
}

fn silent(address: SocketAddr) -> String {
    format!(
        "{address} does not answer: is the node running, and does a firewall let its UDP port \
         through?"
    )
}

fn unreachable(address: SocketAddr, why: &ConnectError) -> String {
    format!("{address} cannot be called: {why}")
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
    use crate::net::authority::{Authority, Issued};
    use crate::net::endpoint::Sending;
    use crate::net::path::PathConfig;
    use crate::net::proxy::Proxy;

    const DAY: Duration = Duration::from_secs(24 * 3600);

    /// A node that shows `certificate` and asks for none: all it wants is to be talked to.
    fn impostor(shown: &Issued, alpn: &[u8]) -> Endpoint {
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

    /// What a player of `farm` says of an impostor; panics if it talks to it.
    fn said_of(farm: &Authority, shown: &Issued, alpn: &[u8]) -> String {
        let today = SystemTime::now() - DAY..SystemTime::now() + DAY;
        let player = farm.credentials(Role::Player, "player", today).unwrap();
        let caller = Caller::new(&player).unwrap();
        runtime().block_on(async {
            let impostor = impostor(shown, alpn);
            let address = impostor.local_addr().unwrap().to_string().parse().unwrap();
            let (called, answered) = tokio::join!(caller.call(&address), async {
                impostor.accept().await.unwrap().await
            });
            assert!(answered.is_err(), "the player finished the handshake");
            called.err().expect("the player talks to an impostor")
        })
    }

    #[test]
    fn a_player_talks_to_nodes_of_its_farm_only() {
        let (farm, other) = (
            Authority::generate().unwrap(),
            Authority::generate().unwrap(),
        );
        let now = SystemTime::now();
        let (today, past) = (now - DAY..now + DAY, now - 3 * DAY..now - DAY);
        let alien = other.issue(Role::Node, "oak", today.clone()).unwrap();
        let player = farm.issue(Role::Player, "oak", today.clone()).unwrap();
        let expired = farm.issue(Role::Node, "oak", past).unwrap();
        let key = rcgen::KeyPair::generate().unwrap();
        let own = rcgen::CertificateParams::default()
            .self_signed(&key)
            .unwrap();
        let own = Issued {
            certificate_pem: own.pem(),
            key_pem: key.serialize_pem(),
        };
        for (shown, sentence) in [
            (&alien, "its certificate is of another farm"),
            (&own, "its certificate is of another farm"),
            (&player, "its certificate does not have the role of a node"),
            (&expired, "its certificate has expired"),
        ] {
            let why = said_of(&farm, shown, tls::ALPN);
            assert!(why.starts_with(sentence), "{why}");
        }
        let node = farm.issue(Role::Node, "oak", today).unwrap();
        let why = said_of(&farm, &node, b"carom/2");
        assert!(why.contains("speak different protocols"), "{why}");
    }

    /// Bytes of the longest packets, once they are over `least`, between a player and a node over
    /// loopback or a path.
    fn packet_bytes(path: Option<PathConfig>, least: u16) -> u16 {
        let farm = Authority::generate().unwrap();
        let today = SystemTime::now() - DAY..SystemTime::now() + DAY;
        let issue = |role, name| farm.credentials(role, name, today.clone()).unwrap();
        let (node, player) = (issue(Role::Node, "node"), issue(Role::Player, "player"));
        let any_port = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        runtime().block_on(async {
            let config = endpoint::server_config(&node, Sending::default()).unwrap();
            let node = endpoint::open_server(any_port, config).unwrap();
            let address = node.local_addr().unwrap();
            let proxy = path.map(|path| Proxy::start(any_port, address, path, 1).unwrap());
            let address = proxy.as_ref().map_or(address, Proxy::local_addr);
            let caller = Caller::new(&player).unwrap();
            let address = address.to_string().parse().unwrap();
            let answer = async { node.accept().await.unwrap().await.unwrap() };
            let (called, answered) = tokio::join!(caller.call(&address), answer);
            let _streams = called.map_err(|why| panic!("{why}")).ok();
            let deadline = Instant::now() + PATIENCE;
            while answered.stats().path.current_mtu <= least && Instant::now() < deadline {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
            answered.stats().path.current_mtu
        })
    }

    #[test]
    fn packets_are_as_long_as_the_path_takes() {
        // A search ends within 20 bytes.
        assert!((6500..=6544).contains(&packet_bytes(None, 6500)));
        let ethernet = PathConfig::default();
        let bytes = packet_bytes(Some(ethernet), 1452);
        assert!((1453..=1472).contains(&bytes), "{bytes}");
    }

    fn runtime() -> tokio::runtime::Runtime {
        tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .unwrap()
    }

    /// A node that does not answer is a failure of the test, not its end.
    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn a_name_that_nobody_has_is_named() {
        let farm = Authority::generate().unwrap();
        let now = SystemTime::now();
        let player = farm.credentials(Role::Player, "player", now - DAY..now + DAY);
        let caller = Caller::new(&player.unwrap()).unwrap();
        // RFC 6761: no name under `invalid` is ever given to anybody.
        let nobody = "nobody.invalid:4433".parse().unwrap();
        let why = runtime().block_on(caller.call(&nobody)).err().unwrap();
        assert!(why.contains("the name `nobody.invalid`"), "{why}");
    }
}
