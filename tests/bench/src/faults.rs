//! The bench of faults: random farms with random faults on virtual time.

use anyhow::anyhow;
use carom_farm::Balancing;
use carom_testkit::simulator::{FaultRun, fault_plan, run_faults};
use rayon::prelude::*;
use serde::Serialize;

use crate::{BenchError, print_json};

/// Run simulated farms with random faults: death, silence, slowness, lies about times, failing devices,
/// pixels that are not numbers, half a minute without network, a sleeping client.
///
/// Every frame must come, whole, right and in order. A run that fails is named by its seed; run it
/// alone with `--first SEED --seeds 1`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// How many runs.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    seeds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Divide with the default balancer in every run, not with any of them.
    #[arg(long)]
    hedged: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct FaultsReport {
    runs: usize,
    frames: usize,
    failures: Vec<FailedRun>,
    /// Lateness over the runs of five nodes or more at 60 frames a second.
    bars: Vec<FaultsCriterion>,
    late: Vec<LateRun>,
}

/// Lateness of one kind of runs.
#[derive(Serialize)]
struct FaultsCriterion {
    what: &'static str,
    hedged: bool,
    /// Whether all nodes but the client's own were lost at once: it then has to do alone what was
    /// requested of all.
    all_lost: bool,
    runs: usize,
    /// Number of runs with lateness above two periods.
    late_runs: usize,
    late_periods_max: f64,
    /// Share of late tiles among all tiles.
    late_tiles: f64,
}

/// A run with lateness above two periods.
#[derive(Serialize)]
struct LateRun {
    seed: u64,
    balancer: Balancing,
    periods: f64,
    frame: u64,
    /// The faults with their times in seconds; frame n is submitted after 0.5 + n/60 seconds.
    faults: Vec<String>,
}

#[derive(Serialize)]
struct FailedRun {
    seed: u64,
    why: Vec<String>,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let last = args.first.saturating_add(args.seeds);
    let run = |seed: u64| (seed, run_faults(&fault_plan(seed, args.hedged)));
    let runs: Vec<(u64, FaultRun)> = (args.first..last).into_par_iter().map(run).collect();
    let report = report(args, &runs);
    if args.json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    match report.failures.len() {
        0 => Ok(()),
        failures => Err(anyhow!("{failures} of {} runs failed", report.runs).into()),
    }
}

fn report(args: &Args, runs: &[(u64, FaultRun)]) -> FaultsReport {
    let failed = runs.iter().filter(|(_, run)| !run.wrong.is_empty());
    let failures = failed.map(|(seed, run)| FailedRun {
        seed: *seed,
        why: run.wrong.clone(),
    });
    let fast = |run: &&(u64, FaultRun)| run.1.pipelined && run.1.nodes >= 5;
    let late = runs.iter().filter(fast).filter(|(_, run)| is_late(run));
    let late: Vec<LateRun> = late.map(|(seed, run)| late_run(args, *seed, run)).collect();
    let kinds = [false, true].into_iter().flat_map(|ahead| {
        let kind = move |hedged| [false, true].map(|all_lost| (ahead, hedged, all_lost));
        [false, true].into_iter().flat_map(kind)
    });
    let bar = |(ahead, hedged, all_lost)| {
        let of_kind = |(seed, run): &&(u64, FaultRun)| {
            let is_hedged = fault_plan(*seed, args.hedged).balancing.hedged;
            (run.looks_ahead, is_hedged, run.all_lost) == (ahead, hedged, all_lost)
        };
        let runs = runs.iter().filter(fast).filter(of_kind);
        bar(ahead, hedged, all_lost, runs.map(|(_, run)| run).collect())
    };
    FaultsReport {
        runs: runs.len(),
        frames: runs.iter().map(|(_, run)| run.frames).sum(),
        failures: failures.collect(),
        bars: kinds.map(bar).filter(|bar| bar.runs > 0).collect(),
        late,
    }
}

fn is_late(run: &FaultRun) -> bool {
    run.late_periods > 2.0
}

fn bar(ahead: bool, hedged: bool, all_lost: bool, runs: Vec<&FaultRun>) -> FaultsCriterion {
    let tiles: u64 = runs.iter().map(|run| run.tiles).sum();
    let late_tiles: u64 = runs.iter().map(|run| run.late_tiles).sum();
    let periods = runs.iter().map(|run| run.late_periods);
    FaultsCriterion {
        what: if ahead {
            "shown at their times, a tile missing in a row"
        } else {
            "awaited, a frame longer than usual"
        },
        hedged,
        all_lost,
        runs: runs.len(),
        late_runs: runs.iter().filter(|run| is_late(run)).count(),
        late_periods_max: periods.fold(0.0, f64::max),
        late_tiles: late_tiles as f64 / tiles.max(1) as f64,
    }
}

fn late_run(args: &Args, seed: u64, run: &FaultRun) -> LateRun {
    let plan = fault_plan(seed, args.hedged);
    let mut faults: Vec<(f64, String)> = Vec::new();
    for (index, node) in plan.nodes.iter().enumerate() {
        let happened = node.changes.iter().filter(|(at, _)| *at > 0.0);
        let fault = |(at, change)| (at, format!("{at:.2} node {index}: {change:?}"));
        faults.extend(happened.copied().map(fault));
    }
    faults.sort_by(|a, b| a.0.total_cmp(&b.0));
    LateRun {
        seed,
        balancer: plan.balancing,
        periods: run.late_periods,
        frame: run.latest.map_or(0, |frame| frame.0),
        faults: faults.into_iter().map(|(_, fault)| fault).collect(),
    }
}

fn print(report: &FaultsReport) {
    for FailedRun { seed, why } in &report.failures {
        println!("seed {seed}: {}", why.join("; "));
    }
    println!(
        "{} runs, {} frames, {} runs failed",
        report.runs,
        report.frames,
        report.failures.len()
    );
    println!("five nodes or more at 60 frames a second:");
    for bar in &report.bars {
        println!(
            "{}{}{}: {} runs, {} by over 2 periods, at most {:.1}; {:.3} % of the tiles late",
            bar.what,
            if bar.hedged {
                ", hedged"
            } else {
                ", not hedged"
            },
            if bar.all_lost {
                ", all other nodes lost at once"
            } else {
                ""
            },
            bar.runs,
            bar.late_runs,
            bar.late_periods_max,
            100.0 * bar.late_tiles
        );
    }
    for late in &report.late {
        println!(
            "seed {}, {}: frame {}, {:.1} periods: {}",
            late.seed,
            late.balancer,
            late.frame,
            late.periods,
            late.faults.join("; ")
        );
    }
}
