//! Random delays, stalls and tile costs, all from a seed.
//!
//! Each value is a hash of the seed and of what it belongs to, so that it is the same whichever
//! algorithm divides the frames, and the clairvoyant optimum can be told of it.

use std::f64::consts::TAU;

use carom_protocol::FrameId;
use carom_tracer::TileGrid;

use crate::random::SplitMix64;
use carom_farm::NodeIndex;

/// How much a farm varies from frame to frame. The default is a farm that never does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NetworkConditions {
    /// Mean of the exponential delay of a node's answers for a frame, in seconds.
    pub delay_secs: f64,
    /// Standard deviation of a node's pace for a frame, as a share.
    pub pace_noise: f64,
    /// How often a node pauses before it begins with a frame, as a share of the frames.
    pub stall_share: f64,
    /// How long it pauses then, in seconds.
    pub stall_secs: f64,
    /// How much tiles differ over the picture: the dearest costs e to this times the middle.
    pub cost_spread: f64,
    /// The most that a tile differs from one frame to the next, as a share.
    pub cost_noise: f64,
}

/// The weather of one run.
#[derive(Clone, Debug)]
pub(super) struct RandomEnvironment {
    seed: u64,
    conditions: NetworkConditions,
    /// What each tile costs on average, with a mean of 1.
    costs: Vec<f64>,
}

impl RandomEnvironment {
    pub(super) fn new(seed: u64, conditions: NetworkConditions, grid: TileGrid) -> Self {
        let mut random = SplitMix64::keyed(&[seed, Quantity::Terrain as u64]);
        let phases = [(); 4].map(|()| TAU * random.uniform());
        let (columns, rows) = (f64::from(grid.columns()), f64::from(grid.rows()));
        let cost = |tile: u32| {
            let x = f64::from(tile % grid.columns()) / columns;
            let y = f64::from(tile / grid.columns()) / rows;
            let waves = [(1.3, 0.4), (0.5, 1.7), (2.1, 1.1), (0.2, 0.9)];
            let waves = waves.iter().zip(phases);
            let height: f64 = waves
                .map(|((across, down), phase)| (TAU * (across * x + down * y) + phase).sin())
                .sum();
            (conditions.cost_spread * 0.25 * height).exp()
        };
        let mut costs: Vec<f64> = (0..grid.len()).map(cost).collect();
        let mean = costs.iter().sum::<f64>() / costs.len().max(1) as f64;
        costs.iter_mut().for_each(|cost| *cost /= mean);
        Self {
            seed,
            conditions,
            costs,
        }
    }

    /// Seconds by which all that a node sends for a frame is late.
    pub(super) fn delay_secs(&self, node: NodeIndex, frame: FrameId) -> f64 {
        if self.conditions.delay_secs == 0.0 {
            return 0.0;
        }
        self.conditions.delay_secs * self.random(Quantity::Delay, node, frame).exponential()
    }

    /// Seconds that a node pauses before it begins with a frame.
    pub(super) fn stall_secs(&self, node: NodeIndex, frame: FrameId) -> f64 {
        let stalls =
            self.random(Quantity::Stall, node, frame).uniform() < self.conditions.stall_share;
        if stalls {
            self.conditions.stall_secs
        } else {
            0.0
        }
    }

    /// How many times its usual time a node takes for a frame.
    pub(super) fn pace(&self, node: NodeIndex, frame: FrameId) -> f64 {
        let noise = self.random(Quantity::Pace, node, frame).normal();
        (1.0 + self.conditions.pace_noise * noise).max(0.5)
    }

    /// What a tile costs in a frame, in tiles of average cost.
    pub(super) fn cost(&self, frame: FrameId, tile: u32) -> f64 {
        if self.conditions.cost_noise == 0.0 {
            return self.costs[tile as usize];
        }
        let noise =
            SplitMix64::keyed(&[self.seed, Quantity::Cost as u64, frame.0, u64::from(tile)])
                .uniform();
        self.costs[tile as usize] * (1.0 + self.conditions.cost_noise * (2.0 * noise - 1.0))
    }

    /// What all tiles of a frame cost.
    pub(super) fn frame_cost(&self, frame: FrameId) -> f64 {
        let tiles = 0..self.costs.len() as u32;
        tiles.map(|tile| self.cost(frame, tile)).sum()
    }

    fn random(&self, quantity: Quantity, node: NodeIndex, frame: FrameId) -> SplitMix64 {
        SplitMix64::keyed(&[self.seed, quantity as u64, node.0 as u64, frame.0])
    }
}

/// What a random number is for.
#[derive(Clone, Copy)]
enum Quantity {
    Terrain,
    Delay,
    Stall,
    Pace,
    Cost,
}
