//! Random delays, stalls and tile costs, all from a seed.
//!
//! Each value is a hash of the seed and of its key, so that it does not depend on the algorithm that
//! divides the frames, and the clairvoyant optimum can use it.

use std::f64::consts::TAU;

use carom_protocol::FrameId;
use carom_tracer::TileGrid;

use crate::random::SplitMix64;
use carom_farm::NodeIndex;

/// Random variation of a farm from frame to frame. The default has none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NetworkConditions {
    /// Mean of the exponential delay of a node's answers for a frame, in seconds.
    pub delay_secs: f64,
    /// Standard deviation of a node's pace for a frame, as a share.
    pub pace_noise: f64,
    /// Share of the frames before which a node pauses.
    pub stall_share: f64,
    /// Duration of such a pause, in seconds.
    pub stall_secs: f64,
    /// Spread of the costs of tiles over the picture: the most expensive costs at most e to this times
    /// the medium.
    pub cost_spread: f64,
    /// Largest relative deviation of a tile's cost in a frame.
    pub cost_noise: f64,
}

/// Random environment of one run.
#[derive(Clone, Debug)]
pub(super) struct RandomEnvironment {
    seed: u64,
    conditions: NetworkConditions,
    /// Cost of each tile without its noise, with a mean of 1.
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
            // Plane waves of random phases: a smooth terrain, with a height from −4 to 4.
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

    /// Delay in seconds of everything that a node sends for a frame.
    pub(super) fn delay_secs(&self, node: NodeIndex, frame: FrameId) -> f64 {
        if self.conditions.delay_secs == 0.0 {
            return 0.0;
        }
        self.conditions.delay_secs * self.random(Quantity::Delay, node, frame).exponential()
    }

    /// Pause of a node before it begins with a frame, in seconds.
    pub(super) fn stall_secs(&self, node: NodeIndex, frame: FrameId) -> f64 {
        let stalls =
            self.random(Quantity::Stall, node, frame).uniform() < self.conditions.stall_share;
        if stalls {
            self.conditions.stall_secs
        } else {
            0.0
        }
    }

    /// Time that a node takes for a frame, over its usual time.
    pub(super) fn pace(&self, node: NodeIndex, frame: FrameId) -> f64 {
        let noise = self.random(Quantity::Pace, node, frame).normal();
        (1.0 + self.conditions.pace_noise * noise).max(0.5)
    }

    /// Cost of a tile in a frame, in tiles of average cost.
    pub(super) fn cost(&self, frame: FrameId, tile: u32) -> f64 {
        if self.conditions.cost_noise == 0.0 {
            return self.costs[tile as usize];
        }
        let noise =
            SplitMix64::keyed(&[self.seed, Quantity::Cost as u64, frame.0, u64::from(tile)])
                .uniform();
        self.costs[tile as usize] * (1.0 + self.conditions.cost_noise * (2.0 * noise - 1.0))
    }

    /// Cost of all tiles of a frame.
    pub(super) fn frame_cost(&self, frame: FrameId) -> f64 {
        let tiles = 0..self.costs.len() as u32;
        tiles.map(|tile| self.cost(frame, tile)).sum()
    }

    fn random(&self, quantity: Quantity, node: NodeIndex, frame: FrameId) -> SplitMix64 {
        SplitMix64::keyed(&[self.seed, quantity as u64, node.0 as u64, frame.0])
    }
}

/// Purpose of a random number, which is part of its key.
#[derive(Clone, Copy)]
enum Quantity {
    Terrain,
    Delay,
    Stall,
    Pace,
    Cost,
}
