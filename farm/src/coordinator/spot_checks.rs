//! Spot checks: a share of the tiles is traced again by another node and compared, so that a node that
//! sends wrong pixels is detected, dropped and named.
//!
//! ```text
//! tile of A ─▶ one in TILES ─▶ B traces it too ─▶ they agree
//!                                              └▶ they differ ─▶ one of them is of this process: it is right
//!                                                             ├▶ C traces it too: two of three are right
//!                                                             └▶ there is no C: both are named
//! ```
//!
//! Spot-checking and voting after Sarmenta, "Sabotage-tolerance mechanisms for volunteer computing
//! systems", Future Generation Computer Systems 18(4), 2002. A key that no node knows determines which
//! tiles are checked. A node that falsifies a share q of n tiles remains undetected with probability (1 − q
//! / TILES)ⁿ; one that colludes with most of the nodes is not detected.

use std::sync::Arc;

use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{RequestId, SceneHash};
use carom_tracer::TileRange;

use super::checked_tile::CheckedTile;
use super::dispatcher::Dispatcher;
use super::frame_in_flight::{FrameInFlight, TileArrival};
use super::node_table::NodeTable;
use super::sample_passes::SamplePasses;
use super::tile_comparison::tiles_agree;
use crate::node_status::NodeIndex;

/// Default number of tiles per spot check: 0.2 % more work.
pub const SPOT_CHECK_TILES: u32 = 512;

/// Selection of tiles to check, and the checks in progress. See the [module](self).
#[derive(Debug)]
pub(super) struct SpotChecks {
    /// Mean number of tiles per check; 0 for no checks.
    tiles: u32,
    key: [u8; 32],
    /// Number of random numbers drawn so far: the counter of the generator.
    drawn: u64,
    /// Tiles up to and including the next one to check.
    left: u32,
    open: Vec<SpotCheck>,
}

/// A check in progress.
#[derive(Debug)]
struct SpotCheck {
    tile: CheckedTile,
    copies: Vec<TileCopy>,
    /// Node and request of the next copy.
    asked: (NodeIndex, RequestId),
}

#[derive(Debug)]
struct TileCopy {
    node: NodeIndex,
    pixels: TilePixels,
    is_lossy: bool,
}

/// Outcome of a check.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// All of these nodes have sent the same pixels.
    Agreement(Vec<NodeIndex>),
    /// The first node's pixels differ from those of all the others, which agree.
    Wrong(NodeIndex, Vec<NodeIndex>),
    /// The nodes disagree and no majority exists.
    Disagreement(Vec<NodeIndex>),
}

impl Default for SpotChecks {
    fn default() -> Self {
        Self::new(SPOT_CHECK_TILES, [0; 32])
    }
}

impl SpotChecks {
    /// Checks one in `tiles` tiles, none if that is 0; `key` determines which ones.
    pub(super) fn new(tiles: u32, key: [u8; 32]) -> Self {
        let mut checks = Self {
            tiles,
            key,
            drawn: 0,
            left: 0,
            open: Vec::new(),
        };
        checks.left = checks.distance();
        checks
    }

    /// Starts a check of one of the tiles that a node has sent, if one is due and another node is
    /// available.
    pub(super) fn offer(
        &mut self,
        now: f64,
        dispatcher: &mut Dispatcher,
        frame: &FrameInFlight,
        node: NodeIndex,
        arrival: &TileArrival<'_>,
    ) {
        let count = arrival.tiles.count;
        if self.tiles == 0 || self.left > count {
            self.left = self.left.saturating_sub(count);
            return;
        }
        let unit = TileRange {
            // Counted in tiles, not messages: which tile is checked does not depend on their grouping.
            first: arrival.tiles.first + self.left - 1,
            count: 1,
        };
        self.left = self.distance();
        let Some(other) = self.choose(&dispatcher.nodes, frame.scene.hash(), &[node]) else {
            return;
        };
        let tile = CheckedTile {
            frame: frame.id,
            spec: frame.spec.clone(),
            scene: Arc::clone(&frame.scene),
            passes: frame.passes,
            unit,
            work: frame.work.of(unit),
        };
        let copy = TileCopy::new(node, tile.passes, unit, arrival);
        if self.open.len() < CHECKS_MAX
            && let Some(request) = dispatcher.request_check(now, other, &tile)
        {
            self.open.push(SpotCheck {
                tile,
                copies: vec![copy],
                asked: (other, request),
            });
        }
    }

    /// Whether a request belongs to a check.
    pub(super) fn has(&self, node: NodeIndex, request: RequestId) -> bool {
        self.place(node, request).is_some()
    }

    /// Compares the copy that has come for a check. `None` if a third node has been asked.
    pub(super) fn answer(
        &mut self,
        now: f64,
        dispatcher: &mut Dispatcher,
        (node, request): (NodeIndex, RequestId),
        arrival: &TileArrival<'_>,
    ) -> Option<Verdict> {
        let mut check = self.open.swap_remove(self.place(node, request)?);
        let (passes, unit) = (check.tile.passes, check.tile.unit);
        check
            .copies
            .push(TileCopy::new(node, passes, unit, arrival));
        if let Some(verdict) = check.verdict(&dispatcher.nodes) {
            return Some(verdict);
        }
        let asked: Vec<NodeIndex> = check.copies.iter().map(|copy| copy.node).collect();
        let third = match asked.len() {
            VOTES.. => None,
            _ => self.choose(&dispatcher.nodes, check.tile.scene.hash(), &asked),
        };
        let request = third.and_then(|third| {
            let request = dispatcher.request_check(now, third, &check.tile)?;
            Some((third, request))
        });
        let Some(asked) = request else {
            return Some(Verdict::Disagreement(asked));
        };
        self.open.push(SpotCheck { asked, ..check });
        None
    }

    /// Abandons the check whose request has ended.
    pub(super) fn close(&mut self, node: NodeIndex, request: RequestId) {
        self.open.retain(|check| check.asked != (node, request));
    }

    /// Abandons the checks that a node takes part in.
    pub(super) fn forget(&mut self, node: NodeIndex) {
        let is_of = |check: &SpotCheck| {
            check.asked.0 == node || check.copies.iter().any(|copy| copy.node == node)
        };
        self.open.retain(|check| !is_of(check));
    }

    fn place(&self, node: NodeIndex, request: RequestId) -> Option<usize> {
        let mut open = self.open.iter();
        open.position(|check| check.asked == (node, request))
    }

    /// The node for the next copy: after a disagreement a node of this process if there is one, else one at
    /// random in proportion to speed, so that checks cost each node the same share of its time.
    fn choose(
        &mut self,
        nodes: &NodeTable,
        scene: SceneHash,
        asked: &[NodeIndex],
    ) -> Option<NodeIndex> {
        let mut others = nodes.usable(scene);
        others.retain(|node| !asked.contains(node));
        if asked.len() > 1
            && let Some(local) = others.iter().find(|node| nodes[**node].is_local)
        {
            return Some(*local);
        }
        let speed = |node: &NodeIndex| {
            let estimate = nodes[*node].workload.estimate();
            estimate.map_or(0.0, |estimate| 1.0 / estimate.secs_per_work)
        };
        // Roulette-wheel selection in proportion to speed; the first node if none is known.
        let all: f64 = others.iter().map(speed).sum();
        let mut left = all * self.draw() as f64 / u64::MAX as f64;
        let chosen = others.iter().find(|node| {
            left -= speed(node);
            left <= 0.0
        });
        chosen.or(others.first()).copied()
    }

    /// Distance to the next tile to check: uniform from 1 to 2·`tiles` − 1, whose mean is `tiles`.
    fn distance(&mut self) -> u32 {
        let tiles = u64::from(self.tiles.max(1));
        (1 + self.draw() % (2 * tiles - 1)) as u32
    }

    fn draw(&mut self) -> u64 {
        self.drawn += 1;
        // A keyed hash of a counter: the checks observed so far do not reveal the next ones.
        let hash = blake3::keyed_hash(&self.key, &self.drawn.to_le_bytes());
        let [a, b, c, d, e, f, g, h, ..] = *hash.as_bytes();
        u64::from_le_bytes([a, b, c, d, e, f, g, h])
    }
}

impl SpotCheck {
    /// The verdict, if the copies allow one.
    fn verdict(&self, nodes: &NodeTable) -> Option<Verdict> {
        let tile = self.tile.tile();
        let agree = |a: &TileCopy, b: &TileCopy| {
            tiles_agree(tile, &a.pixels, &b.pixels, a.is_lossy || b.is_lossy)
        };
        let node = |copy: &TileCopy| copy.node;
        let all: Vec<NodeIndex> = self.copies.iter().map(node).collect();
        let others = |of: &TileCopy| {
            let others = self.copies.iter().filter(|copy| copy.node != of.node);
            others.collect::<Vec<_>>()
        };
        let is_local = |copy: &&TileCopy| nodes[copy.node].is_local;
        if let [a, b] = &self.copies[..] {
            return match (agree(a, b), is_local(&a), is_local(&b)) {
                (true, ..) => Some(Verdict::Agreement(all)),
                (false, true, _) => Some(Verdict::Wrong(b.node, vec![a.node])),
                (false, _, true) => Some(Verdict::Wrong(a.node, vec![b.node])),
                (false, ..) => None,
            };
        }
        // A copy is wrong if it agrees with no other copy, and the others agree among themselves.
        let is_alone = |copy: &&TileCopy| {
            let others = others(copy);
            let agreeing = others.windows(2).all(|pair| agree(pair[0], pair[1]));
            agreeing && !others.iter().any(|other| agree(copy, other))
        };
        let wrong = self.copies.iter().find(is_alone)?;
        Some(Verdict::Wrong(
            wrong.node,
            others(wrong).into_iter().map(node).collect(),
        ))
    }
}

impl TileCopy {
    /// Extracts one unit of an arrival.
    fn new(
        node: NodeIndex,
        passes: SamplePasses,
        unit: TileRange,
        arrival: &TileArrival<'_>,
    ) -> Self {
        let before = TileRange {
            first: arrival.tiles.first,
            count: unit.first - arrival.tiles.first,
        };
        let start = passes.grid.pixels(passes.tiles(before));
        let end = start + passes.grid.pixels(passes.tiles(unit));
        let pixels = match arrival.pixels {
            TilePixels::Srgb8(pixels) => TilePixels::Srgb8(pixels[start..end].to_vec()),
            TilePixels::Linear(pixels) => TilePixels::Linear(pixels[start..end].to_vec()),
        };
        Self {
            node,
            pixels,
            is_lossy: arrival.is_lossy,
        }
    }
}

/// Maximum number of checks in progress: each keeps up to 200 kB of pixels.
const CHECKS_MAX: usize = 16;
/// Copies of a tile after which a disagreement stays undecided.
const VOTES: usize = 3;
