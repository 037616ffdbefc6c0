//! Forward error correction of tile packets on long paths that lose packets: blocks of datagrams
//! with repair symbols, from which a receiver computes those that were lost.

mod block;
pub(crate) mod datagram;
pub(crate) mod decoder;
pub(crate) mod encoder;
pub(crate) mod loss_estimator;
