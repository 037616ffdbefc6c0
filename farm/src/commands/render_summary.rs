//! Summary of a render: time, nodes, shares and bytes.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use carom_farm::{FrameStats, NodeInfo, NodeStatus, StillProgress};
use serde::Serialize;

/// Accumulated costs of a render's frames, counted as they arrive.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameTotals(Arc<Mutex<Totals>>);

#[derive(Clone, Debug, Default)]
struct Totals {
    payload_bytes: u64,
    reissued_tiles: u64,
    lost_tiles: u64,
    nodes: Vec<NodeTotals>,
}

#[derive(Clone, Debug, Default)]
struct NodeTotals {
    /// The last known description: a lost node reports none.
    info: Option<NodeInfo>,
    tiles: u64,
    /// Number of frames it took part in, and the sum of its response times in them.
    frames: u32,
    response_secs: f64,
}

/// Summary of a finished render.
#[derive(Debug, Serialize)]
pub(crate) struct RenderSummary {
    secs: f64,
    payload_bytes: u64,
    /// Tiles requested again because a node was late or lost; of those, the lost ones.
    reissued_tiles: u64,
    lost_tiles: u64,
    nodes: Vec<NodeShare>,
}

#[derive(Debug, Serialize)]
struct NodeShare {
    address: String,
    name: String,
    device: String,
    tiles: u64,
    /// Share of all tiles, 0 to 1.
    share: f64,
    /// Mean time from a frame's submission to the node's last tile of it.
    response_ms: f64,
}

impl FrameTotals {
    /// Counts the frame that has just arrived, if one has.
    pub(crate) fn count(&self, progress: &StillProgress) {
        if let Some(frame) = &progress.frame {
            let mut totals = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            totals.add(frame);
        }
    }

    /// Stores the descriptions of the farm's nodes.
    pub(crate) fn observe(&self, nodes: &[NodeStatus]) {
        let mut totals = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        totals.resize(nodes.len());
        for (node, status) in totals.nodes.iter_mut().zip(nodes) {
            node.info = status.info.clone().or(node.info.take());
        }
    }

    /// The summary of a render that took `time`; `nodes` are those of its farm.
    pub(crate) fn summary(&self, time: Duration, nodes: &[NodeStatus]) -> RenderSummary {
        self.observe(nodes);
        let totals = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let tiles: u64 = totals.nodes.iter().map(|node| node.tiles).sum();
        let took_part = nodes.iter().zip(&totals.nodes);
        let took_part = took_part.filter(|(_, node)| node.tiles > 0);
        let share = |(status, node): (&NodeStatus, &NodeTotals)| {
            let info = node.info.clone();
            let (name, device) = info.map_or_else(Default::default, |it| (it.name, it.device.name));
            NodeShare {
                address: status.address.clone(),
                name,
                device,
                tiles: node.tiles,
                share: node.tiles as f64 / tiles as f64,
                response_ms: 1e3 * node.response_secs / f64::from(node.frames.max(1)),
            }
        };
        RenderSummary {
            secs: time.as_secs_f64(),
            payload_bytes: totals.payload_bytes,
            reissued_tiles: totals.reissued_tiles,
            lost_tiles: totals.lost_tiles,
            nodes: took_part.map(share).collect(),
        }
    }
}

impl Totals {
    fn add(&mut self, frame: &FrameStats) {
        self.payload_bytes += frame.payload_bytes;
        self.reissued_tiles += u64::from(frame.reissued_tiles);
        self.lost_tiles += u64::from(frame.lost_tiles);
        self.resize(frame.tiles_by_node.len());
        let frame = frame.tiles_by_node.iter().zip(&frame.response_secs_by_node);
        for (node, (tiles, response_secs)) in self.nodes.iter_mut().zip(frame) {
            node.tiles += u64::from(*tiles);
            node.frames += u32::from(*tiles > 0);
            node.response_secs += response_secs;
        }
    }

    /// Extends the list to at least so many nodes.
    fn resize(&mut self, nodes: usize) {
        let count = nodes.max(self.nodes.len());
        self.nodes.resize_with(count, NodeTotals::default);
    }
}

impl RenderSummary {
    /// The summary as text for a person.
    pub(crate) fn lines(&self) -> String {
        let count = self.nodes.len();
        let megabytes = 1e-6 * self.payload_bytes as f64;
        let nodes = if count == 1 { "node" } else { "nodes" };
        let mut lines = vec![format!(
            "traced in {:.1} s by {count} {nodes}, {megabytes:.1} MB of pixels, {} tiles asked for again",
            self.secs, self.reissued_tiles
        )];
        lines.extend(self.nodes.iter().map(|node| {
            let NodeShare {
                address,
                name,
                device,
                share,
                response_ms,
                ..
            } = node;
            let node = match (address.as_str(), name.as_str()) {
                ("local", "") => "this machine".to_owned(),
                (address, "") => address.to_owned(),
                (address, name) => format!("{name} ({address})"),
            };
            let share = 100.0 * share;
            format!("  {share:5.1} % {node}, {device}, {response_ms:.0} ms a frame")
        }));
        lines.join("\n")
    }
}

#[cfg(test)]
mod tests {
    use carom_tracer::{DeviceInfo, DeviceKind};

    use super::*;

    fn nodes(addresses: [&str; 3]) -> Vec<NodeStatus> {
        addresses.map(NodeStatus::new).into()
    }

    fn count(totals: &FrameTotals, tiles: Vec<u32>, responses: Vec<f64>) {
        let mut progress = StillProgress::default();
        progress.frame = Some(FrameStats {
            payload_bytes: 1000,
            reissued_tiles: 1,
            tiles_by_node: tiles,
            response_secs_by_node: responses,
            ..FrameStats::default()
        });
        totals.count(&progress);
    }

    #[test]
    fn shares_are_of_all_tiles_of_all_frames() {
        let totals = FrameTotals::default();
        for (tiles, response) in [
            (vec![30], vec![0.2]),
            (vec![30, 0, 20], vec![0.4, 0.0, 0.1]),
        ] {
            totals.count(&StillProgress::default());
            count(&totals, tiles, response);
        }
        let farm = nodes(["oak:1", "elm:1", "ash:1"]);
        let summary = totals.summary(Duration::from_secs(2), &farm);
        assert_eq!((summary.payload_bytes, summary.reissued_tiles), (2000, 2));
        let shares: Vec<_> = summary
            .nodes
            .iter()
            .map(|it| (it.address.as_str(), it.tiles))
            .collect();
        assert_eq!(shares, [("oak:1", 60), ("ash:1", 20)]);
        assert!((summary.nodes[0].share - 0.75).abs() < 1e-9);
        assert!((summary.nodes[0].response_ms - 300.0).abs() < 1e-9);
        assert!(
            summary.lines().contains("by 2 nodes"),
            "{}",
            summary.lines()
        );
    }

    #[test]
    fn lost_nodes_keep_their_names_and_devices() {
        let totals = FrameTotals::default();
        let mut farm = nodes(["local", "oak:1", "elm:1"]);
        farm[1].info = Some(NodeInfo {
            name: "oak".into(),
            instance: 0,
            device: DeviceInfo {
                kind: DeviceKind::Cpu,
                name: "a processor".into(),
                width: 8,
                threads: 2,
            },
        });
        totals.observe(&farm);
        count(&totals, vec![20, 10, 10], vec![0.1; 3]);
        farm[1].info = None;
        let lines = totals.summary(Duration::from_secs(1), &farm).lines();
        for line in [
            "50.0 % this machine,",
            "25.0 % oak (oak:1), a processor,",
            "25.0 % elm:1,",
        ] {
            assert!(lines.contains(line), "{lines}");
        }
    }
}
