//! Self-scheduling with credits: nodes pull tiles from the frame's pool as they deliver.
//!
//! It needs no prediction, but a node must hold enough tiles to bridge the round trip or it idles, and the
//! tiles that slow nodes hold at the end delay the frame. Portions shrink with the pool (guided
//! self-scheduling: Polychronopoulos and Kuck, IEEE Transactions on Computers 36, 1987).

use crate::balancer::{Balancer, Division, Estimate, Shares};

/// See [`crate::Algorithm::Pull`].
#[derive(Debug)]
pub struct Pull;

impl Pull {
    /// The most work that a node may hold: what it does in a round trip, plus a tile. One that has not
    /// delivered yet may hold two tiles.
    pub fn credit(estimate: Option<Estimate>, tile_work: f64) -> f64 {
        let in_flight = estimate.map_or(tile_work, |cost| cost.fixed_secs / cost.secs_per_work);
        in_flight + tile_work
    }

    /// Work that a node takes at once from a pool of `pool_work` shared by `nodes` nodes: half of an equal
    /// share, at least a tile, at most [`PORTION_TILES_MAX`] tiles.
    pub fn portion(pool_work: f64, nodes: usize, tile_work: f64) -> f64 {
        let fair = pool_work / (2 * nodes.max(1)) as f64;
        fair.min(PORTION_TILES_MAX * tile_work).max(tile_work)
    }
}

impl Balancer for Pull {
    fn divide(&mut self, _division: &Division<'_>) -> Shares {
        Shares::Pool
    }
}

/// Maximum portion in tiles: as many as one message carries, more gain nothing.
const PORTION_TILES_MAX: f64 = 8.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_far_node_holds_what_it_does_in_a_round_trip() {
        let estimate = Estimate {
            fixed_secs: 0.046,
            secs_per_work: 1e-6,
        };
        assert_eq!(Pull::credit(Some(estimate), 1000.0), 47_000.0);
        assert_eq!(Pull::credit(None, 1000.0), 2000.0);
    }

    #[test]
    fn portions_shrink_with_the_pool_to_one_tile() {
        assert_eq!(Pull::portion(1000.0, 4, 1.0), 8.0);
        assert_eq!(Pull::portion(40.0, 4, 1.0), 5.0);
        assert_eq!(Pull::portion(3.0, 4, 1.0), 1.0);
    }
}
