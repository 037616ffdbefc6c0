//! Lower bounds of the transport on a loopback: a node that has its answers ready, and the same bytes
//! over bare sockets.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::task::{Context as TaskContext, Poll};
use std::time::{Duration, Instant};

use anyhow::Context;
use carom_farm::net::PacketHandler;
use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::session::{NodeEvent, NodeSession, Packet, SceneProgress};
use carom_protocol::tile_codec::{Encoder, TileInput};
use carom_protocol::{
    Error, NodeInfo, NodeTimes, PixelPrecision, RequestReport, TilesDone, TraceRequest,
};
use carom_tracer::{TileRange, Tracer};

use crate::BenchError;
use carom_testkit::noise_tracer::NoiseTracer;

/// A session that answers each request at once, with the same bytes for each message of tiles.
pub(super) struct ReadySession {
    session: NodeSession,
    message: Vec<u8>,
}

impl ReadySession {
    pub(super) fn new(noise: &NoiseTracer) -> Self {
        let tiles = noise.message();
        let inputs: Vec<TileInput> = tiles
            .iter()
            .map(|(tile, radiance)| TileInput {
                tile: *tile,
                radiance,
                reference: None,
            })
            .collect();
        let (message, _) = Encoder::new().encode_srgb(1.0, PixelPrecision::Exact, &inputs);
        let info = NodeInfo {
            name: "ready".into(),
            instance: 0,
            device: noise.info(),
        };
        Self {
            session: NodeSession::new(info),
            message,
        }
    }

    fn answer(&mut self, request: &TraceRequest) -> Result<(), Error> {
        for first in request
            .tiles
            .indices()
            .step_by(TILES_PER_MESSAGE_MAX as usize)
        {
            let count = TILES_PER_MESSAGE_MAX;
            self.session.tiles(TilesDone {
                request: request.id,
                tiles: TileRange { first, count },
                busy_micros: 0,
                times: NodeTimes::default(),
                dropped_samples: 0,
                pixels: self.message.clone(),
            })?;
        }
        let report = RequestReport {
            request: request.id,
            ..RequestReport::default()
        };
        self.session.request_done(report).map(drop)
    }
}

impl PacketHandler for ReadySession {
    fn handle(&mut self, packet: Packet) -> Result<(), Error> {
        match self.session.handle(packet)? {
            Some(NodeEvent::Trace { request, .. }) => self.answer(&request),
            _ => Ok(()),
        }
    }

    fn handle_scene(&mut self, progress: Result<SceneProgress, Error>) -> Result<(), Error> {
        self.session.handle_scene(progress).map(drop)
    }

    fn poll_transmit(&mut self) -> Option<Packet> {
        self.session.poll_transmit()
    }

    fn poll_commands(&mut self, _: &mut TaskContext<'_>) -> Poll<Result<(), carom_farm::Error>> {
        Poll::Pending
    }
}

/// Times in ms from requests of 200 bytes to answers of 64 KiB over bare sockets, for `count` requests,
/// `period` apart. Those of which a packet was lost are left out.
pub(super) fn bare_sockets(count: u64, period: Duration) -> Result<Vec<f64>, BenchError> {
    let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let open = || -> std::io::Result<UdpSocket> {
        let socket = UdpSocket::bind(any)?;
        socket.set_read_timeout(Some(PATIENCE))?;
        Ok(socket)
    };
    let (asks, answers) = (open().context("a socket")?, open().context("a socket")?);
    let to = answers.local_addr().context("a socket")?;
    let answer = std::thread::spawn(move || {
        let mut buffer = [0; PACKET_BYTES];
        while let Ok((length, from)) = answers.recv_from(&mut buffer) {
            if length == 1 {
                break;
            }
            for _ in 0..PACKETS {
                let _ = answers.send_to(&buffer, from);
            }
        }
    });
    let mut times = Vec::new();
    let mut buffer = [0; PACKET_BYTES];
    for _ in 0..count {
        std::thread::sleep(period);
        let asked = Instant::now();
        asks.send_to(&buffer[..200], to).context("a socket")?;
        if (0..PACKETS).all(|_| asks.recv(&mut buffer).is_ok()) {
            times.push(asked.elapsed().as_secs_f64() * 1e3);
        }
    }
    asks.send_to(&[0], to).context("a socket")?;
    let _ = answer.join(); // a panic has been reported where it happened
    Ok(times)
}

/// Size of QUIC's packets on most paths.
const PACKET_BYTES: usize = 1252;
/// Packets of 64 KiB.
const PACKETS: usize = 65_536_usize.div_ceil(PACKET_BYTES);
const PATIENCE: Duration = Duration::from_secs(1);
