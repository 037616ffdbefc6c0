//! The plan of a simulation: a farm, its frames, and what happens to its nodes.

use carom_protocol::FrameId;
use carom_tracer::{ImageSize, TileGrid};

use super::NetworkConditions;
use carom_farm::coordinator::SPOT_CHECK_TILES;
use carom_farm::{Balancing, Distribution, NodeIndex};

/// A simulation to run.
#[derive(Clone, Debug)]
pub struct FarmPlan {
    /// Seed of all randomness.
    pub seed: u64,
    /// The algorithm that divides the frames.
    pub balancing: Balancing,
    /// The nodes of the farm.
    pub nodes: Vec<NodePlan>,
    /// Number of frames to submit.
    pub frames: u64,
    /// Maximum number of frames in flight.
    pub frames_in_flight: usize,
    /// Interval between submissions in seconds; absent: as soon as there is room.
    pub period_secs: Option<f64>,
    /// Whether frames must be shown at the times of [`carom_farm::pacing::FrameSchedule`] for 60 frames
    /// a second.
    pub looks_ahead: bool,
    /// Size of the picture: its pixels times their samples are the work of a frame.
    pub size: ImageSize,
    /// Samples per pixel.
    pub samples: u32,
    /// Whether tiles or samples are divided.
    pub distribution: Distribution,
    /// Edge of a tile in pixels.
    pub tile_edge: u16,
    /// One tile in this many is traced again by another node; 0 for none.
    pub spot_check_tiles: u32,
    /// Random variation of the farm.
    pub conditions: NetworkConditions,
    /// Changes of nodes at the submission of a frame.
    pub changes: Vec<(FrameId, NodeIndex, NodeChange)>,
}

/// A simulated node.
#[derive(Clone, Debug)]
pub struct NodePlan {
    /// Round trip without jitter, in seconds.
    pub round_trip_secs: f64,
    /// Mean of the jitter of each message, in seconds.
    pub jitter_secs: f64,
    /// Pixel samples per second, in millions.
    pub msamples_per_sec: f64,
    /// Whether tiles are sent as they are finished, as by a processor, or all at the end of a run.
    pub streams: bool,
    /// Ratio of its reported to its true busy time; 1 is honest.
    pub honesty: f64,
    /// Whether it is in the client's process.
    pub is_local: bool,
    /// Changes of the node, by virtual time in seconds.
    pub changes: Vec<(f64, NodeChange)>,
}

/// A change of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NodeChange {
    /// It takes this many times as long as before from now on.
    Slow(f64),
    /// It sends nothing any more, and its connection stays open.
    Silent,
    /// Its connection breaks, which the client learns of at once.
    Die,
    /// It finishes what it has been asked for and ends: it announces that, and closes the connection
    /// once the client has everything.
    Drain,
    /// It connects. A node with this among its changes is not present from the start.
    Join,
    /// Its device fails at each run from now on.
    Fail,
    /// It reports this ratio of its true busy time from now on.
    Lie(f64),
    /// It sends pixels that are not numbers from now on.
    Poison,
    /// It sends wrong but plausible pixels for one tile in this many from now on.
    Forge(u32),
    /// The client sleeps for this many seconds.
    Suspend(f64),
}

/// One frame after the other, divided by tiles, without jitter or changes; the nodes are to be filled
/// in.
impl Default for FarmPlan {
    fn default() -> Self {
        Self {
            seed: 1,
            balancing: Balancing::default(),
            nodes: Vec::new(),
            frames: 1,
            frames_in_flight: 1,
            period_secs: None,
            looks_ahead: false,
            size: ImageSize::new(240, 160),
            samples: 1,
            distribution: Distribution::Tiles,
            tile_edge: 8,
            spot_check_tiles: SPOT_CHECK_TILES,
            conditions: NetworkConditions::default(),
            changes: Vec::new(),
        }
    }
}

impl FarmPlan {
    /// The picture's tiles.
    pub fn grid(&self) -> TileGrid {
        TileGrid::new(self.size, self.tile_edge)
    }

    /// Whether a node is not present from the start.
    pub(super) fn joins_later(&self, node: NodeIndex) -> bool {
        let by_time = self.nodes[node.0].changes.iter();
        let by_time = by_time.map(|(_, change)| *change);
        let by_frame = self.changes.iter().filter(|(_, of, _)| *of == node);
        let mut changes = by_time.chain(by_frame.map(|(.., change)| *change));
        changes.any(|change| change == NodeChange::Join)
    }
}

impl NodePlan {
    /// An honest node on a local network that streams its tiles.
    pub fn new(round_trip_secs: f64, msamples_per_sec: f64) -> Self {
        Self {
            round_trip_secs,
            jitter_secs: 0.0,
            msamples_per_sec,
            streams: true,
            honesty: 1.0,
            is_local: false,
            changes: Vec::new(),
        }
    }

    /// The same with a change.
    pub fn with(mut self, at_secs: f64, change: NodeChange) -> Self {
        self.changes.push((at_secs, change));
        self
    }
}
