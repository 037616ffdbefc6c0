//! Transport of tile packets: each on a stream of its own or, if the path is long and loses packets, as
//! datagrams with [forward error correction](super::fec).

use std::collections::VecDeque;
use std::future::{Future, poll_fn};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::Poll;
use std::time::{Duration, Instant};

use carom_protocol::limits;
use carom_protocol::session::{Channel, Packet};
use carom_protocol::{RequestId, codec};
use quinn::{Connection, ConnectionError, ReadError, RecvStream, SendDatagramError, WriteError};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use super::close_code;
use super::connection_event::{Arrival, ConnectionEnd};
use super::fec::Retransmission;
use super::fec::datagram::Datagram;
use super::fec::decoder::FecDecoder;
use super::fec::encoder::FecEncoder;
use super::fec::loss_estimator::LossEstimator;
use super::fec::tile_stream::{RETRANSMISSION_HEADER_BYTES, TileStream};
use crate::Error;

/// Current transport of a node's tiles, as known at either end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct TileTransport {
    /// Whether the last tiles travelled as datagrams.
    pub(crate) datagrams: bool,
    /// Bytes on the path per byte of tiles, at least 1.
    pub(crate) overhead: f64,
}

/// A player's report of a block that it cannot decode.
pub(crate) struct Nack {
    pub(crate) block: u64,
    /// Bit i: source symbol i has been received.
    pub(crate) received: u64,
}

/// Node's end of the transport. Packets wait in the session while the network is busy, where they can still
/// be dropped.
pub(crate) struct TileSender {
    connection: Connection,
    /// Requests that are no longer wanted: their streams are reset, so that their lost packets are not
    /// retransmitted.
    cancelled: watch::Receiver<VecDeque<RequestId>>,
    transport: watch::Sender<TileTransport>,
    start: Instant,
    losses: LossEstimator,
    encoder: FecEncoder,
    /// Whether this end sends datagrams at all.
    fec: bool,
    /// Tasks that wait for the acknowledgement of written streams.
    unacknowledged: JoinSet<()>,
}

impl TileSender {
    pub(crate) fn new(
        connection: Connection,
        cancelled: watch::Receiver<VecDeque<RequestId>>,
        transport: watch::Sender<TileTransport>,
    ) -> Self {
        let fec = connection.datagram_send_buffer_space() > 0;
        Self {
            connection,
            fec,
            cancelled,
            transport,
            start: Instant::now(),
            losses: LossEstimator::new(),
            encoder: FecEncoder::default(),
            unacknowledged: JoinSet::new(),
        }
    }

    /// Sends packets until the channel closes.
    pub(crate) async fn run(
        mut self,
        mut packets: mpsc::Receiver<Vec<u8>>,
        mut nacks: mpsc::Receiver<Nack>,
    ) -> ConnectionEnd {
        loop {
            while self.unacknowledged.try_join_next().is_some() {}
            // Either the open block has to be closed, or the last one announced; never both.
            let timeout = self.encoder.close_timeout();
            let timeout = timeout.or_else(|| self.encoder.announce_timeout());
            let timeout = timeout.map(|timeout| self.start + timeout);
            let sent = tokio::select! {
                packet = packets.recv() => match packet {
                    Some(packet) => self.send(packet).await,
                    None => return ConnectionEnd::Lost(ConnectionError::LocallyClosed),
                },
                Some(nack) = nacks.recv() => self.retransmit(nack).await,
                () = sleep_until(timeout) => self.on_timeout().await,
            };
            if let Err(end) = sent {
                return end;
            }
        }
    }

    async fn send(&mut self, packet: Vec<u8>) -> Result<(), ConnectionEnd> {
        let request = codec::request_of_tiles(&packet);
        if self.is_cancelled(request) {
            return Ok(());
        }
        let Some(datagram_bytes) = self.choose_transport() else {
            return self.send_stream(request, &[&packet]).await;
        };
        let now = self.start.elapsed();
        let losses = &mut self.losses;
        match self.encoder.push(now, packet, datagram_bytes, losses) {
            Ok(datagrams) => self.send_datagrams(datagrams).await,
            Err(packet) => self.send_stream(request, &[&packet]).await,
        }
    }

    /// The maximum length of datagrams if tiles are to travel in them; `None` for streams.
    fn choose_transport(&mut self) -> Option<usize> {
        let path = self.connection.stats().path;
        self.losses.observe(path.sent_packets, path.lost_packets);
        let wants_fec = self.fec && self.losses.wants_fec(path.rtt);
        let datagram_bytes = self.connection.max_datagram_size().filter(|_| wants_fec);
        let transport = match datagram_bytes {
            Some(_) => TileTransport {
                datagrams: true,
                overhead: self.losses.overhead(),
            },
            None => TileTransport {
                datagrams: false,
                overhead: 1.0,
            },
        };
        self.transport.send_if_modified(|before| {
            let changed = *before != transport;
            *before = transport;
            changed
        });
        datagram_bytes
    }

    async fn send_datagrams(&mut self, datagrams: Vec<Vec<u8>>) -> Result<(), ConnectionEnd> {
        for datagram in datagrams {
            match self.connection.send_datagram_wait(datagram.into()).await {
                // The path MTU has just shrunk: the datagram counts as lost.
                Ok(()) | Err(SendDatagramError::TooLarge) => {}
                Err(SendDatagramError::ConnectionLost(error)) => {
                    return Err(ConnectionEnd::Lost(error));
                }
                Err(error) => return Err(broken(error)),
            }
        }
        Ok(())
    }

    /// Closes the open block and sends its repair symbols, or announces the last block.
    async fn on_timeout(&mut self) -> Result<(), ConnectionEnd> {
        if self.encoder.close_timeout().is_some() {
            let repair = self.encoder.close(&mut self.losses);
            return self.send_datagrams(repair).await;
        }
        match self.encoder.announce_last() {
            Some(last) => {
                let bytes = TileStream::last_block(last);
                self.send_stream(None, &[&bytes]).await
            }
            None => Ok(()),
        }
    }

    async fn retransmit(&mut self, nack: Nack) -> Result<(), ConnectionEnd> {
        let packets = self.encoder.retransmit(nack.block, nack.received);
        if !packets.is_empty() {
            self.losses.on_decoding_failure();
        }
        for Retransmission {
            block,
            index,
            packet,
        } in packets
        {
            let request = codec::request_of_tiles(&packet);
            if self.is_cancelled(request) {
                continue;
            }
            let header = TileStream::retransmission_header(block, index);
            self.send_stream(request, &[&header, &packet]).await?;
        }
        Ok(())
    }

    fn is_cancelled(&self, request: Option<RequestId>) -> bool {
        request.is_some_and(|request| self.cancelled.borrow().contains(&request))
    }

    async fn send_stream(
        &mut self,
        request: Option<RequestId>,
        parts: &[&[u8]],
    ) -> Result<(), ConnectionEnd> {
        let mut cancelled = self.cancelled.clone();
        let cwnd = self.connection.stats().path.cwnd;
        // The initial send window of 4 MB would hide the queue from the bitrate control.
        self.connection
            .set_send_window(cwnd + (cwnd / 8).max(SEND_BYTES_AHEAD));
        let stream = self.connection.open_uni().await;
        let mut stream = stream.map_err(ConnectionEnd::Lost)?;
        let write = async {
            for part in parts {
                stream.write_all(part).await?;
            }
            Ok(())
        };
        let written = tokio::select! {
            written = write => Some(written),
            () = wait_until_cancelled(&mut cancelled, request) => None,
        };
        match written {
            None => drop(stream.reset(close_code::STALE)),
            Some(Ok(())) => {
                let _ = stream.finish();
                // Held until the stream is acknowledged, so that a cancellation can still stop its
                // retransmissions.
                self.unacknowledged.spawn(async move {
                    tokio::select! {
                        _ = stream.stopped() => {}
                        () = wait_until_cancelled(&mut cancelled, request) => {
                            drop(stream.reset(close_code::STALE));
                        }
                    }
                });
            }
            // The player no longer wants these tiles.
            Some(Err(WriteError::Stopped(_))) => {}
            Some(Err(WriteError::ConnectionLost(error))) => {
                return Err(ConnectionEnd::Lost(error));
            }
            Some(Err(error)) => return Err(broken(error)),
        }
        Ok(())
    }
}

/// Waits until `request` is cancelled; never completes if the connection ends before, or without a request.
async fn wait_until_cancelled(
    cancelled: &mut watch::Receiver<VecDeque<RequestId>>,
    request: Option<RequestId>,
) {
    let is_cancelled =
        |requests: &VecDeque<RequestId>| request.is_some_and(|request| requests.contains(&request));
    if cancelled.wait_for(is_cancelled).await.is_err() {
        std::future::pending::<()>().await;
    }
}

/// Sleeps until `deadline`; never completes without one.
async fn sleep_until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => tokio::time::sleep_until(deadline.into()).await,
        None => std::future::pending().await,
    }
}

/// Player's end of the transport.
pub(crate) struct TileReceiver {
    connection: Connection,
    to_session: mpsc::Sender<Arrival>,
    transport: watch::Sender<TileTransport>,
    start: Instant,
    decoder: FecDecoder,
}

impl TileReceiver {
    pub(crate) fn new(
        connection: Connection,
        to_session: mpsc::Sender<Arrival>,
        transport: watch::Sender<TileTransport>,
    ) -> Self {
        Self {
            connection,
            to_session,
            transport,
            start: Instant::now(),
            decoder: FecDecoder::default(),
        }
    }

    /// Receives tiles until the connection ends. QUIC's limit on concurrent streams bounds how many are read
    /// at once.
    pub(crate) async fn run(mut self) -> ConnectionEnd {
        let mut streams: JoinSet<StreamRead> = JoinSet::new();
        let unfinished = Arc::new(AtomicUsize::new(0));
        loop {
            let rtt = self.connection.rtt();
            let timeout = self.decoder.nack_timeout(rtt);
            let timeout = timeout.map(|timeout| self.start + timeout);
            let packets = tokio::select! {
                stream = self.connection.accept_uni() => match stream {
                    Ok(stream) => {
                        let tiles = UnfinishedTiles::new(Arc::clone(&unfinished));
                        let mut read = Box::pin(read_stream(stream, tiles));
                        // Short streams have usually arrived completely, and need no task that must be woken.
                        match poll_fn(|cx| Poll::Ready(read.as_mut().poll(cx))).await {
                            Poll::Ready(read) => self.on_read(read),
                            Poll::Pending => {
                                streams.spawn(read);
                                continue;
                            }
                        }
                    }
                    Err(error) => return ConnectionEnd::Lost(error),
                },
                Some(read) = streams.join_next() => match read {
                    Ok(read) => self.on_read(read),
                    Err(_) => continue,
                },
                datagram = self.connection.read_datagram() => match datagram {
                    Ok(bytes) => self.on_datagram(&bytes).map_err(violation),
                    Err(error) => return ConnectionEnd::Lost(error),
                },
                () = sleep_until(timeout) => {
                    self.send_nacks(rtt);
                    continue;
                }
            };
            match packets {
                Ok(packets) => self.deliver(packets).await,
                Err(end) => return end,
            }
        }
    }

    fn on_read(&mut self, read: StreamRead) -> Result<Vec<Vec<u8>>, ConnectionEnd> {
        match read {
            Ok(bytes) => self.on_stream(bytes).map_err(violation),
            Err(None) => Ok(Vec::new()),
            Err(Some(end)) => Err(end),
        }
    }

    fn on_stream(&mut self, bytes: Vec<u8>) -> Result<Vec<Vec<u8>>, &'static str> {
        match TileStream::parse(bytes)? {
            TileStream::Retransmission(sent) => {
                let packet = self.decoder.on_retransmission(sent);
                Ok(packet.into_iter().collect())
            }
            TileStream::LastBlock(last) => {
                self.decoder.on_announcement(self.start.elapsed(), last);
                Ok(Vec::new())
            }
            TileStream::Packet(bytes) => {
                self.set_transport(false);
                Ok(vec![bytes])
            }
        }
    }

    fn on_datagram(&mut self, bytes: &[u8]) -> Result<Vec<Vec<u8>>, &'static str> {
        self.set_transport(true);
        let datagram = Datagram::parse(bytes).ok_or("a datagram is malformed")?;
        self.decoder.on_datagram(self.start.elapsed(), datagram)
    }

    fn send_nacks(&mut self, rtt: Duration) {
        let now = self.start.elapsed();
        while let Some(nack) = self.decoder.poll_nack(now, rtt) {
            // A NACK that cannot be sent is repeated like a lost one.
            let _ = self.connection.send_datagram(nack.to_bytes().into());
        }
    }

    async fn deliver(&self, packets: Vec<Vec<u8>>) {
        for bytes in packets {
            let channel = Channel::Tiles;
            let packet = Arrival::Packet(Packet::new(channel, bytes));
            let _ = self.to_session.send(packet).await;
        }
    }

    fn set_transport(&self, datagrams: bool) {
        self.transport.send_if_modified(|transport| {
            let changed = transport.datagrams != datagrams;
            transport.datagrams = datagrams;
            changed
        });
    }
}

/// The bytes of a stream; `Err(None)` if the node has reset it since its tiles are cancelled.
type StreamRead = Result<Vec<u8>, Option<ConnectionEnd>>;

/// Reads a stream in order into one buffer: keeping the received chunks would keep their whole packets in
/// memory.
async fn read_stream(mut stream: RecvStream, mut tiles: UnfinishedTiles) -> StreamRead {
    loop {
        match stream.read_chunk(STREAM_BYTES_MAX, true).await {
            Ok(Some(chunk)) => tiles
                .push(&chunk.bytes)
                .map_err(|rule| Some(violation(rule)))?,
            Ok(None) => return Ok(std::mem::take(&mut tiles.bytes)),
            Err(ReadError::Reset(_)) => return Err(None),
            Err(ReadError::ConnectionLost(error)) => return Err(Some(ConnectionEnd::Lost(error))),
            Err(error) => return Err(Some(broken(error))),
        }
    }
}

/// Bytes of an unfinished stream, counted together with those of the connection's other streams.
struct UnfinishedTiles {
    bytes: Vec<u8>,
    counted: usize,
    total: Arc<AtomicUsize>,
}

impl UnfinishedTiles {
    const fn new(total: Arc<AtomicUsize>) -> Self {
        let bytes = Vec::new();
        Self {
            bytes,
            counted: 0,
            total,
        }
    }

    fn push(&mut self, bytes: &[u8]) -> Result<(), String> {
        self.counted += bytes.len();
        // Relaxed, since the sum is only compared with a bound and orders no other memory access.
        let total = self.total.fetch_add(bytes.len(), Ordering::Relaxed) + bytes.len();
        if self.counted > STREAM_BYTES_MAX {
            return Err(format!(
                "a stream has {} bytes or more, and a tile message at most {STREAM_BYTES_MAX}: {UPDATE}",
                self.counted
            ));
        }
        if total > UNFINISHED_BYTES_MAX {
            return Err(format!(
                "{total} bytes are in streams that have not ended, of at most {UNFINISHED_BYTES_MAX}: {UPDATE}"
            ));
        }
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }
}

impl Drop for UnfinishedTiles {
    fn drop(&mut self) {
        self.total.fetch_sub(self.counted, Ordering::Relaxed);
    }
}

fn violation(rule: impl Into<String>) -> ConnectionEnd {
    ConnectionEnd::Violation(Error::ErrorCorrection(rule.into()))
}

fn broken(error: impl std::fmt::Display) -> ConnectionEnd {
    ConnectionEnd::Violation(Error::Stream {
        content: "tiles",
        reason: error.to_string(),
    })
}

/// Advice about a node that sends what no node of this version would.
const UPDATE: &str = "restart the node, and update the older of the two programs";
const STREAM_BYTES_MAX: usize = limits::TILES_BYTES_MAX + RETRANSMISSION_HEADER_BYTES;
/// Maximum bytes in unfinished streams of one node, four times what a node sends unacknowledged. Reading
/// extends the window of flow control, which therefore does not bound them.
const UNFINISHED_BYTES_MAX: usize = 16 << 20;
/// Bytes buffered beyond the congestion window, which the bitrate control does not see and nobody can drop:
/// enough to keep the window full, 6 ms at 25 Mbit/s.
const SEND_BYTES_AHEAD: u64 = 16 << 10;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unfinished_streams_share_one_budget() {
        let total = Arc::new(AtomicUsize::new(0));
        let open = || UnfinishedTiles::new(Arc::clone(&total));
        let chunk = vec![0; 1 << 20];
        let mut streams: Vec<UnfinishedTiles> = (0..16).map(|_| open()).collect();
        for stream in &mut streams {
            stream.push(&chunk).unwrap();
        }
        let why = open().push(&[0]).unwrap_err();
        assert!(why.starts_with("16777217 bytes") && why.contains("at most 16777216: restart"));
        streams.pop();
        open().push(&chunk).unwrap();
        drop(streams);
        assert_eq!(total.load(Ordering::Relaxed), 0);
        assert!(open().push(&vec![0; STREAM_BYTES_MAX + 1]).is_err());
    }
}
