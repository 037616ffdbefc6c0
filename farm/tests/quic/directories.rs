//! Farms whose nodes come from directories.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use carom_farm::directory::{Directory, ListedNode};
use carom_farm::net::{Authority, create_farm};
use carom_farm::{Error, Farm, FarmConfig, LocalNode, NodeStatus};

use crate::greeter::any_port;
use crate::running_node::RunningNode;

fn farm(credentials: &Path, nodes: Vec<String>) -> Farm {
    Farm::new(FarmConfig {
        local: LocalNode::None,
        nodes,
        credentials: credentials.to_owned(),
        ..FarmConfig::default()
    })
    .unwrap()
}

/// Waits until the nodes are so; far longer than that takes is a failure.
fn wait_until(farm: &Farm, is_so: impl Fn(&[NodeStatus]) -> bool) -> Vec<NodeStatus> {
    for _ in 0..6000 {
        let nodes = farm.nodes();
        if is_so(&nodes) {
            return nodes;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("{:?}", farm.nodes());
}

fn answering(nodes: &[NodeStatus]) -> usize {
    nodes.iter().filter(|node| node.info.is_some()).count()
}

#[test]
fn nodes_of_a_file_come_and_go_while_the_farm_runs() {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let [oak, elm, ash] = [(); 3].map(|()| RunningNode::start(&authority, any_port()));
    let path = folder.path().join("nodes.txt");
    let list = |nodes: &[SocketAddr]| {
        let lines: Vec<String> = nodes.iter().map(SocketAddr::to_string).collect();
        std::fs::write(&path, lines.join("\n")).unwrap();
    };
    let farm = farm(folder.path(), vec![format!("file:{}", path.display())]);
    assert!(farm.nodes().is_empty());
    list(&[oak.address]);
    wait_until(&farm, |nodes| answering(nodes) == 1);
    list(&[oak.address, elm.address]);
    wait_until(&farm, |nodes| answering(nodes) == 2);
    // A node that is no longer listed serves until it ends, and so does one of a file that is gone.
    std::fs::remove_file(&path).unwrap();
    std::thread::sleep(Duration::from_millis(1500));
    list(&[elm.address, ash.address]);
    wait_until(&farm, |nodes| answering(nodes) == 3);
    let gone = oak.address.to_string();
    drop(oak);
    let nodes = wait_until(&farm, |nodes| {
        nodes
            .iter()
            .any(|node| node.state.sentence().contains("left the directory"))
    });
    let place = nodes.iter().position(|node| node.address == gone).unwrap();
    let oak = RunningNode::start(&authority, any_port());
    list(&[elm.address, ash.address, oak.address]);
    let nodes = wait_until(&farm, |nodes| answering(nodes) == 3);
    assert_eq!(
        nodes.len(),
        3,
        "the new node takes the place of the old one"
    );
    assert_eq!(nodes[place].address, oak.address.to_string());
    drop(farm);
    for node in [oak, elm, ash] {
        drop(node);
    }
}

/// Lists nobody and fails, as a server that has been killed.
struct Dead;

impl Directory for Dead {
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error> {
        Err(Error::Directory {
            directory: "dead".into(),
            reason: "no answer".into(),
        })
    }

    fn period(&self) -> Duration {
        Duration::from_millis(1)
    }
}

#[test]
fn a_directory_that_fails_takes_no_node_away() {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let oak = RunningNode::start(&authority, any_port());
    let mut farm = farm(folder.path(), Vec::new());
    farm.add_directory(Box::new(Dead)).unwrap();
    farm.add_directory(Box::new(vec![oak.address.into()]))
        .unwrap();
    wait_until(&farm, |nodes| answering(nodes) == 1);
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(answering(&farm.nodes()), 1);
    drop(farm);
    drop(oak);
}

#[test]
fn a_directory_cannot_bring_in_strangers() {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let stranger = RunningNode::start(&Authority::generate().unwrap(), any_port());
    let mut farm = farm(folder.path(), Vec::new());
    farm.add_directory(Box::new(vec![stranger.address.into()]))
        .unwrap();
    let nodes = wait_until(&farm, |nodes| {
        nodes
            .iter()
            .any(|node| node.state.sentence().contains("another farm"))
    });
    assert_eq!(answering(&nodes), 0);
    drop(farm);
    drop(stranger);
}
