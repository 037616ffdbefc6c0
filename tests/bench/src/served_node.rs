//! A node in this process, behind a socket and perhaps an emulated link.

use std::net::{Ipv4Addr, SocketAddr};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use anyhow::Context;
use carom_farm::net::{Authority, Credentials, NodeServer, Role, StopHandle, TransportOptions};
use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};

use crate::BenchError;

/// A node that players reach; it has ended when dropped.
pub(crate) struct ServedNode {
    /// Where they do.
    pub(crate) address: SocketAddr,
    /// Of the emulated link.
    pub(crate) proxy: Option<UdpProxy>,
    stop: StopHandle,
    thread: Option<JoinHandle<()>>,
}

impl ServedNode {
    /// Begins with a certificate of the authority's; a link comes with what draws its losses.
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

    /// Ends the node, and waits for it.
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

/// A certificate for today.
pub(crate) fn credentials(
    authority: &Authority,
    role: Role,
) -> Result<Credentials, carom_farm::Error> {
    let now = SystemTime::now();
    let day = Duration::from_secs(24 * 3600);
    authority.credentials(role, "bench", now - day..now + day)
}
