//! What nodes answer: tiles into films, times into estimates, and refusals into work that nobody holds.

use carom_protocol::session::ClientEvent;
use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{FrameId, NodeTimes, Refusal, RefusalReason, RequestId};
use carom_tracer::TileRange;

use super::{Coordinator, NodeIndex, frame_buffer, scene_command};
use crate::Delivery;
use crate::balancer::{Estimator, Observation, RequestOutcome};
use crate::link::LinkCommand;

impl Coordinator {
    pub(super) fn handle_session(&mut self, now: f64, index: NodeIndex, event: ClientEvent) {
        let node = &mut self.nodes[index.0];
        match event {
            ClientEvent::Welcome(info) => {
                node.open(now, info);
                if let Some((hash, scene)) = self.scene.clone() {
                    self.command(index, scene_command(hash, &scene));
                }
                self.handle_ping(now, index);
            }
            ClientEvent::SceneComing { hash, percent } => node.scene_coming(hash, percent),
            ClientEvent::SceneReady(hash) => {
                if node.scene_ready(hash) {
                    self.unheld = true;
                    self.hasten_hedges(now);
                }
            }
            ClientEvent::SceneRefused { hash, why } => node.scene_refused(hash, why),
            ClientEvent::Tiles {
                request: run,
                tiles,
                pixels,
                busy_micros,
                times,
                dropped_samples,
                payload_bytes,
                ..
            } => {
                let tiles = self.units(index, run, tiles);
                self.receive(now, index, run, tiles, busy_micros);
                let dropped = u64::from(dropped_samples);
                self.fill(
                    now,
                    index,
                    run,
                    tiles,
                    &pixels,
                    dropped,
                    payload_bytes,
                    times,
                );
            }
            ClientEvent::TilesStale {
                request: run,
                tiles,
                busy_micros,
                ..
            } => {
                let tiles = self.units(index, run, tiles);
                self.receive(now, index, run, tiles, busy_micros);
            }
            ClientEvent::RequestDone { report, .. } => self.close(now, index, report.request),
            ClientEvent::RequestRefused { refusal, .. } => self.refused(now, index, refusal),
            ClientEvent::Pong(number) => node.pong(now, number),
        }
    }

    fn handle_ping(&mut self, now: f64, index: NodeIndex) {
        if let Some(number) = self.nodes[index.0].ping(now) {
            self.command(index, LinkCommand::Ping(number));
        }
    }

    /// What tiles of a run are among the units of its frame.
    fn units(&self, index: NodeIndex, id: RequestId, tiles: TileRange) -> TileRange {
        let run = self.nodes[index.0].runs.get(&id);
        run.map_or(tiles, |run| run.passes.units(run.tiles.first, tiles))
    }

    /// Takes note of how long tiles took.
    fn receive(
        &mut self,
        now: f64,
        index: NodeIndex,
        id: RequestId,
        tiles: TileRange,
        micros: u32,
    ) {
        let node = &mut self.nodes[index.0];
        let line = node.delivered();
        let Some(of_frame) = node.runs.get(&id).map(|run| run.frame) else {
            return;
        };
        node.observe_lateness(now, id);
        let is_first = node.begins_with(of_frame);
        self.unheld |= node.hear(now, id, of_frame);
        let Some(run) = node.runs.get_mut(&id) else {
            return;
        };
        let busy_secs = f64::from(micros) * 1e-6;
        let share = f64::from(tiles.count) / f64::from(run.tiles.count);
        let work = match self.frames.by_id(run.frame) {
            Some(frame) => frame.work.of(tiles),
            None => run.work * share,
        };
        if let Some(frame) = self.frames.by_id(run.frame) {
            frame.note_busy(index, busy_secs);
            run.pieces.push((tiles, work, busy_secs));
        }
        run.receive(now, tiles, work, busy_secs, line, is_first);
        node.prove(of_frame, work);
        if node.delivered().is_none() {
            self.learn(index, id, false);
            self.predict_newcomers(now);
        }
        self.pull(now, index);
        self.watch(now, index);
    }

    /// Puts tiles into their film and finishes the frame if they were the last.
    #[expect(clippy::too_many_arguments, reason = "the fields of one event")]
    fn fill(
        &mut self,
        now: f64,
        index: NodeIndex,
        id: RequestId,
        tiles: TileRange,
        pixels: &TilePixels,
        dropped_samples: u64,
        payload_bytes: usize,
        times: NodeTimes,
    ) {
        let nodes = self.nodes.len();
        if !frame_buffer::is_finite(pixels) {
            let why = "it sent pixels that are not numbers".into();
            self.nodes[index.0].rest(now, Some(why));
            self.give_up(now, index, id);
            self.command(index, LinkCommand::CancelRequest(id));
            self.unheld = true;
            return;
        }
        self.nodes[index.0].trust();
        let Some(run) = self.nodes[index.0].runs.get(&id) else {
            return;
        };
        let Some(frame) = self.frames.by_id(run.frame) else {
            return;
        };
        let Some(film) = &mut frame.film else {
            return;
        };
        let filled = film.fill(tiles, pixels);
        frame.stats.payload_bytes += payload_bytes as u64;
        frame.stats.duplicate_tiles += tiles.count - filled;
        if filled == tiles.count {
            frame.stats.dropped_samples += dropped_samples;
        }
        frame.stats.tiles_by_node.resize(nodes, 0);
        frame.stats.tiles_by_node[index.0] += filled;
        let split = frame.note_split(index, run.split(now, frame.submitted, times));
        frame.stats.response_secs_by_node.resize(nodes, 0.0);
        frame.stats.response_secs_by_node[index.0] = now - frame.submitted;
        // Noted by `receive` just before.
        let (_, work, busy_secs) = run.pieces.last().copied().unwrap_or((tiles, 0.0, 0.0));
        frame.stats.deliveries.push(Delivery {
            node: index,
            tiles: run.passes.tiles(tiles),
            fresh_tiles: filled,
            work,
            expected_secs: run.expected.map(|at| at - frame.submitted),
            arrived_secs: now - frame.submitted,
            busy_secs,
            split,
            payload_bytes: u32::try_from(payload_bytes).unwrap_or(u32::MAX),
        });
        self.nodes[index.0].deliver(filled, split);
        let id = frame.id;
        if frame.finish(now) {
            self.release(now, id);
        } else {
            self.take_back_needless(now, id, tiles);
        }
    }

    /// Takes back what is still asked for a frame that is finished, but for probes.
    pub(super) fn release(&mut self, now: f64, frame: FrameId) {
        for node in (0..self.nodes.len()).map(NodeIndex) {
            let runs = self.nodes[node.0].runs.iter();
            let open = runs.filter(|(_, run)| run.frame == frame && run.is_wanted());
            let open = open.filter(|(_, run)| run.tiles_received < run.tiles.count);
            let open: Vec<RequestId> = open.map(|(run, _)| *run).collect();
            for run in open {
                self.give_up(now, node, run);
                self.command(node, LinkCommand::CancelRequest(run));
            }
        }
    }

    /// Marks a run as not wanted, and learns from its lateness.
    pub(super) fn give_up(&mut self, now: f64, index: NodeIndex, id: RequestId) {
        let node = &mut self.nodes[index.0];
        let round_trip_secs = node.round_trip_secs();
        let Some(run) = node.runs.get_mut(&id) else {
            return;
        };
        run.cancelled = true;
        let late = run.expected.is_none_or(|expected| now >= expected);
        let missed = late && run.tiles_received == 0;
        let (secs, queue_secs) = (now - run.issued, run.queue_secs(round_trip_secs));
        // What a node has been asked for at once is late together, and once.
        if node.late_of.replace(run.frame) != Some(run.frame) {
            node.estimator
                .observe_late(run.work, secs, queue_secs, missed);
        }
    }

    fn refused(&mut self, now: f64, index: NodeIndex, refusal: Refusal) {
        let node = &mut self.nodes[index.0];
        let wanted = node
            .runs
            .get(&refusal.request)
            .is_some_and(|run| !run.cancelled);
        match refusal.why {
            RefusalReason::Cancelled | RefusalReason::Busy if wanted => node.rest(now, None),
            RefusalReason::Cancelled | RefusalReason::Busy => {}
            RefusalReason::UnknownScene => {
                node.rest(
                    now,
                    Some("it has lost the scene, which is sent again".into()),
                );
            }
            RefusalReason::Invalid(why) => {
                node.rest(now, Some(format!("it calls a request invalid: {why}")));
            }
            RefusalReason::Device(why) => {
                node.rest(now, Some(format!("its device failed: {why}")));
            }
        }
        self.close(now, index, refusal.request);
    }

    /// Ends a run; one that was refused may leave tiles that nobody holds.
    fn close(&mut self, now: f64, index: NodeIndex, id: RequestId) {
        self.learn(index, id, true);
        let node = &mut self.nodes[index.0];
        let had_room = node.has_room();
        if let Some(run) = node.runs.remove(&id) {
            self.unheld |= run.counts() && run.tiles_received < run.tiles.count;
            node.lose(&run);
            self.unheld |= node.hear(now, id, run.frame) || !had_room;
        }
    }

    /// Tells the estimator, and the balancers if it has ended, how a run went, if anything came.
    fn learn(&mut self, index: NodeIndex, id: RequestId, ended: bool) {
        let node = &mut self.nodes[index.0];
        let Some(run) = node.runs.get(&id) else {
            return;
        };
        if run.tiles_received == 0 || run.work_received <= 0.0 {
            return;
        }
        let response_secs = (run.heard - run.issued).max(0.0);
        let busy_secs = run.busy_secs.clamp(0.0, response_secs);
        let observation = Observation {
            work: run.work_received,
            response_secs,
            queue_secs: run.queue_secs(node.round_trip_secs()).min(response_secs),
            busy_secs,
            round_trip_secs: node.round_trip_secs(),
        };
        if ended {
            if run.probe {
                node.estimator.expect_little();
            }
            node.estimator.observe(&observation);
            self.learn_costs(index, id, &observation);
        } else {
            node.estimator.observe_first(&observation);
        }
        let run = &self.nodes[index.0].runs[&id];
        if ended && !run.probe {
            self.balancers.learn(&RequestOutcome {
                node: index,
                tiles: run.tiles_received,
                work: run.work_received,
                response_secs,
                busy_secs,
            });
        }
    }

    /// Lets the cost map know how long each part of a run took. What the node says counts only
    /// within the run; how long the whole took is what its estimate has been told.
    fn learn_costs(&mut self, index: NodeIndex, id: RequestId, seen: &Observation) {
        let node = &mut self.nodes[index.0];
        let run = &node.runs[&id];
        if run.tiles_received == run.tiles.count {
            node.rhythm.end(run);
        }
        let Some(line) = node.delivered() else {
            return;
        };
        let secs = Estimator::work_secs(seen);
        let in_parts = run.pieces.iter().all(|(.., busy)| *busy > 0.0);
        for (tiles, work, busy) in &run.pieces {
            let ratio = if in_parts {
                secs * busy / (run.busy_secs * line.secs_per_work * work)
            } else {
                secs / (line.secs_per_work * run.work_received)
            };
            let tiles = run.passes.tiles(*tiles);
            self.costs.learn(run.passes.grid, tiles, ratio);
        }
    }
}
