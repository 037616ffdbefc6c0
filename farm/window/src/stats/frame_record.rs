//! Records of finished frames, as the history keeps them and recordings write them.

use std::sync::Arc;

use carom_farm::{Balancing, Delivery, FrameStats, LatencySplit, NodeStatus};
use carom_tracer::ImageSize;
use serde::Serialize;

/// A finished picture as it came from the farm.
#[derive(Debug)]
pub struct FrameSample<'a> {
    /// Its number.
    pub frame: u64,
    /// When it was taken from the farm, seconds since the program began.
    pub at_secs: f64,
    /// Its pixels.
    pub size: ImageSize,
    /// Paths per pixel.
    pub samples: u32,
    /// How it was made.
    pub stats: FrameStats,
    /// The nodes at that time.
    pub nodes: &'a [NodeStatus],
}

/// How a picture was made. Times are seconds from its submission.
#[derive(Clone, Debug, Serialize)]
pub struct FrameRecord {
    /// Its number.
    pub frame: u64,
    /// When it was taken from the farm, seconds since the program began.
    pub at_secs: f64,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Paths per pixel.
    pub samples: u32,
    /// How its tiles were divided.
    pub balancing: Balancing,
    /// When the last tile came.
    pub makespan_secs: f64,
    /// When it would have come, had all nodes ended together.
    pub ideal_secs: f64,
    /// The node whose tile came last, by index.
    pub straggler: Option<usize>,
    /// Bytes of its pixels as they crossed the link.
    pub payload_bytes: u64,
    /// The same before they were encoded.
    pub raw_bytes: u64,
    /// Tiles that were asked for again.
    pub reissued_tiles: u32,
    /// Of those, the ones whose node was lost, refused them or fell silent.
    pub lost_tiles: u32,
    /// Tiles that came twice.
    pub duplicate_tiles: u32,
    /// Samples that were not finite.
    pub dropped_samples: u64,
    /// By index.
    pub nodes: Vec<NodeRecord>,
    /// What maps and Gantt chart are drawn from; dropped from older pictures.
    #[serde(skip)]
    pub detail: Option<Detail>,
}

/// What a node did for a picture, and what was known of it.
#[derive(Clone, Debug, Serialize)]
pub struct NodeRecord {
    /// What it is called: its name, or its address.
    #[serde(serialize_with = "text")]
    pub name: Arc<str>,
    /// Tiles that came from it.
    pub tiles: u32,
    /// Of the picture's work, 0 to 1.
    pub share: f64,
    /// When its last tile came; 0 if it took no part.
    pub response_secs: f64,
    /// When that was expected.
    pub predicted_secs: Option<f64>,
    /// How long it was busy, by its own clock.
    pub busy_secs: f64,
    /// Where the time of its last tile went.
    pub split: LatencySplit,
    /// Bytes of its pixels.
    pub payload_bytes: u64,
    /// Tiles that came well after their prediction.
    pub late_tiles: u32,
    /// Tiles that another node had brought before.
    pub duplicate_tiles: u32,
    /// A, seconds.
    pub fixed_secs: f64,
    /// Its standard error.
    pub fixed_error_secs: f64,
    /// 1/B, millions of samples per second; 0 while it is not known.
    pub msamples_per_sec: f64,
    /// Its standard error, as a share.
    pub speed_error: f64,
}

/// What maps and Gantt chart are drawn from.
#[derive(Clone, Debug)]
pub struct Detail {
    /// Pixels along the edge of a tile.
    pub tile_edge: u16,
    /// Predicted work of each tile.
    pub tile_work: Vec<f32>,
    /// All that came.
    pub deliveries: Vec<Delivery>,
}

impl FrameRecord {
    /// Of a picture whose nodes are called `names`.
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

    /// The ideal makespan over the real one, 0 to 1.
    pub fn efficiency(&self) -> f64 {
        if self.makespan_secs > 0.0 {
            self.ideal_secs / self.makespan_secs
        } else {
            1.0
        }
    }

    /// The nodes that took part.
    pub fn took_part(&self) -> impl Iterator<Item = (usize, &NodeRecord)> {
        self.nodes
            .iter()
            .enumerate()
            .filter(|(_, node)| node.tiles > 0)
    }

    /// How long the nodes that took part had nothing to do at the end, on average, as a share of the
    /// makespan.
    pub fn idle(&self) -> f64 {
        let idle = |(_, node): (usize, &NodeRecord)| self.makespan_secs - node.response_secs;
        let count = self.took_part().count();
        if count == 0 || self.makespan_secs <= 0.0 {
            return 0.0;
        }
        self.took_part().map(idle).sum::<f64>() / (count as f64 * self.makespan_secs)
    }

    /// Mean and standard deviation of the response times of the nodes that took part, seconds.
    pub fn response_mean_and_deviation(&self) -> (f64, f64) {
        let responses: Vec<f64> = self
            .took_part()
            .map(|(_, node)| node.response_secs)
            .collect();
        mean_and_deviation(&responses)
    }

    /// Where the time of the very last tile went.
    pub fn critical_split(&self) -> Option<LatencySplit> {
        Some(self.nodes.get(self.straggler?)?.split)
    }
}

impl Detail {
    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        self.tile_work.len() * size_of::<f32>() + self.deliveries.len() * size_of::<Delivery>()
    }
}

/// Of any values; zeros of none.
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
