//! An in-process node, behind a socket and optionally an emulated link.

use std::net::{Ipv4Addr, SocketAddr};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use anyhow::Context;
use carom_farm::net::{Authority, Credentials, NodeServer, Role, StopHandle, TransportOptions};
use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};

use crate::BenchError;

/// A running node; ends when dropped.
pub(crate) struct ServedNode {
    /// Address for players.
    pub(crate) address: SocketAddr,
    /// The emulated link.
    pub(crate) proxy: Option<UdpProxy>,
    stop: StopHandle,
    thread: Option<JoinHandle<()>>,
}

impl ServedNode {
    /// Starts with a certificate of the authority; a link comes with the seed of its losses.
    pub(crate) fn start(
        authority: &Authority,
        options: TransportOptions,
        link: Option<(LinkConfig, u64)>,
        serve: impl FnOnce(NodeServer, &StopHandle) + Send + 'static,
    ) -> Result<Self, BenchError> {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let credentials = credentials(authority, Role::Node)?;
        let server = NodeServer::bind_with_options(any, &credentials, options)?;
        let address = server.local_addr()?;
        let proxy = link.map(|(link, seed)| UdpProxy::start(any, address, link, seed));
        let proxy = proxy.transpose().context("a proxy")?;
        let stop = StopHandle::default();
        let stopped = stop.clone();
        Ok(Self {
            address: proxy.as_ref().map_or(address, UdpProxy::local_addr),
            proxy,
            stop,
            thread: Some(std::thread::spawn(move || serve(server, &stopped))),
        })
    }

    /// Stops the node and waits for its end.
    pub(crate) fn end(&mut self) {
        self.stop.stop();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // a panic has been reported where it happened
        }
    }
}

impl Drop for ServedNode {
    fn drop(&mut self) {
        self.end();
    }
}

/// A certificate that is valid for a day before and after now.
pub(crate) fn credentials(
    authority: &Authority,
    role: Role,
) -> Result<Credentials, carom_farm::Error> {
    let now = SystemTime::now();
    let day = Duration::from_secs(24 * 3600);
    authority.credentials(role, "bench", now - day..now + day)
}
