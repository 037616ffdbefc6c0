//! Calls nodes: names to addresses, addresses to authenticated connections.

use std::net::SocketAddr;
use std::sync::Mutex;

use quinn::{ClientConfig, ConnectError, Connection, Endpoint};

use crate::Error;
use crate::net::address::NodeAddress;
use crate::net::credentials::{Credentials, Role};
use crate::net::packets::Streams;
use crate::net::{endpoint, refusal, tls};

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
            .map_err(|why| refusal::connection(&why, Role::Player))
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
        why => refusal::connection(why, Role::Player),
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
