//! `carom-farm bench faults`: random faults on simulated farms.

use anyhow::{Context, anyhow};
use carom_farm::sim::{FaultRun, fault_plan, run_faults};
use rayon::prelude::*;
use serde::Serialize;

use crate::commands::Failure;

/// Random faults on simulated farms: death, silence, slowness, lies about times, failing devices,
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
struct Report {
    runs: usize,
    frames: usize,
    failures: Vec<Failed>,
    /// Of the runs of five nodes or more at 60 frames a second: how many had a frame that took more
    /// than two periods longer than nineteen of twenty did, and the most that one did.
    pipelined_runs: usize,
    late_runs: usize,
    late_periods_max: f64,
}

#[derive(Serialize)]
struct Failed {
    seed: u64,
    why: Vec<String>,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let last = args.first.saturating_add(args.seeds);
    let run = |seed: u64| (seed, run_faults(&fault_plan(seed, args.hedged)));
    let runs: Vec<(u64, FaultRun)> = (args.first..last).into_par_iter().map(run).collect();
    let report = report(&runs);
    if args.json {
        println!(
            "{}",
            serde_json::to_string(&report).context("results as JSON")?
        );
    } else {
        print(&report);
    }
    match report.failures.len() {
        0 => Ok(()),
        failures => Err(anyhow!("{failures} of {} runs failed", report.runs).into()),
    }
}

fn report(runs: &[(u64, FaultRun)]) -> Report {
    let failed = runs.iter().filter(|(_, run)| !run.wrong.is_empty());
    let failures = failed.map(|(seed, run)| Failed {
        seed: *seed,
        why: run.wrong.clone(),
    });
    let pipelined: Vec<f64> = runs
        .iter()
        .filter(|(_, run)| run.pipelined && run.nodes >= 5)
        .map(|(_, run)| run.late_periods)
        .collect();
    Report {
        runs: runs.len(),
        frames: runs.iter().map(|(_, run)| run.frames).sum(),
        failures: failures.collect(),
        pipelined_runs: pipelined.len(),
        late_runs: pipelined.iter().filter(|late| **late > 2.0).count(),
        late_periods_max: pipelined.iter().copied().fold(0.0, f64::max),
    }
}

fn print(report: &Report) {
    for Failed { seed, why } in &report.failures {
        println!("seed {seed}: {}", why.join("; "));
    }
    println!(
        "{} runs, {} frames, {} runs failed",
        report.runs,
        report.frames,
        report.failures.len()
    );
    println!(
        "five nodes or more at 60 frames a second: {} runs, {} with a frame that took over 2 \
         periods longer than usual, at most {:.1}",
        report.pipelined_runs, report.late_runs, report.late_periods_max
    );
}
