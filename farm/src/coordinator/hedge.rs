//! Asks again for tiles that are late, of whoever finishes them first; the first answer wins.
//!
//! Dean and Barroso, "The Tail at Scale", CACM 56(2), 2013: a few per cent more requests take
//! away most of the tail. In `tests/sim`, with five unequal nodes, 0.07 % of the tiles come twice
//! while nothing happens, and the frame in which a node falls silent takes up to 1.25 times as
//! long as the others alone would need for it.

use std::collections::BTreeSet;

use carom_protocol::FrameId;
use carom_tracer::TileRun;

use super::balancer::{Line, fill};
use super::divide::usable;
use super::run::Run;
use super::{Coordinator, NodeIndex};

/// Missing tiles that the same nodes hold.
struct LateGroup {
    holders: Vec<NodeIndex>,
    /// When the first of them will be through, as far as they can be trusted; infinite if not.
    credit: f64,
    pieces: Vec<TileRun>,
}

impl Coordinator {
    /// Asks again for what is late.
    pub(super) fn hedge(&mut self, now: f64) {
        let due = |at: Option<f64>| at.is_some_and(|at| at <= now);
        let frames = self.frames.iter().filter(|frame| due(frame.hedge_at));
        let frames: Vec<FrameId> = frames.map(|frame| frame.id).collect();
        for id in frames {
            for group in self.late_groups(now, id) {
                self.hedge_group(now, id, &group);
            }
            self.set_hedge(now, id);
            if let Some(frame) = self.frames.by_id(id) {
                // If nobody can help, the next look is after ever longer pauses.
                let pause = HEDGE_PAUSE_SECS * f64::from(1 << frame.hedges.min(10));
                frame.hedges += 1;
                frame.hedge_at = Some(frame.hedge_at.unwrap_or(now).max(now + pause));
            }
        }
    }

    /// Predicts when a frame should be whole, and with that when it is late.
    pub(super) fn set_hedge(&mut self, now: f64, id: FrameId) {
        let newcomer = self.newcomer();
        let mut late = None::<f64>;
        for node in self.nodes.iter().filter(|node| node.silent_since.is_none()) {
            for run in node
                .runs
                .values()
                .filter(|run| run.frame == id && run.counts())
            {
                let margin = match (run.expected, newcomer) {
                    (Some(expected), _) => HEDGE_FACTOR * (expected - run.issued),
                    (None, Some(line)) => {
                        NEWCOMER_FACTOR * (line.fixed_secs + line.secs_per_work * run.work)
                    }
                    (None, None) => continue,
                };
                let at = run.issued + margin + HEDGE_MARGIN_SECS;
                late = Some(late.map_or(at, |late| late.max(at)));
            }
        }
        if let Some(frame) = self.frames.by_id(id) {
            frame.hedge_at = late
                .map(|late| late.max(now))
                .filter(|_| frame.film.is_some());
        }
    }

    /// Sets the hedges that had to wait until something was known of any node.
    pub(super) fn predict_newcomers(&mut self, now: f64) {
        for id in self.frames.unfinished() {
            if self
                .frames
                .by_id(id)
                .is_some_and(|frame| frame.hedge_at.is_none())
            {
                self.set_hedge(now, id);
            }
        }
    }

    /// Lets frames that will take long profit from a node that has just become ready.
    pub(super) fn hasten_hedges(&mut self, now: f64) {
        for frame in self.frames.iter_mut() {
            if frame.hedge_at.is_some_and(|at| at > now + LONG_SECS) {
                frame.hedge_at = Some(now);
            }
        }
    }

    fn hedge_group(&mut self, now: f64, id: FrameId, group: &LateGroup) {
        let newcomer = self.newcomer();
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        let mut nodes = usable(&self.nodes, frame.scene.0);
        nodes.retain(|node| !group.holders.contains(node));
        let lines = nodes
            .iter()
            .map(|node| self.nodes[node.0].line(now, newcomer));
        let (nodes, mut lines): (Vec<NodeIndex>, Vec<Line>) = nodes
            .iter()
            .zip(lines)
            .filter_map(|(node, line)| Some((*node, line?)))
            .unzip();
        if nodes.is_empty() {
            return;
        }
        let work = frame.work.of_all(&group.pieces);
        // Who can still be trusted keeps what it would finish earlier than the others.
        let trusted = group.credit.is_finite();
        if trusted {
            let b_secs = (group.credit - now).max(1e-9) / work;
            let keeps = Line {
                a_secs: 0.0,
                b_secs,
                cap: f64::INFINITY,
            };
            lines.insert(0, keeps);
        }
        let cut = frame.work.cut(&group.pieces, &fill(work, &lines).shares);
        let cut = cut.into_iter().skip(usize::from(trusted));
        for (node, runs) in nodes.into_iter().zip(cut) {
            for run in runs {
                if let Some(frame) = self.frames.by_id(id) {
                    frame.stats.reissued_tiles += run.count;
                }
                self.ask(now, id, node, run, false);
            }
        }
    }

    /// The missing tiles of a frame, by who has been asked for them.
    fn late_groups(&mut self, now: f64, id: FrameId) -> Vec<LateGroup> {
        let newcomer = self.newcomer();
        let mut runs = Vec::new();
        for (index, node) in self.nodes.iter().enumerate() {
            let pace = node.delivered().or(newcomer).map(|line| line.secs_per_work);
            for run in node
                .runs
                .values()
                .filter(|run| run.frame == id && !run.cancelled)
            {
                let silent = node.silent_since.is_some();
                let credit = if silent {
                    f64::INFINITY
                } else {
                    credit(now, run, pace)
                };
                runs.push((NodeIndex(index), run.tiles, credit));
            }
        }
        let Some(frame) = self.frames.by_id(id) else {
            return Vec::new();
        };
        let Some(film) = &frame.film else {
            return Vec::new();
        };
        let ends = runs
            .iter()
            .flat_map(|(_, tiles, _)| [tiles.first, tiles.end()]);
        let bounds: BTreeSet<u32> = ends.chain([0, frame.grid.len()]).collect();
        let bounds: Vec<u32> = bounds.into_iter().collect();
        let mut groups: Vec<LateGroup> = Vec::new();
        for window in bounds.windows(2) {
            let range = TileRun {
                first: window[0],
                count: window[1] - window[0],
            };
            let pieces = film.missing(range, |_| true);
            if pieces.is_empty() {
                continue;
            }
            let holding = runs
                .iter()
                .filter(|(_, tiles, _)| tiles.first <= range.first && range.end() <= tiles.end());
            let credit = holding
                .clone()
                .map(|(.., credit)| *credit)
                .fold(f64::INFINITY, f64::min);
            let holders: Vec<NodeIndex> = holding.map(|(node, ..)| *node).collect();
            match groups.iter_mut().find(|group| group.holders == holders) {
                Some(group) => group.pieces.extend(pieces),
                None => groups.push(LateGroup {
                    holders,
                    credit,
                    pieces,
                }),
            }
        }
        groups
    }
}

/// When a run will be through: as predicted while that is to come; at the node's pace while tiles
/// keep coming; else nobody knows.
fn credit(now: f64, run: &Run, pace: Option<f64>) -> f64 {
    if let Some(expected) = run.expected.filter(|expected| *expected > now) {
        return expected;
    }
    let Some(pace) = pace else {
        return f64::INFINITY;
    };
    let begun = run.issued.max(run.others_until);
    let seen = (run.heard - begun) / run.work_received.max(1e-9);
    let pace = pace.max(if run.tiles_received > 0 { seen } else { 0.0 });
    if run.tiles_received > 0 && now - run.heard < MESSAGES_PATIENCE * pace * run.message_work {
        now + pace * run.outstanding()
    } else {
        f64::INFINITY
    }
}

/// A frame is late at this many times its predicted time …
const HEDGE_FACTOR: f64 = 1.05;
/// … and this many seconds more.
const HEDGE_MARGIN_SECS: f64 = 1e-3;
/// The same factor where a node's speed is only assumed.
const NEWCOMER_FACTOR: f64 = 2.0;
/// A node that has not been heard for as long as this many messages should take is not trusted.
const MESSAGES_PATIENCE: f64 = 2.0;
/// Seconds until late tiles are looked at again; doubles each time.
const HEDGE_PAUSE_SECS: f64 = 1e-3;
/// Frames that take longer than this are divided again when a node joins.
const LONG_SECS: f64 = 0.1;
