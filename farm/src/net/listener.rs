//! Lets players in: address, certificate, place, in that order and each before the next costs
//! anything.

use std::future::Future;
use std::net::SocketAddr;
use std::sync::Arc;

use quinn::{Connection, Endpoint, Incoming};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::Error;
use crate::net::connection_driver::Streams;
use crate::net::credentials::{Credentials, Role};
use crate::net::endpoint::Sending;
use crate::net::{connection_error, endpoint};

/// Players that a node serves at once: one that plays, one that has crashed and not been given
/// up yet, and a render or two beside. They share the device; more would make it slow for all.
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
    /// [`Error::Credentials`] if the credentials are no node's, [`Error::Socket`] if the address
    /// is in use or not this machine's.
    pub(crate) fn bind(
        address: SocketAddr,
        credentials: &Credentials,
        sending: Sending,
    ) -> Result<Self, Error> {
        let config = endpoint::server_config(credentials, sending)?;
        let endpoint = endpoint::open_server(address, config).map_err(|source| Error::Socket {
            address: address.to_string(),
            source,
        })?;
        Ok(Self { endpoint })
    }

    /// Where it listens, with the port that the system chose if 0 was asked for.
    pub(crate) fn local_addr(&self) -> std::io::Result<SocketAddr> {
        self.endpoint.local_addr()
    }

    /// Gives each player to `serve`, on a task of its own, until the listener is closed.
    pub(crate) async fn run<S, F>(&self, serve: S)
    where
        S: Fn(Streams) -> F + Clone + Send + 'static,
        F: Future<Output = ()> + Send + 'static,
    {
        let handshakes = Arc::new(Semaphore::new(endpoint::HANDSHAKES_MAX));
        let players = Arc::new(Semaphore::new(PLAYERS_MAX));
        while let Some(incoming) = self.endpoint.accept().await {
            let Some((incoming, place)) = screen(incoming, &handshakes) else {
                continue;
            };
            let (players, serve) = (Arc::clone(&players), serve.clone());
            tokio::spawn(async move {
                let from = incoming.remote_address();
                match authenticate(incoming, place, &players).await {
                    Ok((streams, _player)) => serve(streams).await,
                    Err(why) => tracing::info!("{from}: {why}"),
                }
            });
        }
    }

    /// Tells all players that the node is shutting down, and waits until they know.
    pub(crate) async fn drain(&self) {
        self.endpoint
            .close(endpoint::code::DRAINING, b"shutting down");
        let _ = tokio::time::timeout(endpoint::HANDSHAKE, self.endpoint.wait_idle()).await;
    }
}

/// What a stranger may cost before its address and certificate are known: nothing when
/// [`endpoint::HANDSHAKES_MAX`] others are at it, one stateless packet when many are.
fn screen(
    incoming: Incoming,
    handshakes: &Arc<Semaphore>,
) -> Option<(Incoming, OwnedSemaphorePermit)> {
    let Ok(place) = Arc::clone(handshakes).try_acquire_owned() else {
        incoming.ignore();
        return None;
    };
    let pending = endpoint::HANDSHAKES_MAX - handshakes.available_permits();
    if pending > endpoint::HANDSHAKES_UNVALIDATED_MAX && incoming.may_retry() {
        let _ = incoming.retry();
        return None;
    }
    Some((incoming, place))
}

/// Completes the handshake, which checks the certificate, and waits for the control stream.
async fn authenticate(
    incoming: Incoming,
    place: OwnedSemaphorePermit,
    players: &Arc<Semaphore>,
) -> Result<(Streams, OwnedSemaphorePermit), String> {
    let gone = |why| connection_error::connection(&why, Role::Node);
    let connection: Connection = tokio::time::timeout(endpoint::HANDSHAKE, incoming)
        .await
        .map_err(|_| "the handshake took too long")?
        .map_err(gone)?;
    let Ok(player) = Arc::clone(players).try_acquire_owned() else {
        connection.close(endpoint::code::FULL, b"");
        return Err(format!(
            "refused: {PLAYERS_MAX} players are connected already"
        ));
    };
    let (send, receive) = tokio::time::timeout(endpoint::HANDSHAKE, connection.accept_bi())
        .await
        .map_err(|_| "the player opened no control stream")?
        .map_err(gone)?;
    drop(place);
    let role = Role::Node;
    let streams = Streams {
        connection,
        send,
        receive,
        role,
    };
    Ok((streams, player))
}
