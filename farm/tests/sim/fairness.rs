//! A hundred players on a hundred nodes, each of whom wants more than its share.

use std::collections::VecDeque;

use carom_farm::node::{FairQueue, PlayerId};
use carom_testkit::random::SplitMix64;

const PLAYERS: usize = 100;
const NODES: u64 = 100;
const SECS: f64 = 500.0;

/// Every tenth player does its worst.
const fn is_hostile(player: usize) -> bool {
    player % 10 == 9
}

/// Device time of the next slice of a player. A hostile one asks for pixels that cannot be divided, up to
/// the dearest that are admitted.
fn slice_secs(random: &mut SplitMix64, player: usize) -> f64 {
    match is_hostile(player) {
        true => 10.0 * random.uniform(),
        false => 0.02 + 0.03 * random.uniform(),
    }
}

/// Adds the device time that each player gets of one node. Honest players have a frame or two waiting,
/// hostile ones all that they may; some of these pause and come back with a burst.
fn serve(node: u64, times: &mut [f64]) {
    let mut random = SplitMix64::keyed(&[node, 0xfa12]);
    let mut queue = FairQueue::new();
    let players: Vec<PlayerId> = (0..PLAYERS)
        .map(|player| PlayerId::of_key(&player.to_le_bytes()))
        .collect();
    let want = |queue: &mut FairQueue<usize>, player: usize| {
        let jobs = queue.jobs_mut(players[player]);
        if jobs.is_empty() {
            jobs.extend(vec![player; if is_hostile(player) { 32 } else { 2 }]);
        }
    };
    (0..PLAYERS).for_each(|player| want(&mut queue, player));
    let (mut now, mut second) = (0.0, 0);
    while now < SECS {
        let player = queue.next_mut().and_then(VecDeque::pop_front).unwrap();
        let secs = slice_secs(&mut random, player);
        queue.charge(players[player], secs);
        times[player] += secs;
        now += secs;
        let pauses = |player: usize| player % 20 == 19 && (now / 10.0) as u64 % 2 == 1;
        if !pauses(player) {
            want(&mut queue, player);
        }
        if now as u64 > second {
            second = now as u64;
            let back = (0..PLAYERS).filter(|player| !pauses(*player));
            back.for_each(|player| want(&mut queue, player));
        }
    }
}

#[test]
fn a_hundred_players_share_a_hundred_nodes_fairly() {
    let mut times = [0.0; PLAYERS];
    (0..NODES).for_each(|node| serve(node, &mut times));
    let total: f64 = times.iter().sum();
    let squares: f64 = times.iter().map(|secs| secs * secs).sum();
    let jain = total * total / (PLAYERS as f64 * squares);
    assert!(jain >= 0.95, "Jain's index is {jain}");
    let share = total / PLAYERS as f64;
    let honest = (0..PLAYERS).filter(|player| !is_hostile(*player));
    let least = honest.map(|player| times[player]).fold(f64::MAX, f64::min);
    assert!(least >= 0.9 * share, "{least} s of a share of {share} s");
}
