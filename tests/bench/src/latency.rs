//! The bench of latency: each stage of a frame's time, from the player's hand to the screen.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use carom_farm::net::{Authority, NodeServer, Role, StopHandle, create_farm};
use carom_farm::node::Node;
use carom_farm::{
    Farm, FarmConfig, Frame, FrameId, FrameSpec, LatencySplit, LocalNode, PixelFormat, Pixels,
};
use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};
use carom_tracer::{CpuTracer, ImageSize, RenderSettings, SceneUpdate};
use serde::Serialize;

use crate::timing::quantiles;
use crate::wait::WaitArgs;
use crate::{BenchError, case_filter, print_json, scenes};

/// Measure the latency from an input to the screen, stage by stage.
///
/// Sixty inputs come a second, each at any moment between two refreshes of a display; each is taken up at
/// the next refresh as a frame of the pool table, which one node traces with its CPU, and shown at
/// the first refresh after it has come.
///
/// Stages follow each other, and each is a duration by one clock: "input" until the node is asked;
/// "queue", "trace" and "encode" as the node says of the frame's last tile; "decode" of that tile;
/// "network" is what is left of the round trip, both ways and the waiting for it; "compose" from the
/// last tile to the picture as the display wants it; "present" until the refresh. The first second
/// is not counted.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Seconds of each run.
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u64).range(2..=600))]
    seconds: u64,
    /// Draws inputs, losses and jitter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Pixels across; the picture is 16:9, of one sample a pixel.
    #[arg(long, default_value_t = 160, value_parser = clap::value_parser!(u32).range(16..=3840))]
    width: u32,
    /// Only the paths whose name has this in it.
    #[arg(long)]
    path: Option<String>,
    #[command(flatten)]
    wait: WaitArgs,
}

#[derive(Serialize)]
struct LatencyReport {
    runs: Vec<LatencyRow>,
}

#[derive(Serialize)]
struct LatencyRow {
    path: &'static str,
    frames: usize,
    /// Inputs for which there was no room among the frames in flight.
    skipped: u64,
    stages: Vec<StageTimes>,
}

/// Milliseconds.
#[derive(Serialize)]
struct StageTimes {
    stage: &'static str,
    p50_ms: f64,
    p95_ms: f64,
    p99_ms: f64,
}

fn cases() -> [(&'static str, Option<LinkConfig>); 4] {
    let path = |delay, loss| LinkConfig {
        delay: Duration::from_millis(delay),
        jitter: Duration::from_millis(1),
        loss,
        ..LinkConfig::default()
    };
    [
        ("loopback", None),
        ("4 ms", Some(path(2, 0.0))),
        ("46 ms", Some(path(23, 0.0))),
        ("46 ms, 1 % loss", Some(path(23, 0.01))),
    ]
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let mut report = LatencyReport { runs: Vec::new() };
    let wanted = case_filter::named(cases(), |(name, _)| name, args.path.as_deref())?;
    for (name, path) in wanted {
        let row = measure(args, name, path)?;
        if !args.json {
            print_row(&row);
        }
        report.runs.push(row);
    }
    if args.json {
        print_json(&report)?;
    }
    Ok(())
}

fn print_row(row: &LatencyRow) {
    println!(
        "{}: {} frames, {} inputs without room",
        row.path, row.frames, row.skipped
    );
    println!("  {:<8} {:>8} {:>8} {:>8}", "ms", "p50", "p95", "p99");
    for stage in &row.stages {
        println!(
            "  {:<8} {:>8.2} {:>8.2} {:>8.2}",
            stage.stage, stage.p50_ms, stage.p95_ms, stage.p99_ms
        );
    }
}

/// A node behind a socket, and a farm of it.
struct LatencySetup {
    farm: Farm,
    _proxy: Option<UdpProxy>,
    stop: StopHandle,
    server: Option<std::thread::JoinHandle<()>>,
    credentials: PathBuf,
}

impl LatencySetup {
    fn new(args: &Args, path: Option<LinkConfig>) -> Result<Self, BenchError> {
        let credentials =
            std::env::temp_dir().join(format!("carom-bench-latency-{}", std::process::id()));
        create_farm(&credentials)?;
        let authority = Authority::load(&credentials)?;
        let now = std::time::SystemTime::now();
        let day = Duration::from_secs(24 * 3600);
        let node_credentials = authority.credentials(Role::Node, "node", now - day..now + day)?;
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let server = NodeServer::bind(any, &node_credentials)?;
        let address = server.local_addr()?;
        let node = Node::new("node", Arc::new(CpuTracer::with_threads(0)?));
        let stop = StopHandle::default();
        let stopped = stop.clone();
        let serve = move || server.serve(&stopped, move |player, _| node.connect(player), |_| {});
        let proxy = path.map(|path| UdpProxy::start(any, address, path, args.seed));
        let proxy = proxy.transpose().context("a proxy")?;
        let address = proxy.as_ref().map_or(address, UdpProxy::local_addr);
        let mut farm = Farm::new(FarmConfig {
            local: LocalNode::None,
            nodes: vec![address.to_string()],
            credentials: credentials.clone(),
            ..FarmConfig::default()
        })?;
        farm.set_scene(&scenes::scene(None)?.scene)?;
        Ok(Self {
            farm,
            _proxy: proxy,
            stop,
            server: Some(std::thread::spawn(serve)),
            credentials,
        })
    }
}

impl Drop for LatencySetup {
    fn drop(&mut self) {
        self.stop.stop();
        if let Some(server) = self.server.take() {
            let _ = server.join(); // a panic has been reported where it happened
        }
        let _ = std::fs::remove_dir_all(&self.credentials); // what is left there harms nobody
    }
}

fn measure(
    args: &Args,
    name: &'static str,
    path: Option<LinkConfig>,
) -> Result<LatencyRow, BenchError> {
    let mut setup = LatencySetup::new(args, path)?;
    let farm = &mut setup.farm;
    farm.submit(spec(args, 0))?;
    args.wait.frame(farm)?;
    let mut player = LatencyProbe {
        began: Instant::now(),
        asked: BTreeMap::new(),
        times: Vec::new(),
        skipped: 0,
    };
    let mut random = args.seed;
    for refresh in 1..=args.seconds * REFRESHES_PER_SECOND {
        let due = player.began + PERIOD.mul_f64(refresh as f64);
        player.collect(farm, due);
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let waited = PERIOD.mul_f64((random >> 40) as f64 / (1u64 << 24) as f64);
        player.act(farm, args, refresh, waited)?;
    }
    Ok(player.row(name))
}

fn spec(args: &Args, frame: u64) -> FrameSpec {
    FrameSpec {
        update: SceneUpdate::default(),
        size: ImageSize::new(args.width, (args.width * 9 / 16).max(1)),
        settings: RenderSettings {
            samples: 1,
            seed: frame as u32,
            ..RenderSettings::default()
        },
        format: PixelFormat::Srgb8 { exposure: 1.0 },
    }
}

/// Who acts, and looks.
struct LatencyProbe {
    began: Instant,
    /// When each frame was submitted, and how long its input had waited until then.
    asked: BTreeMap<FrameId, (Instant, Duration)>,
    /// By stage, in seconds.
    times: Vec<[f64; STAGES.len()]>,
    skipped: u64,
}

impl LatencyProbe {
    fn act(
        &mut self,
        farm: &mut Farm,
        args: &Args,
        refresh: u64,
        waited: Duration,
    ) -> Result<(), BenchError> {
        if farm.in_flight() >= FarmConfig::default().frames_in_flight {
            self.skipped += 1;
            return Ok(());
        }
        let now = Instant::now();
        let id = farm.submit(spec(args, refresh))?;
        self.asked.insert(id, (now, waited));
        Ok(())
    }

    /// Takes frames until `due`.
    fn collect(&mut self, farm: &mut Farm, due: Instant) {
        loop {
            let left = due.saturating_duration_since(Instant::now());
            match farm.wait_frame(left) {
                Some(frame) => self.take(&frame),
                None => {
                    std::thread::sleep(due.saturating_duration_since(Instant::now()));
                    return;
                }
            }
        }
    }

    fn take(&mut self, frame: &Frame) {
        if matches!(frame.pixels, Pixels::Linear(_)) {
            return;
        }
        let now = Instant::now();
        let since_start = now - self.began;
        let Some((submitted, waited)) = self.asked.remove(&frame.id) else {
            return;
        };
        let Some(split) = frame.stats.last_split().filter(|_| since_start > WARM_UP) else {
            return;
        };
        let LatencySplit {
            request_secs,
            network_secs,
            queue_secs,
            trace_secs,
            encode_secs,
            decode_secs,
        } = *split;
        let refreshes = since_start.div_duration_f64(PERIOD);
        let present_secs = (refreshes.ceil() - refreshes) * PERIOD.as_secs_f64();
        let took = (now - submitted).as_secs_f64();
        self.times.push([
            waited.as_secs_f64() + request_secs,
            network_secs,
            queue_secs,
            trace_secs,
            encode_secs,
            decode_secs,
            (took - frame.stats.makespan_secs).max(0.0),
            present_secs,
            waited.as_secs_f64() + took + present_secs,
        ]);
    }

    fn row(&self, path: &'static str) -> LatencyRow {
        let stage = |(index, stage): (usize, &&'static str)| {
            let times = self.times.iter().map(|times| 1e3 * times[index]);
            let [p50_ms, p95_ms, p99_ms] = quantiles(times, [0.5, 0.95, 0.99]);
            StageTimes {
                stage,
                p50_ms,
                p95_ms,
                p99_ms,
            }
        };
        LatencyRow {
            path,
            frames: self.times.len(),
            skipped: self.skipped,
            stages: STAGES.iter().enumerate().map(stage).collect(),
        }
    }
}

/// In their order, and all of them together.
const STAGES: [&str; 9] = [
    "input", "network", "queue", "trace", "encode", "decode", "compose", "present", "all",
];
const REFRESHES_PER_SECOND: u64 = 60;
const PERIOD: Duration = Duration::from_nanos(16_666_667);
const WARM_UP: Duration = Duration::from_secs(1);
