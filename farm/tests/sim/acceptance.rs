//! A small version of `carom-bench balance`, with the bars that it must meet. Virtual time:
//! the figures are the same on every machine.

use carom_farm::{Algorithm, Balancing};
use carom_testkit::simulator::{Network, Scenario, Score, SubmissionMode, optimum_secs, run};

fn score(nodes: usize, network: Network, mode: SubmissionMode, balancing: Balancing) -> Score {
    let frames = if nodes < 64 { 800 } else { 400 };
    let scenario = Scenario {
        nodes,
        network,
        mode,
        seed: 1,
        frames,
    };
    let plan = scenario.plan(balancing);
    let report = run(&plan, 1e4);
    assert_eq!(
        report.frames.len() as u64,
        frames,
        "{scenario:?}: {:?}",
        report.nodes
    );
    assert_eq!(report.wrong_frames, 0, "{scenario:?}");
    let (frames, events) = (scenario.frames, scenario.events());
    let score = Score::new(
        frames,
        plan.period_secs,
        events,
        &report,
        &optimum_secs(&plan),
    );
    println!(
        "{nodes} {} {}: mean {:.3}, p99 {:.2}, recovery {:?}, twice {:.2} %, death {:.2}",
        network.name(),
        balancing,
        score.mean,
        score.p99,
        score.recovery_frames,
        100.0 * score.duplicates,
        score.worst_after_death
    );
    score
}

fn assert_bars(score: &Score, mean: f64, p99: f64, death: f64) {
    assert!(score.mean <= mean, "mean {}", score.mean);
    assert!(score.p99 <= p99, "p99 {}", score.p99);
    assert!(
        score.worst_after_death <= death,
        "death {}",
        score.worst_after_death
    );
    assert!(score.duplicates < 0.02, "twice {}", score.duplicates);
    let recovered = |frames: &Option<usize>| frames.is_some_and(|frames| frames <= 10);
    assert!(
        score.recovery_frames.iter().all(recovered),
        "{:?}",
        score.recovery_frames
    );
}

#[test]
fn two_and_five_nodes_are_near_the_optimum() {
    for network in Network::ALL {
        let score = |nodes| score(nodes, network, SubmissionMode::Closed, Balancing::default());
        assert_bars(&score(2), 1.05, 1.5, 3.0);
        assert_bars(&score(5), 1.05, 1.5, 3.0);
    }
}

#[test]
fn sixty_four_nodes_are_near_the_optimum() {
    let score = |network, mode| score(64, network, mode, Balancing::default());
    assert_bars(&score(Network::Wan, SubmissionMode::Closed), 1.12, 1.5, 2.0);
    assert_bars(&score(Network::Lan, SubmissionMode::Closed), 1.15, 1.5, 2.0);
    assert_bars(
        &score(Network::Wan, SubmissionMode::Pipelined),
        1.15,
        1.5,
        2.0,
    );
}

#[test]
fn frames_in_flight_at_once_are_near_the_optimum_and_hardly_any_tile_is_traced_twice() {
    let score = |nodes, network| {
        score(
            nodes,
            network,
            SubmissionMode::Pipelined,
            Balancing::default(),
        )
    };
    for nodes in [2, 5] {
        for network in Network::ALL {
            let score = score(nodes, network);
            assert!(
                score.mean <= 1.08 && score.p99 <= 1.5,
                "{nodes} {network:?}"
            );
            assert!(score.duplicates < 0.02, "{nodes} {network:?}");
        }
    }
    let far = score(64, Network::Far);
    assert!(far.mean <= 1.15 && far.p99 <= 1.5 && far.duplicates < 0.02);
}

#[test]
fn hedging_takes_away_the_tail_and_the_wait_for_the_dead() {
    let [plain, hedged] = [false, true].map(|hedged| {
        let algorithm = Algorithm::WaterFilling;
        score(
            64,
            Network::Lan,
            SubmissionMode::Closed,
            Balancing { algorithm, hedged },
        )
    });
    assert!(hedged.mean < 0.9 * plain.mean);
    assert!(hedged.p99 < 0.8 * plain.p99);
    assert!(hedged.worst_after_death < 0.5 * plain.worst_after_death);
}
