//! Statistics of finished frames: which node delivered what, when, and where the time went.

mod efficiency;
mod latency_split;

use carom_tracer::TileRange;
use serde::Serialize;

pub use self::efficiency::NodeEffort;
pub use self::latency_split::LatencySplit;
use crate::balancing::Balancing;
use crate::node_status::NodeIndex;

/// Statistics of a frame, by the client's clock.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FrameStats {
    /// From [`crate::Farm::submit`] to the last tile, in seconds; with tiles missing, to its deadline.
    pub makespan_secs: f64,
    /// Maximum over the nodes of the busy time for the picture, by their own clocks, in seconds: pictures
    /// in flight cannot follow each other faster.
    pub busy_secs: f64,
    /// Balancing of its tiles.
    pub balancing: Balancing,
    /// Passes in which each tile was traced, each with different samples: see [`crate::Distribution`].
    pub passes: u32,
    /// Bytes of pixels as transmitted.
    pub payload_bytes: u64,
    /// Bytes of the same pixels before they were encoded.
    pub raw_bytes: u64,
    /// Tiles that were requested again because a node was late or lost.
    pub reissued_tiles: u32,
    /// Those whose node was lost, refused them or fell silent.
    pub lost_tiles: u32,
    /// Tiles that were missing at the deadline.
    pub late_tiles: u32,
    /// Tiles that arrived twice; the first copy was kept.
    pub duplicate_tiles: u32,
    /// Samples that were not finite and count as black.
    pub dropped_samples: u64,
    /// Tiles that each node delivered, counted once per pass, by index into [`crate::Farm::nodes`].
    pub tiles_by_node: Vec<u32>,
    /// Arrival of each node's last tile, in seconds from [`crate::Farm::submit`], by the same index; 0 for
    /// a node that delivered none.
    pub response_secs_by_node: Vec<f64>,
    /// Latency breakdown of each node's last tile, by the same index.
    pub split_by_node: Vec<LatencySplit>,
    /// Edge of a tile in pixels.
    pub tile_edge: u16,
    /// Predicted work of each tile at the division, in pixel samples of average cost.
    #[serde(skip)]
    pub tile_work: Vec<f32>,
    /// All deliveries until the picture was complete, in order of arrival.
    #[serde(skip)]
    pub deliveries: Vec<Delivery>,
}

/// Tiles of one message of a node. Times are seconds from [`crate::Farm::submit`].
#[derive(Clone, Debug, PartialEq)]
pub struct Delivery {
    /// Node that traced them.
    pub node: NodeIndex,
    /// Range of the tiles.
    pub tiles: TileRange,
    /// Number of them that had not come from another node before.
    pub fresh_tiles: u32,
    /// Their predicted work, in pixel samples of average cost.
    pub work: f64,
    /// Predicted arrival of the last tile of the same request, as of its issue; absent while nothing was
    /// known of the node.
    pub expected_secs: Option<f64>,
    /// Arrival.
    pub arrived_secs: f64,
    /// Seconds that the node was busy with them, by its own clock.
    pub busy_secs: f64,
    /// Breakdown of their latency.
    pub split: LatencySplit,
    /// Bytes of their pixels as transmitted.
    pub payload_bytes: u32,
}

impl FrameStats {
    /// Standard deviation of the response times of the participating nodes, in seconds.
    pub fn response_deviation_secs(&self) -> f64 {
        let took_part = |secs: &&f64| **secs > 0.0;
        let responses = || self.response_secs_by_node.iter().filter(took_part);
        let count = responses().count().max(1) as f64;
        let mean = responses().sum::<f64>() / count;
        let variance = responses().map(|secs| (secs - mean).powi(2)).sum::<f64>() / count;
        variance.sqrt()
    }

    /// Latency breakdown of the very last tile; `None` if no node delivered any.
    pub fn last_split(&self) -> Option<&LatencySplit> {
        let responses = self.response_secs_by_node.iter().enumerate();
        let (last, _) = responses.max_by(|a, b| a.1.total_cmp(b.1))?;
        self.split_by_node.get(last)
    }

    /// Maximum response time of a node, in seconds.
    pub fn response_max_secs(&self) -> f64 {
        self.response_secs_by_node
            .iter()
            .copied()
            .fold(0.0, f64::max)
    }
}
