//! The bench of the balancing algorithms on simulated farms.

mod acceptance;
mod decision;
mod first_frame;
mod own;
mod plot;

use std::path::PathBuf;

use anyhow::Context;
use carom_farm::{Algorithm, Balancing};
use carom_testkit::simulator::{
    self, Extensions, Network, Scenario, Score, SimulationReport, SubmissionMode,
};
use rayon::prelude::*;
use serde::Serialize;

use crate::{BenchError, ValueError, print_json};

/// Compare the balancing algorithms on simulated farms: the real coordinator on virtual time.
///
/// The nodes' speeds differ by up to 100 times. After a quarter of the frames the best node becomes
/// four times as slow, after a half one falls silent, after three quarters a fast one joins. Times
/// are multiples of the clairvoyant optimum: water-filling in real numbers that knows each frame's
/// delays, pauses and costs beforehand. Pipelined it queues as well, and while a farm is too slow for
/// 60 frames a second, or would be busy for over 95 % of the time, there is none. What is in flight
/// when something happens counts as hit by it.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Folder for charts of the nodes' response times: their deviation and maximum by frame.
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// Sizes of farms.
    #[arg(long, value_delimiter = ',', default_values_t = [2, 5, 64, 1000],
        value_parser = clap::value_parser!(u16).range(1..=1000))]
    nodes: Vec<u16>,
    /// How far nodes are: lan, wan, 46ms [default: all; wan for 1000 nodes].
    #[arg(long, value_delimiter = ',', value_parser = network)]
    network: Vec<Network>,
    /// When frames are submitted: closed, pipelined [default: both; closed for 1000 nodes].
    #[arg(long, value_delimiter = ',', value_parser = submission_mode)]
    mode: Vec<SubmissionMode>,
    /// Algorithms by name, with _hedged at the end for hedging; `own` is that of
    /// farm/examples/own_balancer.rs, or of the file that CAROM_BALANCER names when this program is
    /// built [default: all without, water_filling_hedged and own_hedged].
    #[arg(long, value_delimiter = ',', value_parser = algorithm)]
    algorithm: Vec<Balancing>,
    /// Runs of each kind [default: 4 of up to 5 nodes, 2 of up to 64, else 1].
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: Option<u64>,
    /// Frames of a run.
    #[arg(long, default_value_t = 800, value_parser = clap::value_parser!(u64).range(80..=100_000))]
    frames: u64,
}

fn algorithm(text: &str) -> Result<Balancing, carom_farm::Error> {
    let own = [Algorithm::Own.unhedged(), Algorithm::Own.hedged()];
    let own = own.into_iter().find(|own| own.to_string() == text);
    own.map_or_else(|| text.parse(), Ok)
}

fn network(text: &str) -> Result<Network, ValueError> {
    let found = Network::ALL.into_iter().find(|of| of.name() == text);
    found.ok_or(ValueError::Form("lan, wan or 46ms"))
}

fn submission_mode(text: &str) -> Result<SubmissionMode, ValueError> {
    let found = SubmissionMode::ALL.into_iter().find(|of| of.name() == text);
    found.ok_or(ValueError::Form("closed or pipelined"))
}

/// A completed run.
struct BalanceRun {
    balancing: Balancing,
    scenario: Scenario,
    report: SimulationReport,
    score: Score,
}

#[derive(Serialize)]
struct BalanceReport {
    runs: Vec<BalanceRow>,
    first_frames: Vec<first_frame::FirstFrame>,
    decisions: Vec<decision::DivisionCost>,
}

/// Times are multiples of the optimum's; absent where there is no optimum, as when the farm is too slow
/// for 60 frames a second.
#[derive(Serialize)]
struct BalanceRow {
    algorithm: Balancing,
    nodes: usize,
    network: &'static str,
    mode: &'static str,
    seed: u64,
    mean: f64,
    p99: f64,
    recovery_frames: RecoveryFrames,
    duplicates: f64,
    worst_after_death: f64,
    response_deviation_ms: f64,
    lost_frames: u64,
}

#[derive(Serialize)]
struct RecoveryFrames {
    slow: Option<usize>,
    death: Option<usize>,
    join: Option<usize>,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    if let Some(folder) = &args.plot {
        std::fs::create_dir_all(folder)
            .map_err(|why| BenchError::Input(format!("folder {}: {why}", folder.display())))?;
    }
    let algorithms = algorithms(args);
    let runs = |scenario: &Scenario| -> Vec<BalanceRun> {
        let run = |balancing: &Balancing| simulate(*scenario, *balancing);
        algorithms.par_iter().map(run).collect()
    };
    let runs: Vec<BalanceRun> = scenarios(args).par_iter().flat_map_iter(runs).collect();
    if let Some(folder) = &args.plot {
        for charts in runs.chunk_by(|a, b| a.scenario == b.scenario) {
            plot::write(folder, charts)
                .with_context(|| format!("charts in {}", folder.display()))?;
        }
    }
    let output = BalanceReport {
        runs: runs.iter().map(row).collect(),
        first_frames: first_frame::measure(),
        decisions: algorithms.iter().copied().map(decision::measure).collect(),
    };
    if args.json {
        print_json(&output)?;
    } else {
        print_tables(&output);
        acceptance::print(&runs);
        first_frame::print(&output.first_frames);
    }
    Ok(())
}

fn algorithms(args: &Args) -> Vec<Balancing> {
    if args.algorithm.is_empty() {
        let all = Algorithm::ALL.map(Algorithm::unhedged);
        let hedged = [Balancing::default(), Algorithm::Own.hedged()];
        all.into_iter().chain(hedged).collect()
    } else {
        args.algorithm.clone()
    }
}

/// The scenarios to run. A thousand nodes on all networks would take most of the time and add little.
fn scenarios(args: &Args) -> Vec<Scenario> {
    let mut scenarios = Vec::new();
    for nodes in args.nodes.iter().copied().map(usize::from) {
        let many = nodes > 100;
        let networks: Vec<Network> = match &args.network[..] {
            [] if many => vec![Network::Wan],
            [] => Network::ALL.into(),
            some => some.into(),
        };
        let modes: Vec<SubmissionMode> = match &args.mode[..] {
            [] if many => vec![SubmissionMode::Closed],
            [] => SubmissionMode::ALL.into(),
            some => some.into(),
        };
        let seeds = args.seeds.unwrap_or(match nodes {
            ..=5 => 4,
            6..=64 => 2,
            _ => 1,
        });
        for &network in &networks {
            for &mode in &modes {
                scenarios.extend((1..=seeds).map(|seed| Scenario {
                    nodes,
                    network,
                    mode,
                    seed,
                    frames: args.frames,
                }));
            }
        }
    }
    scenarios
}

fn simulate(scenario: Scenario, balancing: Balancing) -> BalanceRun {
    let plan = scenario.plan(balancing);
    let report = match balancing.algorithm {
        Algorithm::Own => {
            let balancer = Some(own::balancer());
            let extensions = Extensions {
                balancer,
                ..Extensions::default()
            };
            simulator::run_with(&plan, SECS_MAX, extensions)
        }
        _ => simulator::run(&plan, SECS_MAX),
    };
    let (frames, events) = (scenario.frames, scenario.events());
    let score = Score::new(
        frames,
        plan.period_secs,
        events,
        &report,
        &simulator::optimum_secs(&plan),
    );
    BalanceRun {
        balancing,
        scenario,
        report,
        score,
    }
}

const LEGEND: &str = "\
mean, p99, death  frame time over the clairvoyant optimum's: settled frames, and the worst after a death
recovery          frames until settled again after a slowdown, a death and a join; - without an optimum
twice             tiles that were traced more than once
dev ms            deviation of the nodes' response times
lost              frames that did not come or were not submitted";

/// More virtual time than any run needs that does not hang, in seconds.
const SECS_MAX: f64 = 1e4;

fn row(run: &BalanceRun) -> BalanceRow {
    let Scenario {
        nodes,
        network,
        mode,
        seed,
        ..
    } = run.scenario;
    let [slow, death, join] = run.score.recovery_frames;
    BalanceRow {
        algorithm: run.balancing,
        nodes,
        network: network.name(),
        mode: mode.name(),
        seed,
        mean: run.score.mean,
        p99: run.score.p99,
        recovery_frames: RecoveryFrames { slow, death, join },
        duplicates: run.score.duplicates,
        worst_after_death: run.score.worst_after_death,
        response_deviation_ms: 1e3 * run.score.response_deviation_secs,
        lost_frames: run.score.lost,
    }
}

fn print_tables(output: &BalanceReport) {
    println!("{LEGEND}\n");
    println!(
        "{:<21} {:>5} {:<4} {:<9} {:>4} {:>6} {:>6} {:>14} {:>6} {:>6} {:>6} {:>5}",
        "algorithm",
        "nodes",
        "net",
        "mode",
        "seed",
        "mean",
        "p99",
        "recovery",
        "twice",
        "death",
        "dev ms",
        "lost"
    );
    for row in &output.runs {
        let frames = |count: Option<usize>| count.map_or("-".into(), |count| count.to_string());
        let RecoveryFrames { slow, death, join } = row.recovery_frames;
        println!(
            "{:<21} {:>5} {:<4} {:<9} {:>4} {:>6.3} {:>6.2} {:>14} {:>5.2}% {:>6.2} {:>6.2} {:>5}",
            row.algorithm.to_string(),
            row.nodes,
            row.network,
            row.mode,
            row.seed,
            row.mean,
            row.p99,
            [slow, death, join].map(frames).join("/"),
            100.0 * row.duplicates,
            row.worst_after_death,
            row.response_deviation_ms,
            row.lost_frames
        );
    }
    println!();
    for decision in &output.decisions {
        println!(
            "{:<21} {:>6.0} µs to divide {} tiles among {} nodes and to ask them",
            decision.algorithm.to_string(),
            decision.micros,
            decision.tiles,
            decision.nodes
        );
    }
}
