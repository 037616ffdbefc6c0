//! Forecast of a frame: when each missing tile should arrive, and when all could if they were assigned
//! anew.

use carom_tracer::TileRange;

use super::frame_in_flight::FrameInFlight;
use super::hedge_budget::HedgeBudget;
use super::node_entry::NodeEntry;
use super::node_table::NodeTable;
use super::open_request::OpenRequest;
use super::partition::push_tile;
use super::workload::{RequestForecast, begins_after};
use crate::balancer::{CostModel, Estimate, water_fill};
use crate::node_status::NodeIndex;

/// Expected course of a frame without intervention. Times are seconds on the client's clock.
pub(super) struct FrameForecast {
    /// Expected arrival of each unit; infinite for those that no node holds, and for those that have
    /// arrived.
    pub(super) arrivals: Vec<f64>,
    /// By unit: whether its node can be told in time not to begin with it.
    pub(super) recallable: Vec<bool>,
    pub(super) missing: Vec<u32>,
    /// Nodes that hold missing tiles.
    pub(super) holders: Vec<NodeIndex>,
    /// Nodes that can take more requests; `help` is the cost model of each after all that it has been
    /// assigned.
    pub(super) helpers: Vec<NodeIndex>,
    pub(super) help: Vec<CostModel>,
    /// The earliest time by which all missing tiles could arrive if they were assigned anew.
    pub(super) level: f64,
}

/// Arrival times from which on tiles count as late.
#[derive(Clone, Copy)]
pub(super) struct LatenessBounds {
    /// For tiles that no node has begun: moving them costs nothing.
    pub(super) recallable: f64,
    /// For tiles that would be traced twice.
    pub(super) duplicate: f64,
    /// From here on tiles are gravely late, and may use the budget's reserve.
    pub(super) grave: f64,
}

impl FrameForecast {
    /// The forecast of an unfinished frame; `None` if no node can help.
    pub(super) fn new(now: f64, nodes: &NodeTable, frame: &FrameInFlight) -> Option<Self> {
        let newcomer = nodes.newcomer();
        let buffer = frame.buffer.as_ref()?;
        // Nodes with a failure help only where no others can.
        let can_help = |node: &NodeEntry| node.is_usable(frame.scene.hash());
        let has_trusted = nodes
            .iter()
            .any(|(_, node)| can_help(node) && node.is_trusted());
        let mut arrivals = vec![f64::INFINITY; frame.passes.all().count as usize];
        let mut recallable = vec![true; arrivals.len()];
        let (mut models, mut holders) = (Vec::new(), Vec::new());
        let (mut helpers, mut help) = (Vec::new(), Vec::new());
        for (index, node) in nodes.iter() {
            let workload = &node.workload;
            let forecasts = workload.forecast(now, newcomer);
            let held_before = models.len();
            for forecast in &forecasts {
                let request = &workload.requests[&forecast.id];
                if forecast.frame != frame.id || request.is_probe || request.is_lost {
                    continue;
                }
                let is_recallable = is_recallable(now, request, forecast, workload.delivered());
                let mut at = forecast.begin;
                let missing = buffer.missing(request.tiles, |_| true);
                for tile in missing.iter().flat_map(|range| range.indices()) {
                    // The tiles of a request arrive in order, each after the work of those before it.
                    at += forecast.pace * frame.work.of(one(tile));
                    let arrival = &mut arrivals[tile as usize];
                    // A tile that several nodes hold arrives with the first of them …
                    *arrival = arrival.min(at);
                    // … and is free to move only if none of them has begun it.
                    recallable[tile as usize] &= is_recallable;
                }
                let model = CostModel::new(forecast.begin, forecast.pace);
                // Work in progress counts as a node with that capacity and no more, so that the level is
                // that of the whole frame.
                models.push(model.with_work_max(forecast.outstanding));
            }
            if models.len() > held_before {
                holders.push(index);
            }
            let Some(cost) = workload.estimate().or(newcomer) else {
                continue;
            };
            if can_help(node) && (node.is_trusted() || !has_trusted) {
                helpers.push(index);
                // Help begins after the node's own queue, as far as that is served before this frame.
                let comes = now + cost.fixed_secs + workload.delay.secs(frame.id);
                let begin = begins_after(&forecasts, frame.id, comes);
                help.push(CostModel {
                    unmonitored_work: workload.arrivals.unmonitored_work(),
                    margin_secs: workload.arrivals.margin_secs(),
                    ..CostModel::new(begin, cost.secs_per_work)
                });
            }
        }
        if help.is_empty() {
            return None;
        }
        let missing = buffer.missing(frame.passes.all(), |_| true);
        models.extend(&help);
        Some(Self {
            arrivals,
            recallable,
            level: water_fill(frame.work.of_all(&missing), &models).finish_secs,
            missing: missing.iter().flat_map(|range| range.indices()).collect(),
            holders,
            helpers,
            help,
        })
    }

    /// Whether there is a helper other than the only holder.
    pub(super) fn can_move(&self) -> bool {
        self.holders.iter().any(|holder| self.helpers != [*holder])
    }

    /// When the last tile that a node holds should arrive.
    pub(super) fn finish(&self) -> f64 {
        let arrivals = self.arrivals.iter().filter(|at| at.is_finite());
        arrivals.copied().fold(0.0, f64::max)
    }

    /// The missing tiles that would be late, as far as the budget allows, the latest chosen first.
    pub(super) fn late(
        &self,
        bounds: LatenessBounds,
        budget: &HedgeBudget,
        work: impl Fn(u32) -> f64,
    ) -> Vec<TileRange> {
        let arrival = |tile: u32| self.arrivals[tile as usize];
        let is_recallable = |tile: u32| self.recallable[tile as usize];
        let until = |tile: u32| {
            if is_recallable(tile) {
                bounds.recallable
            } else {
                bounds.duplicate
            }
        };
        // Unassigned tiles are left to `Recovery::reassign_lost`.
        let late = |tile: &u32| arrival(*tile) > until(*tile) && arrival(*tile).is_finite();
        let mut late: Vec<u32> = self.missing.iter().copied().filter(late).collect();
        late.sort_by(|a, b| arrival(*b).total_cmp(&arrival(*a)));
        let mut sum = 0.0;
        late.retain(|tile| {
            if !is_recallable(*tile) {
                sum += work(*tile);
            }
            // From the latest on, so that a short budget goes to the tiles that delay the frame most.
            sum <= budget.work(arrival(*tile) > bounds.grave)
        });
        late.sort_unstable();
        let mut ranges = Vec::new();
        late.iter().for_each(|tile| push_tile(&mut ranges, *tile));
        ranges
    }
}

/// Whether a node of that cost can be told in time not to begin with a request: when the cancellation
/// arrives, it must not have reached it. Computed with `soonest`, as a late message may only have been
/// delayed by the network.
pub(super) fn is_recallable(
    now: f64,
    request: &OpenRequest,
    forecast: &RequestForecast,
    cost: Option<Estimate>,
) -> bool {
    let told = |cost: Estimate| now + cost.fixed_secs + SOONER * (forecast.soonest - now);
    request.tiles_received == 0 && cost.is_some_and(|cost| forecast.soonest > told(cost))
}

/// The range of a single tile.
pub(super) fn one(first: u32) -> TileRange {
    TileRange { first, count: 1 }
}

/// Safety margin: share of the time until a node should reach a request by which it may be earlier.
const SOONER: f64 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;

    /// Four tiles of work 1 that come at 1, 2, 3 and 4 s; the last two can still be recalled.
    fn forecast() -> FrameForecast {
        FrameForecast {
            arrivals: vec![1.0, 2.0, 3.0, 4.0],
            recallable: vec![false, false, true, true],
            missing: vec![0, 1, 2, 3],
            holders: vec![NodeIndex(0)],
            helpers: vec![NodeIndex(0)],
            help: vec![CostModel::new(0.0, 1.0)],
            level: 0.5,
        }
    }

    fn late(budget: &HedgeBudget) -> Vec<u32> {
        let bounds = LatenessBounds {
            recallable: 3.5,
            duplicate: 0.5,
            grave: f64::INFINITY,
        };
        let ranges = forecast().late(bounds, budget, |_| 1.0);
        ranges.iter().flat_map(|range| range.indices()).collect()
    }

    #[test]
    fn recallable_tiles_need_no_budget() {
        assert_eq!(late(&HedgeBudget::default()), [3]);
    }

    #[test]
    fn budget_goes_to_the_latest_duplicates() {
        let mut budget = HedgeBudget::default();
        budget.add_frame(5.0); // allows work of 1 at once
        assert_eq!(late(&budget), [1, 3]);
    }
}
