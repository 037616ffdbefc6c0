//! QUIC endpoints: sockets and every number of the transport, each with its reason.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::limits;
use quinn::crypto::rustls::{QuicClientConfig, QuicServerConfig};
use quinn::{
    AckFrequencyConfig, Endpoint, EndpointConfig, IdleTimeout, MtuDiscoveryConfig, TransportConfig,
    VarInt, congestion,
};

use crate::Error;
use crate::net::credentials::Credentials;
use crate::net::tls;

/// Why an application closes a connection.
pub(crate) mod code {
    use quinn::VarInt;

    /// Nothing is wrong.
    pub(crate) const DONE: VarInt = VarInt::from_u32(0);
    /// As many players as are allowed are connected.
    pub(crate) const FULL: VarInt = VarInt::from_u32(1);
    /// The node is shutting down.
    pub(crate) const DRAINING: VarInt = VarInt::from_u32(2);
    /// Nobody waits for a stream's tiles any more.
    pub(crate) const STALE: VarInt = VarInt::from_u32(4);
    /// The peer broke the protocol; the reason says how.
    pub(crate) const PROTOCOL: VarInt = VarInt::from_u32(3);
}

/// A peer that says nothing for so long is gone. Five keep-alives may be lost in a row; the
/// coordinator has asked others for the missing tiles long before.
pub(crate) const IDLE: Duration = Duration::from_secs(5);
const KEEP_ALIVE: Duration = Duration::from_secs(1);
/// From the first packet to both certificates checked: 65 round trips of 46 ms. Whoever is slower
/// holds a place that another could have.
pub(crate) const HANDSHAKE: Duration = Duration::from_secs(3);
/// Without a bound on it the last packet of a burst is acknowledged 25 ms late, which looks like a
/// queue (draft-ietf-quic-ack-frequency).
const ACK_DELAY: Duration = Duration::from_millis(2);
/// Packets may overtake others: what has not been acknowledged is lost after one and a half round
/// trips, however many later ones have been. RFC 9002's threshold of three packets took all that a
/// single packet overtook for lost, sent it again, and called it a loss of 70 %. A quarter (RFC 8985,
/// 6.2) is too short: where one packet in fifty overtakes, the newest acknowledged, by which the
/// round trip is told, is mostly one that did, by a quarter of the round trip.
const LOST_AFTER_ROUND_TRIPS: f32 = 1.5;
/// Windows of 16 MB carried 578 Mbit/s over a round trip of 46 ms, quinn's own 53 Mbit/s.
const WINDOW_BYTES: u32 = 16 << 20;
/// What a node has sent and the player not yet acknowledged: 4 MB carry 700 Mbit/s over 46 ms,
/// and on a link that is too slow no more than that is late.
const SEND_BYTES: u64 = 4 << 20;
/// The longest packets to try, as loopbacks and networks of jumbo frames take them: an answer of 64 KiB
/// over a loopback needs a tenth less time. quinn hands the system ten at once, which takes 65,507 bytes.
const PACKET_BYTES_MAX: u16 = 6544;
/// With the system's 208 kB a burst of one frame's tiles is dropped by the receiving socket.
const SOCKET_BYTES: usize = 4 << 20;
/// A message of tiles is never stopped by its stream's own window.
const TILES_WINDOW_BYTES: u32 = limits::TILES_BYTES_MAX as u32;
/// Tile messages on their way to a player: three frames of 115 messages (1280×720 in tiles of 32,
/// eight a message), and room for the same again.
const TILE_STREAMS: u32 = 1024;
/// Datagrams that wait for the window: what waits longer waits in the session, and control packets
/// wait for no more than 10 ms of 25 Mbit/s.
const DATAGRAMS_SENT_BYTES: usize = 32 << 10;
/// Datagrams that have come and not been looked at: a 4K frame at 30 Mbyte/s for 30 ms. Beyond, the
/// oldest are lost.
const DATAGRAMS_OF_TILES_BYTES: usize = 1 << 20;
/// The same of a player: 32 requests of 2 kB.
const DATAGRAMS_OF_PLAYER_BYTES: usize = 64 << 10;
/// A player sends one scene and requests, all on the control stream.
const CONTROL_WINDOW_BYTES: u32 = (limits::SCENE_BYTES_MAX + 4 * limits::CONTROL_BYTES_MAX) as u32;
/// Handshakes that a node works on at once; packets of more strangers are dropped unanswered.
pub(crate) const HANDSHAKES_MAX: usize = 32;
/// Above so many, strangers must first show that their address is theirs (RFC 9000, 8.1.2). It
/// costs them a round trip, so that a quiet node does not ask for it.
pub(crate) const HANDSHAKES_UNVALIDATED_MAX: usize = 8;
/// First flights kept until they are looked at: one datagram or two each.
const INCOMING_MAX: usize = 64;
const INCOMING_BYTES: u64 = 16 << 10;
const INCOMING_BYTES_TOTAL: u64 = 256 << 10;

/// How a node's tiles share a path with others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Congestion {
    /// By delay: [`DelayWindow`](super::DelayWindow).
    #[default]
    Delay,
    /// quinn's own BBR, to compare with.
    Bbr,
    /// quinn's own Cubic, to compare with.
    Cubic,
}

impl Congestion {
    fn factory(self) -> Arc<dyn congestion::ControllerFactory + Send + Sync> {
        match self {
            Self::Delay => Arc::new(super::congestion::Config),
            Self::Bbr => Arc::new(congestion::BbrConfig::default()),
            Self::Cubic => Arc::new(congestion::CubicConfig::default()),
        }
    }
}

/// How a node sends tiles; the default is what farms use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sending {
    /// How much may be under way.
    pub congestion: Congestion,
    /// Whether tiles go as datagrams with forward error correction where the path is long and
    /// loses packets; streams alone, to compare with.
    pub datagrams: bool,
}

impl Default for Sending {
    fn default() -> Self {
        Self {
            congestion: Congestion::default(),
            datagrams: true,
        }
    }
}

/// What both sides share.
fn transport(congestion: Congestion) -> TransportConfig {
    let mut acknowledgements = AckFrequencyConfig::default();
    acknowledgements.max_ack_delay(Some(ACK_DELAY));
    let mut lengths = MtuDiscoveryConfig::default();
    lengths.upper_bound(PACKET_BYTES_MAX);
    let mut config = TransportConfig::default();
    config
        .mtu_discovery_config(Some(lengths))
        .max_idle_timeout(Some(IdleTimeout::from(VarInt::from_u32(
            IDLE.as_millis() as u32
        ))))
        .send_window(SEND_BYTES)
        // Tiles leave in the order they were finished, not all of them late together.
        .send_fairness(false)
        .packet_threshold(u32::MAX)
        .time_threshold(LOST_AFTER_ROUND_TRIPS)
        .ack_frequency_config(Some(acknowledgements))
        .congestion_controller_factory(congestion.factory());
    config
}

/// A player's side of a connection: it opens the control stream and receives tiles.
fn client_transport() -> TransportConfig {
    let mut config = transport(Congestion::default());
    config
        .keep_alive_interval(Some(KEEP_ALIVE))
        .datagram_receive_buffer_size(Some(DATAGRAMS_OF_TILES_BYTES))
        .max_concurrent_bidi_streams(VarInt::from_u32(0))
        .max_concurrent_uni_streams(VarInt::from_u32(TILE_STREAMS))
        .stream_receive_window(VarInt::from_u32(TILES_WINDOW_BYTES))
        .receive_window(VarInt::from_u32(WINDOW_BYTES));
    config
}

/// A node's side of a connection: one control stream comes in, tiles go out.
fn server_transport(sending: Sending) -> TransportConfig {
    let mut config = transport(sending.congestion);
    let datagrams = sending.datagrams.then_some(DATAGRAMS_OF_PLAYER_BYTES);
    config
        .datagram_receive_buffer_size(datagrams)
        .datagram_send_buffer_size(datagrams.map_or(0, |_| DATAGRAMS_SENT_BYTES))
        .max_concurrent_bidi_streams(VarInt::from_u32(1))
        .max_concurrent_uni_streams(VarInt::from_u32(0))
        .stream_receive_window(VarInt::from_u32(CONTROL_WINDOW_BYTES))
        .receive_window(VarInt::from_u32(CONTROL_WINDOW_BYTES));
    config
}

/// What a player calls nodes with.
///
/// # Errors
/// [`Error::Credentials`] if the key is not the certificate's.
pub(crate) fn client_config(credentials: &Credentials) -> Result<quinn::ClientConfig, Error> {
    let tls = tls::client(credentials).map_err(unusable)?;
    let crypto = QuicClientConfig::try_from(tls).map_err(unusable)?;
    let mut config = quinn::ClientConfig::new(Arc::new(crypto));
    config.transport_config(Arc::new(client_transport()));
    Ok(config)
}

/// What a node answers players with.
///
/// # Errors
/// [`Error::Credentials`] if the key is not the certificate's.
pub(crate) fn server_config(
    credentials: &Credentials,
    sending: Sending,
) -> Result<quinn::ServerConfig, Error> {
    let tls = tls::server(credentials).map_err(unusable)?;
    let crypto = QuicServerConfig::try_from(tls).map_err(unusable)?;
    let mut config = quinn::ServerConfig::with_crypto(Arc::new(crypto));
    config
        .transport_config(Arc::new(server_transport(sending)))
        .migration(false)
        .max_incoming(INCOMING_MAX)
        .incoming_buffer_size(INCOMING_BYTES)
        .incoming_buffer_size_total(INCOMING_BYTES_TOTAL);
    Ok(config)
}

/// Opens a player's socket for peers of `peer`'s address family. Needs a tokio runtime.
pub(crate) fn open_client(peer: SocketAddr) -> io::Result<Endpoint> {
    let any = match peer {
        SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
        SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
    };
    open(any, None)
}

/// Opens a node's socket. Needs a tokio runtime.
pub(crate) fn open_server(
    address: SocketAddr,
    config: quinn::ServerConfig,
) -> io::Result<Endpoint> {
    open(address, Some(config))
}

fn open(address: SocketAddr, server: Option<quinn::ServerConfig>) -> io::Result<Endpoint> {
    let socket = UdpSocket::bind(address)?;
    enlarge_buffers(&socket);
    let runtime = Arc::new(quinn::TokioRuntime);
    let mut config = EndpointConfig::default();
    config
        .max_udp_payload_size(PACKET_BYTES_MAX)
        .expect("longer than QUIC's least");
    Endpoint::new(config, server, socket, runtime)
}

/// The system may grant less: then long fast paths are slower, and nothing else.
fn enlarge_buffers(socket: &UdpSocket) {
    let enlarged = quinn::udp::UdpSocketState::new(socket.into()).and_then(|state| {
        state.set_recv_buffer_size(socket.into(), SOCKET_BYTES)?;
        state.set_send_buffer_size(socket.into(), SOCKET_BYTES)
    });
    if let Err(why) = enlarged {
        tracing::debug!("socket buffers stay as they are: {why}");
    }
}

fn unusable(why: impl std::fmt::Display) -> Error {
    Error::Credentials(format!("the certificate and key cannot be used: {why}"))
}
