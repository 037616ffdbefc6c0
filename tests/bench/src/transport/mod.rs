//! The bench of the transport: tiles over real sockets and emulated links, by mode of sending.

mod arrivals;
mod loopback;

use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use carom_farm::net::{
    Authority, Client, CongestionControl, LinkCommand, LinkEvent, NodeLink, Role, TransportOptions,
};
use carom_farm::node::Node;
use carom_protocol::session::ClientEvent;
use carom_protocol::{
    CodedParticles, EncodedScene, FrameId, PixelFormat, PixelPrecision, PrecisionRange, RequestId,
    SceneHash, TraceRequest,
};
use carom_testkit::{link_emulator::LinkConfig, noise_tracer::NoiseTracer};
use carom_tracer::{RenderSettings, SceneUpdate, Tracer};
use serde::Serialize;

use self::arrivals::Arrivals;
use self::loopback::ReadySession;
use crate::served_node::{self, ServedNode};
use crate::timing::quantiles;
use crate::wait::WaitArgs;
use crate::{BenchError, case_filter, print_json, scenes};

/// Measure the time of tiles over emulated links, by mode of sending.
///
/// Sixty requests a second go to one node, each answered over 8 ms by 16 messages of 4 kB that do
/// not compress, 31.5 Mbit/s in all, through a proxy that delays and loses packets.
///
/// A tile's time counts from when the tracer handed it over, and it is missing if it has not come
/// 100 ms after its request, when the frame is cancelled. Loopback has no proxy and answers at
/// once: its times are whole answers of 64 kB from their requests on, with tracer and codec; "ready"
/// is of a node that has its messages ready, less what the player decodes, the transport alone, which
/// shall take at most 1 ms, and "bare" the same bytes over bare sockets, which tells how quiet the
/// machine is. All is of what comes after the first second; of that, "slow start" counts the frames that
/// lack a tile or have one that is more than two frames later than the path. "queue ms" is of packets in the queue of the path's slowest
/// link, 99 of 100 wait no longer there; the rest of a tile's time is the path's own, that
/// of its own packets on that link, and what it waits for its turn at the node.
///
/// Carom sends by delay, and where the path is long and loses packets as datagrams with forward
/// error correction; "streams" is the same without datagrams, BBR and Cubic are quinn's own control
/// of congestion on streams.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Seconds of each run.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u64).range(3..=600))]
    seconds: u64,
    /// Draws losses and jitter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only the paths whose name has this in it.
    #[arg(long)]
    path: Option<String>,
    /// Only Carom's own way of sending.
    #[arg(long)]
    own: bool,
    #[command(flatten)]
    wait: WaitArgs,
}

#[derive(Serialize)]
struct TransportReport {
    runs: Vec<TransportRow>,
}

#[derive(Serialize)]
struct TransportRow {
    path: &'static str,
    sender: &'static str,
    precision: &'static str,
    p50_ms: f64,
    p99_ms: f64,
    /// 99th percentile of the waiting times of packets in the queue of the path's slowest link; absent
    /// without such a link.
    queue_p99_ms: Option<f64>,
    /// Number of frames of the first second of which a tile is missing or more than two frames late.
    start_slow_frames: usize,
    /// Share of missing messages, in percent.
    missing_percent: f64,
    /// Rate of the pixels that arrived.
    mbit_per_second: f64,
}

/// A path with its name.
struct LinkCase {
    name: &'static str,
    /// `None` for loopback.
    path: Option<LinkConfig>,
    /// Whether the node may choose among all precisions.
    governed: bool,
    /// Whether the node has its messages ready.
    ready: bool,
}

fn cases() -> Vec<LinkCase> {
    let ms = Duration::from_millis;
    let path = |delay, loss, rate: Option<f64>| LinkConfig {
        delay,
        jitter: Duration::from_micros(200),
        loss,
        rate,
        queue_bytes: 1 << 20,
        ..LinkConfig::default()
    };
    let case = |name, path| LinkCase {
        name,
        path: Some(path),
        governed: false,
        ready: false,
    };
    let loopback = |name, ready| LinkCase {
        name,
        path: None,
        governed: false,
        ready,
    };
    vec![
        loopback("loopback", false),
        loopback("loopback, ready", true),
        case("4 ms, 1 % loss", path(ms(2), 0.01, None)),
        case("46 ms", path(ms(23), 0.0, None)),
        case("46 ms, 1 % loss", path(ms(23), 0.01, None)),
        case(
            "46 ms, 1 % in fours",
            LinkConfig {
                burst: 4.0,
                ..path(ms(23), 0.01, None)
            },
        ),
        case(
            "46 ms, 2 % reordered",
            LinkConfig {
                reorder: 0.02,
                ..path(ms(23), 0.0, None)
            },
        ),
        case("46 ms, 50 Mbit/s", path(ms(23), 0.0, Some(50e6))),
        case("46 ms, 25 Mbit/s", path(ms(23), 0.0, Some(25e6))),
        LinkCase {
            governed: true,
            ..case("46 ms, 25 Mbit/s", path(ms(23), 0.0, Some(25e6)))
        },
    ]
}

/// Ways of sending, with their names.
const SENDERS: [(&str, TransportOptions); 4] = [
    ("Carom", sending(CongestionControl::DelayBased, true)),
    ("streams", sending(CongestionControl::DelayBased, false)),
    ("BBR", sending(CongestionControl::Bbr, false)),
    ("Cubic", sending(CongestionControl::Cubic, false)),
];

const fn sending(congestion: CongestionControl, fec: bool) -> TransportOptions {
    TransportOptions { congestion, fec }
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let mut report = TransportReport { runs: Vec::new() };
    let wanted = case_filter::named(cases(), |case| case.name, args.path.as_deref())?;
    if !args.json {
        println!(
            "{:<20} {:<7} {:<9} {:>8} {:>8} {:>9} {:>9} {:>7} {:>10}",
            "path",
            "by",
            "precision",
            "p50 ms",
            "p99 ms",
            "queue ms",
            "missing",
            "Mbit/s",
            "slow start"
        );
    }
    for case in &wanted {
        for (name, sending) in SENDERS {
            let only_own = args.own || case.governed || case.ready;
            if sending != TransportOptions::default() && only_own {
                continue;
            }
            let row = measure(args, case, name, sending)?;
            if !args.json {
                print_row(&row);
            }
            report.runs.push(row);
        }
        if case.ready {
            let row = bare(args)?;
            if !args.json {
                print_row(&row);
            }
            report.runs.push(row);
        }
    }
    if args.json {
        print_json(&report)?;
    }
    Ok(())
}

fn bare(args: &Args) -> Result<TransportRow, BenchError> {
    let count = (args.seconds - 1) * FRAMES_PER_SECOND;
    let times = loopback::bare_sockets(count, PERIOD)?;
    let share = times.len() as f64 / count as f64;
    let [p50_ms, p99_ms] = quantiles(times, [0.5, 0.99]);
    Ok(TransportRow {
        path: "loopback, bare",
        sender: "sockets",
        precision: "exact",
        p50_ms,
        p99_ms,
        queue_p99_ms: None,
        start_slow_frames: 0,
        missing_percent: 100.0 * (1.0 - share),
        mbit_per_second: share * 65_536.0 * 8e-6 / PERIOD.as_secs_f64(),
    })
}

fn print_row(row: &TransportRow) {
    let queue = row.queue_p99_ms;
    let queue = queue.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.1}"));
    println!(
        "{:<20} {:<7} {:<9} {:>8.2} {:>8.2} {:>9} {:>7.2} % {:>7.1} {:>10}",
        row.path,
        row.sender,
        row.precision,
        row.p50_ms,
        row.p99_ms,
        queue,
        row.missing_percent,
        row.mbit_per_second,
        row.start_slow_frames
    );
}

/// A node and a link to it, through a proxy if the case has a path.
struct TransportSetup {
    noise: Arc<NoiseTracer>,
    link: NodeLink,
    events: Receiver<(Instant, Vec<LinkEvent>)>,
    _client: Client,
    node: ServedNode,
}

impl TransportSetup {
    fn new(args: &Args, case: &LinkCase, sending: TransportOptions) -> Result<Self, BenchError> {
        let authority = Authority::generate()?;
        let pause = case
            .path
            .map_or(Duration::ZERO, |_| FRAME_RENDER / NoiseTracer::MESSAGES);
        let noise = Arc::new(NoiseTracer::new(pause));
        let node = Node::new("node", Arc::clone(&noise) as Arc<dyn Tracer>);
        let (ready, tracer) = (case.ready, Arc::clone(&noise));
        let link = case.path.map(|path| (path, args.seed));
        let node = ServedNode::start(&authority, sending, link, move |server, stop| match ready {
            true => server.serve(stop, move |_, _| ReadySession::new(&tracer), |_| {}),
            false => server.serve(stop, move |player, _| node.connect(player), |_| {}),
        })?;
        let client = Client::new(&served_node::credentials(&authority, Role::Player)?)?;
        let (sender, events) = mpsc::channel();
        let range = match case.governed {
            true => PrecisionRange {
                finest: PixelPrecision::Exact,
                coarsest: PixelPrecision::Lossy50,
            },
            false => PrecisionRange::EXACT,
        };
        let link = client.link(node.address.into(), range, move |events| {
            drop(sender.send((Instant::now(), events)));
        });
        Ok(Self {
            noise,
            link,
            events,
            _client: client,
            node,
        })
    }

    /// 99th percentile of the waiting times since the last call; none without a slowest link.
    fn queue_p99_ms(&self, case: &LinkCase) -> Option<f64> {
        let (proxy, _) = (self.node.proxy.as_ref()?, case.path?.rate?);
        let delays = proxy.take_queue_delays();
        let ms = delays.iter().map(|delay| delay.as_secs_f64() * 1e3);
        let [p99] = quantiles(ms, [0.99]);
        Some(p99)
    }

    /// Waits for an event that `wanted` accepts.
    fn wait(&self, args: &Args, wanted: impl Fn(&LinkEvent) -> bool) -> Result<(), BenchError> {
        let mut wait = args.wait.begin();
        loop {
            match self.events.recv_timeout(wait.left()) {
                Ok((_, events)) if events.iter().any(&wanted) => return Ok(()),
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => {
                    wait.check("the node's answer", || "it says nothing".to_owned())?;
                }
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(anyhow!("the link to the node has ended").into());
                }
            }
        }
    }
}

fn measure(
    args: &Args,
    case: &LinkCase,
    sender: &'static str,
    sending: TransportOptions,
) -> Result<TransportRow, BenchError> {
    let setup = TransportSetup::new(args, case, sending)?;
    let scene = EncodedScene::new(&scenes::scene(None)?.scene).context("the scene")?;
    let hash = scene.hash();
    setup.wait(args, |event| {
        matches!(event, LinkEvent::Session(ClientEvent::Welcome(_)))
    })?;
    setup.link.send(LinkCommand::Scene(scene));
    setup.wait(args, |event| {
        matches!(event, LinkEvent::Session(ClientEvent::SceneReady(_)))
    })?;
    let mut arrivals = Arrivals::default();
    let frames = args.seconds * FRAMES_PER_SECOND;
    let began = Instant::now();
    for frame in 0..=frames + DEADLINE_FRAMES {
        let due = began + PERIOD.mul_f64(frame as f64);
        arrivals.collect(&setup, case, due)?;
        if frame == START {
            let _ = setup.queue_p99_ms(case); // of the start
        }
        if frame < frames {
            arrivals.requested.push(Instant::now());
            setup.link.send(LinkCommand::Trace(request(hash, frame)));
        }
        let stale = frame.saturating_sub(DEADLINE_FRAMES);
        setup.link.send(LinkCommand::CancelBefore(FrameId(stale)));
    }
    let queue_p99_ms = setup.queue_p99_ms(case);
    Ok(TransportRow {
        queue_p99_ms,
        ..arrivals.row(args, case, sender)
    })
}

fn request(scene: SceneHash, frame: u64) -> Box<TraceRequest> {
    let grid = NoiseTracer::grid();
    Box::new(TraceRequest {
        frame: FrameId(frame),
        id: RequestId(frame),
        scene,
        update: SceneUpdate::default(),
        grid,
        tiles: grid.all(),
        settings: RenderSettings {
            samples: 1,
            seed: frame as u32,
            ..RenderSettings::default()
        },
        format: PixelFormat::Srgb8 { exposure: 1.0 },
        precision: PrecisionRange::ANY,
        references: Vec::new(),
        particles: CodedParticles::default(),
    })
}

const FRAMES_PER_SECOND: u64 = 60;
/// Number of frames of the start, which only the slow-start count includes.
const START: u64 = FRAMES_PER_SECOND;
const PERIOD: Duration = Duration::from_nanos(16_666_667);
const FRAME_RENDER: Duration = Duration::from_millis(8);
/// Frames after which a frame is cancelled: 100 ms.
const DEADLINE_FRAMES: u64 = 6;
