//! Contributions of nodes to a frame, and the time in which the same nodes could have traced it.

use super::FrameStats;
use crate::balancer::{CostModel, water_fill};
use crate::node_status::NodeIndex;

/// A node's contribution to a frame; times are seconds from its submission.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeEffort {
    /// When it could have begun: arrival of its first tiles less the time that it was busy with them.
    pub begin_secs: f64,
    /// Busy seconds, limited to the time between `begin_secs` and `end_secs`.
    pub busy_secs: f64,
    /// Arrival of its last tiles.
    pub end_secs: f64,
    /// Predicted arrival of these, as of their requests; absent without a prediction.
    pub expected_secs: Option<f64>,
    /// Predicted work of its tiles, in pixel samples of average cost.
    pub work: f64,
    /// Tiles that arrived.
    pub tiles: u32,
    /// Those that arrived more than a tenth and a millisecond after their prediction.
    pub late_tiles: u32,
    /// Those that another node had delivered before.
    pub duplicate_tiles: u32,
    /// Bytes of their pixels as transmitted.
    pub payload_bytes: u64,
}

impl FrameStats {
    /// The contribution of each node, by index into [`crate::Farm::nodes`]; trailing nodes without any are
    /// left out.
    pub fn efforts(&self) -> Vec<NodeEffort> {
        let nodes = self.deliveries.iter().map(|delivery| delivery.node.0 + 1);
        let mut efforts = vec![NodeEffort::default(); nodes.max().unwrap_or(0)];
        for delivery in &self.deliveries {
            let effort = &mut efforts[delivery.node.0];
            if effort.tiles == 0 {
                effort.begin_secs = (delivery.arrived_secs - delivery.busy_secs).max(0.0);
            }
            effort.busy_secs += delivery.busy_secs;
            effort.end_secs = delivery.arrived_secs;
            effort.expected_secs = match (effort.expected_secs, delivery.expected_secs) {
                (Some(before), Some(now)) => Some(f64::max(before, now)),
                (before, now) => before.or(now),
            };
            let is_late = |expected: f64| delivery.arrived_secs > expected * LATE + LATE_SECS;
            effort.work += delivery.work;
            effort.tiles += delivery.tiles.count;
            if delivery.expected_secs.is_some_and(is_late) {
                effort.late_tiles += delivery.tiles.count;
            }
            effort.duplicate_tiles += delivery.tiles.count.saturating_sub(delivery.fresh_tiles);
            effort.payload_bytes += u64::from(delivery.payload_bytes);
        }
        for effort in &mut efforts {
            effort.busy_secs = effort.busy_secs.min(effort.end_secs - effort.begin_secs);
        }
        efforts
    }

    /// The shortest time in seconds in which the participating nodes could have traced the frame, had its
    /// work been divided so that all finish together: each begins when it did, at the speed that it
    /// reported. At most [`FrameStats::makespan_secs`]; 0 if nothing arrived.
    pub fn ideal_secs(&self) -> f64 {
        self.level_secs().min(self.makespan_secs)
    }

    /// [`FrameStats::ideal_secs`] without the limit.
    fn level_secs(&self) -> f64 {
        let efforts = self.efforts();
        let took_part = efforts.iter().filter(|effort| effort.work > 0.0);
        let line = |effort: &NodeEffort| {
            let busy_secs = effort.busy_secs.max(BUSY_SECS_MIN);
            CostModel::new(effort.begin_secs, busy_secs / effort.work)
        };
        let lines: Vec<CostModel> = took_part.map(line).collect();
        if lines.is_empty() {
            return 0.0;
        }
        let work = self.tile_work.iter().copied().map(f64::from).sum();
        water_fill(work, &lines).finish_secs
    }

    /// The node whose fresh tiles arrived last.
    pub fn straggler(&self) -> Option<NodeIndex> {
        let fresh = self.deliveries.iter().rev();
        let mut fresh = fresh.filter(|delivery| delivery.fresh_tiles > 0);
        fresh.next().map(|delivery| delivery.node)
    }
}

/// Tiles are late after this multiple of the predicted time plus [`LATE_SECS`].
const LATE: f64 = 1.1;
const LATE_SECS: f64 = 1e-3;
/// Lower limit of busy seconds: a node may report 0.
const BUSY_SECS_MIN: f64 = 1e-7;

#[cfg(test)]
mod tests {
    use carom_tracer::TileRange;
    use proptest::prelude::*;

    use super::*;
    use crate::stats::{Delivery, LatencySplit};

    /// A frame of tiles of work 1, whose nodes send `(node, tiles, arrival, busy)`.
    fn frame(deliveries: &[(usize, u32, f64, f64)]) -> FrameStats {
        let mut first = 0;
        let mut stats = FrameStats::default();
        for &(node, count, arrived_secs, busy_secs) in deliveries {
            stats.deliveries.push(Delivery {
                node: NodeIndex(node),
                tiles: TileRange { first, count },
                fresh_tiles: count,
                work: f64::from(count),
                expected_secs: Some(0.010),
                arrived_secs,
                busy_secs,
                split: LatencySplit::default(),
                payload_bytes: 100,
            });
            first += count;
            stats.makespan_secs = stats.makespan_secs.max(arrived_secs);
        }
        stats
            .deliveries
            .sort_by(|a, b| a.arrived_secs.total_cmp(&b.arrived_secs));
        stats.tile_work = vec![1.0; first as usize];
        stats
    }

    #[test]
    fn the_ideal_of_two_nodes_is_where_both_end_together() {
        // Both could begin after 1 ms; one makes a tile per millisecond, the other ten.
        let stats = frame(&[(0, 10, 0.011, 0.010), (1, 10, 0.002, 0.001)]);
        // 20 tiles at 11 per millisecond.
        assert!((stats.ideal_secs() - (0.001 + 20.0 / 11_000.0)).abs() < 1e-12);
        assert_eq!(stats.straggler(), Some(NodeIndex(0)));
    }

    #[test]
    fn a_frame_whose_nodes_end_together_is_perfect() {
        let stats = frame(&[(0, 4, 0.006, 0.004), (2, 40, 0.006, 0.003)]);
        assert!((stats.ideal_secs() / stats.makespan_secs - 1.0).abs() < 1e-9);
        let efforts = stats.efforts();
        assert_eq!(
            efforts
                .iter()
                .map(|effort| effort.tiles)
                .collect::<Vec<_>>(),
            [4, 0, 40]
        );
    }

    #[test]
    fn tiles_count_as_late_only_well_after_their_prediction() {
        let late = |at: f64| frame(&[(0, 5, at, 0.001)]).efforts()[0].late_tiles;
        assert_eq!([late(0.009), late(0.0119), late(0.0121)], [0, 0, 5]);
    }

    proptest! {
        #[test]
        fn no_frame_is_better_than_ideal(
            deliveries in prop::collection::vec((0..5usize, 1..50u32, 0.0..0.1f64, 0.0..0.2f64), 1..30),
        ) {
            let stats = frame(&deliveries);
            let level = stats.level_secs();
            prop_assert!(level >= 0.0, "{level}");
            prop_assert!(level <= stats.makespan_secs * (1.0 + 1e-9) + BUSY_SECS_MIN, "{level}");
        }
    }
}
