//! States of a node, as the coordinator tells it.

use std::sync::Arc;
use std::time::Duration;

use carom_farm::NodeState::{Paired, Ready, Starting, Syncing};
use carom_farm::coordinator::Coordinator;
use carom_farm::net::LinkEvent;
use carom_farm::{Balancing, NodeInfo, NodeState};
use carom_protocol::{ClientEvent, EncodedScene};
use carom_tracer::{DeviceInfo, DeviceKind, Scene};

#[test]
fn a_node_is_syncing_until_it_holds_the_scene_and_tells_how_much_it_has() {
    let scene = include_str!("../../../assets/scenes/pool.json");
    let mut scene = Scene::from_json(scene).unwrap();
    let first = EncodedScene::new(&scene).unwrap();
    scene.objects.pop();
    let second = EncodedScene::new(&scene).unwrap();
    let [hash, other] = [&first, &second].map(|scene| scene.hash());
    let mut coordinator = Coordinator::new(Balancing::default());
    let node = coordinator.add_node("oak:4433".into());
    let mut state_after = |event: Option<ClientEvent>, scene_is: Option<&Arc<EncodedScene>>| {
        if let Some(scene) = scene_is {
            coordinator.set_scene(Arc::clone(scene));
        }
        if let Some(event) = event {
            coordinator.handle(Duration::ZERO, node, LinkEvent::Session(event));
        }
        let state = coordinator.nodes(Duration::ZERO).remove(0).state;
        (state.to_string(), state)
    };
    let welcome = ClientEvent::Welcome(NodeInfo {
        name: "oak".into(),
        instance: 0,
        device: DeviceInfo {
            kind: DeviceKind::Cpu,
            name: "a processor".into(),
            width: 8,
            threads: 2,
        },
    });
    let coming = |hash, bytes| {
        Some(ClientEvent::SceneComing {
            hash,
            bytes,
            of: 300_000,
        })
    };
    let is = |word: &str, state: NodeState| (word.to_owned(), state);
    assert_eq!(state_after(None, None), is("starting", Starting));
    assert_eq!(state_after(Some(welcome), None), is("paired", Paired));
    let syncing = |percent, bytes, of| {
        let state = Syncing { bytes, of };
        is(&format!("syncing {percent} %"), state)
    };
    assert_eq!(state_after(None, Some(&first)), syncing(0, 0, 0));
    let some = coming(hash, 113_000);
    assert_eq!(state_after(some, None), syncing(37, 113_000, 300_000));
    assert_eq!(state_after(None, Some(&second)), syncing(0, 0, 0));
    let most = coming(other, 299_999);
    assert_eq!(state_after(most, None), syncing(99, 299_999, 300_000));
    let ready = Some(ClientEvent::SceneReady(other));
    assert_eq!(state_after(ready, None), is("ready", Ready));
    // Other scenes had its place at the node.
    let again = coming(other, 3_000);
    assert_eq!(state_after(again, None), syncing(1, 3_000, 300_000));
}

/// Or people would be told that it starts, in the midst of their work.
#[test]
fn a_node_that_was_lost_is_lost_while_it_is_called_again() {
    let mut coordinator = Coordinator::new(Balancing::default());
    let node = coordinator.add_node("oak:4433".into());
    let mut state_after = |event| {
        coordinator.handle(Duration::ZERO, node, event);
        coordinator.nodes(Duration::ZERO).remove(0).state
    };
    assert_eq!(state_after(LinkEvent::Connecting), Starting);
    for retry in [Some(Duration::from_secs(5)), None] {
        let why = "it does not answer".to_owned();
        let state = state_after(LinkEvent::Lost {
            why: why.clone(),
            retry,
        });
        let retry_secs = retry.map(|retry| retry.as_secs());
        assert_eq!(state, NodeState::Lost { why, retry_secs });
        let why = "it does not answer".to_owned();
        let retry_secs = None;
        let state = state_after(LinkEvent::Connecting);
        assert_eq!(state, NodeState::Lost { why, retry_secs });
    }
}
