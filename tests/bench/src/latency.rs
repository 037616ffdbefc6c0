//! The bench of latency: each stage of a frame's time, from the player's hand to the screen.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use carom_farm::net::{Authority, TransportOptions};
use carom_farm::node::Node;
use carom_farm::{Farm, FarmConfig, Frame, FrameId, FrameSpec, LatencySplit, LocalNode, Pixels};
use carom_testkit::{link_emulator::LinkConfig, random::SplitMix64};
use carom_tracer::CpuTracer;
use serde::Serialize;
use tempfile::TempDir;

use crate::cluster::process::farm_folder;
use crate::served_node::ServedNode;
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
    /// Number of inputs for which there was no room among the frames in flight.
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

/// A farm of one node behind a socket.
struct LatencySetup {
    farm: Farm,
    _node: ServedNode,
    _credentials: TempDir,
}

impl LatencySetup {
    fn new(args: &Args, path: Option<LinkConfig>) -> Result<Self, BenchError> {
        let credentials = farm_folder()?;
        let authority = Authority::load(credentials.path())?;
        let node = Node::new("node", Arc::new(CpuTracer::with_threads(0)?));
        let node = ServedNode::start(
            &authority,
            TransportOptions::default(),
            path.map(|path| (path, args.seed)),
            move |server, stop| server.serve(stop, move |player, _| node.connect(player), |_| {}),
        )?;
        let mut farm = Farm::new(FarmConfig {
            local: LocalNode::None,
            nodes: vec![node.address.to_string()],
            credentials: credentials.path().to_owned(),
            ..FarmConfig::default()
        })?;
        farm.set_scene(&scenes::scene(None)?.scene)?;
        Ok(Self {
            farm,
            _node: node,
            _credentials: credentials,
        })
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
    let mut random = SplitMix64::new(args.seed);
    for refresh in 1..=args.seconds * REFRESHES_PER_SECOND {
        let due = player.began + PERIOD.mul_f64(refresh as f64);
        player.collect(farm, due);
        let waited = PERIOD.mul_f64(random.uniform());
        player.act(farm, args, refresh, waited)?;
    }
    Ok(player.row(name))
}

fn spec(args: &Args, frame: u64) -> FrameSpec {
    scenes::frame(scenes::wide(args.width), 1, frame as u32)
}

/// A player who gives inputs and receives frames.
struct LatencyProbe {
    began: Instant,
    /// Time of each frame's submission, and waiting time of its input until then.
    asked: BTreeMap<FrameId, (Instant, Duration)>,
    /// Times of frames by stage, in seconds.
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
        // The frame is shown at the next refresh.
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

/// The stages in their order, and their sum.
const STAGES: [&str; 9] = [
    "input", "network", "queue", "trace", "encode", "decode", "compose", "present", "all",
];
const REFRESHES_PER_SECOND: u64 = 60;
const PERIOD: Duration = Duration::from_nanos(16_666_667);
const WARM_UP: Duration = Duration::from_secs(1);
