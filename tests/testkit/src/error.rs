//! Errors of the test kit: configurations that cannot be.

use std::time::Duration;

/// A value out of its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A share of packets of a link.
    #[error("{quantity} is {share}: it must be from 0 to 1")]
    PacketShare {
        /// What is shared out.
        quantity: &'static str,
        /// The share.
        share: f64,
    },
    /// Packets that are lost together on average.
    #[error("burst is {0}: it must be 1 or more")]
    Burst(f64),
    /// Bits per second of a link.
    #[error("the rate is {0}: it must be from 1e3 to 1e12 bits per second")]
    Rate(f64),
    /// Bytes of the longest packets that pass a link.
    #[error(
        "packets of at most {bytes_max} bytes pass: QUIC sends no shorter ones than {quic_bytes_min}"
    )]
    PacketBytes {
        /// Configured.
        bytes_max: usize,
        /// RFC 9000, 14.
        quic_bytes_min: usize,
    },
    /// Delay or jitter of a link.
    #[error("delay or jitter is {delay:?}: it must be at most {delay_max:?}")]
    Delay {
        /// The longer of both.
        delay: Duration,
        /// The bound.
        delay_max: Duration,
    },
    /// A share of a device's time.
    #[error("a share of {0} is no part of a machine: it must be above 0 and at most 1")]
    DeviceShare(f64),
}
