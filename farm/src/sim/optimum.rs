//! The clairvoyant optimum: fractional water-filling that knows this frame's delays, pauses, paces
//! and costs beforehand. Nothing that has to guess can reach it.

use carom_protocol::FrameId;

use super::world::World;
use super::{Change, NodePlan, Plan};
use crate::coordinator::NodeIndex;
use crate::coordinator::balancer::{Line, fill};

/// The least seconds that each frame of a plan could take; infinite where, at the plan's pace, the
/// nodes cannot do all the work.
pub fn optimum_secs(plan: &Plan) -> Vec<f64> {
    let world = World::new(plan.seed, plan.weather, plan.grid());
    let mut nodes: Vec<State> = (0..plan.nodes.len())
        .map(|index| State {
            slowness: 1.0,
            there: !plan.joins_later(NodeIndex(index)),
        })
        .collect();
    let frame = |frame| {
        for (_, node, change) in plan.changes.iter().filter(|(at, ..)| *at == frame) {
            nodes[node.0].change(*change);
        }
        let lines: Vec<Line> = (0..nodes.len())
            .filter(|index| nodes[*index].there)
            .map(|index| line(plan, &world, NodeIndex(index), nodes[index], frame))
            .collect();
        let work = world.frame_cost(frame) * f64::from(plan.tile_edge).powi(2);
        let work = work * f64::from(plan.samples);
        let capacity: f64 = lines.iter().map(|line| line.cap).sum();
        if lines.is_empty() || capacity < work {
            return f64::INFINITY;
        }
        fill(work, &lines).finish_secs
    };
    (0..plan.frames).map(FrameId).map(frame).collect()
}

/// The work of each node in the optimum of a calm farm.
pub(super) fn shares(nodes: &[NodePlan], work: f64) -> Vec<f64> {
    let line = |node: &NodePlan| Line::new(node.round_trip_secs, 1e-6 / node.msamples_per_sec);
    let lines: Vec<Line> = nodes.iter().map(line).collect();
    fill(work, &lines).shares
}

/// What changes have made of a node.
#[derive(Clone, Copy)]
struct State {
    slowness: f64,
    there: bool,
}

impl State {
    fn change(&mut self, change: Change) {
        match change {
            Change::Slow(factor) => self.slowness *= factor,
            Change::Silent | Change::Die | Change::Fail => self.there = false,
            Change::Join => self.there = true,
            Change::Lie(_) | Change::Poison | Change::Suspend(_) => {}
        }
    }
}

fn line(plan: &Plan, world: &World, node: NodeIndex, state: State, frame: FrameId) -> Line {
    let NodePlan {
        round_trip_secs,
        msamples_per_sec,
        ..
    } = plan.nodes[node.0];
    let b_secs = 1e-6 / msamples_per_sec * state.slowness * world.pace(node, frame);
    let a_secs = round_trip_secs + world.delay_secs(node, frame) + world.stall_secs(node, frame);
    let cap = plan
        .period_secs
        .map_or(f64::INFINITY, |period| period / b_secs);
    Line::new(a_secs, b_secs).capped(cap)
}
