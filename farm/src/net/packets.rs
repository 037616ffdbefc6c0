//! A session's packets over one connection: control packets framed on one stream of both
//! directions, each tile packet on a stream of its own.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::task::{Context, Poll};
use std::time::Duration;

use carom_protocol::framing::{self, Deframer};
use carom_protocol::limits;
use carom_protocol::session::{Channel, Packet};
use carom_protocol::{RunId, codec};
use quinn::{
    Connection, ConnectionError, ReadError, ReadToEndError, RecvStream, SendStream, WriteError,
};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use crate::net::credentials::Role;
use crate::net::endpoint::code;
use crate::net::refusal;

/// What packets are carried for: a session and whoever owns it.
pub trait Peer {
    /// Takes a packet; an error is the other side's fault and ends the connection.
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error>;

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

/// Why a connection can carry no more.
enum Fault {
    /// It is gone.
    Gone(ConnectionError),
    /// The other side broke a rule; it shall know which.
    Rule(String),
    /// This side's owner has had enough.
    Owner(String),
}

/// Packets on their way between the session and a stream's task, per channel. Small: what waits
/// is better kept by the session, which can still drop it.
const PACKETS_WAITING_MAX: usize = 4;
/// Bytes that are taken from the control stream at once.
const CHUNK_BYTES_MAX: usize = 64 << 10;
/// Control packets go before tiles that have not left yet.
const CONTROL_PRIORITY: i32 = 1;
/// How long the last answer of a session that met an error may take to arrive.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Carries packets until the connection ends, closes it, and says why.
pub(crate) async fn carry(streams: Streams, peer: &mut impl Peer) -> String {
    let (connection, role) = (streams.connection.clone(), streams.role);
    match Carrier::new(streams).run(peer).await {
        Fault::Gone(why) => refusal::connection(&why, role),
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
    incoming: mpsc::Receiver<Packet>,
    control: mpsc::Sender<Vec<u8>>,
    tiles: mpsc::Sender<Vec<u8>>,
    /// One for each stream; all end when this is dropped.
    tasks: JoinSet<Fault>,
    writer: tokio::task::JoinHandle<()>,
    connection: Connection,
    /// The last runs that nobody waits for.
    unwanted: watch::Sender<VecDeque<RunId>>,
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
        let (to_session, incoming) = mpsc::channel(PACKETS_WAITING_MAX);
        let (control, control_out) = mpsc::channel(PACKETS_WAITING_MAX);
        let (tiles, tiles_out) = mpsc::channel(PACKETS_WAITING_MAX);
        let unwanted = watch::Sender::default();
        let mut tasks = JoinSet::new();
        tasks.spawn(read_control(receive, role, to_session.clone()));
        if role == Role::Player {
            tasks.spawn(read_tiles(connection.clone(), to_session));
        } else {
            tasks.spawn(write_tiles(
                connection.clone(),
                tiles_out,
                unwanted.subscribe(),
            ));
        }
        Self {
            incoming,
            control,
            tiles,
            tasks,
            writer: tokio::spawn(write_control(send, control_out)),
            connection,
            unwanted,
        }
    }

    async fn run(mut self, peer: &mut impl Peer) -> Fault {
        let mut pending: Option<Packet> = None;
        loop {
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
                        if packet.channel == Channel::Tiles {
                            peer.measure(self.carries());
                        }
                        permit.send(packet.bytes);
                        None
                    }
                    _ => return Fault::Gone(self.connection.closed().await),
                },
                Some(packet) = self.incoming.recv() => self.hear(peer, packet).err(),
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

    fn hear(&self, peer: &mut impl Peer, packet: Packet) -> Result<(), carom_protocol::Error> {
        peer.handle(packet)?;
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

    /// Bytes per second that may leave.
    fn carries(&self) -> f64 {
        let path = self.connection.stats().path;
        path.cwnd as f64 / path.rtt.as_secs_f64().max(1e-4)
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
    to_session: mpsc::Sender<Packet>,
) -> Fault {
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
            if to_session.send(Packet { channel, bytes }).await.is_err() {
                return Fault::Gone(ConnectionError::LocallyClosed);
            }
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

/// QUIC's limit on streams bounds how many are read at once.
async fn read_tiles(connection: Connection, to_session: mpsc::Sender<Packet>) -> Fault {
    let mut streams = JoinSet::new();
    loop {
        tokio::select! {
            stream = connection.accept_uni() => match stream {
                Ok(stream) => {
                    streams.spawn(read_tile_packet(stream, to_session.clone()));
                }
                Err(why) => return Fault::Gone(why),
            },
            Some(read) = streams.join_next() => {
                if let Ok(Some(fault)) = read {
                    return fault;
                }
            }
        }
    }
}

async fn read_tile_packet(
    mut stream: RecvStream,
    to_session: mpsc::Sender<Packet>,
) -> Option<Fault> {
    let bytes = match stream.read_to_end(limits::TILES_BYTES_MAX).await {
        Ok(bytes) => bytes,
        // The node has dropped tiles that nobody waits for.
        Err(ReadToEndError::Read(ReadError::Reset(_))) => return None,
        Err(ReadToEndError::Read(ReadError::ConnectionLost(why))) => return Some(Fault::Gone(why)),
        Err(why) => return Some(Fault::Rule(format!("a stream of tiles: {why}"))),
    };
    let channel = Channel::Tiles;
    let _ = to_session.send(Packet { channel, bytes }).await;
    None
}

/// Each tile packet on a stream of its own, one after the other: what waits for the network waits
/// in the session, which can still drop it. A stream whose run is not wanted any more is reset, so
/// that its lost packets are not sent again.
async fn write_tiles(
    connection: Connection,
    mut packets: mpsc::Receiver<Vec<u8>>,
    unwanted: watch::Receiver<VecDeque<RunId>>,
) -> Fault {
    let mut tails = JoinSet::new();
    while let Some(packet) = packets.recv().await {
        while tails.try_join_next().is_some() {}
        let cwnd = connection.stats().path.cwnd;
        connection.set_send_window((cwnd + cwnd / 2).max(SEND_BYTES_MIN));
        let mut stream = match connection.open_uni().await {
            Ok(stream) => stream,
            Err(why) => return Fault::Gone(why),
        };
        let run = codec::run_of_tiles(&packet);
        let mut stale = unwanted.clone();
        let written = tokio::select! {
            written = stream.write_all(&packet) => written,
            () = wait_until_stale(&mut stale, run) => {
                let _ = stream.reset(code::STALE);
                continue;
            }
        };
        match written {
            Ok(()) => {
                let _ = stream.finish();
                tails.spawn(async move {
                    tokio::select! {
                        _ = stream.stopped() => {}
                        () = wait_until_stale(&mut stale, run) => drop(stream.reset(code::STALE)),
                    }
                });
            }
            // The player does not want these tiles any more.
            Err(WriteError::Stopped(_)) => {}
            Err(WriteError::ConnectionLost(why)) => return Fault::Gone(why),
            Err(why) => return Fault::Rule(why.to_string()),
        }
    }
    Fault::Gone(ConnectionError::LocallyClosed)
}

/// For ever, if the connection ends before.
async fn wait_until_stale(unwanted: &mut watch::Receiver<VecDeque<RunId>>, run: Option<RunId>) {
    let is_stale = |unwanted: &VecDeque<RunId>| run.is_some_and(|run| unwanted.contains(&run));
    if unwanted.wait_for(is_stale).await.is_err() {
        std::future::pending::<()>().await;
    }
}

/// Two frames at 31.5 Mbit/s, whatever the window is.
const SEND_BYTES_MIN: u64 = 128 << 10;
