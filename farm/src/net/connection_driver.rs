//! A session's packets over one connection: control packets framed on one stream of both
//! directions, tile packets as [`super::tile_transport`] has it. While tiles come as datagrams, the path
//! loses packets, and a request is sent twice: on the stream and, a moment later, as a datagram.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::task::{Context, Poll};
use std::time::Duration;

use carom_protocol::framing::{self, Deframer};
use carom_protocol::limits;
use carom_protocol::session::{Channel, Packet};
use carom_protocol::{RunId, codec};
use quinn::{Connection, ConnectionError, ReadError, RecvStream, SendStream};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use crate::net::credentials::Role;
use crate::net::endpoint::code;
use crate::net::fec::datagram::Datagram;
use crate::net::tile_transport::{Asked, TileReader, TileWriter, Way};
use crate::net::{congestion, connection_error};

/// What packets are carried for: a session and whoever owns it.
pub trait Peer {
    /// Takes a packet; an error is the other side's fault and ends the connection.
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error>;

    /// Hands on what has come of the packets that were there.
    fn flush(&mut self) {}

    /// Hears how many bytes of a scene have come that is still on its way, and how many it has.
    fn arriving(&mut self, _bytes: usize, _of: usize) {}

    /// The next packet to send, if there is one now.
    fn poll_transmit(&mut self) -> Option<Packet>;

    /// Does what this side's owner wants of the session, such as the next command. Ready when
    /// [`Peer::poll_transmit`] may have something new, or with a sentence when the connection
    /// shall end; pending when there is nothing to do, with the task to be woken.
    fn poll_owner(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), String>>;

    /// Runs whose tiles nobody waits for any more, since the last call: those under way are reset.
    fn take_unwanted(&mut self) -> Vec<RunId> {
        Vec::new()
    }

    /// Hears how many bytes per second the path carries.
    fn measure(&mut self, _bytes_per_sec: f64) {}
}

/// A new connection with its control stream.
pub(crate) struct Streams {
    pub(crate) connection: Connection,
    pub(crate) send: SendStream,
    pub(crate) receive: RecvStream,
    /// What this side is.
    pub(crate) role: Role,
}

/// What streams and datagrams bring.
pub(crate) enum Incoming {
    Packet(Packet),
    /// So many bytes of a node's next control packet, a scene, of so many.
    Part(usize, usize),
}

/// Why a connection can carry no more.
pub(crate) enum Fault {
    /// It is gone.
    Gone(ConnectionError),
    /// The other side broke a rule; it shall know which.
    Rule(String),
    /// This side's owner has had enough.
    Owner(String),
}

/// Packets on their way from the session to a stream's task, per channel. Small: what waits
/// is better kept by the session, which can still drop it.
const PACKETS_WAITING_MAX: usize = 4;
/// Packets that have come and not been looked at: as many as come at once.
const PACKETS_HEARD_MAX: usize = 16;
/// Blocks that a player asks for and that have not been looked at; it repeats what is dropped.
const BLOCKS_ASKED_MAX: usize = 64;
/// A request's copy leaves so much later: a burst of losses does not take both, and a frame is not
/// late if it takes one.
const COPY_DELAY: Duration = Duration::from_millis(3);
/// Bytes that are taken from the control stream at once.
const CHUNK_BYTES_MAX: usize = 64 << 10;
/// A player hears at most so often how much of a scene has come.
const SCENE_PARTS: usize = 16;
/// Control packets go before tiles that have not left yet.
const CONTROL_PRIORITY: i32 = 1;
/// How long the last answer of a session that met an error may take to arrive.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Carries packets until the connection ends, closes it, and says why.
pub(crate) async fn carry(streams: Streams, peer: &mut impl Peer) -> String {
    let (connection, role) = (streams.connection.clone(), streams.role);
    match Carrier::new(streams).run(peer).await {
        Fault::Gone(why) => connection_error::connection(&why, role),
        Fault::Rule(why) => {
            connection.close(code::PROTOCOL, why.as_bytes());
            why
        }
        Fault::Owner(why) => {
            connection.close(code::DONE, b"");
            why
        }
    }
}

struct Carrier {
    incoming: mpsc::Receiver<Incoming>,
    control: mpsc::Sender<Vec<u8>>,
    tiles: mpsc::Sender<Vec<u8>>,
    /// One for each stream; all end when this is dropped.
    tasks: JoinSet<Fault>,
    writer: tokio::task::JoinHandle<()>,
    connection: Connection,
    /// The last runs that nobody waits for.
    unwanted: watch::Sender<VecDeque<RunId>>,
    way: watch::Receiver<Way>,
    role: Role,
}

impl Carrier {
    fn new(streams: Streams) -> Self {
        let Streams {
            connection,
            send,
            receive,
            role,
        } = streams;
        let _ = send.set_priority(CONTROL_PRIORITY);
        let (to_session, incoming) = mpsc::channel(PACKETS_HEARD_MAX);
        let (control, control_out) = mpsc::channel(PACKETS_WAITING_MAX);
        let (tiles, tiles_out) = mpsc::channel(PACKETS_WAITING_MAX);
        let unwanted = watch::Sender::default();
        let (way, way_now) = watch::channel(Way::default());
        let mut tasks = JoinSet::new();
        tasks.spawn(read_control(receive, role, to_session.clone()));
        if role == Role::Player {
            tasks.spawn(TileReader::new(connection.clone(), to_session, way).run());
        } else {
            let (asked, asked_out) = mpsc::channel(BLOCKS_ASKED_MAX);
            let writer = TileWriter::new(connection.clone(), unwanted.subscribe(), way);
            tasks.spawn(writer.run(tiles_out, asked_out));
            tasks.spawn(read_datagrams(connection.clone(), to_session, asked));
        }
        Self {
            incoming,
            control,
            tiles,
            tasks,
            writer: tokio::spawn(write_control(send, control_out)),
            connection,
            unwanted,
            way: way_now,
            role,
        }
    }

    async fn run(mut self, peer: &mut impl Peer) -> Fault {
        let mut pending: Option<Packet> = None;
        let mut heard = Vec::with_capacity(PACKETS_HEARD_MAX);
        loop {
            peer.flush();
            pending = pending.or_else(|| peer.poll_transmit());
            let out = match pending.as_ref().map(|packet| packet.channel) {
                Some(Channel::Tiles) => &self.tiles,
                _ => &self.control,
            };
            let broken = tokio::select! {
                // What has come is heard before why no more will come.
                biased;
                permit = out.reserve(), if pending.is_some() => match (permit, pending.take()) {
                    (Ok(permit), Some(packet)) => {
                        match packet.channel {
                            Channel::Tiles => peer.measure(self.carries()),
                            _ => self.copy(&packet.bytes),
                        }
                        permit.send(packet.bytes);
                        None
                    }
                    _ => return Fault::Gone(self.connection.closed().await),
                },
                1.. = self.incoming.recv_many(&mut heard, PACKETS_HEARD_MAX) => {
                    heard.drain(..).try_for_each(|incoming| self.hear(peer, incoming)).err()
                }
                owner = poll_fn(|cx| peer.poll_owner(cx)), if pending.is_none() => match owner {
                    Ok(()) => None,
                    Err(why) => return Fault::Owner(why),
                },
                Some(fault) = self.tasks.join_next() => {
                    return fault.unwrap_or_else(|panic| Fault::Rule(panic.to_string()));
                }
            };
            if let Some(error) = broken {
                self.last_words(peer, pending).await;
                return Fault::Rule(error.to_string());
            }
        }
    }

    fn hear(&self, peer: &mut impl Peer, incoming: Incoming) -> Result<(), carom_protocol::Error> {
        match incoming {
            Incoming::Packet(packet) => peer.handle(packet)?,
            Incoming::Part(bytes, of) => peer.arriving(bytes, of),
        }
        let runs = peer.take_unwanted();
        if !runs.is_empty() {
            self.unwanted.send_modify(|unwanted| {
                unwanted.extend(runs);
                let excess = unwanted.len().saturating_sub(limits::RUNS_REFUSED_KEPT);
                unwanted.drain(..excess);
            });
        }
        Ok(())
    }

    /// Bytes of tiles per second that may leave.
    fn carries(&self) -> f64 {
        let bytes = congestion::known_bytes(&self.connection) as f64;
        let overhead = self.way.borrow().overhead.max(1.0);
        bytes / self.connection.rtt().as_secs_f64().max(1e-4) / overhead
    }

    /// Sends a player's request a second time, if its loss is to be feared.
    fn copy(&self, request: &[u8]) {
        let wanted = self.role == Role::Player && self.way.borrow().datagrams;
        if !wanted || !codec::is_trace(request) {
            return;
        }
        let copy = Datagram::Copy(request).to_bytes();
        let connection = self.connection.clone();
        tokio::spawn(async move {
            tokio::time::sleep(COPY_DELAY).await;
            // One that is too long for a datagram has only the stream, as all have elsewhere.
            let _ = connection.send_datagram(copy.into());
        });
    }

    /// A session that met an error may still have an answer, such as its version.
    async fn last_words(mut self, peer: &mut impl Peer, mut pending: Option<Packet>) {
        let spoken = async {
            while let Some(packet) = pending.take().or_else(|| peer.poll_transmit()) {
                if packet.channel == Channel::Control {
                    let _ = self.control.send(packet.bytes).await;
                }
            }
            drop(self.control);
            let _ = (&mut self.writer).await;
        };
        let _ = tokio::time::timeout(LAST_WORDS, spoken).await;
    }
}

async fn read_control(
    mut stream: RecvStream,
    role: Role,
    to_session: mpsc::Sender<Incoming>,
) -> Fault {
    let mut told = 0;
    let mut deframer = Deframer::new(match role {
        Role::Player => limits::CONTROL_BYTES_MAX,
        Role::Node => limits::SCENE_BYTES_MAX,
    });
    loop {
        match stream.read_chunk(CHUNK_BYTES_MAX, true).await {
            Ok(Some(chunk)) => deframer.push(&chunk.bytes),
            Ok(None) | Err(ReadError::Reset(_)) => {
                return Fault::Rule("the control stream has been ended".into());
            }
            Err(ReadError::ConnectionLost(why)) => return Fault::Gone(why),
            Err(why) => return Fault::Rule(why.to_string()),
        }
        loop {
            let bytes = match deframer.next_packet() {
                Ok(Some(bytes)) => bytes,
                Ok(None) => break,
                Err(why) => return Fault::Rule(why.to_string()),
            };
            let channel = Channel::Control;
            let packet = Incoming::Packet(Packet { channel, bytes });
            if to_session.send(packet).await.is_err() {
                return Fault::Gone(ConnectionError::LocallyClosed);
            }
            told = 0;
        }
        // A scene, by its length.
        let long = |(_, of): &(usize, usize)| *of > limits::CONTROL_BYTES_MAX;
        if let Some((there, of)) = deframer.under_way().filter(long)
            && there >= told + of.div_ceil(SCENE_PARTS)
        {
            told = there;
            // What ends the session is seen with the next packet.
            let _ = to_session.send(Incoming::Part(there, of)).await;
        }
    }
}

/// Ends the stream when there is nothing more to come, and waits until all has arrived.
async fn write_control(mut stream: SendStream, mut packets: mpsc::Receiver<Vec<u8>>) {
    while let Some(packet) = packets.recv().await {
        if stream.write_all(&framing::frame(&packet)).await.is_err() {
            return;
        }
    }
    let _ = stream.finish();
    let _ = stream.stopped().await;
}

/// A node's: questions for blocks, and copies of requests.
async fn read_datagrams(
    connection: Connection,
    to_session: mpsc::Sender<Incoming>,
    asked: mpsc::Sender<Asked>,
) -> Fault {
    loop {
        let bytes = match connection.read_datagram().await {
            Ok(bytes) => bytes,
            Err(why) => return Fault::Gone(why),
        };
        match Datagram::parse(&bytes) {
            // If many wait, the player will ask again.
            Some(Datagram::Missing { block, held }) => drop(asked.try_send((block, held))),
            Some(Datagram::Copy(bytes)) => {
                let (channel, bytes) = (Channel::Copy, bytes.to_vec());
                let copy = Incoming::Packet(Packet { channel, bytes });
                let _ = to_session.send(copy).await;
            }
            _ => return Fault::Rule("a datagram is none of a player's".into()),
        }
    }
}
