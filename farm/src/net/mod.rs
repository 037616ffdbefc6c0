//! Farms over QUIC: the only code that knows quinn, rustls, tokio and certificates.
//!
//! ```text
//! authority ──init, add──▶ folders ──load──▶ credentials ──▶ tls ──▶ endpoint
//!                                                                      │
//!            player: client ──▶ caller ──────┐                         │
//!                                            ├── packets ── sessions ──┘
//!            node:   server ──▶ listener ────┘      │
//!                                                 tiles ──▶ streams, or on lossy long paths (loss)
//!                                                           blocks ──▶ datagrams ──▶ assembly
//! ```
//!
//! Both ends prove who they are by a certificate of the farm's own authority that names their
//! role; nothing is allocated for a peer before it has. There is no other way to talk to a node
//! over a socket.

mod address;
pub mod authority;
pub mod client;
mod congestion;
mod connection_driver;
mod connection_error;
mod connector;
pub mod credentials;
mod endpoint;
mod fec;
mod listener;
mod path;
mod proxy;
pub mod server;
mod signals;
mod tile_transport;
mod tls;

pub use address::NodeAddress;
pub use authority::{Authority, Issued, add_node, create_farm};
pub use client::{Client, Command, LinkEvent, NodeLink};
pub use congestion::DelayWindow;
pub use connection_driver::Peer;
pub use credentials::{Credentials, Role};
pub(crate) use endpoint::IDLE;
pub use endpoint::{Congestion, Sending};
pub use path::{Path, PathConfig};
pub use proxy::{Proxy, ProxyCounts};
pub use server::{NodeServer, ServerEvent, Stop};
pub use signals::interruption;
