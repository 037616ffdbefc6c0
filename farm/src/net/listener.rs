//! Admission of players to a node: by address, certificate and place, in this order, each checked before the
//! next incurs any cost.

use std::future::Future;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use quinn::{Connection, Endpoint, Incoming};

use crate::Error;
use crate::net::connection_driver::ConnectionStreams;
use crate::net::credentials::Credentials;
use crate::net::endpoint::{self, TransportOptions};
use crate::net::handshakes::{Handshakes, PendingHandshake};
use crate::net::peer::{CertificateFault, NoPlace, Role};
use crate::net::places::{Place, Places};
use crate::net::{certificate_fields, close_code, connection_error};
use crate::node::PlayerId;

/// Listening socket of a node.
#[derive(Clone)]
pub(crate) struct Listener {
    endpoint: Endpoint,
    handshakes: Handshakes,
}

impl Listener {
    /// Opens the socket. Needs a tokio runtime.
    ///
    /// # Errors
    /// [`Error::KeyPair`] if the credentials are unusable, [`Error::Socket`] if the address is in use or does
    /// not belong to this machine.
    pub(crate) fn bind(
        address: SocketAddr,
        credentials: &Credentials,
        options: TransportOptions,
    ) -> Result<Self, Error> {
        let config = endpoint::server_config(credentials, options)?;
        let handshakes = Handshakes::default();
        let endpoint = endpoint::open_server(address, config, &handshakes);
        Ok(Self {
            endpoint: endpoint.map_err(Error::socket(address))?,
            handshakes,
        })
    }

    /// Presents another certificate from the next connection on.
    ///
    /// # Errors
    /// [`Error::KeyPair`] if the credentials are unusable.
    pub(crate) fn set_credentials(
        &self,
        credentials: &Credentials,
        options: TransportOptions,
    ) -> Result<(), Error> {
        let config = endpoint::server_config(credentials, options)?;
        self.endpoint.set_server_config(Some(config));
        Ok(())
    }

    /// The bound address, with the port chosen by the system if 0 was requested.
    pub(crate) fn local_addr(&self) -> Result<SocketAddr, std::io::Error> {
        self.endpoint.local_addr()
    }

    /// Passes each player to `serve`, on a task of its own, until the listener is closed.
    pub(crate) async fn run<S, F>(&self, serve: S)
    where
        S: Fn(PlayerId, ConnectionStreams) -> F + Clone + Send + 'static,
        F: Future<Output = ()> + Send + 'static,
    {
        let (handshakes, places) = (&self.handshakes, Places::default());
        while let Some(incoming) = self.endpoint.accept().await {
            let Some((incoming, pending)) = screen(incoming, handshakes) else {
                continue;
            };
            let (handshakes, places, serve) = (handshakes.clone(), places.clone(), serve.clone());
            tokio::spawn(async move {
                let from = incoming.remote_address();
                let authenticated = tokio::select! {
                    authenticated = authenticate(incoming, &pending, &places) => authenticated,
                    () = pending.evicted() => Err(Error::HandshakeEvicted),
                };
                drop(pending);
                match authenticated {
                    Ok((streams, place)) => {
                        let connection = streams.connection.clone();
                        let served = serve(place.player, streams);
                        tokio::pin!(served);
                        tokio::select! {
                            () = &mut served => {}
                            () = place.yielded() => {
                                let why = NoPlace::Yielded.to_string();
                                connection.close(close_code::FULL, why.as_bytes());
                                // The session still has to notice the end of its connection and to clean up.
                                served.await;
                            }
                        }
                        drop(place);
                    }
                    Err(error) => {
                        tracing::info!("{from}: {error}");
                        if let Some(counts) = handshakes.fail(Instant::now()) {
                            tracing::warn!("{counts}; the last from {from}: {error}");
                        }
                    }
                }
            });
        }
    }

    /// Tells all players that the node is shutting down, and waits until they have acknowledged it.
    pub(crate) async fn drain(&self) {
        self.endpoint.close(close_code::DRAINING, b"shutting down");
        let _ = tokio::time::timeout(endpoint::HANDSHAKE_TIMEOUT, self.endpoint.wait_idle()).await;
    }
}

/// Bounds the cost of a stranger whose address and certificate are not yet verified: one stateless Retry if
/// many handshakes are in progress, nothing if too many are.
pub(crate) fn screen(
    incoming: Incoming,
    handshakes: &Handshakes,
) -> Option<(Incoming, PendingHandshake)> {
    // A handshake may evict another only from a validated address.
    if handshakes.must_validate() && incoming.may_retry() {
        let _ = incoming.retry();
        return None;
    }
    let Some(pending) = handshakes.begin(incoming.remote_address().ip()) else {
        // No answer at all: with refusals, strangers could reflect packets to forged addresses.
        incoming.ignore();
        return None;
    };
    Some((incoming, pending))
}

/// Completes the handshake, which verifies the certificate.
pub(crate) async fn accept(incoming: Incoming) -> Result<Connection, Error> {
    let connected = tokio::time::timeout(endpoint::HANDSHAKE_TIMEOUT, incoming).await;
    connected
        .map_err(|_| Error::HandshakeTimeout)?
        .map_err(|error| connection_error::connection(&error, Role::Node))
}

/// Completes the handshake, assigns a place and waits for the control stream.
async fn authenticate(
    incoming: Incoming,
    pending: &PendingHandshake,
    places: &Places,
) -> Result<(ConnectionStreams, Place), Error> {
    let role = Role::Node;
    let connection = accept(incoming).await?;
    let player = certificate_fields::peer_certificate(&connection)
        .ok_or(CertificateFault::Missing)
        .and_then(|shown| certificate_fields::key_id(&shown))
        .map_err(Error::PeerCertificate)?;
    let place = places.enter(Instant::now(), PlayerId::of_key(player.as_bytes()));
    let place = place.map_err(|reason| {
        connection.close(close_code::FULL, reason.to_string().as_bytes());
        Error::NodeFull(reason)
    })?;
    let control = tokio::time::timeout(endpoint::HANDSHAKE_TIMEOUT, connection.accept_bi());
    let Ok(control) = control.await else {
        let why = Error::NoControlStream;
        connection.close(close_code::PROTOCOL, why.to_string().as_bytes());
        return Err(why);
    };
    let (send, receive) = control.map_err(|error| connection_error::connection(&error, role))?;
    // Only now, so that a player that opens no stream stays bounded as a handshake.
    pending.succeed();
    let streams = ConnectionStreams {
        connection,
        send,
        receive,
        role,
        account: Arc::clone(&place.account),
    };
    Ok((streams, place))
}
