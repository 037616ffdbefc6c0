//! Random farms with random faults, each from its seed.
//!
//! The first node is the client's own: slow, near, and sound, so that every frame can be traced
//! whatever happens to the others. Messages that a session refuses (tiles of a wrong size or frame, or
//! sent twice) end the connection, as `protocol/tests/wire` shows. Here the connection ends, and the
//! node is called again after pauses that double.

use std::collections::BTreeSet;

use carom_protocol::FrameId;
use carom_tracer::ImageSize;

use super::scenario::PERIOD_SECS;
use super::{FarmPlan, NetworkConditions, NodeChange, NodePlan, SimulationReport, run};
use crate::random::SplitMix64;
use carom_farm::{Balancing, Distribution};

/// Result of a plan with faults.
#[derive(Clone, Debug)]
pub struct FaultRun {
    /// Violations; empty if the run is correct.
    pub wrong: Vec<String>,
    /// Number of complete frames.
    pub frames: usize,
    /// In periods of 1/60 s, how much longer the slowest frame took than the 95th percentile; where
    /// frames are shown at their times, the largest number in a row in which a tile was missing. 0 if
    /// the client sleeps.
    pub late_periods: f64,
    /// The frame of [`FaultRun::late_periods`].
    pub latest: Option<FrameId>,
    /// Number of nodes in the plan.
    pub nodes: usize,
    /// Whether frames were submitted each 1/60 s.
    pub pipelined: bool,
    /// Whether they were shown at their times, complete or not.
    pub looks_ahead: bool,
    /// Whether all nodes but the client's own were lost at once.
    pub all_lost: bool,
    /// Number of tiles that were missing when their frames were shown.
    pub late_tiles: u64,
    /// Number of tiles of all frames.
    pub tiles: u64,
}

/// A farm of 2 to 9 nodes with 1 to 5 faults, divided by any of the balancers or, if `hedged`, by
/// the default one.
pub fn fault_plan(seed: u64, hedged: bool) -> FarmPlan {
    let mut random = SplitMix64::keyed(&[seed, 0xfa17]);
    let others = 1 + random.below(8) as usize;
    let mut nodes = vec![NodePlan::new(2e-4, 1.2)];
    // Round trips of 0.3 to 60 ms and 0.3 to 9 million samples a second, uniform in their logarithms.
    nodes.extend((0..others).map(|_| NodePlan {
        jitter_secs: 1e-3 * random.uniform(),
        streams: random.uniform() < 0.7,
        ..NodePlan::new(
            3e-4 * 200f64.powf(random.uniform()),
            0.3 * 30f64.powf(random.uniform()),
        )
    }));
    for _ in 0..1 + random.below(5) {
        let at = 0.6 + 1.5 * random.uniform();
        let node = 1 + random.below(others as u64) as usize;
        fault(&mut random, at, &mut nodes[node]);
    }
    if random.uniform() < 0.1 {
        let at = 0.6 + 1.5 * random.uniform();
        nodes[1..]
            .iter_mut()
            .for_each(|node| node.changes.push((at, NodeChange::Silent)));
    }
    for node in &mut nodes {
        // A node that joins again later is still present from the start.
        node.changes.insert(0, (0.0, NodeChange::Join));
    }
    let balancers: Vec<Balancing> = Balancing::all().collect();
    let any = balancers[random.below(balancers.len() as u64) as usize];
    let pipelined = random.uniform() < 0.5;
    let frames_in_flight = if pipelined {
        8
    } else {
        1 + random.below(3) as usize
    };
    let looks_ahead = pipelined && random.uniform() < 0.5;
    let mut samples = 1;
    if random.uniform() < 0.25 {
        samples = SAMPLES;
        let speeds = nodes.iter_mut().map(|node| &mut node.msamples_per_sec);
        speeds.for_each(|speed| *speed *= f64::from(SAMPLES));
    }
    FarmPlan {
        seed,
        balancing: if hedged { Balancing::default() } else { any },
        nodes,
        frames: 120,
        frames_in_flight,
        period_secs: pipelined.then_some(PERIOD_SECS),
        looks_ahead,
        size: ImageSize::new(120, 80),
        samples,
        distribution: Distribution::Samples,
        conditions: NetworkConditions {
            cost_spread: 0.5,
            ..NetworkConditions::default()
        },
        ..FarmPlan::default()
    }
}

fn fault(random: &mut SplitMix64, at: f64, node: &mut NodePlan) {
    let later = at + 0.1 + 0.8 * random.uniform();
    let changes = match random.below(9) {
        0 => vec![(at, NodeChange::Silent)],
        1 => vec![(at, NodeChange::Die)],
        // Back after a pause.
        2 => vec![(at, NodeChange::Die), (later, NodeChange::Join)],
        3 => vec![(at, NodeChange::Slow(2.0 + 30.0 * random.uniform()))],
        4 => vec![(at, NodeChange::Slow(10.0)), (later, NodeChange::Slow(0.1))],
        5 => vec![(at, NodeChange::Fail)],
        6 => vec![(
            at,
            NodeChange::Lie(if random.uniform() < 0.5 { 0.0 } else { 50.0 }),
        )],
        7 => vec![(at, NodeChange::Poison)],
        // Cut off for half a minute: the connection times out after ten seconds.
        _ => vec![
            (at, NodeChange::Silent),
            (at + 10.0, NodeChange::Die),
            (at + 30.0, NodeChange::Join),
        ],
    };
    node.changes.extend(changes);
    if random.uniform() < 0.1 {
        node.changes
            .push((later, NodeChange::Suspend(60.0 * random.uniform())));
    }
}

/// Runs a plan and lists the violations: frames that are missing, out of order, or wrong.
pub fn run_faults(plan: &FarmPlan) -> FaultRun {
    let report = run(plan, SECS_MAX);
    let mut wrong = Vec::new();
    let sleeps = sleeps(plan);
    let whole = report.frames.iter().chain(&report.partial);
    let came: BTreeSet<FrameId> = whole.map(|frame| frame.id).collect();
    // Frames that were due while the client slept are not shown any more.
    if came.len() as u64 != plan.frames && !(plan.looks_ahead && sleeps) {
        wrong.push(format!("{} of {} frames came", came.len(), plan.frames));
    }
    if report.shown_late_secs > SHOWN_LATE_SECS_MAX && !sleeps {
        let millis = 1e3 * report.shown_late_secs;
        wrong.push(format!(
            "a frame was handed over {millis:.1} ms after its time"
        ));
    }
    if report.wrong_frames > 0 {
        wrong.push(format!("{} frames have wrong pixels", report.wrong_frames));
    }
    let in_order = report.frames.windows(2).all(|pair| pair[0].id < pair[1].id);
    if !in_order {
        wrong.push("frames are out of order".into());
    }
    let tiles = |frame: &carom_farm::Frame| frame.stats.tiles_by_node.iter().sum::<u32>();
    if report
        .frames
        .iter()
        .any(|frame| tiles(frame) != report.tiles_per_frame * frame.stats.passes)
    {
        wrong.push("tiles are counted wrong".into());
    }
    let (late_periods, latest) = match plan.looks_ahead {
        _ if sleeps => (0.0, None),
        true => longest_missing(plan, &report),
        false => latest(&report),
    };
    let late_tiles = report
        .partial
        .iter()
        .map(|frame| frame.missing.len() as u64);
    FaultRun {
        wrong,
        frames: report.frames.len(),
        late_periods,
        latest,
        nodes: plan.nodes.len(),
        pipelined: plan.period_secs.is_some(),
        looks_ahead: plan.looks_ahead,
        all_lost: all_lost(plan),
        late_tiles: late_tiles.sum(),
        tiles: u64::from(report.tiles_per_frame) * plan.frames,
    }
}

/// Whether the client sleeps.
fn sleeps(plan: &FarmPlan) -> bool {
    let mut changes = plan.nodes.iter().flat_map(|node| &node.changes);
    changes.any(|(_, change)| matches!(change, NodeChange::Suspend(_)))
}

fn all_lost(plan: &FarmPlan) -> bool {
    let silent = |node: &NodePlan, at: f64| node.changes.contains(&(at, NodeChange::Silent));
    let [_, first, others @ ..] = &plan.nodes[..] else {
        return false;
    };
    let mut at = first.changes.iter().map(|(at, _)| *at);
    at.any(|at| silent(first, at) && others.iter().all(|node| silent(node, at)))
}

/// Largest number of consecutive frames that were shown without the same tile, and the last of them.
fn longest_missing(plan: &FarmPlan, report: &SimulationReport) -> (f64, Option<FrameId>) {
    let columns = plan.grid().columns();
    let edge = u32::from(plan.tile_edge);
    let mut since = vec![0; plan.grid().len() as usize];
    let mut longest = (0, None);
    for (index, frame) in report.partial.iter().enumerate() {
        let follows = index > 0 && report.partial[index - 1].id.0 + 1 == frame.id.0;
        let before = std::mem::replace(&mut since, vec![0; plan.grid().len() as usize]);
        for tile in &frame.missing {
            let tile = (tile.y / edge * columns + tile.x / edge) as usize;
            since[tile] = 1 + if follows { before[tile] } else { 0 };
            if frame.id.0 >= WARM_UP_FRAMES as u64 && since[tile] > longest.0 {
                longest = (since[tile], Some(frame.id));
            }
        }
    }
    (f64::from(longest.0), longest.1)
}

/// The frame that took longest, and by how many periods it exceeds the 95th percentile.
fn latest(report: &SimulationReport) -> (f64, Option<FrameId>) {
    // The first frames are divided by guesses, before anything is measured.
    let frames = report.frames.iter().skip(WARM_UP_FRAMES);
    let mut frames: Vec<(f64, FrameId)> = frames
        .map(|frame| (frame.stats.makespan_secs, frame.id))
        .collect();
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (Some(usual), Some(worst)) = (frames.get(frames.len() * 19 / 20), frames.last()) else {
        return (0.0, None);
    };
    ((worst.0 - usual.0) / PERIOD_SECS, Some(worst.1))
}

/// Virtual seconds after which a run counts as hanging.
const SECS_MAX: f64 = 400.0;
/// Frames before the first fault.
const WARM_UP_FRAMES: usize = 5;
/// Samples of each pixel in plans that divide them among nodes.
const SAMPLES: u32 = 5;
/// Lateness in s that is due to the timer itself.
const SHOWN_LATE_SECS_MAX: f64 = 1e-6;
