//! The first frame of a farm in which the slowest node is ready first, and one of a hundred times its
//! speed joins: no work may be left to the slow one that the fast one would have finished.

use carom_farm::Algorithm;
use carom_testkit::simulator::{self, FarmPlan, NodeChange, NodePlan};
use serde::Serialize;

use crate::met;

/// Result of one run.
#[derive(Serialize)]
pub(super) struct FirstFrame {
    /// Time at which the fast node joins.
    joins_ms: f64,
    first_frame_ms: f64,
    /// Ratio to the time that both nodes need together from when the fast one has joined.
    ratio: f64,
}

/// Runs in which the fast node joins at once, and up to half a second late.
pub(super) fn measure() -> Vec<FirstFrame> {
    [0.0, 0.02, 0.1, 0.5].map(simulate).into()
}

fn simulate(joins_secs: f64) -> FirstFrame {
    let (slow, fast) = (
        NodePlan::new(1e-4, SLOW),
        NodePlan::new(1e-3, SPREAD * SLOW),
    );
    let plan = FarmPlan {
        balancing: Algorithm::WaterFilling.hedged(),
        nodes: vec![slow, fast.with(START_SECS + joins_secs, NodeChange::Join)],
        ..FarmPlan::default()
    };
    let report = simulator::run(&plan, SECS_MAX);
    let frame_secs = report
        .frames
        .first()
        .map_or(f64::INFINITY, |frame| frame.stats.makespan_secs);
    let together = 1e-6 * plan.size.pixels() as f64 / (SLOW * (1.0 + SPREAD));
    FirstFrame {
        joins_ms: 1e3 * joins_secs,
        first_frame_ms: 1e3 * frame_secs,
        ratio: frame_secs / (joins_secs + 1e-3 + together),
    }
}

/// Prints a line with the criterion.
pub(super) fn print(frames: &[FirstFrame]) {
    let met = met(frames.iter().all(|frame| frame.ratio <= RATIO_MAX));
    let ratio = |frame: &FirstFrame| format!("{:.2} after {:.0} ms", frame.ratio, frame.joins_ms);
    let ratios: Vec<String> = frames.iter().map(ratio).collect();
    println!(
        "{met:<6} first frame of a slow node and one 100 times as fast that joins, over the optimum: {} \
         ≤ {RATIO_MAX}",
        ratios.join(", ")
    );
}

/// Speed of the slow node in million samples a second, and ratio of the fast node's speed to it.
const SLOW: f64 = 0.02;
const SPREAD: f64 = 100.0;
/// Time at which the simulator submits the first frame.
const START_SECS: f64 = 0.5;
const RATIO_MAX: f64 = 2.0;
const SECS_MAX: f64 = 600.0;
