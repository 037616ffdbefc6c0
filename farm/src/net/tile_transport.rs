//! Tile packets over a connection: each on a stream of its own, or, where the path is long and
//! loses packets, as datagrams with parities; what they do not repair is asked for, and comes on
//! a stream.
//!
//! A stream is a tile packet, or [`REPAIR`], the number of a block, the packet's first piece in it,
//! and the packet, or [`LAST`] and the number of the last block that was sent.

use std::collections::VecDeque;
use std::future::{Future, poll_fn};
use std::task::Poll;
use std::time::{Duration, Instant};

use carom_protocol::limits;
use carom_protocol::session::{Channel, Packet};
use carom_protocol::{RunId, codec};
use quinn::{
    Connection, ConnectionError, ReadError, ReadToEndError, RecvStream, SendDatagramError,
    WriteError,
};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use super::connection_driver::{Fault, Incoming};
use super::endpoint::code;
use super::fec::datagram::Datagram;
use super::fec::decoder::Assembly;
use super::fec::encoder::{Blocks, Repair};
use super::fec::loss_estimator::LossMeter;

/// How the node's tiles come, for both ends to go by.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Way {
    /// Whether the last ones came as datagrams.
    pub(crate) datagrams: bool,
    /// Bytes on the path for each byte of tiles, 1 or more.
    pub(crate) overhead: f64,
}

/// What a player does not have of a block: its number, and which pieces it has.
pub(crate) type Asked = (u64, u64);

/// A node's end. What waits for the network waits in the session, which can still drop it.
pub(crate) struct TileWriter {
    connection: Connection,
    /// Runs that nobody waits for: their streams are reset, so that their lost packets are not
    /// sent again.
    unwanted: watch::Receiver<VecDeque<RunId>>,
    way: watch::Sender<Way>,
    began: Instant,
    losses: LossMeter,
    blocks: Blocks,
    /// Whether this end sends datagrams at all.
    datagrams: bool,
    /// Streams that have been written and not been acknowledged.
    tails: JoinSet<()>,
}

impl TileWriter {
    pub(crate) fn new(
        connection: Connection,
        unwanted: watch::Receiver<VecDeque<RunId>>,
        way: watch::Sender<Way>,
    ) -> Self {
        let datagrams = connection.datagram_send_buffer_space() > 0;
        Self {
            connection,
            datagrams,
            unwanted,
            way,
            began: Instant::now(),
            losses: LossMeter::new(),
            blocks: Blocks::default(),
            tails: JoinSet::new(),
        }
    }

    /// Sends packets until there are no more.
    pub(crate) async fn run(
        mut self,
        mut packets: mpsc::Receiver<Vec<u8>>,
        mut asked: mpsc::Receiver<Asked>,
    ) -> Fault {
        loop {
            while self.tails.try_join_next().is_some() {}
            let due = self.blocks.due().or_else(|| self.blocks.tell_due());
            let due = due.map(|due| self.began + due);
            let sent = tokio::select! {
                packet = packets.recv() => match packet {
                    Some(packet) => self.send(packet).await,
                    None => return Fault::Gone(ConnectionError::LocallyClosed),
                },
                Some((block, held)) = asked.recv() => self.repair(block, held).await,
                () = wait_until(due) => self.end_block().await,
            };
            if let Err(fault) = sent {
                return fault;
            }
        }
    }

    async fn send(&mut self, packet: Vec<u8>) -> Result<(), Fault> {
        let run = codec::run_of_tiles(&packet);
        if self.is_stale(run) {
            return Ok(());
        }
        let Some(datagram_bytes) = self.datagram_bytes() else {
            return self.send_stream(run, &[&packet]).await;
        };
        let now = self.began.elapsed();
        let pieces = self
            .blocks
            .push(now, packet, datagram_bytes, &mut self.losses);
        match pieces {
            Ok(datagrams) => self.send_datagrams(datagrams).await,
            Err(packet) => self.send_stream(run, &[&packet]).await,
        }
    }

    /// How long datagrams may be, if tiles are to go as such.
    fn datagram_bytes(&mut self) -> Option<usize> {
        let path = self.connection.stats().path;
        self.losses.observe(path.sent_packets, path.lost_packets);
        let wanted = self.datagrams && self.losses.wants_datagrams(path.rtt);
        let bytes = self.connection.max_datagram_size().filter(|_| wanted);
        let way = match bytes {
            Some(_) => Way {
                datagrams: true,
                overhead: self.losses.overhead(),
            },
            None => Way {
                datagrams: false,
                overhead: 1.0,
            },
        };
        self.way.send_if_modified(|before| {
            let changed = *before != way;
            *before = way;
            changed
        });
        bytes
    }

    async fn send_datagrams(&mut self, datagrams: Vec<Vec<u8>>) -> Result<(), Fault> {
        for datagram in datagrams {
            match self.connection.send_datagram_wait(datagram.into()).await {
                // One that has become too long for the path is lost like others.
                Ok(()) | Err(SendDatagramError::TooLarge) => {}
                Err(SendDatagramError::ConnectionLost(why)) => return Err(Fault::Gone(why)),
                Err(why) => return Err(Fault::Rule(why.to_string())),
            }
        }
        Ok(())
    }

    /// Sends the parities of the open block, or tells which was the last.
    async fn end_block(&mut self) -> Result<(), Fault> {
        if self.blocks.due().is_some() {
            let parities = self.blocks.close(&mut self.losses);
            return self.send_datagrams(parities).await;
        }
        match self.blocks.tell() {
            Some(last) => {
                self.send_stream(None, &[&[LAST], &last.to_le_bytes()])
                    .await
            }
            None => Ok(()),
        }
    }

    async fn repair(&mut self, block: u64, held: u64) -> Result<(), Fault> {
        let repairs = self.blocks.repair(block, held);
        if !repairs.is_empty() {
            self.losses.on_unrepaired();
        }
        for repair in repairs {
            let run = codec::run_of_tiles(&repair.packet);
            if self.is_stale(run) {
                continue;
            }
            let header = [&[REPAIR], &repair.block.to_le_bytes()[..], &[repair.index]].concat();
            self.send_stream(run, &[&header, &repair.packet]).await?;
        }
        Ok(())
    }

    fn is_stale(&self, run: Option<RunId>) -> bool {
        run.is_some_and(|run| self.unwanted.borrow().contains(&run))
    }

    async fn send_stream(&mut self, run: Option<RunId>, parts: &[&[u8]]) -> Result<(), Fault> {
        let mut stale = self.unwanted.clone();
        let cwnd = self.connection.stats().path.cwnd;
        self.connection
            .set_send_window(cwnd + (cwnd / 8).max(SEND_BYTES_AHEAD));
        let mut stream = self.connection.open_uni().await.map_err(Fault::Gone)?;
        let write = async {
            for part in parts {
                stream.write_all(part).await?;
            }
            Ok(())
        };
        let written = tokio::select! {
            written = write => Some(written),
            () = wait_until_stale(&mut stale, run) => None,
        };
        match written {
            None => drop(stream.reset(code::STALE)),
            Some(Ok(())) => {
                let _ = stream.finish();
                self.tails.spawn(async move {
                    tokio::select! {
                        _ = stream.stopped() => {}
                        () = wait_until_stale(&mut stale, run) => drop(stream.reset(code::STALE)),
                    }
                });
            }
            // The player does not want these tiles any more.
            Some(Err(WriteError::Stopped(_))) => {}
            Some(Err(WriteError::ConnectionLost(why))) => return Err(Fault::Gone(why)),
            Some(Err(why)) => return Err(Fault::Rule(why.to_string())),
        }
        Ok(())
    }
}

/// For ever, if the connection ends before.
async fn wait_until_stale(unwanted: &mut watch::Receiver<VecDeque<RunId>>, run: Option<RunId>) {
    let is_stale = |unwanted: &VecDeque<RunId>| run.is_some_and(|run| unwanted.contains(&run));
    if unwanted.wait_for(is_stale).await.is_err() {
        std::future::pending::<()>().await;
    }
}

/// For ever, if there is no such time.
async fn wait_until(due: Option<Instant>) {
    match due {
        Some(due) => tokio::time::sleep_until(due.into()).await,
        None => std::future::pending().await,
    }
}

/// A player's end.
pub(crate) struct TileReader {
    connection: Connection,
    to_session: mpsc::Sender<Incoming>,
    way: watch::Sender<Way>,
    began: Instant,
    assembly: Assembly,
}

impl TileReader {
    pub(crate) fn new(
        connection: Connection,
        to_session: mpsc::Sender<Incoming>,
        way: watch::Sender<Way>,
    ) -> Self {
        Self {
            connection,
            to_session,
            way,
            began: Instant::now(),
            assembly: Assembly::default(),
        }
    }

    /// Reads tiles until the connection ends. QUIC's limit on streams bounds how many are read at
    /// once.
    pub(crate) async fn run(mut self) -> Fault {
        let mut streams: JoinSet<Read> = JoinSet::new();
        loop {
            let round_trip = self.connection.rtt();
            let due = self.assembly.next_timeout(round_trip);
            let due = due.map(|due| self.began + due);
            let packets = tokio::select! {
                stream = self.connection.accept_uni() => match stream {
                    Ok(stream) => {
                        let mut read = Box::pin(read_stream(stream));
                        // Short streams are there whole, as a rule: no task has to be woken for them.
                        match poll_fn(|cx| Poll::Ready(read.as_mut().poll(cx))).await {
                            Poll::Ready(read) => self.take_read(read),
                            Poll::Pending => {
                                streams.spawn(read);
                                continue;
                            }
                        }
                    }
                    Err(why) => return Fault::Gone(why),
                },
                Some(read) = streams.join_next() => match read {
                    Ok(read) => self.take_read(read),
                    Err(_) => continue,
                },
                datagram = self.connection.read_datagram() => match datagram {
                    Ok(bytes) => self.take_datagram(&bytes).map_err(broken),
                    Err(why) => return Fault::Gone(why),
                },
                () = wait_until(due) => {
                    self.ask(round_trip);
                    continue;
                }
            };
            match packets {
                Ok(packets) => self.deliver(packets).await,
                Err(fault) => return fault,
            }
        }
    }

    fn take_read(&mut self, read: Read) -> Result<Vec<Vec<u8>>, Fault> {
        match read {
            Ok(bytes) => self.take_stream(bytes).map_err(broken),
            Err(None) => Ok(Vec::new()),
            Err(Some(fault)) => Err(fault),
        }
    }

    fn take_stream(&mut self, bytes: Vec<u8>) -> Result<Vec<Vec<u8>>, &'static str> {
        match bytes.first() {
            Some(&REPAIR) => {
                let (header, packet) = bytes
                    .split_first_chunk::<REPAIR_BYTES>()
                    .ok_or("a stream of tiles is too short")?;
                let [_, block @ .., index] = *header;
                let packet = self.assembly.receive_repair(Repair {
                    block: u64::from_le_bytes(block),
                    index,
                    packet: packet.to_vec(),
                });
                Ok(packet.into_iter().collect())
            }
            Some(&LAST) => {
                let last = bytes[1..]
                    .try_into()
                    .map_err(|_| "the number of a block is cut off")?;
                let now = self.began.elapsed();
                self.assembly.expect(now, u64::from_le_bytes(last));
                Ok(Vec::new())
            }
            _ => {
                self.note(false);
                Ok(vec![bytes])
            }
        }
    }

    fn take_datagram(&mut self, bytes: &[u8]) -> Result<Vec<Vec<u8>>, &'static str> {
        self.note(true);
        let datagram = Datagram::parse(bytes).ok_or("a datagram cannot be read")?;
        self.assembly.receive(self.began.elapsed(), datagram)
    }

    fn ask(&mut self, round_trip: Duration) {
        let now = self.began.elapsed();
        while let Some(missing) = self.assembly.poll_missing(now, round_trip) {
            // One that does not leave is repeated like one that gets lost.
            let _ = self.connection.send_datagram(missing.to_bytes().into());
        }
    }

    async fn deliver(&self, packets: Vec<Vec<u8>>) {
        for bytes in packets {
            let channel = Channel::Tiles;
            let packet = Incoming::Packet(Packet { channel, bytes });
            let _ = self.to_session.send(packet).await;
        }
    }

    fn note(&self, datagrams: bool) {
        self.way.send_if_modified(|way| {
            let changed = way.datagrams != datagrams;
            way.datagrams = datagrams;
            changed
        });
    }
}

/// A stream's bytes; no fault if the node has dropped tiles that nobody waits for.
type Read = Result<Vec<u8>, Option<Fault>>;

async fn read_stream(mut stream: RecvStream) -> Read {
    match stream
        .read_to_end(limits::TILES_BYTES_MAX + REPAIR_BYTES)
        .await
    {
        Ok(bytes) => Ok(bytes),
        Err(ReadToEndError::Read(ReadError::Reset(_))) => Err(None),
        Err(ReadToEndError::Read(ReadError::ConnectionLost(why))) => Err(Some(Fault::Gone(why))),
        Err(why) => Err(Some(Fault::Rule(format!("a stream of tiles: {why}")))),
    }
}

fn broken(why: &str) -> Fault {
    Fault::Rule(why.into())
}

/// First byte of a stream with a packet that was lost as datagrams; no tile packet begins so.
const REPAIR: u8 = 0xff;
const REPAIR_BYTES: usize = 10;
/// Likewise of a stream that tells which block was the last.
const LAST: u8 = 0xfe;
/// What waits here beyond the window, the governor does not see and nobody can drop: enough that
/// the window is always full, 6 ms of 25 Mbit/s.
const SEND_BYTES_AHEAD: u64 = 16 << 10;
