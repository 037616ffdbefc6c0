//! Records of finished pictures, which the history keeps and recordings write.

use std::sync::Arc;

use carom_farm::{Balancing, Delivery, FrameStats, LatencySplit, NodeStatus};
use carom_tracer::ImageSize;
use serde::Serialize;

/// A finished picture as received from the farm.
#[derive(Debug)]
pub struct FrameSample<'a> {
    /// Its number.
    pub frame: u64,
    /// Time when it was received, in seconds since the program began.
    pub at_secs: f64,
    /// Its size in pixels.
    pub size: ImageSize,
    /// Samples per pixel.
    pub samples: u32,
    /// Statistics of its tracing.
    pub stats: FrameStats,
    /// Status of the nodes at that time.
    pub nodes: &'a [NodeStatus],
}

/// Record of how a picture was traced. Times are in seconds since its submission, unless stated otherwise.
#[derive(Clone, Debug, Serialize)]
pub struct FrameRecord {
    /// Its number.
    pub frame: u64,
    /// Time when it was received, in seconds since the program began.
    pub at_secs: f64,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Samples per pixel.
    pub samples: u32,
    /// The balancing that distributed its tiles.
    pub balancing: Balancing,
    /// Time of arrival of the last tile.
    pub makespan_secs: f64,
    /// The same if all nodes had finished simultaneously.
    pub ideal_secs: f64,
    /// Index of the node whose tile came last.
    pub straggler: Option<usize>,
    /// Bytes of its pixels on the wire.
    pub payload_bytes: u64,
    /// Bytes of its pixels before encoding.
    pub raw_bytes: u64,
    /// Tiles that were requested again.
    pub reissued_tiles: u32,
    /// Of those, the ones whose node was lost, refused them or timed out.
    pub lost_tiles: u32,
    /// Tiles that arrived twice.
    pub duplicate_tiles: u32,
    /// Samples that were not finite and count as black.
    pub dropped_samples: u64,
    /// Contributions of the nodes, by index.
    pub nodes: Vec<NodeRecord>,
    /// Data for maps and Gantt chart; dropped from older pictures.
    #[serde(skip)]
    pub detail: Option<Detail>,
}

/// Contribution of a node to a picture, and the balancer's estimates of it.
#[derive(Clone, Debug, Serialize)]
pub struct NodeRecord {
    /// Its name, or else its address.
    #[serde(serialize_with = "text")]
    pub name: Arc<str>,
    /// Tiles that it delivered.
    pub tiles: u32,
    /// Share of the picture's work, 0 to 1.
    pub share: f64,
    /// Time of its last tile's arrival; 0 if it took no part.
    pub response_secs: f64,
    /// Predicted time of its last tile's arrival.
    pub predicted_secs: Option<f64>,
    /// Time for which it was busy, by its own clock.
    pub busy_secs: f64,
    /// Latency breakdown of its last tile.
    pub split: LatencySplit,
    /// Bytes of its pixels on the wire.
    pub payload_bytes: u64,
    /// Tiles that arrived well after their prediction.
    pub late_tiles: u32,
    /// Tiles that another node had delivered before.
    pub duplicate_tiles: u32,
    /// Estimated fixed cost of a request, A, in seconds.
    pub fixed_secs: f64,
    /// Standard error of A in seconds.
    pub fixed_error_secs: f64,
    /// Estimated speed, 1/B, in millions of samples per second; 0 while unknown.
    pub msamples_per_sec: f64,
    /// Standard error of the speed, as a share of it.
    pub speed_error: f64,
}

/// Data for maps and Gantt chart.
#[derive(Clone, Debug)]
pub struct Detail {
    /// Edge of a tile in pixels.
    pub tile_edge: u16,
    /// Predicted work of each tile.
    pub tile_work: Vec<f32>,
    /// All tile messages that arrived.
    pub deliveries: Vec<Delivery>,
}

impl FrameRecord {
    /// The record of a picture; `names` are those of its nodes.
    pub fn new(seen: FrameSample<'_>, names: &[Arc<str>]) -> Self {
        let stats = seen.stats;
        let efforts = stats.efforts();
        let work: f64 = efforts.iter().map(|effort| effort.work).sum();
        let node = |(index, (status, name)): (usize, (&NodeStatus, &Arc<str>))| {
            let effort = efforts.get(index).copied().unwrap_or_default();
            NodeRecord {
                name: Arc::clone(name),
                tiles: effort.tiles,
                share: if work > 0.0 { effort.work / work } else { 0.0 },
                response_secs: effort.end_secs,
                predicted_secs: effort.expected_secs,
                busy_secs: effort.busy_secs,
                split: stats.split_by_node.get(index).copied().unwrap_or_default(),
                payload_bytes: effort.payload_bytes,
                late_tiles: effort.late_tiles,
                duplicate_tiles: effort.duplicate_tiles,
                fixed_secs: status.fixed_secs,
                fixed_error_secs: status.fixed_error_secs,
                msamples_per_sec: status.msamples_per_sec,
                speed_error: status.speed_error,
            }
        };
        Self {
            frame: seen.frame,
            at_secs: seen.at_secs,
            width: seen.size.width,
            height: seen.size.height,
            samples: seen.samples,
            balancing: stats.balancing,
            makespan_secs: stats.makespan_secs,
            ideal_secs: stats.ideal_secs(),
            straggler: stats.straggler().map(|node| node.0),
            payload_bytes: stats.payload_bytes,
            raw_bytes: stats.raw_bytes,
            reissued_tiles: stats.reissued_tiles,
            lost_tiles: stats.lost_tiles,
            duplicate_tiles: stats.duplicate_tiles,
            dropped_samples: stats.dropped_samples,
            nodes: seen.nodes.iter().zip(names).enumerate().map(node).collect(),
            detail: Some(Detail {
                tile_edge: stats.tile_edge,
                tile_work: stats.tile_work,
                deliveries: stats.deliveries,
            }),
        }
    }

    /// Ratio of the ideal makespan to the actual one, 0 to 1.
    pub fn efficiency(&self) -> f64 {
        if self.makespan_secs > 0.0 {
            self.ideal_secs / self.makespan_secs
        } else {
            1.0
        }
    }

    /// The nodes that took part, with their indices.
    pub fn took_part(&self) -> impl Iterator<Item = (usize, &NodeRecord)> {
        self.nodes
            .iter()
            .enumerate()
            .filter(|(_, node)| node.tiles > 0)
    }

    /// Mean idle time at the end of the nodes that took part, as a share of the makespan.
    pub fn idle(&self) -> f64 {
        let idle = |(_, node): (usize, &NodeRecord)| self.makespan_secs - node.response_secs;
        let count = self.took_part().count();
        if count == 0 || self.makespan_secs <= 0.0 {
            return 0.0;
        }
        self.took_part().map(idle).sum::<f64>() / (count as f64 * self.makespan_secs)
    }

    /// Mean and standard deviation of the response times of the nodes that took part, in seconds.
    pub fn response_mean_and_deviation(&self) -> (f64, f64) {
        let responses: Vec<f64> = self
            .took_part()
            .map(|(_, node)| node.response_secs)
            .collect();
        mean_and_deviation(&responses)
    }

    /// Latency breakdown of the last tile.
    pub fn critical_split(&self) -> Option<LatencySplit> {
        Some(self.nodes.get(self.straggler?)?.split)
    }
}

impl Detail {
    /// Bytes that it occupies.
    pub fn bytes(&self) -> usize {
        self.tile_work.len() * size_of::<f32>() + self.deliveries.len() * size_of::<Delivery>()
    }
}

/// Mean and population standard deviation of values; zeros without any.
pub fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values
        .iter()
        .map(|value| (value - mean).powi(2))
        .sum::<f64>()
        / count;
    (mean, variance.sqrt())
}

fn text<S: serde::Serializer>(text: &Arc<str>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(text)
}
