//! A node's socket: serves up to four players at once until it is told to stop.

use std::net::SocketAddr;
use std::sync::Arc;

use tokio::runtime::Runtime;
use tokio::sync::Notify;

use crate::Error;
use crate::net::connection_driver::{self, Peer, Streams};
use crate::net::credentials::Credentials;
use crate::net::endpoint::Sending;
use crate::net::listener::Listener;
use crate::net::signals::Signals;

/// What becomes of a player's connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ServerEvent {
    /// A player with a right certificate has opened a session.
    Paired {
        /// From where.
        player: SocketAddr,
    },
    /// A player is gone.
    Lost {
        /// From where.
        player: SocketAddr,
        /// A sentence.
        why: String,
    },
    /// The node is shutting down.
    Draining,
}

/// A node's open socket.
pub struct NodeServer {
    runtime: Runtime,
    listener: Listener,
    /// Listened for from the start: a node that says that it listens ends well when told to.
    signals: Signals,
}

/// Stops a [`NodeServer`] from another thread.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<Notify>);

impl Stop {
    /// Ends [`NodeServer::serve`], now or as soon as it begins.
    pub fn stop(&self) {
        self.0.notify_one();
    }
}

/// Sealing takes 2 ms of a core for a megabyte, and tiles are encoded elsewhere. With two threads, which
/// wake each other for each message, an answer of 64 KiB over a loopback takes a fifth more processor
/// time and leaves in smaller pieces.
const THREADS: usize = 1;

impl NodeServer {
    /// Opens the socket.
    ///
    /// # Errors
    /// [`Error::Credentials`] if the credentials are no node's, [`Error::Socket`] if the address
    /// is in use or not this machine's.
    pub fn bind(address: SocketAddr, credentials: &Credentials) -> Result<Self, Error> {
        Self::bind_with(address, credentials, Sending::default())
    }

    /// The same with another way of sending, to compare.
    ///
    /// # Errors
    /// As [`NodeServer::bind`].
    pub fn bind_with(
        address: SocketAddr,
        credentials: &Credentials,
        sending: Sending,
    ) -> Result<Self, Error> {
        let failed = |source| Error::Socket {
            address: address.to_string(),
            source,
        };
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(THREADS)
            .thread_name("carom-net")
            .enable_all()
            .build()
            .map_err(failed)?;
        let (listener, signals) = {
            let _inside = runtime.enter();
            let signals = Signals::listen().map_err(failed)?;
            (Listener::bind(address, credentials, sending)?, signals)
        };
        Ok(Self {
            runtime,
            listener,
            signals,
        })
    }

    /// Where it listens, with the port that the system chose if 0 was asked for.
    ///
    /// # Errors
    /// [`Error::Socket`] if the system does not know.
    pub fn local_addr(&self) -> Result<SocketAddr, Error> {
        self.listener.local_addr().map_err(|source| Error::Socket {
            address: "the node's socket".into(),
            source,
        })
    }

    /// Serves players until `stop`, Ctrl-C or SIGTERM; then tells them that the node is shutting
    /// down, so that their coordinators ask others at once. `connect` makes a player's session.
    pub fn serve<P: Peer + Send>(
        self,
        stop: &Stop,
        connect: impl Fn(SocketAddr) -> P + Clone + Send + Sync + 'static,
        events: impl Fn(ServerEvent) + Clone + Send + Sync + 'static,
    ) {
        let Self {
            runtime,
            listener,
            mut signals,
        } = self;
        let draining = events.clone();
        let serve = move |streams: Streams| {
            let (connect, events) = (connect.clone(), events.clone());
            async move {
                let player = streams.connection.remote_address();
                events(ServerEvent::Paired { player });
                let why = connection_driver::carry(streams, &mut connect(player)).await;
                events(ServerEvent::Lost { player, why });
            }
        };
        runtime.block_on(async {
            tokio::select! {
                () = listener.run(serve) => {}
                () = stop.0.notified() => {}
                () = signals.recv() => {}
            }
            draining(ServerEvent::Draining);
            listener.drain().await;
        });
    }
}
