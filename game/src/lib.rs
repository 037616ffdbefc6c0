//! Carom.

pub mod sim;
