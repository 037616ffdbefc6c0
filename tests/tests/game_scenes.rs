//! Scenes of the game: they travel as one message, so that no question to the node delays the first frame.

use carom::scene::ball_materials::BallSet;
use carom::scene::table_scene::TableScene;
use carom_protocol::EncodedScene;

#[test]
fn the_room_travels_in_one_message_whatever_its_balls_are_of() {
    for set in BallSet::ALL {
        let room = TableScene::room(set);
        let encoded = EncodedScene::new(room.scene()).expect("it can be drawn");
        println!("{set:?}: {} bytes", encoded.bytes());
        assert!(encoded.chunks().is_empty(), "{encoded:?}");
    }
}
