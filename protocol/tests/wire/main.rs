//! Laws of the wire: what is sent arrives as it was, whatever arrives does no harm.

mod any;
mod chunks;
mod delta;
mod document;
mod hostile;
mod messages;
mod pair;
mod particles;
mod tiles;
