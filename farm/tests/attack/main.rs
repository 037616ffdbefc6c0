//! Attacks on a node beside an honest player: the player's frames stay quick, and the node's memory,
//! descriptors and threads bounded.
//!
//! The attacker is another QUIC stack (`attacker.py`, on Python's aioquic): where there is none the tests
//! are skipped with a line, unless `CAROM_REQUIRE_ATTACKS` is set. `farm/SECURITY.md` lists which groups
//! of attacks are tried here and which elsewhere.
//!
//! Other processes of the machine disturb the player too: each attack is measured against the quiet
//! moments before it, a flood against one sent elsewhere, three times at most, and `nobody` says what the machine does
//! by itself.

mod attacked_node;
mod attacker;
mod honest_player;

use std::net::UdpSocket;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use serde_json::{Map, Value};

use self::attacked_node::AttackedNode;
use self::attacker::{Attacker, PYTHON};
use self::honest_player::HonestPlayer;

/// One attack at a time: each is measured.
static MACHINE: Mutex<()> = Mutex::new(());

/// The most memory of a node, whoever does what, in MiB.
const MEMORY_MIB_MAX: u64 = 256;
/// How many times as long as in quiet the 99th percentile of the player's frames may take.
const SLOWER_MAX: f64 = 2.0;
const ATTEMPTS: usize = 3;

/// An attack beside an honest player.
struct Trial<'a> {
    attack: &'a str,
    /// Minimum duration.
    duration: Duration,
    /// Whether the player is compared with one beside whom the same is sent to a socket that nobody reads:
    /// sending takes one core of the machine.
    is_sent_aside: bool,
}

impl<'a> Trial<'a> {
    fn new(attack: &'a str) -> Self {
        Self {
            attack,
            duration: Duration::ZERO,
            is_sent_aside: false,
        }
    }
}

/// Tries an attack beside an honest player. Returns what the attacker has counted; none if there is no
/// attacker.
fn withstood(attack: &str) -> Option<Map<String, Value>> {
    withstood_by(&Trial::new(attack), AttackedNode::start)
}

/// The same of a node that `start` starts.
fn withstood_by(
    trial: &Trial<'_>,
    start: impl FnOnce() -> AttackedNode,
) -> Option<Map<String, Value>> {
    let python = PYTHON.as_ref()?;
    let _alone = MACHINE.lock().unwrap_or_else(PoisonError::into_inner);
    let attack = trial.attack;
    let mut node = start();
    let mut player = HonestPlayer::new(&node);
    let unread = UdpSocket::bind("127.0.0.1:0").unwrap();
    let aside = trial
        .is_sent_aside
        .then(|| unread.local_addr().unwrap().to_string());
    let before = node.resources();
    let mut ratios = Vec::new();
    let mut counts = Map::new();
    for _ in 0..ATTEMPTS {
        let sender = (aside.as_ref()).map(|aside| Attacker::start(python, attack, &node, aside));
        let quiet = player.p99_secs(Duration::ZERO);
        sender.map(Attacker::end);
        let attacker = Attacker::start(python, attack, &node, &node.address);
        let attacked = player.p99_secs(trial.duration);
        counts = attacker.end();
        ratios.push(attacked / quiet);
        println!(
            "{attack}: p99 {:.1} ms without, {:.1} ms attacked; {}",
            1e3 * quiet,
            1e3 * attacked,
            Value::Object(counts.clone())
        );
        if attacked < SLOWER_MAX * quiet {
            break;
        }
    }
    let after = node.resources();
    println!("{attack}: {before:?} before, {after:?} after");
    assert!(
        ratios.last().is_some_and(|ratio| *ratio < SLOWER_MAX),
        "{ratios:?}"
    );
    assert!(after.memory_mib < MEMORY_MIB_MAX, "{after:?}");
    assert!(
        after.descriptors <= before.descriptors + 2,
        "{before:?}, {after:?}"
    );
    assert!(after.threads <= before.threads + 8, "{before:?}, {after:?}");
    assert!(!node.log().contains("panicked"), "{}", node.log());
    Some(counts)
}

fn count(counts: &Map<String, Value>, of: &str) -> u64 {
    counts.get(of).and_then(Value::as_u64).unwrap_or(0)
}

/// RFC 9000, 8.1: an address that has not proved itself gets at most three times what it has sent.
fn assert_reflects_little(counts: &Map<String, Value>) {
    let (sent, received) = (count(counts, "bytes sent"), count(counts, "bytes received"));
    assert!(
        sent > 0 && received <= 3 * sent,
        "{received} bytes for {sent}"
    );
}

#[test]
fn nobody_disturbs_the_player() {
    withstood("nobody");
}

#[test]
fn only_players_of_the_farm_are_heard() {
    if let Some(counts) = withstood("certificates") {
        assert_eq!(counts["heard"], serde_json::json!(["good"]));
    }
}

#[test]
fn replays_and_stolen_tokens_open_nothing() {
    if let Some(counts) = withstood("replays") {
        assert_eq!(count(&counts, "token stolen"), 1);
        assert_reflects_little(&counts);
    }
}

#[test]
fn floods_from_many_addresses_are_hardly_answered() {
    let trial = Trial {
        is_sent_aside: true,
        ..Trial::new("flood")
    };
    if let Some(counts) = withstood_by(&trial, AttackedNode::start) {
        assert_reflects_little(&counts);
    }
}

#[test]
fn slow_and_silent_peers_hold_nothing() {
    if let Some(counts) = withstood("slow") {
        assert!(count(&counts, "taken") > 0, "{counts:?}");
    }
}

#[test]
fn floods_of_frames_end_with_their_connection() {
    if let Some(counts) = withstood("frames") {
        assert_eq!(count(&counts, "parameters: taken"), 0, "{counts:?}");
        assert!(count(&counts, "gaps: closed") > 0, "{counts:?}");
    }
}

#[test]
fn messages_that_break_rules_end_their_connection() {
    if let Some(counts) = withstood("messages") {
        assert!(count(&counts, "closed") > 0, "{counts:?}");
        let borne = counts.keys().find(|key| key.starts_with("borne"));
        assert_eq!(borne, None, "{counts:?}");
    }
}

#[test]
fn floods_of_requests_cost_their_sender() {
    if let Some(counts) = withstood("requests") {
        assert!(count(&counts, "requests") > 0, "{counts:?}");
    }
}

#[test]
fn large_scenes_cost_their_sender() {
    if let Some(counts) = withstood("scenes") {
        assert!(count(&counts, "scenes") > 0, "{counts:?}");
    }
}

#[test]
fn textures_that_grow_cost_their_sender() {
    if let Some(counts) = withstood_by(&Trial::new("textures"), AttackedNode::start_small) {
        assert!(count(&counts, "scenes") > 0, "{counts:?}");
    }
}

#[test]
fn nodes_of_nobodys_farm_are_told_nothing() {
    if let Some(counts) = withstood("wrong_nodes") {
        assert!(count(&counts, "calls") > 0, "{counts:?}");
        assert_eq!(count(&counts, "bytes told"), 0, "{counts:?}");
    }
}

#[test]
fn nodes_that_lie_do_not_hold_frames_up() {
    // The player has been calling the node that is not there, and calls again once it has given that up.
    let duration = Duration::from_secs(10);
    let trial = Trial {
        duration,
        ..Trial::new("rogue_nodes")
    };
    if let Some(counts) = withstood_by(&trial, AttackedNode::start) {
        assert!(count(&counts, "requests taken") > 0, "{counts:?}");
        assert!(count(&counts, "forged tiles") > 0, "{counts:?}");
    }
}

#[test]
fn tokens_are_not_guessed() {
    if let Some(counts) = withstood_by(&Trial::new("guesses"), AttackedNode::start_with_enrolment) {
        assert!(count(&counts, "guesses") > 0, "{counts:?}");
        assert_eq!(count(&counts, "admitted"), 0, "{counts:?}");
    }
}

#[test]
fn arbitrary_bytes_end_their_own_connection() {
    if let Some(counts) = withstood("noise") {
        assert!(count(&counts, "closed") > 0, "{counts:?}");
    }
}

#[test]
fn one_player_takes_few_connections_and_no_descriptors() {
    if let Some(counts) = withstood_by(&Trial::new("connections"), || {
        AttackedNode::start_limited("64")
    }) {
        assert!(count(&counts, "most at once") <= 4, "{counts:?}");
        assert!(count(&counts, "turned away") > 0, "{counts:?}");
        assert_eq!(count(&counts, "unanswered"), 0, "{counts:?}");
    }
}

#[test]
fn crowds_fit_into_a_node() {
    if let Some(counts) = withstood("crowd") {
        assert_eq!(count(&counts, "served"), 100, "{counts:?}");
    }
}

#[test]
fn a_node_that_stood_still_serves_its_player_again() {
    let _alone = MACHINE.lock().unwrap_or_else(PoisonError::into_inner);
    let node = AttackedNode::start();
    let mut player = HonestPlayer::new(&node);
    player.frame();
    node.signal("-STOP");
    // Longer than a connection lives without a word.
    std::thread::sleep(std::time::Duration::from_secs(7));
    node.signal("-CONT");
    player.frame();
}

#[test]
fn secrets_are_neither_told_nor_readable_by_others() {
    use std::os::unix::fs::PermissionsExt;
    let _alone = MACHINE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut node = AttackedNode::start();
    HonestPlayer::new(&node).frame();
    let keys = [
        ".carom/ca.key",
        ".carom/player.key",
        ".carom/nodes/oak/node.key",
        ".carom/players/mallory/player.key",
    ];
    let (environment, log) = (node.environment(), node.log());
    for key in keys {
        let path = node.path().join(key);
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "{key}");
        let text = std::fs::read_to_string(&path).unwrap();
        let secret = text.lines().nth(1).expect("a PEM file");
        assert!(
            !log.contains(secret) && !environment.contains(secret),
            "{key}"
        );
    }
    assert!(
        node.core_bytes_max() == 0,
        "a core dump would hold the node's key"
    );
    node.resources();
}
