//! Driver of one connection, which carries a session's packets: control packets framed on one
//! bidirectional stream, tile packets as in [`super::tile_transport`]. While tiles travel as datagrams,
//! the path is known to lose packets, and requests are sent twice: on the stream and, a moment later, as a
//! datagram.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::sync::Arc;
use std::time::{Duration, Instant};

use carom_protocol::framing::{self, Deframer};
use carom_protocol::limits;
use carom_protocol::session::{Channel, Packet, SceneAssembler};
use carom_protocol::{RequestId, codec};
use quinn::{Connection, ConnectionError, ReadError, RecvStream, SendStream};
use tokio::sync::{OwnedSemaphorePermit, mpsc, watch};
use tokio::task::JoinSet;

use crate::Error;
use crate::net::connection_event::{Arrival, ConnectionEnd};
use crate::net::endpoint::HANDSHAKE_TIMEOUT;
use crate::net::fec::datagram::Datagram;
use crate::net::peer::Role;
use crate::net::player_account::PlayerAccount;
use crate::net::tile_transport::{Nack, TileReceiver, TileSender, TileTransport};
use crate::net::{close_code, congestion, connection_error};
use crate::node::PacketHandler;

/// A new connection with its control stream.
pub(crate) struct ConnectionStreams {
    pub(crate) connection: Connection,
    pub(crate) send: SendStream,
    pub(crate) receive: RecvStream,
    /// The role of this side.
    pub(crate) role: Role,
    /// Account of the player: a node shares it among the player's connections.
    pub(crate) account: Arc<PlayerAccount>,
}

/// Packets queued between the session and a stream's task, per channel. Few, since packets that wait are
/// better kept by the session, which can still drop them.
const PACKETS_SENDING_MAX: usize = 4;
/// Packets that have arrived and wait to be handled in one batch.
const PACKETS_ARRIVED_MAX: usize = 16;
/// NACKs waiting to be answered; the player repeats those that are dropped.
const NACKS_MAX: usize = 64;
/// Delay of a request's copy: long enough that one burst of losses does not take both, short enough that
/// a frame whose first request was lost is not late.
const REQUEST_COPY_DELAY: Duration = Duration::from_millis(3);
/// Bytes read from the control stream at once.
const CHUNK_BYTES_MAX: usize = 64 << 10;
/// Priority of the control stream, above the tile streams' 0.
const CONTROL_PRIORITY: i32 = 1;
/// Maximum duration of the final flush of a session that met an error.
const FINAL_FLUSH_TIMEOUT: Duration = Duration::from_secs(1);

/// Carries packets until the connection ends; closes it and returns the reason.
pub(crate) async fn drive(streams: ConnectionStreams, handler: &mut impl PacketHandler) -> Error {
    let (connection, role) = (streams.connection.clone(), streams.role);
    match ConnectionDriver::new(streams, handler.assembler())
        .run(handler)
        .await
    {
        ConnectionEnd::Lost(error) => connection_error::connection(&error, role),
        ConnectionEnd::Violation(error) => {
            connection.close(close_code::PROTOCOL, error.to_string().as_bytes());
            error
        }
        ConnectionEnd::Closed(error) => {
            connection.close(close_code::DONE, b"");
            error
        }
    }
}

struct ConnectionDriver {
    arrivals: mpsc::Receiver<Arrival>,
    control: mpsc::Sender<Vec<u8>>,
    tiles: mpsc::Sender<Vec<u8>>,
    /// A task for each kind of stream; all are aborted when this is dropped.
    tasks: JoinSet<ConnectionEnd>,
    control_writer: tokio::task::JoinHandle<()>,
    connection: Connection,
    /// The last requests that were cancelled, for the sender of tiles.
    cancelled: watch::Sender<VecDeque<RequestId>>,
    transport: watch::Receiver<TileTransport>,
    role: Role,
    account: Arc<PlayerAccount>,
}

impl ConnectionDriver {
    fn new(streams: ConnectionStreams, assembler: SceneAssembler) -> Self {
        let ConnectionStreams {
            connection,
            send,
            receive,
            role,
            account,
        } = streams;
        let _ = send.set_priority(CONTROL_PRIORITY);
        let (to_session, arrivals) = mpsc::channel(PACKETS_ARRIVED_MAX);
        let (control, control_packets) = mpsc::channel(PACKETS_SENDING_MAX);
        let (tiles, tile_packets) = mpsc::channel(PACKETS_SENDING_MAX);
        let cancelled = watch::Sender::default();
        let (transport_sender, transport) = watch::channel(TileTransport::default());
        let mut tasks = JoinSet::new();
        let reader = ControlReader::new(role, to_session.clone(), Arc::clone(&account), assembler);
        tasks.spawn(reader.run(receive));
        if role == Role::Player {
            let receiver = TileReceiver::new(connection.clone(), to_session, transport_sender);
            tasks.spawn(receiver.run());
        } else {
            let (nack_sender, nacks) = mpsc::channel(NACKS_MAX);
            let subscription = cancelled.subscribe();
            let sender = TileSender::new(connection.clone(), subscription, transport_sender);
            tasks.spawn(sender.run(tile_packets, nacks));
            let account = Arc::clone(&account);
            let (connection, nacks) = (connection.clone(), nack_sender);
            tasks.spawn(read_datagrams(connection, account, to_session, nacks));
        }
        Self {
            arrivals,
            control,
            tiles,
            tasks,
            control_writer: tokio::spawn(write_control(connection.clone(), send, control_packets)),
            connection,
            cancelled,
            transport,
            role,
            account,
        }
    }

    async fn run(mut self, handler: &mut impl PacketHandler) -> ConnectionEnd {
        let mut pending: Option<Packet> = None;
        let mut arrived = Vec::with_capacity(PACKETS_ARRIVED_MAX);
        loop {
            handler.flush();
            // At most one packet is held here; the others stay in the session, where they can still be
            // dropped.
            pending = pending.or_else(|| handler.poll_transmit());
            let out = match pending.as_ref().map(|packet| packet.channel) {
                Some(Channel::Tiles) => &self.tiles,
                _ => &self.control,
            };
            let violation = tokio::select! {
                // In this order, so that packets that have arrived are handled before the end of the
                // connection.
                biased;
                permit = out.reserve(), if pending.is_some() => match (permit, pending.take()) {
                    (Ok(permit), Some(packet)) => {
                        match packet.channel {
                            Channel::Tiles => {
                                self.account.work(Instant::now());
                                handler.on_bandwidth(self.tile_bytes_per_sec());
                            }
                            _ => self.send_copy(&packet.bytes),
                        }
                        permit.send(packet.bytes);
                        None
                    }
                    _ => return ConnectionEnd::Lost(self.connection.closed().await),
                },
                1.. = self.arrivals.recv_many(&mut arrived, PACKETS_ARRIVED_MAX) => {
                    let mut arrivals = arrived.drain(..);
                    arrivals.try_for_each(|arrival| self.on_arrival(handler, arrival)).err()
                }
                // No commands while a packet waits: theirs would only queue behind it in the session.
                command = poll_fn(|cx| handler.poll_commands(cx)), if pending.is_none() => {
                    match command {
                        Ok(()) => None,
                        Err(error) => return ConnectionEnd::Closed(error),
                    }
                }
                Some(end) = self.tasks.join_next() => {
                    return end.unwrap_or_else(panicked);
                }
            };
            if let Some(error) = violation {
                self.final_flush(handler, pending).await;
                return ConnectionEnd::Violation(error.into());
            }
        }
    }

    fn on_arrival(
        &self,
        handler: &mut impl PacketHandler,
        arrival: Arrival,
    ) -> Result<(), carom_protocol::Error> {
        match arrival {
            Arrival::Packet(packet) => handler.handle(packet)?,
            Arrival::Scene(progress) => handler.handle_scene(progress)?,
        }
        let requests = handler.take_cancelled();
        if !requests.is_empty() {
            self.cancelled.send_modify(|cancelled| {
                cancelled.extend(requests);
                let excess = cancelled
                    .len()
                    .saturating_sub(limits::REQUESTS_REFUSED_KEPT);
                cancelled.drain(..excess);
            });
        }
        Ok(())
    }

    /// Bytes of tiles per second that the path is known to carry, without repair symbols: the validated
    /// window per round trip, divided by the overhead.
    fn tile_bytes_per_sec(&self) -> f64 {
        let bytes = congestion::validated_bytes(&self.connection) as f64;
        let overhead = self.transport.borrow().overhead.max(1.0);
        bytes / self.connection.rtt().as_secs_f64().max(1e-4) / overhead
    }

    /// Sends a player's request a second time, as a datagram, if the path loses packets.
    fn send_copy(&self, request: &[u8]) {
        let is_lossy = self.role == Role::Player && self.transport.borrow().datagrams;
        if !is_lossy || !codec::is_trace(request) {
            return;
        }
        let copy = Datagram::RequestCopy(request).to_bytes();
        let connection = self.connection.clone();
        tokio::spawn(async move {
            tokio::time::sleep(REQUEST_COPY_DELAY).await;
            // A request that is too long for a datagram travels on the stream alone.
            let _ = connection.send_datagram(copy.into());
        });
    }

    /// Sends the control packets that the session still has after an error, such as its version.
    async fn final_flush(mut self, handler: &mut impl PacketHandler, mut pending: Option<Packet>) {
        let flushed = async {
            while let Some(packet) = pending.take().or_else(|| handler.poll_transmit()) {
                if packet.channel == Channel::Control {
                    let _ = self.control.send(packet.bytes).await;
                }
            }
            drop(self.control);
            let _ = (&mut self.control_writer).await;
        };
        let _ = tokio::time::timeout(FINAL_FLUSH_TIMEOUT, flushed).await;
    }
}

/// Reader of a peer's control stream.
struct ControlReader {
    role: Role,
    deframer: Deframer,
    to_session: mpsc::Sender<Arrival>,
    /// Whether the first packet has arrived.
    greeted: bool,
    assembler: SceneAssembler,
    /// Permit held while chunks of a scene are expected.
    transfer: Option<OwnedSemaphorePermit>,
    account: Arc<PlayerAccount>,
}

impl ControlReader {
    fn new(
        role: Role,
        to_session: mpsc::Sender<Arrival>,
        account: Arc<PlayerAccount>,
        assembler: SceneAssembler,
    ) -> Self {
        let packet_bytes_max = match role {
            Role::Player => limits::CONTROL_BYTES_MAX,
            Role::Node => limits::TO_NODE_BYTES_MAX,
        };
        Self {
            role,
            deframer: Deframer::new(packet_bytes_max),
            to_session,
            greeted: false,
            assembler,
            transfer: None,
            account,
        }
    }

    /// Reads until the stream ends. Beyond the allowed rate reading pauses, so that QUIC's flow control slows
    /// the peer down.
    async fn run(mut self, mut stream: RecvStream) -> ConnectionEnd {
        let greeting_due = tokio::time::Instant::now() + HANDSHAKE_TIMEOUT;
        loop {
            let read = stream.read_chunk(CHUNK_BYTES_MAX, true);
            let read = match self.greeted || self.role == Role::Player {
                true => read.await,
                // Without this deadline a peer could hold a place by keep-alives alone.
                false => match tokio::time::timeout_at(greeting_due, read).await {
                    Ok(read) => read,
                    Err(_) => return ConnectionEnd::Violation(Error::NoGreeting),
                },
            };
            let chunk = match read {
                Ok(Some(chunk)) => chunk.bytes,
                Ok(None) | Err(ReadError::Reset(_)) => {
                    return ConnectionEnd::Violation(Error::ControlStreamEnded);
                }
                Err(ReadError::ConnectionLost(error)) => return ConnectionEnd::Lost(error),
                Err(error) => {
                    return ConnectionEnd::Violation(Error::Stream {
                        content: "control messages",
                        reason: error.to_string(),
                    });
                }
            };
            self.deframer.push(&chunk);
            if let Err(end) = self.deliver().await {
                return end;
            }
            pause(self.account.spend_bytes(Instant::now(), chunk.len())).await;
        }
    }

    /// Delivers the complete packets.
    async fn deliver(&mut self) -> Result<(), ConnectionEnd> {
        let violation = |error: carom_protocol::Error| ConnectionEnd::Violation(error.into());
        while let Some(bytes) = self.deframer.next_packet().map_err(violation)? {
            let arrival = match self.role {
                Role::Node if self.greeted && codec::is_of_scene(&bytes) => {
                    self.assemble(bytes).await?
                }
                _ => Arrival::Packet(Packet::new(Channel::Control, bytes)),
            };
            self.greeted = true;
            if self.to_session.send(arrival).await.is_err() {
                return Err(ConnectionEnd::Lost(ConnectionError::LocallyClosed));
            }
            if self.role == Role::Node {
                pause(self.account.spend_packet(Instant::now())).await;
            }
        }
        Ok(())
    }

    /// Handles a packet of a scene on a blocking thread, since this one serves other players too. Of all
    /// connections of a player one at a time does so, and one at a time expects chunks, which are in memory
    /// until the scene is complete; the others wait before they read on.
    async fn assemble(&mut self, packet: Vec<u8>) -> Result<Arrival, ConnectionEnd> {
        // The semaphores are never closed, so waiting for a permit cannot fail.
        // The permit for the transfer comes before the one for decoding: a connection that held the latter
        // while waiting here would keep the connection that holds the transfer from handling its chunks, a
        // deadlock.
        if codec::is_manifest(&packet) && self.transfer.is_none() {
            let transfers = Arc::clone(&self.account.transfers);
            self.transfer = transfers.acquire_owned().await.ok();
        }
        let _turn = self.account.decoding.acquire().await;
        let mut assembler = std::mem::take(&mut self.assembler);
        let handled = tokio::task::spawn_blocking(move || {
            let progress = assembler.handle(&packet);
            (assembler, progress)
        });
        let (assembler, progress) = handled.await.map_err(panicked)?;
        if !assembler.is_under_way() {
            self.transfer = None;
        }
        self.assembler = assembler;
        Ok(Arrival::Scene(progress))
    }
}

async fn pause(duration: Duration) {
    if !duration.is_zero() {
        tokio::time::sleep(duration).await;
    }
}

/// Writes packets until the channel closes, then ends the stream and waits until all of it has arrived.
async fn write_control(
    connection: Connection,
    mut stream: SendStream,
    mut packets: mpsc::Receiver<Vec<u8>>,
) {
    while let Some(packet) = packets.recv().await {
        if packet.len() > limits::CONTROL_BYTES_MAX {
            // Requests queue behind the bytes that quinn has buffered, initially up to 4 MB of chunks. A send
            // window of little more than the congestion window keeps that queue short without starving the
            // path.
            let cwnd = connection.stats().path.cwnd;
            connection.set_send_window(cwnd + (cwnd / 8).max(limits::CHUNK_BYTES_MAX as u64));
        }
        if stream.write_all(&framing::frame(&packet)).await.is_err() {
            return;
        }
    }
    let _ = stream.finish();
    let _ = stream.stopped().await;
}

/// Reads a player's datagrams: NACKs and copies of requests. Those beyond the allowed rate are dropped by
/// quinn's bounded queue.
async fn read_datagrams(
    connection: Connection,
    account: Arc<PlayerAccount>,
    to_session: mpsc::Sender<Arrival>,
    nacks: mpsc::Sender<Nack>,
) -> ConnectionEnd {
    loop {
        pause(account.spend_packet(Instant::now())).await;
        let bytes = match connection.read_datagram().await {
            Ok(bytes) => bytes,
            Err(error) => return ConnectionEnd::Lost(error),
        };
        match Datagram::parse(&bytes) {
            // If too many wait, this one is dropped and the player repeats it.
            Some(Datagram::Nack { block, received }) => {
                drop(nacks.try_send(Nack { block, received }));
            }
            Some(Datagram::RequestCopy(bytes)) => {
                let (channel, bytes) = (Channel::Copy, bytes.to_vec());
                let copy = Arrival::Packet(Packet::new(channel, bytes));
                let _ = to_session.send(copy).await;
            }
            _ => {
                let why = "a player sends no such datagram".to_owned();
                return ConnectionEnd::Violation(Error::ErrorCorrection(why));
            }
        }
    }
}

fn panicked(panic: tokio::task::JoinError) -> ConnectionEnd {
    ConnectionEnd::Violation(Error::Task(panic.to_string()))
}
