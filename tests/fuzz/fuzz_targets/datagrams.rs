//! Datagrams and blocks of forward error correction, as a player hears them.
#![no_main]
#![allow(
    dead_code,
    reason = "the farm's module as it is, of which a player's side is called"
)]

use std::time::Duration;

use fec::Retransmission;
use fec::datagram::Datagram;
use fec::decoder::FecDecoder;

#[path = "../../../farm/src/net/fec/mod.rs"]
mod fec;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let mut decoder = FecDecoder::default();
    let (mut now, mut heard, mut packets) = (Duration::ZERO, 0, 0);
    let mut rest = bytes;
    // Each datagram after its length and the milliseconds before it.
    while let Some(([what, length, millis], after)) = rest.split_first_chunk() {
        let (bytes, after) = after.split_at(usize::from(*length).min(after.len()));
        rest = after;
        now += Duration::from_millis(u64::from(*millis));
        heard += bytes.len();
        if *what == u8::MAX {
            let block = bytes
                .iter()
                .fold(0, |number, byte| number << 8 | u64::from(*byte));
            decoder.on_announcement(now, block);
            let packet = bytes.to_vec();
            let index = *length;
            drop(decoder.on_retransmission(Retransmission {
                block,
                index,
                packet,
            }));
        } else if let Some(datagram) = Datagram::parse(bytes) {
            let written = datagram.to_bytes();
            assert_eq!(Datagram::parse(&written), Some(datagram));
            match decoder.on_datagram(now, datagram) {
                Ok(complete) => packets += complete.iter().map(Vec::len).sum::<usize>(),
                Err(_) => return, // the connection ends
            }
        }
        drop(decoder.poll_nack(now, Duration::from_millis(40)));
    }
    // Repair symbols may restore what never came, but no more of it than blocks hold.
    assert!(
        packets <= 64 * heard.max(1),
        "{packets} bytes of packets from {heard}"
    );
});
