//! The load of a node by other players, as a player is told it.

use std::time::Duration;

use carom_farm::net::{Authority, AuthorityFolder, Role, create_farm};

use crate::drain::{farm, paced_node, submit};

#[test]
fn a_player_is_told_how_much_of_a_node_others_have() {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let issuer = AuthorityFolder::open(folder.path(), None).unwrap();
    let bob = issuer.add(Role::Player, "bob", None, false).unwrap();
    let node = paced_node(&authority, Duration::from_millis(20));
    let mut busy = farm(folder.path(), &[&node]);
    let watching = farm(&bob, &[&node]);
    let load = || watching.nodes()[0].load;
    assert_eq!((load().players, load().busy_percent), (0, 0));
    // A picture takes 1.2 s.
    while load().busy_percent < 50 {
        if busy.in_flight() == 0 {
            submit(&mut busy);
        }
        drop(busy.poll_frame());
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(load().players, 1);
    assert_eq!(
        busy.nodes()[0].load.players,
        0,
        "its own work is no others'"
    );
}
