//! Network side of a node: its socket, which serves many players at once until it is stopped.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::Runtime;
use tokio::sync::watch;
use tokio::time::timeout;

use crate::Error;
use crate::net::connection_driver::{self, ConnectionStreams};
use crate::net::credentials::Credentials;
use crate::net::deny_list::DenyList;
use crate::net::endpoint::TransportOptions;
use crate::net::enrolment;
use crate::net::listener::Listener;
use crate::net::peer::{DisconnectReason, Role};
use crate::net::signals::Signals;
use crate::net::{close_code, migration, runtime};
use crate::node::{ConnectionDrain, PacketHandler, PlayerId};

/// Change of a node's connections.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ServerEvent {
    /// The node has a new certificate.
    Renewed {
        /// Its last day, as `2026-12-24`.
        last_day: String,
    },
    /// A player with a valid certificate has opened a session.
    Paired {
        /// Its address.
        player: SocketAddr,
    },
    /// A player's packets come from another address: its NAT has changed its port, or it has changed
    /// networks.
    Moved {
        /// The address from which it connected.
        player: SocketAddr,
        /// Its address from now on.
        to: SocketAddr,
    },
    /// A player has closed its connection.
    Left {
        /// The address from which it connected.
        player: SocketAddr,
    },
    /// A player's connection has failed.
    Lost {
        /// The address from which it connected.
        player: SocketAddr,
        /// The reason, in words for a person.
        why: String,
    },
    /// The node is shutting down.
    Draining,
}

/// Network side of a node with its open socket.
pub struct NodeServer {
    runtime: Runtime,
    listener: Listener,
    options: TransportOptions,
    denied: Arc<DenyList>,
    renewal: Option<Renewal>,
    /// Caught from the start, so that a node that has announced its socket always shuts down in order.
    signals: Signals,
}

/// Credentials that are renewed in their folder.
struct Renewal {
    credentials: Credentials,
    folder: PathBuf,
}

/// Handle that stops each [`NodeServer`] that serves with it, from any thread.
#[derive(Clone, Debug, Default)]
pub struct StopHandle(Arc<watch::Sender<bool>>);

impl StopHandle {
    /// Ends [`NodeServer::serve`], now or as soon as it starts.
    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

impl NodeServer {
    /// Opens the socket.
    ///
    /// # Errors
    /// [`Error::KeyPair`] if the credentials are unusable, [`Error::Socket`] if the address is in use or does
    /// not belong to this machine.
    pub fn bind(address: SocketAddr, credentials: &Credentials) -> Result<Self, Error> {
        Self::bind_with_options(address, credentials, TransportOptions::default())
    }

    /// Opens the socket with other options of the transport, for comparison.
    ///
    /// # Errors
    /// As [`NodeServer::bind`].
    pub fn bind_with_options(
        address: SocketAddr,
        credentials: &Credentials,
        options: TransportOptions,
    ) -> Result<Self, Error> {
        let failed = Error::socket(address);
        let runtime = runtime::own_thread("carom-net").map_err(failed)?;
        let (listener, signals) = {
            let _inside = runtime.enter();
            let signals = Signals::listen().map_err(failed)?;
            (Listener::bind(address, credentials, options)?, signals)
        };
        Ok(Self {
            runtime,
            listener,
            options,
            denied: Arc::clone(&credentials.denied),
            renewal: None,
            signals,
        })
    }

    /// Presents new certificates from `folder` while the node serves, and renews them if the folder was
    /// made by a join.
    pub fn keep_renewed(&mut self, credentials: Credentials, folder: PathBuf) {
        self.renewal = Some(Renewal {
            credentials,
            folder,
        });
    }

    /// The bound address, with the port chosen by the system if 0 was requested.
    ///
    /// # Errors
    /// [`Error::Socket`] if the system cannot tell.
    pub fn local_addr(&self) -> Result<SocketAddr, Error> {
        let address = self.listener.local_addr();
        address.map_err(Error::socket("the node's socket"))
    }

    /// Serves players until `stop`, Ctrl-C or SIGTERM, then drains for at most ten seconds: each player is
    /// told to send no more requests, and leaves once it has the answers to those that it has sent. `connect`
    /// creates the session for a player's connection from an address.
    pub fn serve<P: PacketHandler + Send>(
        self,
        stop: &StopHandle,
        connect: impl Fn(PlayerId, SocketAddr) -> P + Clone + Send + Sync + 'static,
        events: impl Fn(ServerEvent) + Clone + Send + Sync + 'static,
    ) {
        let Self {
            runtime,
            listener,
            options,
            denied,
            renewal,
            mut signals,
        } = self;
        if let Some(renewal) = renewal {
            runtime.spawn(renewal.run(listener.clone(), options, events.clone()));
        }
        let draining = events.clone();
        let mut stopped = stop.0.subscribe();
        let stopping = watch::Sender::new(false);
        let stops = stopping.clone();
        let serve = move |id, streams: ConnectionStreams| {
            let (connect, events) = (connect.clone(), events.clone());
            let denied = Arc::clone(&denied);
            let stops = stops.subscribe();
            async move {
                let player = streams.connection.remote_address();
                events(ServerEvent::Paired { player });
                let (connection, mut session) = (streams.connection.clone(), connect(id, player));
                let (account, drain) = (Arc::clone(&streams.account), session.drain());
                let moved = |to| events(ServerEvent::Moved { player, to });
                let error = tokio::select! {
                    error = connection_driver::drive(streams, &mut session) => error,
                    error = denied.close_if_denied(&connection) => error,
                    error = migration::watch(&connection, &account, moved) => error,
                    () = drained(stops, drain, &connection) => Error::ControlStreamEnded,
                };
                events(ended(player, &error));
            }
        };
        runtime.block_on(async {
            tokio::select! {
                () = listener.run(serve) => {}
                _ = stopped.wait_for(|is_stopped| *is_stopped) => {}
                () = signals.recv() => {}
            }
            draining(ServerEvent::Draining);
            stopping.send_replace(true);
            // The receivers are held by the players' tasks, so the channel closes when the last session ends.
            if timeout(DRAIN_TIMEOUT, stopping.closed()).await.is_err() {
                tracing::warn!("what players had asked for took too long and was given up");
            }
            listener.drain().await;
        });
    }
}

/// Waits until the node is to stop, then until the session's player has left or is owed nothing for
/// [`FAREWELL_PATIENCE`], and closes the connection.
async fn drained(
    mut stops: watch::Receiver<bool>,
    drain: Option<ConnectionDrain>,
    connection: &quinn::Connection,
) {
    if stops.wait_for(|stop| *stop).await.is_err() {
        return; // nobody can be told any more: the server has gone
    }
    if let Some(drain) = drain {
        drain.begin();
        let mut idle = Duration::ZERO;
        while !drain.has_left() && idle < FAREWELL_PATIENCE {
            tokio::time::sleep(DRAIN_POLL).await;
            idle = if drain.is_idle() {
                idle + DRAIN_POLL
            } else {
                Duration::ZERO
            };
        }
    }
    connection.close(close_code::DRAINING, b"shutting down");
}

/// Maximum time of draining. A frame of a game takes milliseconds and a slice of a film some seconds;
/// Kubernetes kills a process after 30 s, EC2 two minutes after its notice.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(10);
/// Interval at which a draining session is polled: a quarter of a frame at 60 a second.
const DRAIN_POLL: Duration = Duration::from_millis(4);
/// Time for which a player without open requests may leave the farewell unanswered: longer than a round trip
/// with retransmissions of lost packets.
const FAREWELL_PATIENCE: Duration = Duration::from_millis(500);

/// Interval of requests for the deny list, and for a certificate when one is due.
const RENEWAL_PERIOD: Duration = Duration::from_secs(3600);

impl Renewal {
    /// Renews now and then every hour; a new certificate is presented to players from their next connection
    /// on.
    async fn run(
        mut self,
        listener: Listener,
        options: TransportOptions,
        events: impl Fn(ServerEvent),
    ) {
        loop {
            match self.renew(&listener, options).await {
                Ok(Some(last_day)) => events(ServerEvent::Renewed { last_day }),
                Ok(None) => {}
                Err(why) if self.credentials.is_due() => {
                    tracing::warn!("the certificate could not be renewed: {why}");
                }
                Err(why) => tracing::debug!("no news from the farm's authority: {why}"),
            }
            tokio::time::sleep(RENEWAL_PERIOD).await;
        }
    }

    async fn renew(
        &mut self,
        listener: &Listener,
        options: TransportOptions,
    ) -> Result<Option<String>, Error> {
        let asked = enrolment::renew(&self.credentials, &self.folder).await;
        // Renewed by the authority, or copied here by a person.
        let in_folder = Credentials::load(&self.folder, Role::Node)?;
        if in_folder.certificate == self.credentials.certificate {
            return asked.map(|()| None);
        }
        listener.set_credentials(&in_folder, options)?;
        self.credentials = in_folder;
        self.credentials.last_day().map(Some)
    }
}

/// The event of an ended connection. A player that leaves ends its control stream and closes the connection,
/// and either may arrive first.
fn ended(player: SocketAddr, error: &Error) -> ServerEvent {
    match error {
        Error::ControlStreamEnded => ServerEvent::Left { player },
        Error::Disconnected {
            reason: DisconnectReason::Closed(why),
            ..
        } if why.is_empty() => ServerEvent::Left { player },
        error => ServerEvent::Lost {
            player,
            why: error.to_string(),
        },
    }
}
