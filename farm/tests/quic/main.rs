//! Farms over QUIC on the loopback interface: who is let in, and what holds when peers misbehave.

mod admission;
mod assets;
mod congestion;
mod directories;
mod drain;
mod farms;
mod greeter;
mod load;
mod nat_rebinding;
#[cfg(feature = "nats")]
mod nats;
mod running_node;
mod stranger;
mod trust;
