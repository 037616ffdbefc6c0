//! Network layer of a farm: QUIC connections with mutual authentication. The only code that names quinn,
//! rustls, tokio and certificates.
//!
//! ```text
//! authority ──init, add-node, join──▶ folders ──▶ credentials ──▶ tls ──▶ endpoint
//!                                                                      │
//!            player: client ──▶ connector ───┐                         │
//!                                            ├── connection_driver ────┘
//!            node:   server ──▶ listener ────┘      │
//!                                            tile_transport ──▶ streams; on lossy long paths
//!                                                               datagrams with fec
//! ```
//!
//! Both ends authenticate each other by certificates from the farm's own authority that state their role;
//! nothing is allocated for a peer before that. There is no other way to reach a node over a socket.
//!
//! # Measurements of the transport
//!
//! 31.5 Mbit/s of tiles over a round trip of 46 ms, by `carom-bench transport --seconds 10` with seeds 1 to 3
//! on an idle machine of 16 cores; medians. A tile is missing if it has not arrived
//! within 100 ms of its request; the 99th percentile is of those that have.
//!
//! | path | | `congestion`, `fec` | `congestion`, streams | BBR, streams | Cubic, streams |
//! |---|---|---|---|---|---|
//! | clean | p99 | 25.4 ms | 25.5 ms | 25.5 ms | 25.3 ms |
//! | | slow frames of the first 60 | 0 | 0 | 0 | 16 |
//! | 1 % loss | p99 | 28.3 ms | 26.6 ms | 25.5 ms | 92.2 ms |
//! | | missing | 0.00 % | 4.63 % | 4.07 % | 99.1 % |
//! | 1 % loss, four at a time | p99 | 28.2 ms | 25.4 ms | 25.4 ms | 92.0 ms |
//! | | missing | 0.01 % | 2.43 % | 2.62 % | 98.9 % |
//! | 25 Mbit/s | p99 | 90.6 ms | 91.8 ms | 89.6 ms | 89.6 ms |
//! | | missing | 82.9 % | 69.5 % | 97.9 % | 95.4 % |
//! | | p99 in the link's queue | 25.6 ms | 20.2 ms | 335 ms | 335 ms |
//! | 25 Mbit/s, bitrate control | p99 | 62.1 ms | | | |
//! | | missing | 0.01 % | | | |
//!
//! Error correction is worth its cost: without it 2 to 5 % of the tiles miss their deadline on a lossy path.
//! So is the delay-based window: on a slow link BBR and Cubic keep a third of a second of data in the queue,
//! which leaves bitrate control no signal. quinn's controllers remain selectable for comparison.

mod address;
pub mod authority;
mod certificate;
mod certificate_fields;
pub mod client;
mod close_code;
mod congestion;
mod connection_driver;
mod connection_error;
mod connection_event;
mod connector;
mod credential_files;
pub mod credentials;
mod deny_list;
mod encrypted_key;
mod endpoint;
mod enrolment;
#[doc(hidden)]
pub mod enrolment_messages;
pub mod enrolment_service;
pub mod farm_folder;
mod fec;
mod flood_filter;
mod handshakes;
mod issuance;
mod join_url;
mod listener;
mod migration;
pub(crate) mod peer;
mod places;
mod player_account;
pub(crate) mod runtime;
pub mod server;
mod signals;
mod tile_transport;
mod tls;

pub use address::NodeAddress;
pub use authority::{Authority, IssuedCertificate};
pub use certificate_fields::utc;
pub use client::{Client, LinkCommand, LinkEvent, NodeLink};
pub use congestion::DelayBasedController;
pub use credentials::Credentials;
pub use endpoint::{CongestionControl, TransportOptions};
pub use enrolment::join;
pub use enrolment_service::{EnrolmentEvent, EnrolmentService};
pub use farm_folder::{AuthorityFolder, FIRST_PLAYER, add_node, create_farm, revoke};
pub use issuance::IssuanceRecord;
pub use join_url::JoinUrl;
pub use peer::{CertificateFault, DisconnectReason, NoPlace, Role};
pub use server::{NodeServer, ServerEvent, StopHandle};
pub use signals::interruption;

pub use crate::node::PacketHandler;
