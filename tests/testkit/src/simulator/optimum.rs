//! The clairvoyant optimum: fractional water-filling that knows each frame's delays, pauses, paces and
//! costs beforehand. No algorithm that has to guess can reach it.

use carom_protocol::FrameId;

use super::random_environment::RandomEnvironment;
use super::{FarmPlan, NodeChange, NodePlan};
use carom_farm::NodeIndex;
use carom_farm::balancer::{CostModel, water_fill};

/// The optimal time in seconds of each frame of a plan; infinite where the nodes cannot do the work at
/// the plan's pace, or only when nearly always busy: their queues would then grow from frame to frame,
/// and frames would be skipped.
///
/// At a fixed frame rate a node begins with a frame once it has finished its part of those before: any
/// division, even with full knowledge, has to queue as well.
pub fn optimum_secs(plan: &FarmPlan) -> Vec<f64> {
    let environment = RandomEnvironment::new(plan.seed, plan.conditions, plan.grid());
    let mut nodes: Vec<NodeForecast> = (0..plan.nodes.len())
        .map(|index| NodeForecast {
            slowness: 1.0,
            there: !plan.joins_later(NodeIndex(index)),
            free_secs: 0.0,
        })
        .collect();
    let frame = |frame| {
        for (_, node, change) in plan.changes.iter().filter(|(at, ..)| *at == frame) {
            nodes[node.0].change(*change);
        }
        frame_secs(plan, &environment, &mut nodes, frame)
    };
    (0..plan.frames).map(FrameId).map(frame).collect()
}

/// Optimal time of one frame; updates how long the nodes work on it.
fn frame_secs(
    plan: &FarmPlan,
    environment: &RandomEnvironment,
    nodes: &mut [NodeForecast],
    frame: FrameId,
) -> f64 {
    let there: Vec<usize> = (0..nodes.len())
        .filter(|index| nodes[*index].there)
        .collect();
    let lines: Vec<CostModel> = there
        .iter()
        .map(|index| line(plan, environment, NodeIndex(*index), nodes[*index], frame))
        .collect();
    let work = environment.frame_cost(frame) * f64::from(plan.tile_edge).powi(2);
    let work = work * f64::from(plan.samples);
    if lines.is_empty() || !holds_pace(plan, nodes) {
        nodes.iter_mut().for_each(|node| node.free_secs = 0.0);
        return f64::INFINITY;
    }
    let filling = water_fill(work, &lines);
    if let Some(period_secs) = plan.period_secs {
        for ((index, line), share) in there.iter().zip(&lines).zip(&filling.shares) {
            let (node, index) = (&mut nodes[*index], NodeIndex(*index));
            if *share > 0.0 {
                let answers_secs = environment.delay_secs(index, frame);
                node.free_secs = line.fixed_secs + line.secs_per_work * share - answers_secs;
            }
            // Relative to the submission of the next frame.
            node.free_secs -= period_secs;
        }
    }
    filling.finish_secs
}

/// Whether the nodes, each busy for [`BUSY_MAX`] of the time, can do frames of average work.
fn holds_pace(plan: &FarmPlan, nodes: &[NodeForecast]) -> bool {
    let Some(period_secs) = plan.period_secs else {
        return true;
    };
    let there = plan.nodes.iter().zip(nodes).filter(|(_, node)| node.there);
    let speed: f64 = there
        .map(|(plan, node)| 1e6 * plan.msamples_per_sec / node.slowness)
        .sum();
    let work = plan.size.pixels() as f64 * f64::from(plan.samples);
    work <= BUSY_MAX * period_secs * speed
}

/// Utilisation above which a farm counts as too slow for its pace.
const BUSY_MAX: f64 = 0.95;

/// Work of each node in the optimum of a farm without random variation.
pub(super) fn shares(nodes: &[NodePlan], work: f64) -> Vec<f64> {
    let line = |node: &NodePlan| CostModel::new(node.round_trip_secs, 1e-6 / node.msamples_per_sec);
    let lines: Vec<CostModel> = nodes.iter().map(line).collect();
    water_fill(work, &lines).shares
}

/// State of a node after its changes.
#[derive(Clone, Copy)]
struct NodeForecast {
    slowness: f64,
    there: bool,
    /// Time in s at which its next answers can begin, relative to the next frame and without their
    /// delays.
    free_secs: f64,
}

impl NodeForecast {
    fn change(&mut self, change: NodeChange) {
        match change {
            NodeChange::Slow(factor) => self.slowness *= factor,
            NodeChange::Silent | NodeChange::Die | NodeChange::Fail | NodeChange::Drain => {
                self.there = false;
            }
            NodeChange::Join => self.there = true,
            NodeChange::Lie(_)
            | NodeChange::Poison
            | NodeChange::Forge(_)
            | NodeChange::Suspend(_) => {}
        }
    }
}

fn line(
    plan: &FarmPlan,
    environment: &RandomEnvironment,
    node: NodeIndex,
    state: NodeForecast,
    frame: FrameId,
) -> CostModel {
    let NodePlan {
        round_trip_secs,
        msamples_per_sec,
        ..
    } = plan.nodes[node.0];
    let secs_per_work = 1e-6 / msamples_per_sec * state.slowness * environment.pace(node, frame);
    let begin_secs = round_trip_secs.max(state.free_secs) + environment.stall_secs(node, frame);
    let fixed_secs = begin_secs + environment.delay_secs(node, frame);
    // Work of more than a period per frame would let the node's queue grow without bound.
    let cap = plan
        .period_secs
        .map_or(f64::INFINITY, |period| period / secs_per_work);
    CostModel::new(fixed_secs, secs_per_work).with_work_max(cap)
}
