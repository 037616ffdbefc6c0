//! What an application asks of a farm, and what it gets.

use std::fmt;
use std::time::Duration;

use carom_protocol::{FrameId, NodeInfo, PixelFormat};
use carom_tracer::{ImageSize, RenderSettings, SceneUpdate, Tile, TileRange};
use serde::Serialize;

use crate::Balancing;
use crate::coordinator::NodeIndex;

/// A picture to trace.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSpec {
    /// Camera and poses.
    pub update: SceneUpdate,
    /// Pixels.
    pub size: ImageSize,
    /// Samples, maximum depth and seed.
    pub settings: RenderSettings,
    /// How pixels come back.
    pub format: PixelFormat,
}

/// A finished picture.
#[derive(Clone, Debug)]
pub struct Frame {
    /// What [`crate::Farm::submit`] returned.
    pub id: FrameId,
    /// Pixels across and down.
    pub size: ImageSize,
    /// The pixels, row-major from the top left.
    pub pixels: Pixels,
    /// Tiles that were not whole when the picture had to be shown: their pixels are black or, where
    /// samples are divided, the mean of those that were there. The picture comes again when it is
    /// whole, unless a later one has had to be shown by then.
    pub missing: Vec<Tile>,
    /// How it was made.
    pub stats: FrameStats,
}

/// Pixels in the format that was asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// [`PixelFormat::Srgb8`].
    Srgb8(Vec<[u8; 3]>),
    /// [`PixelFormat::LinearF16`] and [`PixelFormat::LinearF32`].
    Linear(Vec<[f32; 3]>),
}

/// How a frame was made, by the client's clock.
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

/// Where the time of a tile went, from [`crate::Farm::submit`] until its pixels were there, in
/// seconds: one after the other, each a duration by one clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencySplit {
    /// From submission until the node was asked, by the client's clock.
    pub request_secs: f64,
    /// What is left of the round trip: both ways through the network, and waiting for it.
    pub network_secs: f64,
    /// Waiting for the node's device, by the node's clock.
    pub queue_secs: f64,
    /// Tracing, and waiting for the tiles that travel together, by the node's clock.
    pub trace_secs: f64,
    /// Encoding, by the node's clock.
    pub encode_secs: f64,
    /// Decoding, by the client's clock.
    pub decode_secs: f64,
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

/// A node as the coordinator sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeStatus {
    /// Its address, or `local`.
    pub address: String,
    /// What it said of itself; absent until it has.
    pub info: Option<NodeInfo>,
    /// Where it stands.
    pub state: NodeState,
    /// Learned fixed cost of a request, A, in seconds.
    pub fixed_secs: f64,
    /// Standard error of A, in seconds; 0 until two requests have been answered.
    pub fixed_error_secs: f64,
    /// Learned speed, 1/B, in millions of pixel samples per second.
    pub msamples_per_sec: f64,
    /// Standard error of the speed, as a share of it; 0 until two requests have been answered.
    pub speed_error: f64,
    /// Tiles delivered since it joined.
    pub tiles: u64,
    /// Tiles that it was asked for and that it refused, or that were lost with its connection or
    /// asked of others because it had fallen silent.
    pub lost_tiles: u64,
    /// Last round trip of a ping, if there was one.
    pub round_trip: Option<Duration>,
    /// Where the time of its last tile went.
    pub split: LatencySplit,
}

/// Where a node stands, in the words that players, `carom-farm status` and the node itself use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeState {
    /// Its device is being opened, or it is being called.
    Starting,
    /// It waits for a player: only a node says that, of itself.
    Listening,
    /// Connected, and this farm has no scene yet.
    Paired,
    /// Connected, without this farm's scene yet.
    Syncing {
        /// How much of the scene has come to it.
        percent: u8,
    },
    /// Holds the scene.
    Ready,
    /// Holds the scene and has had work within the last second.
    Rendering,
    /// Ends: only a node says that, of itself.
    Draining,
    /// Gone, or of no use for now.
    Lost {
        /// A sentence.
        why: String,
        /// When it is tried again, in whole seconds from now, rounded up; absent if nobody knows.
        retry_secs: Option<u64>,
    },
}

impl NodeState {
    /// One word.
    pub const fn word(&self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Listening => "listening",
            Self::Paired => "paired",
            Self::Syncing { .. } => "syncing",
            Self::Ready => "ready",
            Self::Rendering => "rendering",
            Self::Draining => "draining",
            Self::Lost { .. } => "lost",
        }
    }

    /// What that means, as the end of a sentence that begins with the node's name.
    pub fn sentence(&self) -> String {
        match self {
            Self::Starting => "is being called, or opens its device".into(),
            Self::Listening => "waits for a player".into(),
            Self::Paired => "is connected and waits for a scene".into(),
            Self::Syncing { percent } => {
                format!("is being sent the scene and has {percent} % of it")
            }
            Self::Ready => "holds the scene and waits for work".into(),
            Self::Rendering => "traces".into(),
            Self::Draining => "is shutting down".into(),
            Self::Lost { why, retry_secs } => match retry_secs {
                Some(secs) => format!("is lost ({why}, tried again within {secs} s)"),
                None => format!("is lost ({why})"),
            },
        }
    }

    /// Whether it can be asked for pictures of this farm's scene.
    pub const fn is_ready(&self) -> bool {
        matches!(self, Self::Ready | Self::Rendering)
    }
}

/// Its word, with how much of the scene it has, and for a lost node why it is and when it is tried
/// again.
impl fmt::Display for NodeState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())?;
        match self {
            Self::Syncing { percent } => write!(f, " {percent} %"),
            Self::Lost { why, retry_secs } => match retry_secs {
                Some(secs) => write!(f, " ({why}, tried again within {secs} s)"),
                None => write!(f, " ({why})"),
            },
            _ => Ok(()),
        }
    }
}
