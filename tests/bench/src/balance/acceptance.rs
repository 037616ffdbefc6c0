//! Acceptance criteria of hedged water-filling, with the measured values.

use std::fmt;

use carom_farm::Balancing;
use carom_testkit::simulator::{Network, Score};

use super::BalanceRun;
use crate::met;

/// An upper bound on a measured value.
struct Criterion {
    what: &'static str,
    came: f64,
    most: f64,
    decimals: usize,
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            what,
            came,
            most,
            decimals,
        } = self;
        let sign = if came <= most { "≤" } else { ">" };
        write!(f, "{what} {came:.decimals$} {sign} {most}")
    }
}

/// Prints a line for each kind of farm on which hedged water-filling has been run, over all its seeds.
pub(super) fn print(runs: &[BalanceRun]) {
    let asked = |run: &&BalanceRun| run.balancing == Balancing::default();
    let runs: Vec<&BalanceRun> = runs.iter().filter(asked).collect();
    let kind = |run: &BalanceRun| (run.scenario.nodes, run.scenario.network, run.scenario.mode);
    println!();
    for same in runs.chunk_by(|a, b| kind(a) == kind(b)) {
        let (nodes, network, mode) = kind(same[0]);
        let measures = measures(same, nodes, network);
        let is_met = measures.iter().all(|measure| measure.came <= measure.most);
        let met = met(is_met);
        let measures: Vec<String> = measures.iter().map(Criterion::to_string).collect();
        println!(
            "{met:<6} {nodes} nodes, {}, {}, seeds 1–{}: {}",
            network.name(),
            mode.name(),
            same.len(),
            measures.join(", ")
        );
    }
}

/// Criteria over all settled frames, and over the worst run. Without a settled frame none is met; an
/// event after which there is no optimum does not count.
fn measures(runs: &[&BalanceRun], nodes: usize, network: Network) -> Vec<Criterion> {
    let scores = || runs.iter().map(|run| &run.score);
    let mut ratios: Vec<f64> = scores().flat_map(|score| score.settled.clone()).collect();
    ratios.sort_by(f64::total_cmp);
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    let p99 = ratios.get((0.99 * ratios.len() as f64) as usize);
    let most = |of: fn(&Score) -> f64| scores().map(of).fold(0.0, f64::max);
    let recovery = |score: &Score| {
        let frames = score.recovery_frames.into_iter().flatten();
        frames.max().unwrap_or(0) as f64
    };
    let mean_max = match (nodes, network) {
        (..=5, _) => 1.05,
        (..=64, Network::Lan) => 1.25,
        (..=64, _) => 1.15,
        _ => 1.35,
    };
    let measure = |what, came, most, decimals| Criterion {
        what,
        came,
        most,
        decimals,
    };
    let twice = |score: &Score| 100.0 * score.duplicates;
    let mut measures = vec![
        measure("mean", mean, mean_max, 3),
        measure("p99", p99.copied().unwrap_or(f64::NAN), 1.5, 2),
        measure("recovery in frames", most(recovery), 10.0, 0),
        measure("traced twice in percent", most(twice), 2.0, 2),
    ];
    // Of two nodes only one is left after the death.
    if nodes >= 5 {
        let death_max = if nodes < 64 { 3.0 } else { 2.0 };
        let death = most(|score| score.worst_after_death);
        measures.push(measure("worst after the death", death, death_max, 2));
    }
    measures
}
