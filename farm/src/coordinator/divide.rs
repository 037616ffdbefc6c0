//! Hands out tiles that nobody holds: whole frames by the chosen algorithm, the remains of lost
//! runs to whoever finishes them first.

use carom_protocol::limits::{RUN_SAMPLES_MAX, RUN_TILES_MAX};
use carom_protocol::{FrameId, PrecisionRange, RunId, SceneHash, TraceRequest};
use carom_tracer::{TileGrid, TileRun};

use super::balancer::{Candidate, Division, Estimate, WaterFilling, fill};
use super::run::Run;
use super::{Coordinator, NodeIndex};
use crate::Algorithm;
use crate::link::Command;

/// How the last whole frame was divided: kept while a new division would hardly differ, so that
/// each node goes on tracing the same part of the picture.
#[derive(Debug, Default)]
pub(super) struct LastDivision {
    grid: Option<TileGrid>,
    runs: Vec<(NodeIndex, Vec<TileRun>)>,
}

impl LastDivision {
    /// `runs`, or what it was before if each node's part differs by two per cent or a tile.
    fn settle(
        &mut self,
        grid: TileGrid,
        runs: Vec<(NodeIndex, Vec<TileRun>)>,
    ) -> &[(NodeIndex, Vec<TileRun>)] {
        let count = |runs: &[TileRun]| runs.iter().map(|run| run.count).sum::<u32>();
        let same = self.grid == Some(grid)
            && self.runs.len() == runs.len()
            && self.runs.iter().zip(&runs).all(|(old, new)| {
                let (before, after) = (count(&old.1), count(&new.1));
                let slack = (before / 50).max(1);
                let starved = (before == 0) != (after == 0);
                old.0 == new.0 && before.abs_diff(after) <= slack && !starved
            });
        if !same {
            self.grid = Some(grid);
            self.runs = runs;
        }
        &self.runs
    }
}

impl Coordinator {
    /// Hands out all tiles that nobody holds, as far as there are nodes for them.
    pub(super) fn divide(&mut self, now: f64) {
        for id in self.frames.unfinished() {
            let pieces = self.unheld_tiles(id);
            let Some(frame) = self.frames.by_id(id) else {
                continue;
            };
            let nodes = usable(&self.nodes, frame.scene.0);
            if pieces.is_empty() || nodes.is_empty() {
                continue;
            }
            if frame.divided {
                frame.stats.reissued_tiles += pieces.iter().map(|run| run.count).sum::<u32>();
                self.divide_pieces(now, id, &pieces, &nodes);
            } else {
                frame.divided = true;
                self.divide_whole(now, id, &nodes);
            }
        }
    }

    /// The tiles of a frame that are neither there nor asked of a node that answers.
    fn unheld_tiles(&mut self, id: FrameId) -> Vec<TileRun> {
        let Some(frame) = self.frames.by_id(id) else {
            return Vec::new();
        };
        let mut held = vec![false; frame.grid.len() as usize];
        for node in self.nodes.iter().filter(|node| node.silent_since.is_none()) {
            for run in node
                .runs
                .values()
                .filter(|run| run.frame == id && run.counts())
            {
                held[run.tiles.first as usize..run.tiles.end() as usize].fill(true);
            }
        }
        let film = frame.film.as_ref();
        film.map_or_else(Vec::new, |film| {
            film.missing(frame.grid.all(), |tile| !held[tile as usize])
        })
    }

    fn divide_whole(&mut self, now: f64, id: FrameId, nodes: &[NodeIndex]) {
        let period_secs = self.frames.period_secs();
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        let (grid, all) = (frame.grid, [frame.grid.all()]);
        let candidates: Vec<Candidate> = nodes
            .iter()
            .map(|node| self.candidate(now, *node))
            .collect();
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        let shares = self.balancers.of(self.algorithm).divide(&Division {
            work: frame.work.of_all(&all),
            tile_work: frame.work.mean_tile(),
            period_secs,
            candidates: &candidates,
        });
        let cut = frame.work.cut(&all, &shares);
        let runs = nodes.iter().copied().zip(cut).collect();
        let runs = self.last_division.settle(grid, runs).to_vec();
        for (node, runs) in &runs {
            runs.iter()
                .for_each(|run| self.ask(now, id, *node, *run, false));
        }
        if self.algorithm == Algorithm::WaterFilling {
            self.probe(now, id, &runs);
        }
        self.set_hedge(now, id);
    }

    fn divide_pieces(&mut self, now: f64, id: FrameId, pieces: &[TileRun], nodes: &[NodeIndex]) {
        let candidates: Vec<Candidate> = nodes
            .iter()
            .map(|node| self.candidate(now, *node))
            .collect();
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        let work = frame.work.of_all(pieces);
        let lines = WaterFilling::lines(&Division {
            work,
            tile_work: frame.work.mean_tile(),
            period_secs: f64::INFINITY,
            candidates: &candidates,
        });
        let cut = frame.work.cut(pieces, &fill(work, &lines).shares);
        for (node, runs) in nodes.iter().zip(cut) {
            runs.into_iter()
                .for_each(|run| self.ask(now, id, *node, run, false));
        }
        self.set_hedge(now, id);
    }

    /// Asks nodes that got nothing for one tile now and then, beside the node whose tile it is:
    /// they may have become faster, and nothing else would tell.
    fn probe(&mut self, now: f64, id: FrameId, runs: &[(NodeIndex, Vec<TileRun>)]) {
        for (index, _) in runs.iter().filter(|(_, runs)| runs.is_empty()) {
            let node = &mut self.nodes[index.0];
            let recent = node
                .last_probe
                .is_some_and(|last| id.0 < last.0 + PROBE_FRAMES);
            if recent || node.runs.values().any(|run| run.probe) {
                continue;
            }
            node.last_probe = Some(id);
            let Some(frame) = self.frames.by_id(id) else {
                return;
            };
            let first = (id.0.wrapping_add(index.0 as u64) % u64::from(frame.grid.len())) as u32;
            self.ask(now, id, *index, TileRun { first, count: 1 }, true);
        }
    }

    /// Asks a node for tiles, in several requests if they are many.
    pub(super) fn ask(
        &mut self,
        now: f64,
        id: FrameId,
        node: NodeIndex,
        tiles: TileRun,
        probe: bool,
    ) {
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        let tile_samples =
            u64::from(frame.grid.edge).pow(2) * u64::from(frame.spec.settings.samples);
        let most =
            (RUN_SAMPLES_MAX / tile_samples.max(1)).clamp(1, u64::from(RUN_TILES_MAX)) as u32;
        let mut first = tiles.first;
        while first < tiles.end() {
            let count = most.min(tiles.end() - first);
            self.ask_run(now, id, node, TileRun { first, count }, probe);
            first += count;
        }
    }

    fn ask_run(&mut self, now: f64, id: FrameId, index: NodeIndex, tiles: TileRun, probe: bool) {
        let node = &mut self.nodes[index.0];
        let Some(frame) = self.frames.by_id(id) else {
            return;
        };
        if !node.has_room() {
            return; // handed out again when a run of this node ends
        }
        let work = frame.work.of(tiles);
        let wait_secs = node.wait_secs(now);
        let finish = |line: Estimate| line.fixed_secs + wait_secs + line.secs_per_work * work;
        let expected = node.delivered().map(|line| now + finish(line));
        self.last_run = RunId(self.last_run.0 + 1);
        let run = Run {
            frame: id,
            tiles,
            work,
            issued: now,
            expected,
            probe,
            cancelled: false,
            tiles_received: 0,
            work_received: 0.0,
            message_work: 0.0,
            heard: now,
            busy_secs: 0.0,
            others_until: now,
        };
        node.ask(now, self.last_run, run);
        let request = Box::new(TraceRequest {
            frame: id,
            run: self.last_run,
            scene: frame.scene.0,
            update: frame.spec.update.clone(),
            grid: frame.grid,
            tiles,
            settings: frame.spec.settings,
            format: frame.spec.format,
            precision: PrecisionRange::EXACT,
            held: Vec::new(),
        });
        // Nothing is sent if the node has it; a node keeps only the scenes used last.
        let scene = super::scene_command(frame.scene.0, &frame.scene.1);
        self.command(index, scene);
        self.command(index, Command::Trace(request));
    }

    fn candidate(&self, now: f64, index: NodeIndex) -> Candidate {
        let node = &self.nodes[index.0];
        Candidate {
            node: index,
            estimate: node.estimate(),
            wait_secs: node.wait_secs(now),
            proven_work: node.estimator.proven_work(),
        }
    }

    /// What is assumed of a node that has delivered nothing: the mean of the others.
    pub(super) fn newcomer(&self) -> Option<Estimate> {
        let known: Vec<Estimate> = self
            .nodes
            .iter()
            .filter_map(super::Node::delivered)
            .collect();
        if known.is_empty() {
            return None;
        }
        let count = known.len() as f64;
        let speed: f64 = known.iter().map(|line| 1.0 / line.secs_per_work).sum();
        Some(Estimate {
            fixed_secs: known.iter().map(|line| line.fixed_secs).sum::<f64>() / count,
            secs_per_work: count / speed,
        })
    }
}

/// The nodes that can be asked for tiles of a scene.
pub(super) fn usable(nodes: &[super::Node], scene: SceneHash) -> Vec<NodeIndex> {
    let nodes = nodes.iter().enumerate();
    let usable = nodes.filter(|(_, node)| node.is_usable(scene));
    usable.map(|(index, _)| NodeIndex(index)).collect()
}

/// Frames between the probes of a node that gets no share.
const PROBE_FRAMES: u64 = 20;
