//! Framing of packets in a byte stream: a length as a little-endian `u32`, then the packet.

use crate::error::{EMPTY, Error};
use crate::limits::TO_NODE_BYTES_MAX;

/// Prefixes a packet with its length, ready for a stream.
///
/// # Panics
/// If it is longer than any message, which no session hands out.
pub fn frame(packet: &[u8]) -> Vec<u8> {
    assert!(packet.len() <= TO_NODE_BYTES_MAX, "{} bytes", packet.len());
    let mut framed = Vec::with_capacity(LENGTH_BYTES + packet.len());
    framed.extend_from_slice(&(packet.len() as u32).to_le_bytes());
    framed.extend_from_slice(packet);
    framed
}

/// Splitter of a byte stream into packets, in whatever pieces the bytes arrive.
///
/// ```
/// let mut deframer = carom_protocol::framing::Deframer::new(1024);
/// let stream = carom_protocol::framing::frame(b"break");
/// deframer.push(&stream[..3]);
/// assert_eq!(deframer.next_packet(), Ok(None));
/// deframer.push(&stream[3..]);
/// assert_eq!(deframer.next_packet(), Ok(Some(b"break".to_vec())));
/// ```
#[derive(Debug)]
pub struct Deframer {
    /// Bytes that have been pushed; the packets before `start` have been handed out.
    bytes: Vec<u8>,
    start: usize,
    packet_bytes_max: usize,
}

impl Deframer {
    /// A deframer for packets of up to `packet_bytes_max` bytes: [`TO_NODE_BYTES_MAX`] at a node,
    /// [`crate::limits::CONTROL_BYTES_MAX`] at a client.
    pub const fn new(packet_bytes_max: usize) -> Self {
        Self {
            bytes: Vec::new(),
            start: 0,
            packet_bytes_max,
        }
    }

    /// Appends the next bytes of the stream. Call [`Deframer::next_packet`] afterwards until it returns
    /// `None`: then less than one packet is buffered, and no more than has been pushed.
    pub fn push(&mut self, bytes: &[u8]) {
        // The remainder is moved once for all packets that were handed out since the last push.
        self.bytes.drain(..self.start);
        self.start = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// The next complete packet, or `None` until more bytes are pushed.
    ///
    /// # Errors
    /// [`Error::TooLarge`] or [`Error::Malformed`] as soon as a length is out of range, without waiting
    /// for its packet. The stream is unusable afterwards.
    pub fn next_packet(&mut self) -> Result<Option<Vec<u8>>, Error> {
        let rest = &self.bytes[self.start..];
        let Some((&length, rest)) = rest.split_first_chunk::<LENGTH_BYTES>() else {
            return Ok(None);
        };
        let length = u32::from_le_bytes(length) as usize;
        if length == 0 {
            return Err(Error::malformed("packet", EMPTY));
        }
        if length > self.packet_bytes_max {
            return Err(Error::TooLarge {
                what: "packet",
                bytes: length as u64,
                max: self.packet_bytes_max as u64,
            });
        }
        let Some(packet) = rest.get(..length) else {
            return Ok(None);
        };
        let packet = packet.to_vec();
        self.start += LENGTH_BYTES + length;
        Ok(Some(packet))
    }
}

const LENGTH_BYTES: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn length_out_of_range_is_refused_before_its_packet() {
        let mut deframer = Deframer::new(100);
        deframer.push(&101u32.to_le_bytes());
        let (bytes, max) = (101, 100);
        let what = "packet";
        assert_eq!(
            deframer.next_packet(),
            Err(Error::TooLarge { what, bytes, max })
        );
        let mut deframer = Deframer::new(100);
        deframer.push(&[0; 4]);
        assert!(matches!(
            deframer.next_packet(),
            Err(Error::Malformed { .. })
        ));
    }

    #[test]
    fn packets_come_out_whole_whatever_the_pieces() {
        let packets: Vec<Vec<u8>> = (1..40).map(|n| vec![n as u8; n * 7]).collect();
        let stream: Vec<u8> = packets.iter().flat_map(|packet| frame(packet)).collect();
        for piece in [1, 2, 3, 5, 64, 1000, stream.len()] {
            let mut deframer = Deframer::new(1000);
            let mut out = Vec::new();
            for bytes in stream.chunks(piece) {
                deframer.push(bytes);
                while let Some(packet) = deframer.next_packet().unwrap() {
                    out.push(packet);
                }
            }
            assert_eq!(out, packets);
        }
    }
}
