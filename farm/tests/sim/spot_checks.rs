//! Spot checks: nodes that send wrong pixels are found, dropped and named, and honest ones pay little.

use carom_farm::coordinator::SPOT_CHECK_TILES;
use carom_farm::{Distribution, NodeStatus};

use super::*;

/// Five unequal nodes, of which that one forges a tile of every four messages.
fn with_forger(forger: usize) -> Vec<NodePlan> {
    let mut nodes = unequal();
    nodes[forger] = nodes[forger].clone().with(1.0, NodeChange::Forge(4));
    nodes
}

fn dropped(nodes: &[NodeStatus]) -> Vec<usize> {
    let is_dropped = |node: &NodeStatus| matches!(&node.state, NodeState::Lost { why, retry_secs: None } if why.contains("other pixels"));
    let nodes = nodes.iter().enumerate();
    let dropped = nodes.filter(|(_, node)| is_dropped(node));
    dropped.map(|(index, _)| index).collect()
}

#[test]
fn a_node_that_forges_tiles_is_dropped_and_named_whichever_it_is() {
    for forger in 0..4 {
        let plan = plan(with_forger(forger), WaterFilling, 1500);
        let report = run(&plan, SECS_MAX);
        assert_eq!(report.frames.len(), 1500);
        assert_eq!(dropped(&report.nodes), [forger], "{:?}", report.warnings);
        let [warning] = &report.warnings[..] else {
            panic!("{:?}", report.warnings);
        };
        let name = format!("node {forger}");
        assert!(
            warning.contains(&format!("{name} ({name}) is dropped")),
            "{warning}"
        );
        // Each tile that it forges is found with one chance of 512.
        println!(
            "node {forger}: {} frames had wrong pixels",
            report.wrong_frames
        );
        assert!(report.wrong_frames < 100, "{}", report.wrong_frames);
    }
}

#[test]
fn honest_nodes_pay_less_than_a_hundredth() {
    let report = |spot_check_tiles| {
        let plan = plan(unequal(), WaterFilling, 400);
        checked(&FarmPlan {
            spot_check_tiles,
            ..plan
        })
    };
    let (with, without) = (report(SPOT_CHECK_TILES), report(0));
    let checked: u64 = with.nodes.iter().map(|node| node.checked_tiles).sum();
    let tiles = u64::from(with.tiles_per_frame) * 400;
    let share = checked as f64 / 2.0 / tiles as f64 * f64::from(SPOT_CHECK_TILES);
    assert!(
        (0.8..1.2).contains(&share),
        "{share} of the checks that should be"
    );
    let traced = with.tiles_traced as f64 / without.tiles_traced as f64;
    let secs = with.mean_secs(50..400) / without.mean_secs(50..400);
    println!("{traced:.4} times the tiles, {secs:.4} times the time");
    assert!(traced < 1.01 && secs < 1.01, "{traced}, {secs}");
    assert!(with.nodes.iter().all(|node| node.doubt.is_none()));
}

#[test]
fn two_nodes_that_disagree_are_both_named_and_go_on() {
    let mut nodes = vec![NodePlan::new(1e-3, 1.0), NodePlan::new(1e-3, 1.0)];
    nodes[1] = nodes[1].clone().with(1.0, NodeChange::Forge(1));
    let report = run(&plan(nodes, WaterFilling, 200), SECS_MAX);
    assert_eq!(
        (report.frames.len(), dropped(&report.nodes).len()),
        (200, 0)
    );
    for (node, other) in report.nodes.iter().zip(["node 1", "node 0"]) {
        let doubt = node.doubt.as_deref().unwrap_or_default();
        assert!(doubt.contains(other), "{doubt}");
    }
    let [warning] = &report.warnings[..] else {
        panic!("{:?}", report.warnings);
    };
    assert!(
        warning.contains("node 0") && warning.contains("node 1"),
        "{warning}"
    );
}

#[test]
fn a_node_of_this_process_is_right_where_one_other_differs() {
    for local in [0, 1] {
        let mut nodes = vec![NodePlan::new(1e-3, 1.0), NodePlan::new(1e-3, 1.0)];
        nodes[local].is_local = true;
        nodes[1 - local] = nodes[1 - local].clone().with(1.0, NodeChange::Forge(1));
        let report = run(&plan(nodes, WaterFilling, 200), SECS_MAX);
        assert_eq!(dropped(&report.nodes), [1 - local], "{:?}", report.warnings);
        assert!(report.wrong_frames < 50, "{}", report.wrong_frames);
    }
}

#[test]
fn a_forger_is_dropped_where_nodes_trace_samples_and_takes_its_sums_along() {
    for seed in 0..12 {
        let report = run(
            &FarmPlan {
                seed,
                distribution: Distribution::Samples,
                samples: 16,
                ..plan(with_forger(1), WaterFilling, 100)
            },
            SECS_MAX,
        );
        assert_eq!(report.frames.len(), 100, "seed {seed}");
        assert_eq!(dropped(&report.nodes), [1], "{:?}", report.warnings);
    }
}
