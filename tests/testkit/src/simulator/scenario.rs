//! Scenarios for the comparison of algorithms: unequal nodes at unequal distances, of which one slows
//! down, one dies and one joins.

use carom_protocol::FrameId;
use carom_tracer::ImageSize;

use super::optimum::shares;
use super::{FarmPlan, NetworkConditions, NodeChange, NodePlan};
use crate::random::SplitMix64;
use carom_farm::Balancing;
use carom_farm::NodeIndex;

/// Distances of the nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Network {
    /// Round trips of 0.3 to 2 ms.
    Lan,
    /// Round trips of 1 to 80 ms.
    Wan,
    /// Round trips of 46 ms for all nodes.
    Far,
}

/// Submission of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SubmissionMode {
    /// Each frame once the one before is complete.
    Closed,
    /// 60 frames a second, up to eight in flight.
    Pipelined,
}

/// One run of the comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scenario {
    /// Number of nodes from the start; one more joins.
    pub nodes: usize,
    /// Their distances.
    pub network: Network,
    /// Submission of frames.
    pub mode: SubmissionMode,
    /// Seed of all randomness.
    pub seed: u64,
    /// Number of frames; the events come after a quarter, a half and three quarters of them.
    pub frames: u64,
}

impl Network {
    /// All networks.
    pub const ALL: [Self; 3] = [Self::Lan, Self::Wan, Self::Far];

    /// Name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lan => "lan",
            Self::Wan => "wan",
            Self::Far => "46ms",
        }
    }

    /// Round trips of the nearest and the farthest node in seconds.
    const fn round_trips_secs(self) -> (f64, f64) {
        match self {
            Self::Lan => (0.3e-3, 2e-3),
            Self::Wan => (1e-3, 80e-3),
            Self::Far => (46e-3, 46e-3),
        }
    }
}

impl SubmissionMode {
    /// All modes.
    pub const ALL: [Self; 2] = [Self::Closed, Self::Pipelined];

    /// Name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::Pipelined => "pipelined",
        }
    }
}

impl Scenario {
    /// The run's plan, with `balancing` dividing the frames.
    pub fn plan(&self, balancing: Balancing) -> FarmPlan {
        // Tiles have one pixel: 920 of them, or 3,600.
        let size = if self.nodes < 1000 {
            ImageSize::new(40, 23)
        } else {
            ImageSize::new(60, 60)
        };
        let mut plan = FarmPlan {
            seed: self.seed,
            balancing,
            nodes: self.nodes(size.pixels() as f64),
            frames: self.frames,
            frames_in_flight: if self.mode == SubmissionMode::Closed {
                1
            } else {
                8
            },
            period_secs: (self.mode == SubmissionMode::Pipelined).then_some(PERIOD_SECS),
            size,
            tile_edge: 1,
            conditions: NETWORK_CONDITIONS,
            ..FarmPlan::default()
        };
        plan.changes = self.changes(&plan);
        plan
    }

    /// Frames before which the best node slows down, another dies, and one joins.
    pub fn events(&self) -> [u64; 3] {
        [1, 2, 3].map(|quarter| quarter * self.frames / 4)
    }

    /// Speeds and round trips are spread evenly over the logarithms of their ranges and paired at
    /// random.
    fn nodes(&self, tiles: f64) -> Vec<NodePlan> {
        let mut random = SplitMix64::keyed(&[self.seed, 0xfa12]);
        let mut speeds = spread(&mut random, self.nodes, (1.0, SPEED_SPREAD));
        let round_trips = spread(&mut random, self.nodes, self.network.round_trips_secs());
        let sum: f64 = speeds.iter().sum();
        let scale = 1e-6 * tiles / (WORK_SECS * sum);
        speeds.iter_mut().for_each(|speed| *speed *= scale);
        let mut nodes: Vec<NodePlan> = speeds
            .iter()
            .zip(&round_trips)
            .map(|(speed, trip)| NodePlan::new(*trip, *speed))
            .collect();
        let (near, far) = self.network.round_trips_secs();
        nodes.push(NodePlan::new((near * far).sqrt(), SPEED_SPREAD * scale));
        nodes
    }

    fn changes(&self, plan: &FarmPlan) -> Vec<(FrameId, NodeIndex, NodeChange)> {
        let joins = self.nodes;
        let shares = shares(&plan.nodes[..joins], plan.size.pixels() as f64);
        let mut best: Vec<usize> = (0..joins).collect();
        best.sort_by(|a, b| shares[*b].total_cmp(&shares[*a]));
        let [slow, death, join] = self.events().map(FrameId);
        let dies = best[2.min(joins - 1)];
        vec![
            (slow, NodeIndex(best[0]), NodeChange::Slow(4.0)),
            (death, NodeIndex(dies), NodeChange::Silent),
            (join, NodeIndex(joins), NodeChange::Join),
        ]
    }
}

/// `count` values from `range`, one in each of as many equal parts of its logarithm (stratified), in
/// random order.
fn spread(random: &mut SplitMix64, count: usize, (low, high): (f64, f64)) -> Vec<f64> {
    let value = |index: usize, random: &mut SplitMix64| {
        let place = (index as f64 + random.uniform()) / count as f64;
        low * (high / low).powf(place)
    };
    let mut values: Vec<f64> = (0..count).map(|index| value(index, random)).collect();
    for index in (1..count).rev() {
        values.swap(index, random.below(index as u64 + 1) as usize);
    }
    values
}

/// Ratio of the speeds of the fastest and the slowest node.
const SPEED_SPREAD: f64 = 100.0;
/// Time in s of a frame if every node were used perfectly.
const WORK_SECS: f64 = 8e-3;
/// Interval in s between the frames of [`SubmissionMode::Pipelined`].
pub const PERIOD_SECS: f64 = 1.0 / 60.0;
/// Random variation in all scenarios.
const NETWORK_CONDITIONS: NetworkConditions = NetworkConditions {
    delay_secs: 1e-3,
    pace_noise: 0.03,
    stall_share: 0.002,
    stall_secs: 20e-3,
    cost_spread: 0.7,
    cost_noise: 0.08,
};
