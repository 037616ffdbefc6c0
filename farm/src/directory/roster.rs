//! Roster of a farm: the nodes listed by its directories, compared with those it connects to.

use std::collections::BTreeMap;

use super::ListedNode;
use crate::net::NodeAddress;
use crate::node_status::NodeIndex;

/// Remote nodes of a farm that directories have listed. Performs no input or output.
#[derive(Debug, Default)]
pub struct Roster {
    /// The last answer of each directory.
    lists: Vec<Vec<ListedNode>>,
    called: BTreeMap<NodeIndex, NodeAddress>,
}

impl Roster {
    /// Adds a directory and returns its index.
    pub fn add_directory(&mut self) -> usize {
        self.lists.push(Vec::new());
        self.lists.len() - 1
    }

    /// Stores the answer of a directory; returns the nodes to connect to because of it.
    pub fn update(&mut self, directory: usize, nodes: Vec<ListedNode>) -> Vec<NodeAddress> {
        self.lists[directory] = nodes;
        let mut new = Vec::new();
        for node in &self.lists[directory] {
            let address = &node.address;
            let is_known = self.called.values().any(|called| called == address);
            if !is_known && !node.is_draining() && !new.contains(address) {
                new.push(address.clone());
            }
        }
        new
    }

    /// Records the index of a node that is being connected to.
    pub fn call(&mut self, node: NodeIndex, address: NodeAddress) {
        self.called.insert(node, address);
    }

    /// The nodes with a link that no directory lists, or that are listed as draining only.
    pub fn left(&self) -> Vec<NodeIndex> {
        let is_listed = |address: &NodeAddress| {
            let mut nodes = self.lists.iter().flatten();
            nodes.any(|node| node.address == *address && !node.is_draining())
        };
        let called = self.called.iter();
        let left = called.filter(|(_, address)| !is_listed(address));
        left.map(|(node, _)| *node).collect()
    }

    /// Removes a node whose link has ended.
    pub fn forget(&mut self, node: NodeIndex) {
        self.called.remove(&node);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::directory::NodeRecord;

    fn listed(hosts: &[&str]) -> Vec<ListedNode> {
        let address = |host: &&str| format!("{host}:4433").parse().unwrap();
        hosts.iter().map(address).map(ListedNode::at).collect()
    }

    fn roster(hosts: &[&str]) -> Roster {
        let mut roster = Roster::default();
        roster.add_directory();
        for (index, address) in roster.update(0, listed(hosts)).into_iter().enumerate() {
            roster.call(NodeIndex(index), address);
        }
        roster
    }

    #[test]
    fn a_node_is_called_once_whoever_lists_it() {
        let mut roster = roster(&["oak", "elm", "oak"]);
        let other = roster.add_directory();
        assert!(roster.update(0, listed(&["elm", "oak"])).is_empty());
        let new = roster.update(other, listed(&["ash", "oak"]));
        assert_eq!(new, ["ash:4433".parse().unwrap()]);
    }

    #[test]
    fn a_node_has_left_when_no_directory_lists_it() {
        let mut roster = roster(&["oak", "elm"]);
        let other = roster.add_directory();
        roster.update(other, listed(&["oak"]));
        roster.update(0, Vec::new());
        assert_eq!(roster.left(), [NodeIndex(1)]);
        roster.forget(NodeIndex(1));
        assert!(roster.left().is_empty());
        assert_eq!(roster.update(0, listed(&["elm"])).len(), 1);
    }

    #[test]
    fn draining_nodes_are_not_called() {
        let mut draining = listed(&["oak"]);
        draining[0].record = Some(NodeRecord {
            draining: true,
            ..NodeRecord::default()
        });
        let mut roster = roster(&["oak"]);
        assert!(roster.update(0, draining.clone()).is_empty());
        assert_eq!(roster.left(), [NodeIndex(0)]);
        roster.forget(NodeIndex(0));
        assert!(roster.update(0, draining).is_empty());
    }
}
