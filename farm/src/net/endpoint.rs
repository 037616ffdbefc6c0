//! QUIC endpoints: sockets, and all parameters of the transport with their reasons.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::limits;
use quinn::crypto::rustls::QuicServerConfig;
use quinn::{
    AckFrequencyConfig, Connection, ConnectionError, Endpoint, EndpointConfig, IdleTimeout,
    MtuDiscoveryConfig, Runtime, TransportConfig, VarInt, congestion,
};

use crate::Error;
use crate::net::certificate::PeerVerifier;
use crate::net::credentials::Credentials;
use crate::net::flood_filter::FilteredSocket;
use crate::net::handshakes::Handshakes;
pub(crate) use crate::net::peer::HANDSHAKE_TIMEOUT;
use crate::net::peer::Role;
use crate::net::{connection_error, tls};
use crate::node::STALL_TIMEOUT;

/// max_idle_timeout (RFC 9000, 10.1). Five keep-alives in a row may be lost; long before, the coordinator has
/// requested the missing tiles from other nodes. A node lets a worker wait as long for a player that accepts
/// no tiles.
const IDLE_TIMEOUT: Duration = STALL_TIMEOUT;
const KEEP_ALIVE: Duration = Duration::from_secs(1);
/// max_ack_delay. With the default of 25 ms the last packet of a burst is acknowledged so late that
/// the delay looks like a queue (draft-ietf-quic-ack-frequency).
const ACK_DELAY_MAX: Duration = Duration::from_millis(2);
/// kTimeThreshold (RFC 9002, 6.1.2); kPacketThreshold is off. On a path that reorders, a threshold of three
/// packets declared lost whatever a single packet had overtaken: a loss of 70 % was measured. The standard
/// 9/8 and RACK's 5/4 (RFC 8985, 6.2) are too short: where one packet in fifty overtakes others by a quarter
/// of the round trip, that one is mostly the newest acknowledged, from which the round-trip time is taken.
const TIME_THRESHOLD: f32 = 1.5;
/// Flow control window of a connection: 16 MB carried 578 Mbit/s over a round trip of 46 ms, quinn's default
/// 53 Mbit/s.
const RECEIVE_WINDOW_BYTES: u32 = 16 << 20;
/// Bytes that a node may have sent and the player not acknowledged: 4 MB carry 700 Mbit/s over 46 ms, and
/// bound how much is late on a link that is too slow.
const SEND_WINDOW_BYTES: u64 = 4 << 20;
/// Upper bound of the path MTU discovery, for loopback and jumbo frames: an answer of 64 KiB over loopback
/// takes a tenth less time. quinn hands up to ten packets to the system at once, which accepts at most 65,507
/// bytes.
const MTU_MAX: u16 = 6544;
/// Size of socket buffers: with the system's 208 kB the receiving socket drops a burst of one frame's tiles.
const SOCKET_BYTES: usize = 4 << 20;
/// Flow control window of a tile stream, as long as the longest message, so that it never blocks.
const TILE_STREAM_WINDOW_BYTES: u32 = limits::TILES_BYTES_MAX as u32;
/// Tile messages in flight to a player: three frames of 115 messages (1280×720 in tiles of 32×32,
/// eight a message) and as many again, rounded up to a power of two.
const TILE_STREAMS_MAX: u32 = 1024;
/// Bytes of outgoing datagrams that wait for the congestion window. Others wait in the session, which can
/// drop them; control packets wait for at most 10 ms at 25 Mbit/s.
const TILE_DATAGRAMS_SENT_BYTES: usize = 32 << 10;
/// Bytes of received tile datagrams that wait to be read: 30 ms at 30 MB/s, the rate of a 4K frame. Beyond,
/// the oldest are dropped.
const TILE_DATAGRAMS_RECEIVED_BYTES: usize = 1 << 20;
/// Bytes of a player's datagrams that wait to be read: 32 requests of 2 kB.
const REQUEST_DATAGRAMS_RECEIVED_BYTES: usize = 64 << 10;
/// Flow control window of the control stream, which carries all scenes and requests of a player.
const CONTROL_WINDOW_BYTES: u32 = RECEIVE_WINDOW_BYTES;
/// Flow control window of an enrolment: a certificate signing request has a thousand bytes.
const REQUEST_WINDOW_BYTES: u32 = 16 << 10;
/// First flights that wait to be accepted, of one or two datagrams each, and bounds of their bytes.
const INCOMING_MAX: usize = 64;
const INCOMING_BYTES: u64 = 16 << 10;
const INCOMING_BYTES_TOTAL: u64 = 256 << 10;

/// Congestion controller of the connections that carry tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CongestionControl {
    /// [`DelayBasedController`](super::DelayBasedController).
    #[default]
    DelayBased,
    /// quinn's BBR, for comparison.
    Bbr,
    /// quinn's Cubic, for comparison.
    Cubic,
}

impl CongestionControl {
    fn factory(self) -> Arc<dyn congestion::ControllerFactory + Send + Sync> {
        match self {
            Self::DelayBased => Arc::new(super::congestion::ControllerConfig),
            Self::Bbr => Arc::new(congestion::BbrConfig::default()),
            Self::Cubic => Arc::new(congestion::CubicConfig::default()),
        }
    }
}

/// Options of the transport of a node's tiles. Farms use the default; the others serve for comparison
/// by `carom-bench transport`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransportOptions {
    /// The congestion controller.
    pub congestion: CongestionControl,
    /// Whether tiles travel as datagrams with forward error correction if the path is long and loses packets;
    /// otherwise all travel on streams.
    pub fec: bool,
}

impl Default for TransportOptions {
    fn default() -> Self {
        Self {
            congestion: CongestionControl::default(),
            fec: true,
        }
    }
}

/// Parameters that both sides share.
fn transport(congestion: CongestionControl) -> TransportConfig {
    let mut ack_frequency = AckFrequencyConfig::default();
    ack_frequency.max_ack_delay(Some(ACK_DELAY_MAX));
    let mut mtu_discovery = MtuDiscoveryConfig::default();
    mtu_discovery.upper_bound(MTU_MAX);
    let idle_timeout = VarInt::from_u32(IDLE_TIMEOUT.as_millis() as u32);
    let mut config = TransportConfig::default();
    config
        .mtu_discovery_config(Some(mtu_discovery))
        .max_idle_timeout(Some(IdleTimeout::from(idle_timeout)))
        .send_window(SEND_WINDOW_BYTES)
        // Tiles leave in the order in which they were finished: sharing the link between their streams would
        // make all of them late.
        .send_fairness(false)
        .packet_threshold(u32::MAX)
        .time_threshold(TIME_THRESHOLD)
        .ack_frequency_config(Some(ack_frequency))
        .congestion_controller_factory(congestion.factory());
    config
}

/// Parameters of a player's side, which opens the control stream and receives tiles.
fn client_transport() -> TransportConfig {
    let mut config = transport(CongestionControl::default());
    config
        .keep_alive_interval(Some(KEEP_ALIVE))
        .datagram_receive_buffer_size(Some(TILE_DATAGRAMS_RECEIVED_BYTES))
        .max_concurrent_bidi_streams(VarInt::from_u32(0))
        .max_concurrent_uni_streams(VarInt::from_u32(TILE_STREAMS_MAX))
        .stream_receive_window(VarInt::from_u32(TILE_STREAM_WINDOW_BYTES))
        .receive_window(VarInt::from_u32(RECEIVE_WINDOW_BYTES));
    config
}

/// Parameters of a node's side, which accepts one control stream and sends tiles.
fn server_transport(options: TransportOptions) -> TransportConfig {
    let mut config = transport(options.congestion);
    let received_bytes = options.fec.then_some(REQUEST_DATAGRAMS_RECEIVED_BYTES);
    config
        .datagram_receive_buffer_size(received_bytes)
        .datagram_send_buffer_size(received_bytes.map_or(0, |_| TILE_DATAGRAMS_SENT_BYTES))
        .max_concurrent_bidi_streams(VarInt::from_u32(1))
        .max_concurrent_uni_streams(VarInt::from_u32(0))
        .stream_receive_window(VarInt::from_u32(CONTROL_WINDOW_BYTES))
        .receive_window(VarInt::from_u32(CONTROL_WINDOW_BYTES));
    config
}

/// Configuration with which a player connects to nodes.
///
/// # Errors
/// [`Error::KeyPair`] if the key does not belong to the certificate.
pub(crate) fn client_config(credentials: &Credentials) -> Result<quinn::ClientConfig, Error> {
    let crypto = tls::client(
        peers(credentials, Role::Node)?,
        Some(credentials),
        tls::ALPN,
    )?;
    let mut config = quinn::ClientConfig::new(Arc::new(crypto));
    config.transport_config(Arc::new(client_transport()));
    Ok(config)
}

/// Configuration with which a node accepts players.
///
/// # Errors
/// [`Error::KeyPair`] if the key does not belong to the certificate.
pub(crate) fn server_config(
    credentials: &Credentials,
    options: TransportOptions,
) -> Result<quinn::ServerConfig, Error> {
    let crypto = tls::server(
        peers(credentials, Role::Player)?,
        &credentials.certificate,
        credentials.key.clone_key(),
        tls::ALPN,
    )?;
    let mut config = bounded(crypto, server_transport(options));
    // The cost of changes of address is bounded by `net::migration`.
    config.migration(true);
    Ok(config)
}

fn peers(credentials: &Credentials, role: Role) -> Result<PeerVerifier, Error> {
    let denied = Arc::clone(&credentials.denied);
    PeerVerifier::new(&credentials.authority, role, denied).map_err(tls::unusable)
}

/// Configuration with which an authority answers nodes: one stream each.
pub(crate) fn enrolment_server_config(crypto: QuicServerConfig) -> quinn::ServerConfig {
    let mut transport = TransportConfig::default();
    transport
        .max_concurrent_bidi_streams(VarInt::from_u32(1))
        .max_concurrent_uni_streams(VarInt::from_u32(0))
        .datagram_receive_buffer_size(None)
        .receive_window(VarInt::from_u32(REQUEST_WINDOW_BYTES))
        .stream_receive_window(VarInt::from_u32(REQUEST_WINDOW_BYTES));
    bounded(crypto, transport)
}

/// A server configuration that bounds what is kept for strangers.
fn bounded(crypto: QuicServerConfig, transport: TransportConfig) -> quinn::ServerConfig {
    let mut config = quinn::ServerConfig::with_crypto(Arc::new(crypto));
    config
        .transport_config(Arc::new(transport))
        .migration(false)
        .max_incoming(INCOMING_MAX)
        .incoming_buffer_size(INCOMING_BYTES)
        .incoming_buffer_size_total(INCOMING_BYTES_TOTAL);
    config
}

/// Opens a player's socket for the address family of `peer`. Needs a tokio runtime.
pub(crate) fn open_client(peer: SocketAddr) -> Result<Endpoint, io::Error> {
    let any = match peer {
        SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
        SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
    };
    let runtime = Arc::new(quinn::TokioRuntime);
    Endpoint::new(endpoint_config()?, None, bind(any)?, runtime)
}

/// Connects to `address` as the side with role `own`.
///
/// # Errors
/// [`Error::NoAnswer`] or [`Error::Unreachable`] if nothing answers there; an error of the connection.
pub(crate) async fn connect(
    endpoint: &Endpoint,
    config: quinn::ClientConfig,
    address: SocketAddr,
    own: Role,
) -> Result<Connection, Error> {
    let connecting = endpoint
        .connect_with(config, address, tls::SERVER_NAME)
        .map_err(|error| Error::Unreachable {
            address,
            reason: error.to_string(),
        })?;
    match tokio::time::timeout(HANDSHAKE_TIMEOUT, connecting).await {
        Ok(Ok(connection)) => Ok(connection),
        Ok(Err(ConnectionError::TimedOut)) | Err(_) => Err(Error::NoAnswer(address)),
        Ok(Err(error)) => Err(connection_error::connection(&error, own)),
    }
}

/// Opens a server's socket with a filter that distinguishes sources known to `handshakes` from strangers.
/// Needs a tokio runtime.
pub(crate) fn open_server(
    address: SocketAddr,
    config: quinn::ServerConfig,
    handshakes: &Handshakes,
) -> Result<Endpoint, io::Error> {
    let runtime = quinn::TokioRuntime;
    let socket = runtime.wrap_udp_socket(bind(address)?)?;
    let socket = Arc::new(FilteredSocket::new(socket, handshakes.clone()));
    Endpoint::new_with_abstract_socket(endpoint_config()?, Some(config), socket, Arc::new(runtime))
}

fn endpoint_config() -> Result<EndpointConfig, io::Error> {
    let mut config = EndpointConfig::default();
    config
        .max_udp_payload_size(MTU_MAX)
        .map_err(io::Error::other)?;
    Ok(config)
}

fn bind(address: SocketAddr) -> Result<UdpSocket, io::Error> {
    let socket = UdpSocket::bind(address)?;
    enlarge_buffers(&socket);
    Ok(socket)
}

/// Requests larger socket buffers. The system may grant less, which only slows down long fast paths.
fn enlarge_buffers(socket: &UdpSocket) {
    let enlarged = quinn::udp::UdpSocketState::new(socket.into()).and_then(|state| {
        state.set_recv_buffer_size(socket.into(), SOCKET_BYTES)?;
        state.set_send_buffer_size(socket.into(), SOCKET_BYTES)
    });
    if let Err(error) = enlarged {
        tracing::debug!("socket buffers stay at the system's size: {error}");
    }
}
