//! Farms over QUIC: the only code that names quinn, rustls, tokio and certificates.
//!
//! ```text
//! authority ──init, add-node──▶ folders ──▶ credentials ──▶ tls ──▶ endpoint
//!                                                                      │
//!            player: client ──▶ connector ───┐                         │
//!                                            ├── connection_driver ────┘
//!            node:   server ──▶ listener ────┘      │
//!                                            tile_transport ──▶ streams, or on lossy long paths
//!                                                               fec: encoder ──▶ datagrams ──▶ decoder
//! ```
//!
//! Both ends authenticate each other by certificates of the farm's own authority that name their
//! role; nothing is allocated for a peer before. There is no other way to reach a node over a socket.

mod address;
pub mod authority;
mod certificate;
pub mod client;
mod close_code;
mod congestion;
mod connection_driver;
mod connection_error;
mod connection_event;
mod connector;
pub mod credentials;
mod endpoint;
mod fec;
mod listener;
pub(crate) mod peer;
pub mod server;
mod signals;
mod tile_transport;
mod tls;

pub use address::NodeAddress;
pub use authority::{Authority, Issued, add_node, create_farm};
pub use client::{Client, LinkCommand, LinkEvent, NodeLink};
pub use congestion::DelayBasedController;
pub use connection_driver::PacketHandler;
pub use credentials::Credentials;
pub use endpoint::{CongestionControl, TransportOptions};
pub use peer::{CertificateFault, DisconnectReason, Role};
pub use server::{NodeServer, ServerEvent, StopHandle};
pub use signals::interruption;
