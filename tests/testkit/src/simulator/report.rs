//! The results of a simulation.

use carom_farm::coordinator::FrameRefusal;
use carom_farm::{Frame, NodeStatus};

/// Results of a simulation.
#[derive(Clone, Debug, Default)]
pub struct SimulationReport {
    /// The whole frames in the order of delivery; the pixels have been checked and dropped.
    pub frames: Vec<Frame>,
    /// Frames that were shown with tiles missing, some of which were completed later.
    pub partial: Vec<Frame>,
    /// Frames that every node refused.
    pub refused: Vec<FrameRefusal>,
    /// Warnings to the user.
    pub warnings: Vec<String>,
    /// Largest delay of a frame's delivery after it had to be shown, in seconds.
    pub shown_late_secs: f64,
    /// Frames in which any pixel was wrong or missing.
    pub wrong_frames: u64,
    /// Number of tiles in a frame.
    pub tiles_per_frame: u32,
    /// Number of tiles that devices have worked on, wanted or not.
    pub tiles_traced: u64,
    /// Submissions that were skipped as the maximum number of frames was in flight.
    pub skipped: u64,
    /// The nodes at the end.
    pub nodes: Vec<NodeStatus>,
    /// Duration in virtual seconds.
    pub secs: f64,
}

impl SimulationReport {
    /// Mean time of the frames with an index in `range`, in seconds.
    pub fn mean_secs(&self, range: std::ops::Range<usize>) -> f64 {
        let frames = &self.frames[range];
        let sum: f64 = frames.iter().map(|frame| frame.stats.makespan_secs).sum();
        sum / frames.len() as f64
    }

    /// The longest time of a frame with an index in `range`, in seconds.
    pub fn worst_secs(&self, range: std::ops::Range<usize>) -> f64 {
        let times = self.frames[range]
            .iter()
            .map(|frame| frame.stats.makespan_secs);
        times.fold(0.0, f64::max)
    }

    /// Tiles that came twice, as a share of all.
    pub fn duplicate_share(&self) -> f64 {
        let duplicates: u32 = self
            .frames
            .iter()
            .map(|frame| frame.stats.duplicate_tiles)
            .sum();
        f64::from(duplicates) / (f64::from(self.tiles_per_frame) * self.frames.len() as f64)
    }
}
