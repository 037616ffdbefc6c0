//! Recovery of tiles that do not arrive: of nodes that are lost, that refuse, that fall silent, and that
//! are late. The first copy of a tile wins.
//!
//! ```text
//! lost    connection ends       ─▶ its requests are forgotten    ┐
//! refused RequestRefused        ─▶ Recovery::refuse, a back-off  ├▶ their tiles are unassigned
//! silent  NodeEntry::time_out   ─▶ its requests count as lost    ┘  ─▶ Recovery::reassign_lost
//! late    Recovery::evaluate    ─▶ the same tiles from others too, within the HedgeBudget
//! ```
//!
//! A frame is evaluated when a message is late or shows lateness, not only when the frame is: by then, what
//! a distant node has not begun to send could not be replaced in time. Hedged requests follow Dean and
//! Barroso, "The Tail at Scale", CACM 56(2), 2013: a few per cent more requests remove most of the tail.
//! `bench balance` prints gain and cost.

use carom_protocol::{Refusal, RefusalReason, RequestId};
use carom_tracer::TileRange;

use super::dispatcher::Dispatcher;
use super::frame_forecast::{FrameForecast, LatenessBounds, is_recallable, one};
use super::frame_in_flight::FrameInFlight;
use super::frame_queue::FrameQueue;
use super::hedge_budget::HedgeBudget;
use super::node_entry::NodeEntry;
use super::node_table::NodeTable;
use super::open_request::OpenRequest;
use super::partition::push_tile;
use crate::balancer::{Division, WaterFilling};
use crate::link::LinkCommand;
use crate::node_status::NodeIndex;

/// Policy of reassignments and hedges. Times are seconds on the client's clock.
#[derive(Debug, Default)]
pub(super) struct Recovery {
    /// Work that may be duplicated. Tiles taken over from lost nodes do not count.
    pub(super) budget: HedgeBudget,
}

impl Recovery {
    /// Backs off from a node that has refused a request, if the request was still wanted. Returns the
    /// reason if the node, its device or the request is at fault.
    pub(super) fn refuse(now: f64, node: &mut NodeEntry, refusal: &Refusal) -> Option<String> {
        let request = node.workload.requests.get(&refusal.request);
        let is_wanted = request.is_some_and(|request| !request.is_cancelled);
        let why = match &refusal.why {
            RefusalReason::Cancelled | RefusalReason::Busy if is_wanted => None,
            RefusalReason::Cancelled | RefusalReason::Busy => return None,
            RefusalReason::UnknownScene => {
                Some("it has lost the scene, which is sent again".to_owned())
            }
            RefusalReason::Invalid(why) => Some(format!("it calls a request invalid: {why}")),
            RefusalReason::Device(why) => Some(format!("its device failed: {why}")),
        };
        node.back_off(now, why.clone());
        why
    }

    /// Requests the unassigned `tiles` of an already assigned frame from `helpers`, so that the last one
    /// arrives as early as possible.
    pub(super) fn reassign_lost(
        &self,
        now: f64,
        frame: &mut FrameInFlight,
        tiles: &[TileRange],
        helpers: &[NodeIndex],
        dispatcher: &mut Dispatcher,
    ) {
        frame.count_lost(tiles);
        let models = WaterFilling::cost_models(&Division {
            work: frame.work.of_all(tiles),
            tile_work: frame.work.mean_tile(),
            period_secs: f64::INFINITY,
            candidates: &dispatcher.nodes.candidates(now, frame.id, helpers),
        });
        let partition = frame.work.partition(tiles, &models);
        for (node, tiles) in helpers.iter().zip(partition.tiles) {
            dispatcher.request(now, *node, frame, &tiles, false);
        }
        self.set_target(now, &dispatcher.nodes, frame);
    }

    /// Sets the frame's target to the latest finish that is forecast for any of its nodes.
    pub(super) fn set_target(&self, now: f64, nodes: &NodeTable, frame: &mut FrameInFlight) {
        let id = frame.id;
        let finish = |node: &NodeEntry| {
            let forecasts = node.workload.forecast(now, None).into_iter();
            let of_frame = forecasts.filter(|forecast| forecast.frame == id);
            let requests = &node.workload.requests;
            let held = of_frame.filter(|forecast| !requests[&forecast.id].is_lost);
            held.map(|forecast| forecast.finish()).reduce(f64::max)
        };
        let target = nodes.iter().filter_map(|(_, node)| finish(node));
        frame.target = target.reduce(f64::max).unwrap_or(f64::INFINITY);
        frame.planned_secs = frame.planned_secs.min(frame.target - frame.submitted);
        self.schedule(now, nodes, frame);
    }

    /// Schedules a frame's next evaluation for when the next message counts as late.
    pub(super) fn schedule(&self, now: f64, nodes: &NodeTable, frame: &mut FrameInFlight) {
        frame.evaluate_at = None;
        // Nobody waits for a background frame: only its lost tiles are traced again.
        if frame.buffer.is_none() || !nodes.hedged || frame.id.is_background() {
            return;
        }
        // A node that has delivered nothing is timed as the average of the others.
        let newcomer = nodes.newcomer();
        // The emptier the budget, the larger the margin: hedges that the budget cannot pay for are not
        // searched for.
        let margin = frame.margin_secs(self.price());
        let soonest = frame.last_evaluation + evaluation_pause_secs(now, frame);
        let mut due = None::<f64>;
        for (_, node) in nodes.iter() {
            let mut requests = node.workload.requests.values();
            if !requests.any(|request| request.frame == frame.id && request.counts()) {
                continue;
            }
            let Some(next) = node.workload.next_message(newcomer) else {
                continue;
            };
            let late = now - next;
            let at = if late < margin {
                next + margin
            } else {
                // Already late: the next evaluation is when the delay has grown by a quarter, so that their
                // number grows with the logarithm of the delay.
                now + late * LATE_PAUSE
            };
            due = Some(due.map_or(at, |due| due.min(at)));
        }
        frame.evaluate_at = due.map(|due| due.max(soonest).max(now));
    }

    /// Schedules the frames that had no evaluation because no node's cost was known.
    pub(super) fn schedule_waiting(&self, now: f64, nodes: &NodeTable, frames: &mut FrameQueue) {
        let frames = frames.unfinished_mut();
        for frame in frames.filter(|frame| frame.evaluate_at.is_none()) {
            self.schedule(now, nodes, frame);
        }
    }

    /// Brings evaluations forward if the node's last message shows that its rest will be late.
    pub(super) fn advance_late(
        &self,
        now: f64,
        nodes: &NodeTable,
        node: NodeIndex,
        frames: &mut FrameQueue,
    ) {
        if !nodes.hedged {
            return;
        }
        let price = self.price();
        for forecast in nodes[node].workload.forecast(now, None) {
            let Some(frame) = frames.get_mut(forecast.frame) else {
                continue;
            };
            let late = forecast.finish() > frame.target + frame.margin_secs(price);
            let soonest = now.max(frame.last_evaluation + evaluation_pause_secs(now, frame));
            if late && let Some(at) = &mut frame.evaluate_at {
                *at = at.min(soonest);
            }
        }
    }

    /// Evaluates long frames at once, so that they profit from a node that has just become ready.
    pub(super) fn advance_long(now: f64, frames: &mut FrameQueue) {
        for frame in frames.unfinished_mut() {
            if frame.evaluate_at.is_some() && frame.target > now + LONG_SECS {
                frame.evaluate_at = Some(now);
            }
        }
    }

    /// Evaluates at once the frames that were divided by guesses and would take very long by them, so that
    /// they profit from a node that has just shown its speed.
    pub(super) fn advance_guessed(now: f64, frames: &mut FrameQueue) {
        for frame in frames.unfinished_mut().filter(|frame| frame.is_guessed) {
            let is_long = frame.target.is_finite() && frame.target > now + VERY_LONG_SECS;
            if frame.evaluate_at.is_some() && is_long {
                frame.evaluate_at = Some(now);
            }
        }
    }

    /// Evaluates the frames that are due.
    pub(super) fn evaluate_due(
        &mut self,
        now: f64,
        frames: &mut FrameQueue,
        dispatcher: &mut Dispatcher,
    ) {
        for frame in frames.unfinished_mut() {
            if frame.evaluate_at.is_some_and(|at| at <= now) {
                self.evaluate(now, frame, dispatcher);
                frame.last_evaluation = now;
                self.schedule(now, &dispatcher.nodes, frame);
            }
        }
    }

    /// Requests the late tiles of a frame from the nodes that can deliver them in time.
    fn evaluate(&mut self, now: f64, frame: &mut FrameInFlight, dispatcher: &mut Dispatcher) {
        let Some(forecast) = FrameForecast::new(now, &dispatcher.nodes, frame) else {
            return;
        };
        // With fewer tiles missing than helpers, some helpers would idle: the price of duplicates falls in
        // proportion. With 1000 distant nodes this lowers the 99th percentile at 60 frames per second from
        // 1.50 to 1.45 times the optimum.
        let left = forecast.missing.len() as f64 / forecast.helpers.len() as f64;
        let price = 1.0 + (self.price() - 1.0) * left.min(1.0);
        frame.target = forecast.level;
        // The only holder is the only helper.
        if !forecast.can_move() {
            return;
        }
        let (margin, dear) = (frame.margin_secs(1.0), frame.margin_secs(price));
        let mut grave_secs = GRAVE_SHARE * frame.planned_secs;
        // A plan made from guesses is no measure of what is late: the possible duration is.
        if frame.is_guessed && forecast.finish() > frame.submitted + VERY_LONG_SECS {
            let possible_secs = forecast.level - frame.submitted;
            grave_secs = grave_secs.min(GRAVE_FACTOR * possible_secs);
        }
        let mut bounds = LatenessBounds {
            recallable: forecast.level + margin,
            duplicate: forecast.level + dear,
            grave: frame.submitted + grave_secs + dear,
        };
        // `level` is the optimum for divisible work. If whole tiles cannot arrive by then, only those that
        // would come after the achievable finish are worth moving: each round raises the bound to that
        // finish, so that fewer tiles are late and the finish falls. It ends when the two meet, or when no
        // tile is late any more.
        for _ in 0..ROUNDS_MAX {
            let late = forecast.late(bounds, &self.budget, |tile| frame.work.of(one(tile)));
            if late.is_empty() {
                return;
            }
            let partition = frame.work.partition(&late, &forecast.help);
            if partition.finish_secs <= bounds.recallable + margin {
                recall(now, frame, &late, dispatcher);
                self.spend(frame, &forecast, bounds.grave, &partition.tiles);
                for (node, tiles) in forecast.helpers.iter().zip(&partition.tiles) {
                    dispatcher.request(now, *node, frame, tiles, false);
                }
                return;
            }
            // Both bounds rise by the same amount, which keeps the preference for tiles that are free to
            // move over duplicates.
            bounds.duplicate += partition.finish_secs - bounds.recallable;
            bounds.recallable = partition.finish_secs;
        }
    }

    /// Counts reissued tiles, and charges the budget with those that will be traced twice.
    fn spend(
        &mut self,
        frame: &mut FrameInFlight,
        forecast: &FrameForecast,
        grave: f64,
        tiles: &[Vec<TileRange>],
    ) {
        for range in tiles.iter().flatten() {
            frame.reissued.push(*range);
            frame.stats.reissued_tiles += range.count;
            let is_duplicate = |tile: &u32| !forecast.recallable[*tile as usize];
            for tile in range.indices().filter(is_duplicate) {
                let is_grave = forecast.arrivals[tile as usize] > grave;
                self.budget.spend(frame.work.of(one(tile)), is_grave);
            }
        }
    }

    /// Factor by which the lateness margin of duplicates grows as the budget empties, from 1 to 1 +
    /// [`PRICE`], so that the rest goes to the latest tiles.
    fn price(&self) -> f64 {
        1.0 + PRICE * (1.0 - self.budget.fullness())
    }
}

/// Seconds between two evaluations of a frame: longer, the more of it has been reissued and the farther off
/// its end is. Late tiles may catch up in that time, and enough is left to hedge.
fn evaluation_pause_secs(now: f64, frame: &FrameInFlight) -> f64 {
    let left = frame.target - now - LONG_SECS;
    let far = if left.is_finite() {
        frame.reissued_per_tile() * left
    } else {
        0.0
    };
    EVALUATION_PAUSE_SECS + far.clamp(0.0, FAR_PAUSE_SECS_MAX)
}

/// Cancels the requests that their nodes have not begun and that hold any of the `late` tiles, and requests
/// their other tiles anew.
fn recall(now: f64, frame: &mut FrameInFlight, late: &[TileRange], dispatcher: &mut Dispatcher) {
    let is_late = |tile: u32| {
        let mut late = late.iter();
        late.any(|range| range.first <= tile && tile < range.end())
    };
    for index in dispatcher.nodes.indices() {
        let workload = &mut dispatcher.nodes[index].workload;
        let cost = workload.delivered();
        let mut kept = Vec::new();
        let mut cancelled = Vec::new();
        for forecast in workload.forecast(now, None) {
            let Some(request) = workload.requests.get_mut(&forecast.id) else {
                continue;
            };
            let is_recallable = request.frame == frame.id
                && request.counts()
                && is_recallable(now, request, &forecast, cost);
            if is_recallable && request.tiles.indices().any(is_late) {
                // Not through `Workload::cancel`: nothing is learned from what was never begun.
                request.is_cancelled = true;
                cancelled.push(forecast.id);
                let keeps = request.tiles.indices().filter(|tile| !is_late(*tile));
                keeps.for_each(|tile| push_tile(&mut kept, tile));
            }
        }
        for request in cancelled {
            dispatcher.send(index, LinkCommand::CancelRequest(request));
        }
        dispatcher.request(now, index, frame, &kept, false);
    }
}

/// Cancels requests of a frame whose tiles have all come from other nodes, on nodes that have other work.
/// On idle nodes they go on: their completion is an observation for the estimator.
pub(super) fn cancel_redundant(
    now: f64,
    frame: &FrameInFlight,
    tiles: TileRange,
    dispatcher: &mut Dispatcher,
) {
    let overlaps = |range: &TileRange| range.first < tiles.end() && tiles.first < range.end();
    let Some(buffer) = &frame.buffer else {
        return;
    };
    if !frame.reissued.iter().any(overlaps) {
        return;
    }
    let is_redundant = |request: &OpenRequest| {
        request.frame == frame.id
            && request.is_wanted()
            && overlaps(&request.tiles)
            && buffer.has(request.tiles)
    };
    let mut redundant: Vec<(NodeIndex, RequestId)> = Vec::new();
    for (index, node) in dispatcher.nodes.iter() {
        let requests = node.workload.requests.iter();
        let open = requests.filter(|(_, request)| request.outstanding() > 0.0);
        let (unwanted, wanted): (Vec<_>, Vec<_>) =
            open.partition(|(_, request)| is_redundant(request));
        if !wanted.is_empty() {
            redundant.extend(unwanted.iter().map(|(id, _)| (index, **id)));
        }
    }
    for (node, request) in redundant {
        dispatcher.cancel(now, node, request);
    }
}

/// Growth of the lateness margin of duplicates from a full to an empty budget.
const PRICE: f64 = 8.0;
/// A tile is gravely late if its frame takes this many times its planned duration. The reserve for such
/// tiles brings three in four of the frames after a fault in on time.
const GRAVE_SHARE: f64 = 1.25;
/// The same for a frame that was divided by guesses, as when a slow node was alone at first, relative to
/// the duration possible if all missing tiles were assigned anew.
const GRAVE_FACTOR: f64 = 1.5;
/// Minimum seconds between two evaluations of a frame.
const EVALUATION_PAUSE_SECS: f64 = 0.5e-3;
/// Maximum extra seconds between two evaluations of a frame whose end is far off and much of which has been
/// reissued. Over the first 24 frames of eight processes on two busy cores it lowers the reissues per tile
/// from 1.4–1.7 to 0.9–1.1 (`carom-bench first-frames`). A larger margin for such frames in addition
/// exceeds the bounds of `tests/sim/acceptance.rs` for two nodes on a local network.
const FAR_PAUSE_SECS_MAX: f64 = 0.1;
/// Growth of a message's delay, as a share, until the next evaluation.
const LATE_PAUSE: f64 = 0.25;
/// Maximum rounds of choosing the late tiles anew because not all can be delivered in time.
const ROUNDS_MAX: u32 = 4;
/// Remaining seconds from which on a frame is evaluated when a node joins, and more rarely otherwise.
const LONG_SECS: f64 = 0.05;
/// Remaining seconds from which on a frame divided by guesses is evaluated when more is known.
const VERY_LONG_SECS: f64 = 0.1;
