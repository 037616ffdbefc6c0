//! Carom.
fn main() {}
