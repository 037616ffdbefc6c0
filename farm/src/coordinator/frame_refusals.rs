//! Refusals of a frame: the nodes that will not trace it, and whether any node is left that may.

use std::collections::BTreeMap;

use carom_protocol::{FrameId, SceneHash};

use super::node_entry::NodeEntry;
use super::node_table::NodeTable;
use crate::node_status::NodeIndex;

/// A frame that no node will trace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameRefusal {
    /// Its id.
    pub frame: FrameId,
    /// Address and reason of each node that refuses it.
    pub nodes: Vec<(String, String)>,
}

impl FrameRefusal {
    /// All addresses and reasons, joined with semicolons.
    pub fn reasons(&self) -> String {
        let nodes = self.nodes.iter();
        let sentences = nodes.map(|(node, why)| format!("{node}: {why}"));
        sentences.collect::<Vec<_>>().join("; ")
    }
}

/// Refusals of one frame.
#[derive(Debug, Default)]
pub(super) struct FrameRefusals {
    /// By node: failures at this frame since it last sent tiles of it, and the last reason.
    by_node: BTreeMap<NodeIndex, (u32, String)>,
    /// Since when no connected node can trace the frame.
    hopeless_since: Option<f64>,
}

impl FrameRefusals {
    /// Counts a failure of a node. `is_final` failures exclude it at once; others may be temporary.
    pub(super) fn count(&mut self, node: NodeIndex, is_final: bool, why: &str) {
        let (failures, reason) = self.by_node.entry(node).or_default();
        *failures += if is_final { FAILURES_MAX } else { 1 };
        why.clone_into(reason);
    }

    /// Forgets a node's failures: it has sent tiles, or another node has taken its index.
    pub(super) fn forget(&mut self, node: NodeIndex) {
        self.by_node.remove(&node);
    }

    /// The reason of a node that has failed often enough to be excluded.
    pub(super) fn reason(&self, node: NodeIndex) -> Option<&str> {
        let (_, why) = self
            .by_node
            .get(&node)
            .filter(|(n, _)| *n >= FAILURES_MAX)?;
        Some(why)
    }

    /// Gives up frame `id` if no node is left that may trace it: at least one refuses it or its scene, and
    /// none is being connected to, or all those have been for [`AWAY_SECS`].
    pub(super) fn give_up(
        &mut self,
        now: f64,
        id: FrameId,
        scene: SceneHash,
        nodes: &NodeTable,
    ) -> Option<FrameRefusal> {
        let reason = |index, node: &'_ NodeEntry| -> Option<String> {
            let why = self.reason(index).or_else(|| node.scene_refusal(scene))?;
            Some(why.to_owned())
        };
        let is_able = |(index, node): (NodeIndex, &NodeEntry)| {
            node.is_open() && reason(index, node).is_none()
        };
        if nodes.iter().any(is_able) {
            self.hopeless_since = None;
            return None;
        }
        // Nodes that are being connected to may still trace it.
        let is_away = nodes
            .iter()
            .any(|(index, node)| !node.is_gone() && reason(index, node).is_none());
        let refusing = nodes.iter().filter_map(|(index, node)| {
            let why = reason(index, node)?;
            Some((node.address().to_owned(), why))
        });
        let nodes: Vec<(String, String)> = refusing.collect();
        let since = *self.hopeless_since.get_or_insert(now);
        let is_over = !nodes.is_empty() && (!is_away || now - since >= AWAY_SECS);
        is_over.then_some(FrameRefusal { frame: id, nodes })
    }
}

/// Failures at one frame without a tile in between after which a node is excluded: with their back-offs,
/// about three seconds.
const FAILURES_MAX: u32 = 5;
/// Seconds for which a frame that all connected nodes refuse waits for nodes that are being connected to.
const AWAY_SECS: f64 = 10.0;

#[cfg(test)]
mod tests {
    use carom_protocol::NodeInfo;
    use carom_tracer::{DeviceInfo, DeviceKind};

    use super::super::node_entry::ConnectionState;
    use super::*;

    const NODE: NodeIndex = NodeIndex(3);

    #[test]
    fn a_node_refuses_at_once_for_good_or_by_failing_often() {
        let mut refusals = FrameRefusals::default();
        refusals.count(NODE, true, "it is too large");
        assert_eq!(refusals.reason(NODE), Some("it is too large"));
        refusals.forget(NODE);
        for _ in 1..FAILURES_MAX {
            refusals.count(NODE, false, "its device failed");
            assert_eq!(refusals.reason(NODE), None);
        }
        refusals.count(NODE, false, "its device failed");
        assert_eq!(refusals.reason(NODE), Some("its device failed"));
    }

    #[test]
    fn a_frame_is_given_up_when_nobody_is_left_who_may_trace_it() {
        let mut nodes = NodeTable::new(true);
        let [oak, ash] = ["oak", "ash"].map(|name| nodes.add(name.into()));
        let scene = SceneHash([1; 32]);
        let is_over = |now: f64, nodes: &NodeTable, refusals: &mut FrameRefusals| {
            let refusal = refusals.give_up(now, FrameId(7), scene, nodes);
            refusal.map(|refusal| refusal.reasons())
        };
        let lost = |retry_at| ConnectionState::Lost {
            why: "it is gone".into(),
            retry_at,
        };
        let refusals = &mut FrameRefusals::default();
        // Nobody has refused: there may be nodes later.
        assert_eq!(is_over(0.0, &nodes, refusals), None);
        nodes[oak].open(0.0, node_info());
        nodes[oak].scene_refused(scene, "it is too large".into());
        assert_eq!(is_over(1.0, &nodes, refusals), None, "ash is being called");
        nodes[ash].open(0.0, node_info());
        assert_eq!(is_over(2.0 * AWAY_SECS, &nodes, refusals), None, "ash may");
        nodes[ash].reset(lost(Some(1.0)));
        assert_eq!(is_over(2.0 * AWAY_SECS, &nodes, refusals), None);
        let why = Some("oak: it is too large".to_owned());
        assert_eq!(is_over(3.0 * AWAY_SECS, &nodes, refusals), why);
        nodes[ash].reset(lost(None));
        assert_eq!(is_over(0.0, &nodes, &mut FrameRefusals::default()), why);
    }

    fn node_info() -> NodeInfo {
        NodeInfo {
            name: "oak".into(),
            instance: 0,
            device: DeviceInfo {
                kind: DeviceKind::Cpu,
                name: "simulated".into(),
                width: 1,
                threads: 1,
            },
        }
    }
}
