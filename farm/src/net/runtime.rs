//! Tokio runtimes for the network's tasks.

use std::io;

use tokio::runtime::{Builder, Runtime};

/// A runtime on a thread of its own with this name.
///
/// One thread suffices: encryption takes 2 ms of a core per megabyte, and tiles are encoded elsewhere. Two
/// threads wake each other for each message: an answer of 64 KiB over loopback then takes a fifth more
/// processor time and leaves in smaller packets.
pub(crate) fn own_thread(name: &str) -> io::Result<Runtime> {
    let mut builder = Builder::new_multi_thread();
    builder.worker_threads(1).thread_name(name).enable_all();
    builder.build()
}

/// A runtime on the thread that blocks on its tasks.
pub(crate) fn waiting_thread() -> io::Result<Runtime> {
    Builder::new_current_thread().enable_all().build()
}
