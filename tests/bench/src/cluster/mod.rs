//! The bench of the balancing algorithms on real processes of one machine, compared with the simulation
//! of the same farm.

mod player;
pub(crate) mod process;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::Context;
use carom_farm::NodeIndex;
use carom_farm::backend::NodeBackend;
use carom_farm::net::interruption;
use carom_farm::{Algorithm, Balancing, Farm, FarmConfig, FrameId, LocalNode, PrecisionRange};
use carom_testkit::link_emulator::LinkConfig;
use carom_testkit::simulator::{self, FarmPlan, NodePlan, Score, SimulationReport, optimum_secs};
use carom_tracer::ImageSize;
use serde::Serialize;
use tempfile::TempDir;

use self::player::{ClusterPlayer, ExpectedFrames, SubmissionPace};
use self::process::{NodeAction, NodeProcess, NodeSpec, ScheduledAction, farm_folder};
use crate::proxy::LinkArgs;
use crate::scenes;
use crate::timing::median;
use crate::wait::WaitArgs;
use crate::{BenchError, print_json};

/// Compare the balancing algorithms on a farm of real processes of this machine.
///
/// Each process uses a share of one thread, behind an emulated link of its own.
///
/// Unless told otherwise the best node becomes four times as slow after a quarter of the frames,
/// after a half one is killed, after three quarters one joins. Each node is first measured alone;
/// the simulation is of nodes as measured, and both are compared with the clairvoyant optimum of
/// these. The shares should leave the machine some time for the client and the network.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// A node: its share of a thread and its round trip in milliseconds; may be repeated. Those
    /// that join are the last.
    #[arg(long, value_name = "SHARE@MS", value_delimiter = ',',
        default_values = ["0.4@2", "0.2@46", "0.1@10", "0.05@1", "0.3@4"])]
    node: Vec<NodeSpec>,
    /// What happens when a frame is submitted: the frame, the node, counted from 0, and one of
    /// kill, stop, go, join, throttle=SHARE; may be repeated, and replaces the usual changes.
    #[arg(long, value_name = "FRAME:NODE:ACTION", value_delimiter = ',')]
    change: Vec<ScheduledAction>,
    /// Without any change.
    #[arg(long, conflicts_with = "change")]
    calm: bool,
    /// Algorithms by name, with _hedged at the end for hedging [default: all without, and
    /// water_filling_hedged].
    #[arg(long, value_delimiter = ',')]
    algorithm: Vec<Balancing>,
    /// Frames of a run.
    #[arg(long, default_value_t = 400, value_parser = clap::value_parser!(u64).range(16..=100_000))]
    frames: u64,
    /// Milliseconds between frames, of which up to eight are in flight [default: each frame when
    /// the one before is whole].
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    period: Option<u64>,
    /// Pixels across; the picture is 16:9.
    #[arg(long, default_value_t = 160, value_parser = clap::value_parser!(u32).range(16..=3840))]
    width: u32,
    /// Samples a pixel.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4096))]
    spp: u32,
    /// Pixels along a tile's edge.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(8..=128))]
    tile_edge: u16,
    /// What is wrong with all paths; --delay is the nodes' own.
    #[command(flatten)]
    path: LinkArgs,
    /// Draws losses and jitter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    wait: WaitArgs,
}

#[derive(Serialize)]
struct ClusterReport {
    nodes: Vec<NodeAlone>,
    runs: Vec<ClusterRow>,
}

/// A node as measured by itself.
#[derive(Clone, Copy, Serialize)]
struct NodeAlone {
    share: f64,
    fixed_ms: f64,
    msamples_per_sec: f64,
}

#[derive(Serialize)]
struct ClusterRow {
    algorithm: Balancing,
    measured: ClusterFigures,
    simulated: ClusterFigures,
    /// Number of frames whose pixels differ from those of one tracer.
    wrong_frames: u64,
}

/// `mean`, `p99` and `worst_after_death` are multiples of the optimum.
#[derive(Serialize)]
struct ClusterFigures {
    mean_ms: f64,
    mean: f64,
    p99: f64,
    recovery_frames: [Option<usize>; 3],
    duplicates: f64,
    worst_after_death: f64,
    response_deviation_ms: f64,
    lost_frames: u64,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let path = args.path.config()?;
    let changes = changes(args)?;
    let bench = ClusterBench {
        args,
        path,
        changes,
        folder: farm_folder()?,
        pictures: pictures(args)?,
        interrupted: interruption().context("Ctrl-C")?,
    };
    let nodes = bench.measure_alone()?;
    if !args.json {
        print_nodes(&nodes);
    }
    let mut output = ClusterReport {
        nodes,
        runs: Vec::new(),
    };
    for balancing in algorithms(args) {
        let row = bench.compare(balancing, &output.nodes)?;
        if !args.json {
            print_row(&row);
        }
        output.runs.push(row);
    }
    if args.json {
        print_json(&output)?;
    }
    Ok(())
}

fn algorithms(args: &Args) -> Vec<Balancing> {
    if args.algorithm.is_empty() {
        let all = Algorithm::ALL.map(Algorithm::unhedged);
        all.into_iter().chain([Balancing::default()]).collect()
    } else {
        args.algorithm.clone()
    }
}

/// The requested changes, or the usual ones.
fn changes(args: &Args) -> Result<Vec<ScheduledAction>, BenchError> {
    let changes = if args.change.is_empty() && !args.calm {
        usual_changes(&args.node, args.frames)?
    } else {
        args.change.clone()
    };
    for change in &changes {
        if change.node >= args.node.len() {
            return Err(BenchError::Input(format!(
                "--change is about node {}: there are {}, counted from 0",
                change.node,
                args.node.len()
            )));
        }
    }
    let joins = |node| joins(&changes, node);
    if let Some(node) = (1..args.node.len()).find(|node| joins(*node - 1) && !joins(*node)) {
        return Err(BenchError::Input(format!(
            "node {} joins and node {node} is there from the start: give those that join last",
            node - 1
        )));
    }
    if joins(0) {
        return Err(BenchError::Input(
            "node 0 joins: one must be there from the start".into(),
        ));
    }
    Ok(changes)
}

fn usual_changes(nodes: &[NodeSpec], frames: u64) -> Result<Vec<ScheduledAction>, BenchError> {
    if nodes.len() < 3 {
        return Err(BenchError::Input(format!(
            "{} nodes are too few for one to slow down, one to be killed and one to join: give \
             three, or --calm, or what is to happen with --change",
            nodes.len()
        )));
    }
    let last = nodes.len() - 1;
    let mut best: Vec<usize> = (0..last).collect();
    best.sort_by(|a, b| nodes[*b].share.total_cmp(&nodes[*a].share));
    let slow = NodeAction::Throttle(0.25 * nodes[best[0]].share);
    let events = [
        (best[0], slow),
        (best[2.min(last - 1)], NodeAction::Kill),
        (last, NodeAction::Join),
    ];
    let change = |(quarter, (node, action)): (u64, _)| ScheduledAction {
        frame: quarter * frames / 4,
        node,
        action,
    };
    Ok((1..).zip(events).map(change).collect())
}

/// Whether a node is not present from the start.
fn joins(changes: &[ScheduledAction], node: usize) -> bool {
    let mut changes = changes.iter();
    changes.any(|change| change.node == node && change.action == NodeAction::Join)
}

fn size(args: &Args) -> ImageSize {
    scenes::wide(args.width)
}

fn pictures(args: &Args) -> Result<ExpectedFrames, BenchError> {
    let mut farm = Farm::with_tracers(
        config(args, Balancing::default()),
        vec![NodeBackend::Cpu.open(0)?],
    )?;
    farm.set_scene(&scenes::scene(None)?.scene)?;
    ExpectedFrames::new(&mut farm, size(args), args.spp, args.wait)
}

fn config(args: &Args, balancer: Balancing) -> FarmConfig {
    FarmConfig {
        local: LocalNode::None,
        balancer,
        tile_edge: args.tile_edge,
        precision: PrecisionRange::EXACT,
        ..FarmConfig::default()
    }
}

struct ClusterBench<'a> {
    args: &'a Args,
    path: LinkConfig,
    changes: Vec<ScheduledAction>,
    folder: TempDir,
    pictures: ExpectedFrames,
    interrupted: Arc<AtomicBool>,
}

impl ClusterBench<'_> {
    fn nodes(&self) -> anyhow::Result<Vec<NodeProcess>> {
        let start = |(index, spec)| {
            NodeProcess::start(self.folder.path(), index, spec, self.path, self.args.seed)
        };
        self.args.node.iter().enumerate().map(start).collect()
    }

    fn player<'a>(
        &'a self,
        nodes: &'a mut [NodeProcess],
        there: std::ops::Range<usize>,
        balancing: Balancing,
    ) -> Result<ClusterPlayer<'a>, BenchError> {
        let count = there.len();
        let mut farm = Farm::new(FarmConfig {
            nodes: nodes[there].iter().map(NodeProcess::address).collect(),
            credentials: self.folder.path().to_owned(),
            ..config(self.args, balancing)
        })?;
        farm.set_scene(&scenes::scene(None)?.scene)?;
        let player = ClusterPlayer {
            farm,
            nodes,
            pictures: &self.pictures,
            interrupted: &self.interrupted,
            wait: self.args.wait,
        };
        player.wait_ready(count)?;
        Ok(player)
    }

    /// Measures each node by itself: medians over frames.
    fn measure_alone(&self) -> Result<Vec<NodeAlone>, BenchError> {
        let mut nodes = self.nodes()?;
        let pace = SubmissionPace {
            frames: ALONE_FRAMES,
            frames_in_flight: 1,
            period: None,
        };
        let alone = |index: usize| {
            let there = index..index + 1;
            let mut player = self.player(&mut nodes, there, Balancing::default())?;
            let (report, _) = player.play(pace, &[])?;
            let stats = || report.frames.iter().map(|frame| &frame.stats);
            let busy_secs = median(stats().map(|stats| stats.busy_secs));
            let fixed = stats().map(|stats| stats.makespan_secs - stats.busy_secs);
            let samples = size(self.args).pixels() as f64 * f64::from(self.args.spp);
            Ok(NodeAlone {
                share: self.args.node[index].share,
                fixed_ms: 1e3 * median(fixed).max(0.0),
                msamples_per_sec: 1e-6 * samples / busy_secs.max(1e-9),
            })
        };
        (0..self.args.node.len()).map(alone).collect()
    }

    /// Runs the algorithm on processes of its own, and on a simulation of them.
    fn compare(&self, balancing: Balancing, alone: &[NodeAlone]) -> Result<ClusterRow, BenchError> {
        let mut nodes = self.nodes()?;
        let first = (0..nodes.len()).filter(|node| !joins(&self.changes, *node));
        let there = 0..first.count();
        let mut player = self.player(&mut nodes, there, balancing)?;
        let (report, happened) = player.play(self.pace(), &self.changes)?;
        drop(player);
        let plan = self.plan(balancing, alone, &happened);
        let simulated = simulator::run(&plan, SIMULATED_SECS_MAX);
        Ok(ClusterRow {
            algorithm: balancing,
            wrong_frames: report.wrong_frames,
            measured: figures(&plan, &happened, &report),
            simulated: figures(&plan, &happened, &simulated),
        })
    }

    fn pace(&self) -> SubmissionPace {
        let period = self.args.period.map(Duration::from_millis);
        SubmissionPace {
            frames: self.args.frames,
            frames_in_flight: if period.is_some() { 8 } else { 1 },
            period,
        }
    }

    /// The same farm on virtual time, with the changes at the frames at which they took effect. Its
    /// picture has one sample per pixel.
    fn plan(
        &self,
        balancing: Balancing,
        alone: &[NodeAlone],
        happened: &[ScheduledAction],
    ) -> FarmPlan {
        let pace = self.pace();
        let node = |alone: &NodeAlone| NodePlan {
            jitter_secs: self.path.jitter.as_secs_f64(),
            ..NodePlan::new(
                1e-3 * alone.fixed_ms,
                alone.msamples_per_sec / f64::from(self.args.spp),
            )
        };
        let mut shares: Vec<f64> = alone.iter().map(|alone| alone.share).collect();
        let change = |change: &ScheduledAction| {
            let node = change.node;
            let simulated = match change.action {
                NodeAction::Kill | NodeAction::Stop => simulator::NodeChange::Silent,
                NodeAction::Go | NodeAction::Join => simulator::NodeChange::Join,
                NodeAction::Throttle(share) => {
                    let before = std::mem::replace(&mut shares[node], share);
                    simulator::NodeChange::Slow(before / share)
                }
            };
            (FrameId(change.frame), NodeIndex(node), simulated)
        };
        FarmPlan {
            seed: self.args.seed,
            balancing,
            nodes: alone.iter().map(node).collect(),
            frames: pace.frames,
            frames_in_flight: pace.frames_in_flight,
            period_secs: pace.period.map(|period| period.as_secs_f64()),
            size: size(self.args),
            tile_edge: self.args.tile_edge,
            changes: happened.iter().map(change).collect(),
            ..FarmPlan::default()
        }
    }
}

fn figures(
    plan: &FarmPlan,
    happened: &[ScheduledAction],
    report: &SimulationReport,
) -> ClusterFigures {
    let first = |wanted: fn(NodeAction) -> bool| {
        let mut changes = happened.iter().filter(|change| wanted(change.action));
        changes.next().map_or(plan.frames, |change| change.frame)
    };
    let events = [
        first(|action| matches!(action, NodeAction::Throttle(_))),
        first(|action| matches!(action, NodeAction::Kill | NodeAction::Stop)),
        first(|action| action == NodeAction::Join),
    ];
    let score = Score::new(
        plan.frames,
        plan.period_secs,
        events,
        report,
        &optimum_secs(plan),
    );
    ClusterFigures {
        mean_ms: 1e3 * report.mean_secs(0..report.frames.len()),
        mean: score.mean,
        p99: score.p99,
        recovery_frames: score.recovery_frames,
        duplicates: score.duplicates,
        worst_after_death: score.worst_after_death,
        response_deviation_ms: 1e3 * score.response_deviation_secs,
        lost_frames: score.lost,
    }
}

fn print_nodes(nodes: &[NodeAlone]) {
    for (index, node) in nodes.iter().enumerate() {
        println!(
            "node {index}: {:.1} % of a thread, alone {:.3} Msample/s and {:.1} ms a request",
            100.0 * node.share,
            node.msamples_per_sec,
            node.fixed_ms
        );
    }
    println!(
        "{:<21} {:<9} {:>8} {:>6} {:>6} {:>14} {:>6} {:>6} {:>7} {:>5} {:>5}",
        "algorithm",
        "",
        "mean ms",
        "mean",
        "p99",
        "recovery",
        "twice",
        "death",
        "dev ms",
        "lost",
        "wrong"
    );
}

fn print_row(row: &ClusterRow) {
    for (name, figures, wrong) in [
        ("measured", &row.measured, row.wrong_frames.to_string()),
        ("simulated", &row.simulated, String::new()),
    ] {
        let frames = |count: Option<usize>| count.map_or("-".into(), |count| count.to_string());
        println!(
            "{:<21} {:<9} {:>8.1} {:>6.2} {:>6.2} {:>14} {:>5.1}% {:>6.2} {:>7.2} {:>5} {:>5}",
            row.algorithm.to_string(),
            name,
            figures.mean_ms,
            figures.mean,
            figures.p99,
            figures.recovery_frames.map(frames).join("/"),
            100.0 * figures.duplicates,
            figures.worst_after_death,
            figures.response_deviation_ms,
            figures.lost_frames,
            wrong
        );
    }
}

/// Number of frames until a node's speed is known.
const ALONE_FRAMES: u64 = 32;
/// More virtual time than any run needs that does not hang, in seconds.
const SIMULATED_SECS_MAX: f64 = 1e5;
