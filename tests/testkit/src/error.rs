//! Errors of the test kit: invalid configurations.

use std::time::Duration;

/// A value out of its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A share of packets of a link.
    #[error("{quantity} is {share}: it must be from 0 to 1")]
    PacketShare {
        /// Name of the setting.
        quantity: &'static str,
        /// The share.
        share: f64,
    },
    /// Mean number of packets that are lost together.
    #[error("burst is {0}: it must be 1 or more")]
    Burst(f64),
    /// Rate of a link, in bits per second.
    #[error("the rate is {0}: it must be from 1e3 to 1e12 bits per second")]
    Rate(f64),
    /// Largest packets that pass a link, in bytes.
    #[error(
        "packets of at most {bytes_max} bytes pass: QUIC sends no shorter ones than {quic_bytes_min}"
    )]
    PacketBytes {
        /// Configured.
        bytes_max: usize,
        /// Smallest datagram size that QUIC needs: RFC 9000, 14.
        quic_bytes_min: usize,
    },
    /// Delay or jitter of a link.
    #[error("delay or jitter is {delay:?}: it must be at most {delay_max:?}")]
    Delay {
        /// The longer of both.
        delay: Duration,
        /// Maximum.
        delay_max: Duration,
    },
    /// A share of a device's time.
    #[error("a share of {0} is no part of a machine: it must be above 0 and at most 1")]
    DeviceShare(f64),
}
