//! Laws of nodes that finish their work and end: on SIGTERM, a spot notice, or when they are told.

use std::collections::BTreeSet;

use carom_farm::{Algorithm, NodeIndex};
use carom_protocol::FrameId;
use carom_testkit::simulator::{
    FarmPlan, NodeChange, NodePlan, PERIOD_SECS, SimulationReport, run,
};
use carom_tracer::ImageSize;

/// Five equal nodes, of which one is left out at the 100th of 200 frames, 60 a second.
fn shot(change: NodeChange, round_trip_secs: f64, msamples_per_sec: f64) -> SimulationReport {
    let nodes = vec![NodePlan::new(round_trip_secs, msamples_per_sec); 5];
    let plan = FarmPlan {
        frames_in_flight: 8,
        period_secs: Some(PERIOD_SECS),
        size: ImageSize::new(160, 120),
        changes: vec![(FrameId(100), NodeIndex(2), change)],
        ..super::plan(nodes, Algorithm::WaterFilling, 200)
    };
    run(&plan, 100.0)
}

/// By how many periods a frame that is in flight then, or later, takes longer than any of the 40 before.
fn late_periods(report: &SimulationReport) -> f64 {
    (report.worst_secs(90..report.frames.len()) - report.worst_secs(50..90)) / PERIOD_SECS
}

#[test]
fn no_frame_is_late_by_more_than_a_period_when_a_node_drains() {
    for (round_trip_secs, msamples_per_sec) in [(1e-3, 0.5), (0.02, 0.5), (0.08, 0.5), (0.02, 5.0)]
    {
        let drained = shot(NodeChange::Drain, round_trip_secs, msamples_per_sec);
        let killed = shot(NodeChange::Die, round_trip_secs, msamples_per_sec);
        let frames: BTreeSet<FrameId> = drained.frames.iter().map(|frame| frame.id).collect();
        assert_eq!(
            (frames.len(), drained.wrong_frames, drained.skipped),
            (200, 0, 0)
        );
        let lost: u32 = drained
            .frames
            .iter()
            .map(|frame| frame.stats.lost_tiles)
            .sum();
        let [drained, killed] = [drained, killed].map(|report| late_periods(&report));
        println!(
            "round trip {:>4.0} ms, {msamples_per_sec} Msample/s: late by {drained:.2} periods when one \
             of 5 drains, {killed:.2} when it is killed",
            1e3 * round_trip_secs
        );
        assert_eq!(lost, 0);
        assert!(drained <= 1.0, "{drained}");
    }
}
