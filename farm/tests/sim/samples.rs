//! Frames of which nodes trace other samples each.

use carom_farm::Algorithm::WaterFilling;
use carom_farm::NodeIndex;
use carom_farm::{Distribution, FrameId};
use carom_testkit::simulator::{FarmPlan, NodeChange, NodePlan, PERIOD_SECS, run};

use super::{checked, plan, unequal};

/// Frames that take as long as those of one sample.
fn of_samples(distribution: Distribution, samples: u32, mut nodes: Vec<NodePlan>) -> FarmPlan {
    let speeds = nodes.iter_mut().map(|node| &mut node.msamples_per_sec);
    speeds.for_each(|speed| *speed *= f64::from(samples));
    FarmPlan {
        samples,
        distribution,
        ..plan(nodes, WaterFilling, 120)
    }
}

#[test]
fn frames_divided_by_samples_are_through_as_early_as_by_tiles() {
    let reports = Distribution::ALL.map(|of| checked(&of_samples(of, 12, unequal())));
    let [tiles, samples] = &reports;
    let ratio = samples.mean_secs(60..120) / tiles.mean_secs(60..120);
    println!("by samples {ratio:.3} times as long as by tiles");
    assert!(ratio < 1.05, "{ratio}");
    let last =
        |report: &carom_testkit::simulator::SimulationReport| report.frames[119].stats.passes;
    // The five are 1.7 times the fastest of them.
    assert_eq!((last(tiles), last(samples)), (1, 2));
}

#[test]
fn each_of_equal_nodes_has_a_pass() {
    let nodes = (0..5).map(|_| NodePlan::new(1e-3, 1.0)).collect();
    let report = checked(&of_samples(Distribution::Samples, 15, nodes));
    let stats = &report.frames[119].stats;
    assert_eq!(stats.passes, 5);
    for tiles in &stats.tiles_by_node {
        let passes = f64::from(*tiles) / f64::from(report.tiles_per_frame);
        assert!((passes - 1.0).abs() < 0.1, "{:?}", stats.tiles_by_node);
    }
}

/// What is there at its deadline is the whole picture, with more noise where the dead node's samples are
/// not there yet.
#[test]
fn a_node_that_dies_costs_its_own_samples_until_others_have_traced_them() {
    let mut nodes = vec![NodePlan::new(1e-3, 1.0); 4];
    // In the middle of a frame; each takes 10.6 ms.
    nodes[1] = nodes[1].clone().with(1.0 + 5e-3, NodeChange::Die);
    let plan = of_samples(Distribution::Samples, 12, nodes);
    let report = checked(&plan);
    let hit: Vec<_> = report
        .frames
        .iter()
        .filter(|frame| frame.stats.lost_tiles > 0)
        .collect();
    assert_eq!(hit.len(), 1);
    let stats = &hit[0].stats;
    assert_eq!(stats.passes, 4);
    assert!(
        stats.lost_tiles <= report.tiles_per_frame,
        "{}",
        stats.lost_tiles
    );
    assert_eq!(stats.duplicate_tiles, 0);

    let shown = run(
        &FarmPlan {
            frames_in_flight: 8,
            period_secs: Some(PERIOD_SECS),
            looks_ahead: true,
            nodes: vec![NodePlan::new(1e-3, 12.0); 4],
            changes: vec![(FrameId(60), NodeIndex(1), NodeChange::Silent)],
            ..plan
        },
        100.0,
    );
    assert_eq!(shown.wrong_frames, 0);
    assert!(shown.shown_late_secs < 1e-6, "{}", shown.shown_late_secs);
}
