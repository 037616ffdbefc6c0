//! Table of a farm's nodes by index, with the timers by which each is revisited.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::{Index, IndexMut};
use std::time::Duration;

use carom_protocol::{FrameId, SceneHash};

use super::node_entry::NodeEntry;
use crate::balancer::{Candidate, Estimate};
use crate::node_status::{NodeIndex, NodeStatus};

/// All nodes. An index returned by [`NodeTable::add`] is valid until [`NodeTable::release`].
#[derive(Debug)]
pub(super) struct NodeTable {
    entries: Vec<NodeEntry>,
    /// Free entries, of removed nodes.
    released: Vec<NodeIndex>,
    /// Timers by earliest time. An entry that is not the node's [`NodeEntry::armed`] has been superseded by
    /// an earlier one.
    timers: BinaryHeap<Reverse<(Duration, NodeIndex)>>,
    /// Whether late tiles are hedged: then nodes count as silent much earlier.
    pub(super) hedged: bool,
}

impl Index<NodeIndex> for NodeTable {
    type Output = NodeEntry;

    fn index(&self, index: NodeIndex) -> &NodeEntry {
        &self.entries[index.0]
    }
}

impl IndexMut<NodeIndex> for NodeTable {
    fn index_mut(&mut self, index: NodeIndex) -> &mut NodeEntry {
        &mut self.entries[index.0]
    }
}

impl NodeTable {
    pub(super) fn new(hedged: bool) -> Self {
        Self {
            entries: Vec::new(),
            released: Vec::new(),
            timers: BinaryHeap::new(),
            hedged,
        }
    }

    pub(super) fn add(&mut self, address: String) -> NodeIndex {
        if let Some(index) = self.released.pop() {
            self.entries[index.0] = NodeEntry::new(address);
            return index;
        }
        self.entries.push(NodeEntry::new(address));
        NodeIndex(self.entries.len() - 1)
    }

    /// Frees the index of a removed node for the next one, so that the table is never longer than the
    /// maximum number of simultaneous nodes.
    pub(super) fn release(&mut self, index: NodeIndex) {
        self.released.push(index);
    }

    /// Ensures a timer for the next time at which the node has something due.
    pub(super) fn arm(&mut self, index: NodeIndex) {
        let others_take_over = self.others_take_over();
        let entry = &mut self.entries[index.0];
        let Some(at) = entry.next_timeout(others_take_over).map(timer) else {
            return;
        };
        // A later time needs no entry: the node is visited too early once, and armed again then.
        if entry.armed.is_none_or(|armed| at < armed) {
            entry.armed = Some(at);
            self.timers.push(Reverse((at, index)));
        }
    }

    /// Whether late tiles can go to other nodes. A single node would be asked for the same tiles again, and
    /// trace them twice.
    pub(super) fn others_take_over(&self) -> bool {
        let mut open = self.entries.iter().filter(|node| node.is_open());
        self.hedged && open.nth(1).is_some()
    }

    /// Time of the earliest timer.
    pub(super) fn next_timeout(&self) -> Option<Duration> {
        self.timers.peek().map(|Reverse((at, _))| *at)
    }

    /// The next node whose timer has passed; its timer is disarmed.
    pub(super) fn next_due(&mut self, now: Duration) -> Option<NodeIndex> {
        while let Some(Reverse((at, index))) = self.timers.peek().copied() {
            if at > now {
                return None;
            }
            self.timers.pop();
            let entry = &mut self.entries[index.0];
            // Entries that have been superseded are skipped (lazy deletion).
            if entry.armed == Some(at) {
                entry.armed = None;
                return Some(index);
            }
        }
        None
    }

    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    pub(super) fn indices(&self) -> impl Iterator<Item = NodeIndex> + use<> {
        (0..self.entries.len()).map(NodeIndex)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (NodeIndex, &NodeEntry)> {
        let entries = self.entries.iter().enumerate();
        entries.map(|(index, entry)| (NodeIndex(index), entry))
    }

    /// The nodes that can take requests for a scene.
    pub(super) fn usable(&self, scene: SceneHash) -> Vec<NodeIndex> {
        let usable = self.iter().filter(|(_, node)| node.is_usable(scene));
        usable.map(|(index, _)| index).collect()
    }

    /// The given nodes as balancers see them, for a request of `frame`.
    pub(super) fn candidates(
        &self,
        now: f64,
        frame: FrameId,
        nodes: &[NodeIndex],
    ) -> Vec<Candidate> {
        let candidate = |index: &NodeIndex| {
            let workload = &self[*index].workload;
            Candidate {
                node: *index,
                estimate: workload.estimate(),
                wait_secs: workload.wait_secs(now, frame),
                proven_work: workload.proven_work,
                unmonitored_work: workload.arrivals.unmonitored_work(),
                margin_secs: if self.hedged {
                    workload.arrivals.margin_secs()
                } else {
                    0.0
                },
            }
        };
        nodes.iter().map(candidate).collect()
    }

    /// Cost assumed of a node that has delivered nothing: the mean of the others; `None` if none has.
    pub(super) fn newcomer(&self) -> Option<Estimate> {
        let delivered = self.entries.iter().map(|node| node.workload.delivered());
        let known: Vec<Estimate> = delivered.flatten().collect();
        if known.is_empty() {
            return None;
        }
        let count = known.len() as f64;
        // The mean of speeds: a mean of seconds per work would be dominated by the slowest node.
        let speed: f64 = known.iter().map(|cost| 1.0 / cost.secs_per_work).sum();
        Some(Estimate {
            fixed_secs: known.iter().map(|cost| cost.fixed_secs).sum::<f64>() / count,
            secs_per_work: count / speed,
        })
    }

    pub(super) fn statuses(&self, now: f64, scene: Option<SceneHash>) -> Vec<NodeStatus> {
        let entries = self.entries.iter();
        entries.map(|node| node.status(now, scene)).collect()
    }
}

/// Converts a moment of the client's clock into a timer, slightly later so that rounding never makes it
/// fire early.
pub(super) fn timer(secs: f64) -> Duration {
    Duration::from_secs_f64(secs.max(0.0)) + Duration::from_nanos(100)
}

#[cfg(test)]
mod tests {
    use carom_protocol::NodeInfo;
    use carom_tracer::{DeviceInfo, DeviceKind};

    use super::super::node_entry::ConnectionState;
    use super::*;

    const SCENE: SceneHash = SceneHash([1; 32]);

    fn open(table: &mut NodeTable) -> NodeIndex {
        let index = table.add("oak".into());
        table[index].open(0.0, info());
        table[index].scene_ready(SCENE);
        index
    }

    fn info() -> NodeInfo {
        NodeInfo {
            name: "oak".into(),
            instance: 0,
            device: DeviceInfo {
                kind: DeviceKind::Gpu,
                name: "simulated".into(),
                width: 1,
                threads: 1,
            },
        }
    }

    #[test]
    fn nodes_are_due_in_order_and_once() {
        let mut table = NodeTable::new(true);
        let nodes = [open(&mut table), open(&mut table)];
        // Pings are due at once; the back-off of one node ends later.
        assert_eq!(table[nodes[0]].ping(0.0), Some(1));
        table[nodes[0]].back_off(2.0, None);
        nodes.iter().for_each(|node| table.arm(*node));
        table.arm(nodes[1]);
        let at = Duration::from_secs_f64;
        assert_eq!(table.next_due(at(1.0)), Some(nodes[1]));
        assert_eq!(table.next_due(at(1.0)), None);
        assert_eq!(table.next_due(at(3.0)), Some(nodes[0]));
        assert_eq!(table.next_timeout(), None);
    }

    #[test]
    fn nodes_that_come_and_go_share_a_place() {
        let mut table = NodeTable::new(true);
        let [oak, elm] = [0; 2].map(|_| open(&mut table));
        table[oak].ping(0.0);
        table.arm(oak);
        for _ in 0..3 {
            table[oak].reset(ConnectionState::Connecting { lost: None });
            table.release(oak);
            assert_eq!(table.add("ash".into()), oak);
            assert!(table.usable(SCENE).contains(&elm) && !table.usable(SCENE).contains(&oak));
        }
        assert_eq!(table.len(), 2);
        assert_eq!(table.statuses(0.0, None)[oak.0].address, "ash");
    }

    #[test]
    fn lost_and_paused_nodes_are_not_usable() {
        let mut table = NodeTable::new(true);
        let [sound, paused, lost] = [0; 3].map(|_| open(&mut table));
        table[paused].back_off(0.0, Some("its device failed".into()));
        table[lost].reset(ConnectionState::Connecting { lost: None });
        assert_eq!(table.usable(SCENE), [sound]);
        assert!(table.usable(SceneHash([2; 32])).is_empty());
        assert!(table[paused].resume(1.0) && !table[paused].is_trusted());
        assert_eq!(table.usable(SCENE), [sound, paused]);
    }

    #[test]
    fn pauses_double_with_each_failure_up_to_a_bound() {
        let mut table = NodeTable::new(true);
        let node = open(&mut table);
        let mut pause_secs = || {
            table[node].back_off(0.0, Some("its device failed".into()));
            let milliseconds = (0..).find(|ms| table[node].resume(f64::from(*ms) * 1e-3));
            milliseconds.unwrap()
        };
        assert_eq!(
            [0; 8].map(|_| pause_secs()),
            [100, 200, 400, 800, 1600, 3200, 5000, 5000]
        );
    }
}
