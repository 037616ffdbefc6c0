//! Random farms on which random things go wrong, each from its seed.
//!
//! The first node is the client's own: slow, near, and sound, so that every frame can be traced
//! whatever becomes of the others. What a session refuses (tiles of a wrong size or frame, or sent
//! twice) ends the connection; `protocol/tests/wire` shows that. Here the connection ends, and the
//! node is called again after pauses that double.

use carom_tracer::ImageSize;

use super::random::Random;
use super::scenario::PERIOD_SECS;
use super::{Change, NodePlan, Plan, Report, Weather, run};
use crate::Balancing;

/// What came of a plan with faults.
#[derive(Clone, Debug)]
pub struct FaultRun {
    /// What is wrong with it; nothing, if it is as it should be.
    pub wrong: Vec<String>,
    /// Frames.
    pub frames: usize,
    /// How much longer than nineteen of twenty frames the longest took, in periods of 1/60 s. A
    /// frame that waited for a sleeping client does not count.
    pub late_periods: f64,
    /// Nodes at the start.
    pub nodes: usize,
    /// Whether frames were submitted each 1/60 s.
    pub pipelined: bool,
}

/// A farm of 2 to 9 nodes with 1 to 5 faults, divided by any of the balancers or, if `hedged`, by
/// the default one.
pub fn fault_plan(seed: u64, hedged: bool) -> Plan {
    let mut random = Random::of(&[seed, 0xfa17]);
    let others = 1 + random.below(8) as usize;
    let mut nodes = vec![NodePlan::new(2e-4, 1.2)];
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
            .for_each(|node| node.changes.push((at, Change::Silent)));
    }
    for node in &mut nodes {
        // One that joins again was there from the start.
        node.changes.insert(0, (0.0, Change::Join));
    }
    let balancers: Vec<Balancing> = Balancing::all().collect();
    let any = balancers[random.below(balancers.len() as u64) as usize];
    let pipelined = random.uniform() < 0.5;
    Plan {
        seed,
        balancing: if hedged { Balancing::default() } else { any },
        nodes,
        frames: 120,
        frames_in_flight: if pipelined {
            8
        } else {
            1 + random.below(3) as usize
        },
        period_secs: pipelined.then_some(PERIOD_SECS),
        size: ImageSize::new(120, 80),
        tile_edge: 8,
        weather: Weather {
            cost_spread: 0.5,
            ..Weather::default()
        },
        changes: Vec::new(),
    }
}

fn fault(random: &mut Random, at: f64, node: &mut NodePlan) {
    let later = at + 0.1 + 0.8 * random.uniform();
    let changes = match random.below(9) {
        0 => vec![(at, Change::Silent)],
        1 => vec![(at, Change::Die)],
        // Back after a pause.
        2 => vec![(at, Change::Die), (later, Change::Join)],
        3 => vec![(at, Change::Slow(2.0 + 30.0 * random.uniform()))],
        4 => vec![(at, Change::Slow(10.0)), (later, Change::Slow(0.1))],
        5 => vec![(at, Change::Fail)],
        6 => vec![(
            at,
            Change::Lie(if random.uniform() < 0.5 { 0.0 } else { 50.0 }),
        )],
        7 => vec![(at, Change::Poison)],
        // Cut off for half a minute: the connection times out after ten seconds.
        _ => vec![
            (at, Change::Silent),
            (at + 10.0, Change::Die),
            (at + 30.0, Change::Join),
        ],
    };
    node.changes.extend(changes);
    if random.uniform() < 0.1 {
        node.changes
            .push((later, Change::Suspend(60.0 * random.uniform())));
    }
}

/// Runs a plan and says what is wrong: frames that are missing, out of order, or not the picture.
pub fn run_faults(plan: &Plan) -> FaultRun {
    let report = run(plan, SECS_MAX);
    let mut wrong = Vec::new();
    let count = report.frames.len() as u64;
    if count != plan.frames {
        wrong.push(format!("{count} of {} frames came", plan.frames));
    }
    if report.wrong_frames > 0 {
        wrong.push(format!("{} frames have wrong pixels", report.wrong_frames));
    }
    let in_order = report.frames.windows(2).all(|pair| pair[0].id < pair[1].id);
    if !in_order {
        wrong.push("frames are out of order".into());
    }
    let tiles = |frame: &crate::Frame| frame.stats.tiles_by_node.iter().sum::<u32>();
    if report
        .frames
        .iter()
        .any(|frame| tiles(frame) != report.tiles_per_frame)
    {
        wrong.push("tiles are counted wrong".into());
    }
    FaultRun {
        wrong,
        frames: report.frames.len(),
        late_periods: late_periods(plan, &report),
        nodes: plan.nodes.len(),
        pipelined: plan.period_secs.is_some(),
    }
}

fn late_periods(plan: &Plan, report: &Report) -> f64 {
    let sleeps = plan.nodes.iter().flat_map(|node| &node.changes);
    let mut sleeps = sleeps.filter(|(_, change)| matches!(change, Change::Suspend(_)));
    if sleeps.next().is_some() {
        return 0.0;
    }
    // The first frames are divided by guesses.
    let frames = report.frames.iter().skip(WARM_UP_FRAMES);
    let mut secs: Vec<f64> = frames.map(|frame| frame.stats.makespan_secs).collect();
    secs.sort_by(f64::total_cmp);
    let usual = secs.get(secs.len() * 19 / 20).copied().unwrap_or(0.0);
    let worst = secs.last().copied().unwrap_or(0.0);
    (worst - usual) / PERIOD_SECS
}

/// Virtual seconds after which a run counts as hanging.
const SECS_MAX: f64 = 400.0;
/// Frames before the first fault.
const WARM_UP_FRAMES: usize = 5;
