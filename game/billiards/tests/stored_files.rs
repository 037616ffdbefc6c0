//! Files and shots of earlier versions: they still load, and play to the same bits.

#![allow(
    clippy::disallowed_methods,
    reason = "tests need no digits that all systems share"
)]

use std::path::{Path, PathBuf};

use carom_billiards::game_match::{Match, MatchSave, TurnRecord};
use carom_billiards::physics::{
    BallBody, BallState, Engine, Laws, Phase, Recording, Shot, Stroke, Table, World,
};
use glam::DVec3;

/// FNV-1a over the bits of numbers.
struct BitHash(u64);

impl BitHash {
    fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    fn add(&mut self, number: f64) {
        for byte in number.to_bits().to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn add_vector(&mut self, vector: DVec3) {
        for number in vector.to_array() {
            self.add(number);
        }
    }

    /// The instants of all events, and where and how fast the balls are at each of them.
    fn add_shot(&mut self, shot: &Shot) {
        for event in shot.events() {
            self.add(event.time_secs);
            for ball in shot.states_at(event.time_secs) {
                self.add_vector(ball.position);
                self.add_vector(ball.velocity);
                self.add_vector(ball.spin);
            }
        }
    }
}

fn stored(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/stored")
        .join(name)
}

#[test]
fn stored_recording_is_its_shot_to_the_bit() {
    let path = stored("break_shot.carom");
    let recording = Recording::load(&path).expect("it was written by an earlier version");
    let bytes = std::fs::read(&path).expect("it is there");
    assert!(recording.to_bytes().expect("small enough") == bytes);
    let table = Table::nine_foot();
    let rack = table.rack_eight(3);
    let world = World::new(table.clone(), rack).expect("a rack is valid");
    let shot = world.strike(Stroke::straight(0.0, 10.0)).expect("it ends");
    let again = Recording::of(&table, recording.clips[0].title.clone(), shot);
    assert!(again.to_bytes().expect("small enough") == bytes);
}

/// Of the shots by the exact engine: rapier's solver promises its bits for one build on one machine.
fn match_bits(game: &Match) -> u64 {
    let mut hash = BitHash::new();
    let exact = |turn: &&TurnRecord| turn.world().engine() == Engine::Exact;
    for turn in game.turns().iter().filter(exact) {
        let shot = turn.world().strike(turn.stroke).expect("it was played");
        hash.add_shot(&shot);
    }
    hash.0
}

#[test]
fn stored_matches_play_to_the_same_bits() {
    for (name, turns, hash) in MATCHES {
        let path = stored(name);
        let record = MatchSave::load(&path).expect(name).expect("it is there");
        let game = record.play().expect(name);
        assert_eq!(
            (game.turns().len(), format!("0x{:016x}", match_bits(&game))),
            (turns, format!("0x{hash:016x}")),
            "{name}"
        );
        let bytes = MatchSave::of(&game).to_bytes().expect("small enough");
        assert!(bytes == std::fs::read(&path).expect(name), "{name}");
    }
}

/// Version 2 of the format: the table follows as it is. What particles then do has the bits of one kind of processor.
#[test]
fn stored_match_among_particles_is_read_as_it_was() {
    let path = stored("match_particles.carom");
    let record = MatchSave::load(&path).expect("sound").expect("it is there");
    let game = record.play().expect("it goes on");
    let bytes = std::fs::read(&path).expect("it is there");
    assert_eq!(bytes[b"carom match\n".len()], 2);
    assert!(MatchSave::of(&game).to_bytes().expect("small enough") == bytes);
    let bed = game.world().particles().expect("sand and snow");
    assert_eq!(bed.centers().len(), 128);
    assert_eq!(game.world().balls().len(), 2);
    let stroke = Stroke::straight(0.0, 1.5);
    let shot = game.world().strike(stroke).expect("it ends");
    let free = game.world().without_particles().strike(stroke);
    assert!(shot.final_states() != free.expect("it ends").final_states());
}

/// Breaks, soft shots, jumps and curves on every table, and balls thrown over it.
fn shots() -> Vec<Shot> {
    let mut shots = Vec::new();
    for (index, name) in Table::built_in_names().enumerate() {
        let table = Table::built_in(name).expect("it ships with the crate");
        for seed in 0..4u32 {
            let turn = f64::from(seed) + 0.1 * index as f64;
            let world = World::new(table.clone(), table.rack_eight(seed)).expect("a rack");
            for (speed_m_s, elevation_rad) in [(9.0, 0.0), (2.0, 0.3), (7.0, 0.9)] {
                let stroke = Stroke {
                    side: 0.1 * turn - 0.2,
                    vertical: 0.25 - 0.12 * turn,
                    elevation_rad,
                    ..Stroke::straight(0.004 * turn, speed_m_s)
                };
                shots.push(world.strike(stroke).expect("it ends"));
            }
            let thrown = |number: u8| {
                let k = f64::from(number) + turn;
                let body = if number == 0 {
                    table.cue_ball()
                } else {
                    BallBody::POOL
                };
                BallState {
                    position: DVec3::new(0.3 * f64::from(number) - 0.4, 0.05 * k.sin(), 0.2),
                    velocity: DVec3::new(3.0 * (1.7 * k).cos(), 4.0 * (2.3 * k).sin(), 1.0),
                    spin: DVec3::new(60.0 * (3.1 * k).sin(), 40.0 * k.cos(), 90.0 - 50.0 * k),
                    phase: Phase::Airborne,
                    ..BallState::at_rest(number, 0.0, 0.0, &body)
                }
            };
            let balls = (0..4).map(thrown).collect();
            let world =
                World::with_laws(table.clone(), Laws::default(), balls).expect("in the air");
            shots.push(world.release().expect("it ends"));
        }
    }
    shots
}

#[test]
fn shots_on_all_tables_have_the_stored_bits() {
    let mut hash = BitHash::new();
    for shot in shots() {
        hash.add_shot(&shot);
    }
    assert_eq!(hash.0, SHOTS, "0x{:016x}", hash.0);
}

/// Each with its turns and the hash of their shots.
const MATCHES: [(&str, usize, u64); 6] = [
    ("match_free.carom", 3, 0x3950_5065_51ed_a2d7),
    ("match_eight.carom", 12, 0x3491_ffd8_0506_8d70),
    ("match_nine.carom", 7, 0x7f84_ba18_aa61_64bf),
    ("match_straight.carom", 12, 0x1261_9b91_c1ea_bf93),
    ("match_snooker.carom", 12, 0x1eed_5e13_6657_9eb6),
    ("match_three_cushion.carom", 12, 0x947f_fd8c_8e11_7d1a),
];
const SHOTS: u64 = 0x12fe_ebb3_3d18_061c;
