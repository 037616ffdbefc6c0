//! Node behind a socket, in the process of the test.

use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;

use carom_farm::net::{Authority, NodeServer, Role, ServerEvent, StopHandle};
use carom_farm::node::Node;
use carom_tracer::{CpuTracer, Tracer};

use crate::greeter::today;

/// A node on a thread of its own; dropped, it ends.
pub(crate) struct RunningNode {
    pub(crate) address: SocketAddr,
    pub(crate) stop: StopHandle,
    thread: Option<JoinHandle<()>>,
}

impl RunningNode {
    /// A node that traces with one thread.
    pub(crate) fn start(authority: &Authority, address: SocketAddr) -> Self {
        let tracer = Arc::new(CpuTracer::with_threads(1).unwrap());
        Self::start_with(authority, address, tracer)
    }

    pub(crate) fn start_with(
        authority: &Authority,
        address: SocketAddr,
        tracer: Arc<dyn Tracer>,
    ) -> Self {
        Self::serve(authority, address, Node::new("any name", tracer))
    }

    pub(crate) fn serve(authority: &Authority, address: SocketAddr, node: Arc<Node>) -> Self {
        Self::serve_and_tell(authority, address, node, |_| {})
    }

    /// A node that hands over what becomes of its connections.
    pub(crate) fn serve_and_tell(
        authority: &Authority,
        address: SocketAddr,
        node: Arc<Node>,
        events: impl Fn(ServerEvent) + Clone + Send + Sync + 'static,
    ) -> Self {
        let credentials = authority.credentials(Role::Node, "oak", today()).unwrap();
        let server = NodeServer::bind(address, &credentials).unwrap();
        let address = server.local_addr().unwrap();
        let stop = StopHandle::default();
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            server.serve(&stopped, move |player, _| node.connect(player), events);
        });
        Self {
            address,
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for RunningNode {
    fn drop(&mut self) {
        self.stop.stop();
        let ended = self.thread.take().map(JoinHandle::join);
        if !std::thread::panicking() {
            ended.unwrap().unwrap();
        }
    }
}
