//! Health probes and metrics of a node over HTTP, without authentication: on a port that only its own
//! machine, or its cluster, can reach.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::NodeInfo;
use carom_protocol::limits::{PROBE_SECS_MAX, PROBES_MAX};
use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::{CONTENT_TYPE, ORIGIN};
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;

use super::NodeCounters;
use crate::Error;
use crate::net::{StopHandle, runtime};

/// Subject of the probes.
#[derive(Clone)]
pub struct NodeProbe {
    /// Counters of the node.
    pub counters: Arc<NodeCounters>,
    /// Its current name and device.
    pub info: Arc<dyn Fn() -> NodeInfo + Send + Sync>,
    /// Handle that stops it.
    pub stop: StopHandle,
}

/// HTTP server on its own thread, which runs until the process ends.
///
/// | request | answer |
/// |---|---|
/// | `GET /healthz` | 200 while the process runs |
/// | `GET /readyz` | 200 while it accepts players, 503 once it drains |
/// | `GET /metrics` | the counters, for Prometheus |
/// | `POST /drain` | 202, and the node finishes its work and ends; only from its own machine |
#[derive(Debug)]
pub struct HealthServer {
    address: SocketAddr,
}

impl HealthServer {
    /// Listens at `address`.
    ///
    /// # Errors
    /// [`Error::Socket`] if the address is in use or not one of this machine.
    pub fn start(address: SocketAddr, probe: NodeProbe) -> Result<Self, Error> {
        let port = format!("the health port {address}");
        let failed = Error::socket(&port);
        let runtime = runtime::waiting_thread().map_err(failed)?;
        let listener = runtime.block_on(TcpListener::bind(address));
        let listener = listener.map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        std::thread::Builder::new()
            .name("carom-health".into())
            .spawn(move || runtime.block_on(listen(listener, probe)))
            .map_err(failed)?;
        Ok(Self { address })
    }

    /// The bound address, with the port that the system chose if 0 was asked for.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

async fn listen(listener: TcpListener, probe: NodeProbe) {
    let places = Arc::new(Semaphore::new(PROBES_MAX));
    loop {
        let (Ok(place), accepted) = (
            // The permit first: while all are taken, connections wait in the system's queue and use no
            // memory here.
            Arc::clone(&places).acquire_owned().await,
            listener.accept().await,
        ) else {
            return; // the semaphore is never closed
        };
        match accepted {
            Ok((stream, peer)) => {
                let probe = probe.clone();
                tokio::spawn(async move {
                    serve(stream, peer, probe).await;
                    drop(place);
                });
            }
            Err(why) => {
                tracing::warn!("the health port cannot accept: {why}");
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

/// Serves one request per connection.
async fn serve(stream: TcpStream, peer: SocketAddr, probe: NodeProbe) {
    let answer = service_fn(|request: Request<Incoming>| {
        let response = answer(&request, peer, &probe);
        async move { Ok::<_, Infallible>(response) }
    });
    let connection = hyper::server::conn::http1::Builder::new()
        .keep_alive(false)
        .max_buf_size(REQUEST_BYTES_MAX)
        .serve_connection(TokioIo::new(stream), answer);
    match tokio::time::timeout(Duration::from_secs(PROBE_SECS_MAX), connection).await {
        Ok(Ok(())) => {}
        Ok(Err(why)) => tracing::debug!("a probe from {peer}: {why}"),
        Err(_) => tracing::debug!("a probe from {peer} took too long"),
    }
}

fn answer<B>(request: &Request<B>, peer: SocketAddr, probe: &NodeProbe) -> Response<Full<Bytes>> {
    let figures = probe.counters.figures();
    let (status, text) = match (request.method(), request.uri().path()) {
        (&Method::GET, "/healthz") => (StatusCode::OK, "ok\n".to_owned()),
        (&Method::GET, "/readyz") if figures.draining => {
            (StatusCode::SERVICE_UNAVAILABLE, "draining\n".to_owned())
        }
        (&Method::GET, "/readyz") => (StatusCode::OK, "ready\n".to_owned()),
        (&Method::GET, "/metrics") => (StatusCode::OK, figures.prometheus(&(probe.info)())),
        // A web page open in a browser on this machine could send a POST, but the browser adds its origin.
        (&Method::POST, "/drain")
            if peer.ip().to_canonical().is_loopback()
                && !request.headers().contains_key(ORIGIN) =>
        {
            probe.stop.stop();
            (StatusCode::ACCEPTED, "draining\n".to_owned())
        }
        (&Method::POST, "/drain") => (
            StatusCode::FORBIDDEN,
            "only this machine may end its node\n".to_owned(),
        ),
        (_, "/healthz" | "/readyz" | "/metrics" | "/drain") => {
            (StatusCode::METHOD_NOT_ALLOWED, "wrong method\n".to_owned())
        }
        _ => (
            StatusCode::NOT_FOUND,
            "there are /healthz, /readyz, /metrics and POST /drain\n".to_owned(),
        ),
    };
    let mut response = Response::new(Full::from(text));
    *response.status_mut() = status;
    let plain = hyper::header::HeaderValue::from_static("text/plain; version=0.0.4");
    response.headers_mut().insert(CONTENT_TYPE, plain);
    response
}

/// Maximum bytes of a request's head, of which a probe has some hundred: the minimum that hyper allows.
const REQUEST_BYTES_MAX: usize = 8192;
/// Pause after a failed accept, as when the process is out of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};

    use carom_tracer::{DeviceInfo, DeviceKind};

    use super::*;

    fn probe() -> NodeProbe {
        let device = DeviceInfo {
            kind: DeviceKind::Cpu,
            name: "test".into(),
            width: 1,
            threads: 1,
        };
        let name = String::from("oak");
        let info = NodeInfo {
            name,
            instance: 0,
            device,
        };
        NodeProbe {
            counters: Arc::default(),
            info: Arc::new(move || info.clone()),
            stop: StopHandle::default(),
        }
    }

    fn exchange(server: &HealthServer, request: &str) -> String {
        let mut stream = std::net::TcpStream::connect(server.address()).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn probes_are_answered_without_a_key() {
        let probe = probe();
        let any_port = SocketAddr::from(([127, 0, 0, 1], 0));
        let server = HealthServer::start(any_port, probe.clone()).unwrap();
        let ask = |line: &str| exchange(&server, &format!("{line} HTTP/1.1\r\nHost: a\r\n\r\n"));
        assert!(ask("GET /healthz").starts_with("HTTP/1.1 200"));
        assert!(ask("GET /readyz").starts_with("HTTP/1.1 200"));
        assert!(ask("GET /metrics").contains("carom_node_info{name=\"oak\""));
        assert!(ask("GET /drain").starts_with("HTTP/1.1 405"));
        assert!(ask("GET /").starts_with("HTTP/1.1 404"));
        assert!(ask("nonsense").starts_with("HTTP/1.1 400"));
        probe.counters.drain();
        assert!(ask("GET /readyz").starts_with("HTTP/1.1 503"));
        assert!(ask("GET /healthz").starts_with("HTTP/1.1 200"));
    }

    #[test]
    fn strangers_and_pages_of_browsers_end_no_node() {
        let probe = probe();
        let drain = |origin: Option<&str>, peer: &str| {
            let mut request = Request::post("/drain");
            if let Some(origin) = origin {
                request = request.header(ORIGIN, origin);
            }
            let request = request.body(()).unwrap();
            answer(&request, peer.parse().unwrap(), &probe).status()
        };
        assert_eq!(drain(None, "10.0.0.7:5"), StatusCode::FORBIDDEN);
        let page = Some("https://example.org");
        assert_eq!(drain(page, "127.0.0.1:5"), StatusCode::FORBIDDEN);
        assert_eq!(drain(None, "127.0.0.1:5"), StatusCode::ACCEPTED);
        assert_eq!(drain(None, "[::1]:5"), StatusCode::ACCEPTED);
        assert_eq!(drain(None, "[::ffff:127.0.0.1]:5"), StatusCode::ACCEPTED);
    }

    #[test]
    fn a_silent_connection_keeps_nobody_waiting() {
        let any_port = SocketAddr::from(([127, 0, 0, 1], 0));
        let server = HealthServer::start(any_port, probe()).unwrap();
        let silent: Vec<_> = (0..PROBES_MAX - 1)
            .map(|_| std::net::TcpStream::connect(server.address()).unwrap())
            .collect();
        let answer = exchange(&server, "GET /healthz HTTP/1.1\r\nHost: a\r\n\r\n");
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        drop(silent);
    }
}
