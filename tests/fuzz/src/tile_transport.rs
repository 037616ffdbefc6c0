//! Datagrams, streams and blocks of forward error correction, as a player hears them.

use std::time::Duration;

use fec::datagram::Datagram;
use fec::decoder::FecDecoder;
use fec::tile_stream::TileStream;

#[allow(
    dead_code,
    reason = "the farm's module as it is, of which a player's side is called"
)]
#[path = "../../../farm/src/net/fec/mod.rs"]
mod fec;

/// Blocks give packets or the rule that was broken; what parses is written as it was.
pub fn datagrams(bytes: &[u8]) {
    let mut decoder = FecDecoder::default();
    let (mut now, mut heard, mut packets) = (Duration::ZERO, 0, 0);
    let mut rest = bytes;
    // Each datagram or stream after its length and the milliseconds before it.
    while let Some(([what, length, millis], after)) = rest.split_first_chunk() {
        let (bytes, after) = after.split_at(usize::from(*length).min(after.len()));
        rest = after;
        now += Duration::from_millis(u64::from(*millis));
        heard += bytes.len();
        if *what == STREAM {
            match stream(&mut decoder, now, bytes) {
                Ok(packet) => packets += packet.map_or(0, |packet| packet.len()),
                Err(_) => return, // the connection ends
            }
        } else if let Some(datagram) = Datagram::parse(bytes) {
            let written = datagram.to_bytes();
            assert_eq!(Datagram::parse(&written), Some(datagram));
            match decoder.on_datagram(now, datagram) {
                Ok(complete) => packets += complete.iter().map(Vec::len).sum::<usize>(),
                Err(_) => return,
            }
        }
        let _ = decoder.poll_nack(now, Duration::from_millis(40));
    }
    // Repair symbols may restore what never came, but no more of it than blocks hold.
    assert!(
        packets <= 64 * heard.max(1),
        "{packets} bytes of packets from {heard}"
    );
}

/// The packet in a stream, if it is not to be thrown away.
fn stream(
    decoder: &mut FecDecoder,
    now: Duration,
    bytes: &[u8],
) -> Result<Option<Vec<u8>>, &'static str> {
    match TileStream::parse(bytes.to_vec())? {
        TileStream::Packet(packet) => {
            assert_eq!(packet, bytes);
            Ok(Some(packet))
        }
        TileStream::Retransmission(sent) => {
            let header = TileStream::retransmission_header(sent.block, sent.index);
            assert_eq!([&header[..], &sent.packet].concat(), bytes);
            Ok(decoder.on_retransmission(sent))
        }
        TileStream::LastBlock(last) => {
            assert_eq!(TileStream::last_block(last), bytes);
            decoder.on_announcement(now, last);
            Ok(None)
        }
    }
}

/// What a node sends: a block of one packet, whose second symbol only the repair brings; the announcement
/// of the last block, a packet once more, and one that was never lost.
pub fn datagrams_seeds() -> Vec<Vec<u8>> {
    let mut losses = fec::loss_estimator::LossEstimator::new();
    let mut encoder = fec::encoder::FecEncoder::default();
    let packet: Vec<u8> = (0..150).collect();
    let sent = encoder.push(Duration::ZERO, packet.clone(), 100, &mut losses);
    let mut datagrams = sent.unwrap_or_default();
    datagrams.extend(encoder.close(&mut losses));
    let lossy = datagrams
        .iter()
        .enumerate()
        .filter(|(index, _)| *index != 1);
    let lossy = lossy.flat_map(|(_, bytes)| heard(0, bytes)).collect();
    let again = [&TileStream::retransmission_header(0, 0)[..], &packet].concat();
    let streams = [TileStream::last_block(0), again, packet];
    let streams = streams.iter().flat_map(|bytes| heard(STREAM, bytes));
    vec![
        datagrams.iter().flat_map(|bytes| heard(0, bytes)).collect(),
        lossy,
        streams.collect(),
    ]
}

fn heard(what: u8, bytes: &[u8]) -> Vec<u8> {
    let length = u8::try_from(bytes.len()).expect("a short seed");
    [&[what, length, 1], bytes].concat()
}

/// Stands for a stream; any other byte for a datagram.
const STREAM: u8 = u8::MAX;
