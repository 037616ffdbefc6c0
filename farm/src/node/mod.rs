//! A node: owns one tracer, traces what its clients ask for, and answers with encoded tiles.
//!
//! ```text
//! NodeConnection (NodeSession) ──Job──▶ queue ──▶ worker: Tracer::trace ─▶ groups of tiles
//!       ▲  one per client                                                      │
//!       └──────────────── TilesDone, RequestDone ◀── encoded on rayon's threads ◀──┘
//! ```
//!
//! A tracer that fails or panics costs a refused run, never the node. Stale and cancelled runs
//! leave the queue without being begun. Durations are measured on the node's own clock; busy time
//! counts only from when the device was through with earlier work, so that runs which overlap on
//! a GPU are not counted twice.

mod bitrate_control;
mod connection;
mod queue;
mod rate_model;
mod worker;

use std::sync::Arc;
use std::time::Duration;

use carom_protocol::NodeInfo;
use carom_tracer::{DeviceKind, Tracer};

pub use bitrate_control::LinkMeasure;
pub use connection::NodeConnection;
pub(crate) use connection::STALL_TIMEOUT;
use queue::Queue;

/// One device, shared by any number of clients.
pub struct Node {
    name: String,
    tracer: Arc<dyn Tracer>,
    queue: Arc<Queue>,
}

impl Node {
    /// Starts the worker threads of a node called `name`: two for a GPU, which then has the next
    /// frame's work before it has ended this one's, one for a processor, which is busy with one.
    pub fn new(name: impl Into<String>, tracer: Arc<dyn Tracer>) -> Arc<Self> {
        let workers = match tracer.info().kind {
            DeviceKind::Gpu => 2,
            DeviceKind::Cpu | DeviceKind::Scalar => 1,
        };
        let queue = Arc::new(Queue::new());
        for _ in 0..workers {
            worker::start(Arc::clone(&queue), Arc::clone(&tracer));
        }
        Arc::new(Self {
            name: name.into(),
            tracer,
            queue,
        })
    }

    /// What the node is: its device's name says of a device that has failed why.
    pub fn info(&self) -> NodeInfo {
        NodeInfo {
            name: self.name.clone(),
            device: self.tracer.info(),
        }
    }

    /// A session for a client that has just connected. Dropping it cancels all that the client
    /// has asked for.
    pub fn connect(&self) -> NodeConnection {
        NodeConnection::new(self.info(), Arc::clone(&self.queue))
    }
}

impl Drop for Node {
    /// Ends the workers, but does not wait for a device that hangs.
    fn drop(&mut self) {
        self.queue.close(WORKERS_PATIENCE);
    }
}

/// How long a device may go on after it has been told to stop.
const WORKERS_PATIENCE: Duration = Duration::from_secs(1);
