//! Admission of players to a node: by address, certificate and number, in this order, each checked
//! before the next costs anything.

use std::future::Future;
use std::net::SocketAddr;
use std::sync::Arc;

use quinn::{Connection, Endpoint, Incoming};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::Error;
use crate::net::connection_driver::ConnectionStreams;
use crate::net::credentials::Credentials;
use crate::net::endpoint::{self, TransportOptions};
use crate::net::peer::Role;
use crate::net::{close_code, connection_error};

/// Players that a node serves at once: one that plays, one that has crashed and whose connection
/// has not timed out, and a render or two. They share the device; more would make it slow for all.
pub(crate) const PLAYERS_MAX: usize = 4;

/// A node's socket.
#[derive(Clone)]
pub(crate) struct Listener {
    endpoint: Endpoint,
}

impl Listener {
    /// Opens the socket. Needs a tokio runtime.
    ///
    /// # Errors
    /// [`Error::KeyPair`] if the credentials cannot be used, [`Error::Socket`] if the address
    /// is in use or does not belong to this machine.
    pub(crate) fn bind(
        address: SocketAddr,
        credentials: &Credentials,
        options: TransportOptions,
    ) -> Result<Self, Error> {
        let config = endpoint::server_config(credentials, options)?;
        let endpoint = endpoint::open_server(address, config).map_err(|source| Error::Socket {
            address: address.to_string(),
            source,
        })?;
        Ok(Self { endpoint })
    }

    /// Shows another certificate from the next connection on.
    ///
    /// # Errors
    /// [`Error::KeyPair`] if the credentials cannot be used.
    pub(crate) fn set_credentials(
        &self,
        credentials: &Credentials,
        options: TransportOptions,
    ) -> Result<(), Error> {
        let config = endpoint::server_config(credentials, options)?;
        self.endpoint.set_server_config(Some(config));
        Ok(())
    }

    /// The bound address, with the port that the system chose if 0 was asked for.
    pub(crate) fn local_addr(&self) -> Result<SocketAddr, std::io::Error> {
        self.endpoint.local_addr()
    }

    /// Gives each player to `serve`, on a task of its own, until the listener is closed.
    pub(crate) async fn run<S, F>(&self, serve: S)
    where
        S: Fn(ConnectionStreams) -> F + Clone + Send + 'static,
        F: Future<Output = ()> + Send + 'static,
    {
        let handshakes = Arc::new(Semaphore::new(endpoint::HANDSHAKES_MAX));
        let players = Arc::new(Semaphore::new(PLAYERS_MAX));
        while let Some(incoming) = self.endpoint.accept().await {
            let Some((incoming, permit)) = screen(incoming, &handshakes) else {
                continue;
            };
            let (players, serve) = (Arc::clone(&players), serve.clone());
            tokio::spawn(async move {
                let from = incoming.remote_address();
                match authenticate(incoming, permit, &players).await {
                    Ok((streams, _player)) => serve(streams).await,
                    Err(error) => tracing::info!("{from}: {error}"),
                }
            });
        }
    }

    /// Tells all players that the node is shutting down, and waits until they know.
    pub(crate) async fn drain(&self) {
        self.endpoint.close(close_code::DRAINING, b"shutting down");
        let _ = tokio::time::timeout(endpoint::HANDSHAKE_TIMEOUT, self.endpoint.wait_idle()).await;
    }
}

/// Bounds the cost of a stranger whose address and certificate are not known yet: nothing when
/// [`endpoint::HANDSHAKES_MAX`] handshakes are under way, one stateless packet when many are.
pub(crate) fn screen(
    incoming: Incoming,
    handshakes: &Arc<Semaphore>,
) -> Option<(Incoming, OwnedSemaphorePermit)> {
    let Ok(permit) = Arc::clone(handshakes).try_acquire_owned() else {
        // No answer at all: a refusal would let strangers reflect packets at others.
        incoming.ignore();
        return None;
    };
    let pending = endpoint::HANDSHAKES_MAX - handshakes.available_permits();
    if pending > endpoint::HANDSHAKES_UNVALIDATED_MAX && incoming.may_retry() {
        let _ = incoming.retry();
        return None;
    }
    Some((incoming, permit))
}

/// Completes the handshake, which checks the certificate, and waits for the control stream.
async fn authenticate(
    incoming: Incoming,
    handshake: OwnedSemaphorePermit,
    players: &Arc<Semaphore>,
) -> Result<(ConnectionStreams, OwnedSemaphorePermit), Error> {
    let role = Role::Node;
    let lost = |error| connection_error::connection(&error, role);
    let connection: Connection = tokio::time::timeout(endpoint::HANDSHAKE_TIMEOUT, incoming)
        .await
        .map_err(|_| Error::HandshakeTimeout)?
        .map_err(lost)?;
    let Ok(player) = Arc::clone(players).try_acquire_owned() else {
        connection.close(close_code::FULL, b"");
        return Err(Error::NodeFull {
            players_max: PLAYERS_MAX,
        });
    };
    let control = tokio::time::timeout(endpoint::HANDSHAKE_TIMEOUT, connection.accept_bi());
    let (send, receive) = control
        .await
        .map_err(|_| Error::NoControlStream)?
        .map_err(lost)?;
    // Only now, so that a player that opens no stream counts as a handshake.
    drop(handshake);
    let streams = ConnectionStreams {
        connection,
        send,
        receive,
        role,
    };
    Ok((streams, player))
}
