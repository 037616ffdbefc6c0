//! Statistics of finished frames: who delivered what, when, and where the time went.

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
    /// The longest that a node was busy with the picture, by its own clock, in seconds: pictures in
    /// flight cannot follow each other faster.
    pub busy_secs: f64,
    /// How its tiles were divided.
    pub balancing: Balancing,
    /// How often each tile was traced, with other samples each time: see [`crate::Distribution`].
    pub passes: u32,
    /// Bytes of pixels as they crossed the link.
    pub payload_bytes: u64,
    /// Bytes of the same pixels before they were encoded.
    pub raw_bytes: u64,
    /// Tiles that were asked for again because a node was late or lost.
    pub reissued_tiles: u32,
    /// Of those, the ones whose node was lost, refused them or fell silent.
    pub lost_tiles: u32,
    /// Tiles that were not there when the picture had to be shown.
    pub late_tiles: u32,
    /// Tiles that came twice; the first was kept.
    pub duplicate_tiles: u32,
    /// Samples that were not finite and count as black.
    pub dropped_samples: u64,
    /// Tiles that each node delivered, a tile in each pass counted anew, by index into
    /// [`crate::Farm::nodes`].
    pub tiles_by_node: Vec<u32>,
    /// When each node's last tile came, in seconds from [`crate::Farm::submit`], by the same
    /// index; 0 for a node that delivered none.
    pub response_secs_by_node: Vec<f64>,
    /// Where the time of each node's last tile went, by the same index.
    pub split_by_node: Vec<LatencySplit>,
    /// Pixels along the edge of a tile.
    pub tile_edge: u16,
    /// The work of each tile as it was predicted when they were divided, in pixel samples of average
    /// cost.
    #[serde(skip)]
    pub tile_work: Vec<f32>,
    /// Everything that came until the picture was whole, in the order of arrival.
    #[serde(skip)]
    pub deliveries: Vec<Delivery>,
}

/// Tiles that came together from one node. Times are seconds from [`crate::Farm::submit`].
#[derive(Clone, Debug, PartialEq)]
pub struct Delivery {
    /// Who traced them.
    pub node: NodeIndex,
    /// Which.
    pub tiles: TileRange,
    /// How many of them had not come from another node before.
    pub fresh_tiles: u32,
    /// Their predicted work, in pixel samples of average cost.
    pub work: f64,
    /// When the last tile of the same request was expected, as predicted when it was asked for;
    /// absent while nothing was known of the node.
    pub expected_secs: Option<f64>,
    /// When they were there.
    pub arrived_secs: f64,
    /// How long the node was busy with them, by its own clock.
    pub busy_secs: f64,
    /// Where their time went.
    pub split: LatencySplit,
    /// Bytes of their pixels as they crossed the link.
    pub payload_bytes: u32,
}

impl FrameStats {
    /// Standard deviation of the response times of those nodes that took part, in seconds.
    pub fn response_deviation_secs(&self) -> f64 {
        let took_part = |secs: &&f64| **secs > 0.0;
        let responses = || self.response_secs_by_node.iter().filter(took_part);
        let count = responses().count().max(1) as f64;
        let mean = responses().sum::<f64>() / count;
        let variance = responses().map(|secs| (secs - mean).powi(2)).sum::<f64>() / count;
        variance.sqrt()
    }

    /// Where the time of the very last tile went; absent if no node delivered any.
    pub fn last_split(&self) -> Option<&LatencySplit> {
        let responses = self.response_secs_by_node.iter().enumerate();
        let (last, _) = responses.max_by(|a, b| a.1.total_cmp(b.1))?;
        self.split_by_node.get(last)
    }

    /// The longest response time of a node, in seconds.
    pub fn response_max_secs(&self) -> f64 {
        self.response_secs_by_node
            .iter()
            .copied()
            .fold(0.0, f64::max)
    }
}
