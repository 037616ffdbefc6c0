//! Asks again for tiles that will be late, of whoever finishes them first; the first answer wins.
//!
//! ```text
//! look: what nodes still hold, and at which pace it comes ─▶ the time D at which all of it could
//!       be there if it were divided now ─▶ tiles that come after D, by those who can by then
//! ```
//!
//! Dean and Barroso, "The Tail at Scale", CACM 56(2), 2013: a few per cent more requests take
//! away most of the tail. A look is taken when a message is late or tells of lateness, not only
//! when the frame is: what a far node has not begun to send by then could not be got in time.
//! `carom-bench balance` prints what it gains and what it costs.

use carom_protocol::FrameId;
use carom_tracer::TileRange;

use super::arrival_model::{Prospect, begins_after};
use super::hedge_budget::Spare;
use super::node_state::Node;
use super::open_request::Run;
use super::partition::push_tile;
use super::{Coordinator, NodeIndex};
use crate::balancer::{CostModel, Estimate, water_fill};
use crate::link::LinkCommand;

/// From when on tiles are late.
#[derive(Clone, Copy)]
struct Bounds {
    /// Those that nobody has begun with.
    free: f64,
    /// Those that will be traced twice.
    twice: f64,
    /// From here on they are gravely late.
    grave: f64,
}

/// How a frame should go on if nothing is done.
struct Forecast {
    /// When each missing tile should come; infinite if nobody holds it, and for those that are
    /// there already.
    arrivals: Vec<f64>,
    /// Whether the node that holds a tile can be told in time not to begin with it.
    free: Vec<bool>,
    missing: Vec<u32>,
    /// What each node can do that can be asked for more, after all that it has been asked for.
    helpers: Vec<NodeIndex>,
    help: Vec<CostModel>,
    /// When all missing tiles could be there if they were divided anew.
    level: f64,
}

impl Coordinator {
    /// Looks at the frames for which it is time.
    pub(super) fn hedge(&mut self, now: f64) {
        let due = |at: Option<f64>| at.is_some_and(|at| at <= now);
        let frames = self.frames.iter().filter(|frame| due(frame.hedge_at));
        let frames: Vec<FrameId> = frames.map(|frame| frame.id).collect();
        for id in frames {
            self.look(now, id);
            if let Some(frame) = self.frames.by_id(id) {
                frame.last_look = now;
            }
            self.set_hedge(now, id);
        }
    }

    /// Sets the time of the next look: when the next message is late.
    pub(super) fn set_hedge(&mut self, now: f64, id: FrameId) {
        let (newcomer, price) = (self.newcomer(), self.price());
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        frame.hedge_at = None;
        if frame.film.is_none() || !self.balancing.hedged {
            return;
        }
        let margin = frame.margin_secs(price);
        let (soonest, mut due) = (frame.last_look + LOOK_PAUSE_SECS, None::<f64>);
        for node in &self.nodes {
            if !node
                .runs
                .values()
                .any(|run| run.frame == id && run.counts())
            {
                continue;
            }
            let Some(next) = node.next_message(newcomer) else {
                continue;
            };
            let late = now - next;
            let at = if late < margin {
                next + margin
            } else {
                now + late * LATE_PAUSE
            };
            due = Some(due.map_or(at, |due| due.min(at)));
        }
        if let Some(frame) = self.frames.by_id(id) {
            frame.hedge_at = due.map(|due| due.max(soonest).max(now));
        }
    }

    /// Brings the next look forward if what has just come of a node tells that the rest is late.
    pub(super) fn watch(&mut self, now: f64, index: NodeIndex) {
        if !self.balancing.hedged {
            return;
        }
        let price = self.price();
        for prospect in self.nodes[index.0].prospects(now, None) {
            let Some(frame) = self.frames.by_id(prospect.frame) else {
                continue;
            };
            let late = prospect.finish() > frame.target + frame.margin_secs(price);
            if late && let Some(at) = &mut frame.hedge_at {
                *at = at.min(now.max(frame.last_look + LOOK_PAUSE_SECS));
            }
        }
    }

    /// Sets the looks that had to wait until something was known of any node.
    pub(super) fn predict_newcomers(&mut self, now: f64) {
        for id in self.frames.unfinished() {
            let waits = |frame: &mut super::FrameInFlight| frame.hedge_at.is_none();
            if self.frames.by_id(id).is_some_and(waits) {
                self.set_hedge(now, id);
            }
        }
    }

    /// Lets frames that will take long profit from a node that has just become ready.
    pub(super) fn hasten_hedges(&mut self, now: f64) {
        for frame in self.frames.iter_mut() {
            if frame.hedge_at.is_some() && frame.target > now + LONG_SECS {
                frame.hedge_at = Some(now);
            }
        }
    }

    /// How many times the usual margin a tile may be late: more, the less work is left that may be
    /// done twice, so that it goes to the latest tiles.
    fn price(&self) -> f64 {
        1.0 + PRICE * (1.0 - self.spare.fullness())
    }

    fn look(&mut self, now: f64, id: FrameId) {
        let Some(forecast) = self.forecast(now, id) else {
            return;
        };
        // The last tiles cost little, and the frame waits for them: with 1000 far nodes the 99th percentile
        // of frames at 60 a second is 1.45 times the optimum instead of 1.50.
        let left = forecast.missing.len() as f64 / forecast.helpers.len() as f64;
        let (spare, price) = (&self.spare, 1.0 + (self.price() - 1.0) * left.min(1.0));
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        frame.target = forecast.level;
        let (margin, dear) = (frame.margin_secs(1.0), frame.margin_secs(price));
        let mut bounds = Bounds {
            free: forecast.level + margin,
            twice: forecast.level + dear,
            grave: frame.submitted + GRAVE_SHARE * frame.planned_secs + dear,
        };
        for _ in 0..DEALS_MAX {
            let late = forecast.late(bounds, spare, |tile| frame.work.of(one(tile)));
            if late.is_empty() {
                return;
            }
            let deal = frame.work.deal(&late, &forecast.help);
            if deal.finish_secs <= bounds.free + margin {
                self.take_back(now, id, &late);
                self.ask_again(now, id, &forecast, bounds.grave, deal.runs);
                return;
            }
            bounds.twice += deal.finish_secs - bounds.free;
            bounds.free = deal.finish_secs;
        }
    }

    /// Cancels the runs that their nodes have not begun and that hold any of the `late` tiles, and
    /// asks for the other tiles of them anew.
    fn take_back(&mut self, now: f64, id: FrameId, late: &[TileRange]) {
        let is_late = |tile: u32| late.iter().any(|run| run.first <= tile && tile < run.end());
        for index in (0..self.nodes.len()).map(NodeIndex) {
            let node = &mut self.nodes[index.0];
            let line = node.delivered();
            let mut kept = Vec::new();
            let mut cancelled = Vec::new();
            for prospect in node.prospects(now, None) {
                let run_id = &prospect.run;
                let Some(run) = node.runs.get_mut(run_id) else {
                    continue;
                };
                let free = run.frame == id && run.counts() && is_free(now, run, &prospect, line);
                if free && run.tiles.indices().any(is_late) {
                    run.cancelled = true;
                    cancelled.push(*run_id);
                    let keeps = run.tiles.indices().filter(|tile| !is_late(*tile));
                    keeps.for_each(|tile| push_tile(&mut kept, tile));
                }
            }
            for run in cancelled {
                self.command(index, LinkCommand::CancelRequest(run));
            }
            self.ask(now, id, index, &kept, false);
        }
    }

    /// Takes back what is still asked for of a frame and has come from others with `tiles`, of nodes
    /// that have more to do: how long it takes the others teaches something.
    pub(super) fn take_back_needless(&mut self, now: f64, id: FrameId, tiles: TileRange) {
        let meets = |run: &TileRange| run.first < tiles.end() && tiles.first < run.end();
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        let Some(film) = frame.film.as_ref() else {
            return;
        };
        if !frame.asked_again.iter().any(meets) {
            return;
        }
        let is_needless = |run: &Run| {
            run.frame == id && run.is_wanted() && meets(&run.tiles) && film.has(run.tiles)
        };
        let mut needless = Vec::new();
        for (index, node) in self.nodes.iter().enumerate() {
            let open = node.runs.iter().filter(|(_, run)| run.outstanding() > 0.0);
            let (unwanted, wanted): (Vec<_>, Vec<_>) = open.partition(|(_, run)| is_needless(run));
            if !wanted.is_empty() {
                needless.extend(unwanted.iter().map(|(run, _)| (NodeIndex(index), **run)));
            }
        }
        for (node, run) in needless {
            self.give_up(now, node, run);
            self.command(node, LinkCommand::CancelRequest(run));
        }
    }

    fn ask_again(
        &mut self,
        now: f64,
        id: FrameId,
        forecast: &Forecast,
        grave: f64,
        runs: Vec<Vec<TileRange>>,
    ) {
        for (node, runs) in forecast.helpers.iter().zip(runs) {
            let Some(frame) = self.frames.by_id(id) else {
                return;
            };
            frame.asked_again.extend(&runs);
            for run in &runs {
                frame.stats.reissued_tiles += run.count;
                for tile in run.indices().filter(|tile| !forecast.free[*tile as usize]) {
                    let is_grave = forecast.arrivals[tile as usize] > grave;
                    self.spare.take(frame.work.of(one(tile)), is_grave);
                }
            }
            self.ask(now, id, *node, &runs, false);
        }
    }

    fn forecast(&self, now: f64, id: FrameId) -> Option<Forecast> {
        let newcomer = self.newcomer();
        let frame = self.frames.iter().find(|frame| frame.id == id)?;
        let film = frame.film.as_ref()?;
        // What has failed helps only where nothing else is left.
        let can_help = |node: &Node| node.is_usable(frame.scene.0);
        let has_trusted = self.nodes.iter().any(|n| can_help(n) && n.is_trusted());
        let mut arrivals = vec![f64::INFINITY; frame.passes.all().count as usize];
        let mut free_tiles = vec![true; arrivals.len()];
        let (mut lines, mut helpers, mut help) = (Vec::new(), Vec::new(), Vec::new());
        for (index, node) in self.nodes.iter().enumerate() {
            let prospects = node.prospects(now, newcomer);
            for prospect in &prospects {
                let run = &node.runs[&prospect.run];
                if prospect.frame != id || run.probe || run.lost {
                    continue;
                }
                let is_free = is_free(now, run, prospect, node.delivered());
                let mut at = prospect.begin;
                for tile in film
                    .missing(run.tiles, |_| true)
                    .iter()
                    .flat_map(|r| r.indices())
                {
                    at += prospect.pace * frame.work.of(one(tile));
                    let arrival = &mut arrivals[tile as usize];
                    *arrival = arrival.min(at);
                    free_tiles[tile as usize] &= is_free;
                }
                lines.push(
                    CostModel::new(prospect.begin, prospect.pace)
                        .with_work_max(prospect.outstanding),
                );
            }
            let Some(line) = node.estimate().or(newcomer) else {
                continue;
            };
            if can_help(node) && (node.is_trusted() || !has_trusted) {
                helpers.push(NodeIndex(index));
                let comes = now + line.fixed_secs + node.drift.of(id);
                help.push(CostModel {
                    unmonitored_work: node.rhythm.unmonitored_work(),
                    margin_secs: node.rhythm.guard_secs(),
                    ..CostModel::new(begins_after(&prospects, id, comes), line.secs_per_work)
                });
            }
        }
        if help.is_empty() {
            return None;
        }
        let missing = film.missing(frame.passes.all(), |_| true);
        lines.extend(&help);
        Some(Forecast {
            arrivals,
            free: free_tiles,
            level: water_fill(frame.work.of_all(&missing), &lines).finish_secs,
            missing: missing.iter().flat_map(|run| run.indices()).collect(),
            helpers,
            help,
        })
    }
}

impl Forecast {
    /// The missing tiles that come too late, the latest first to be chosen, no more than there is
    /// spare work for.
    fn late(&self, bounds: Bounds, spare: &Spare, work: impl Fn(u32) -> f64) -> Vec<TileRange> {
        let arrival = |tile: u32| self.arrivals[tile as usize];
        let is_free = |tile: u32| self.free[tile as usize];
        let until = |tile: u32| {
            if is_free(tile) {
                bounds.free
            } else {
                bounds.twice
            }
        };
        // What nobody holds is handed out elsewhere.
        let late = |tile: &u32| arrival(*tile) > until(*tile) && arrival(*tile).is_finite();
        let mut late: Vec<u32> = self.missing.iter().copied().filter(late).collect();
        late.sort_by(|a, b| arrival(*b).total_cmp(&arrival(*a)));
        let mut sum = 0.0;
        late.retain(|tile| {
            if !is_free(*tile) {
                sum += work(*tile);
            }
            sum <= spare.work(arrival(*tile) > bounds.grave)
        });
        late.sort_unstable();
        let mut runs = Vec::new();
        late.iter().for_each(|tile| push_tile(&mut runs, *tile));
        runs
    }
}

/// Whether a node with that line can be told in time not to begin with a run: half a round trip after it
/// has been told, it must not have come to it. What is late may merely be late on its way.
fn is_free(now: f64, run: &Run, prospect: &Prospect, line: Option<Estimate>) -> bool {
    let told = |line: Estimate| now + line.fixed_secs + SOONER * (prospect.soonest - now);
    run.tiles_received == 0 && line.is_some_and(|line| prospect.soonest > told(line))
}

fn one(first: u32) -> TileRange {
    TileRange { first, count: 1 }
}

/// How much the margin grows until nothing is spare, for what will be traced twice.
const PRICE: f64 = 8.0;
/// A tile is gravely late if its frame takes this many times as long as planned for it. What there is
/// in reserve for these makes three of four late frames after a fault punctual.
const GRAVE_SHARE: f64 = 1.25;
/// Share of the time until a node should begin with a run by which it may be earlier.
const SOONER: f64 = 0.1;
/// Seconds between two looks at a frame.
const LOOK_PAUSE_SECS: f64 = 0.5e-3;
/// The next look after one at which a message was late: when it is late by this share more.
const LATE_PAUSE: f64 = 0.25;
/// How often the late tiles are chosen again because nobody can bring all of them in time.
const DEALS_MAX: u32 = 4;
/// Frames that take longer than this are looked at when a node joins.
const LONG_SECS: f64 = 0.05;
