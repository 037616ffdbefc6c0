//! The earliest common finish: nodes are filled like vessels whose floors are their fixed costs.
//!
//! Minimise T subject to Σ xᵢ = W and Aᵢ + Bᵢ·xᵢ ≤ T wherever xᵢ > 0. The optimum leaves out
//! exactly the nodes with Aᵢ ≥ T, and T = (W + Σ Aᵢ/Bᵢ) / Σ 1/Bᵢ over the others. With bounds
//! xᵢ ≤ cᵢ the level rises along a polyline whose corners are known, so that the optimum is still
//! found by one sweep in O(n log n).

use super::{Balancer, Candidate, Division, Shares, in_proportion};

/// See [`crate::Algorithm::WaterFilling`].
#[derive(Debug, Default)]
pub struct WaterFilling;

/// Cost of work x on a node: y = A + B·x seconds for x up to `work_max`, a vessel of water-allocation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostModel {
    /// Seconds until the first work could come.
    pub fixed_secs: f64,
    /// Seconds per unit of work, above 0.
    pub secs_per_work: f64,
    /// The most work that it may get, above 0, perhaps infinite.
    pub work_max: f64,
    /// Of work up to `unmonitored_work` nothing is heard before its end, when it is too late to ask
    /// others: whole tiles are dealt so that it ends earlier than the rest by `margin_secs`.
    pub unmonitored_work: f64,
    /// See `unmonitored_work`.
    pub margin_secs: f64,
}

impl CostModel {
    /// y = A + B·x for any x.
    pub const fn new(fixed_secs: f64, secs_per_work: f64) -> Self {
        Self {
            fixed_secs,
            secs_per_work,
            work_max: f64::INFINITY,
            unmonitored_work: 0.0,
            margin_secs: 0.0,
        }
    }

    /// The same for x up to `work_max`.
    pub const fn with_work_max(self, work_max: f64) -> Self {
        Self { work_max, ..self }
    }

    /// The most work that is through at `finish_secs`.
    pub fn room(&self, finish_secs: f64) -> f64 {
        // Work that is over before anything is heard of it gets a margin instead of a hedge: nobody could
        // help in time.
        let room = ((finish_secs - self.fixed_secs) / self.secs_per_work).min(self.work_max);
        if room > self.unmonitored_work {
            return room;
        }
        room - self.margin_secs / self.secs_per_work
    }
}

/// Work divided over [`CostModel`]s.
#[derive(Clone, Debug, PartialEq)]
pub struct Allocation {
    /// Seconds until the last one finishes.
    pub finish_secs: f64,
    /// The work of each.
    pub shares: Vec<f64>,
}

impl WaterFilling {
    /// The cost models of `division`'s candidates.
    ///
    /// A node may get no more than `GROWTH_MAX` times what it has been seen to deliver, and, with
    /// frames pipelined, a little less than it can do in a frame's period, or its queue would grow. One
    /// that has delivered nothing is taken to be as fast as the others on average and gets a
    /// quarter of an equal share.
    pub fn cost_models(division: &Division<'_>) -> Vec<CostModel> {
        let candidates = division.candidates;
        let known: Vec<_> = candidates.iter().filter_map(|node| node.estimate).collect();
        let count = known.len().max(1) as f64;
        let mean_speed = known
            .iter()
            .map(|model| 1.0 / model.secs_per_work)
            .sum::<f64>()
            / count;
        let mean_fixed = known.iter().map(|model| model.fixed_secs).sum::<f64>() / count;
        // The bound of a node that has delivered nothing: a quarter of an equal share.
        let probe = division.work / (GROWTH_MAX * candidates.len() as f64);
        let busy = (division.work / (division.period_secs * mean_speed * count)).min(1.0);
        // The idle share shrinks as frames need all that the nodes can do.
        let busy_secs_max = division.period_secs * (1.0 - IDLE_SHARE * (1.0 - busy));
        let model = |candidate: &Candidate| {
            let (fixed_secs, secs_per_work) = match candidate.estimate {
                Some(estimate) => (estimate.fixed_secs, estimate.secs_per_work),
                None if mean_speed > 0.0 => (mean_fixed, 1.0 / mean_speed),
                None => (0.0, 1.0),
            };
            let in_period = busy_secs_max / secs_per_work;
            let proven = (GROWTH_MAX * candidate.proven_work).max(probe);
            CostModel {
                unmonitored_work: candidate.unmonitored_work,
                margin_secs: candidate.margin_secs,
                ..CostModel::new(fixed_secs + candidate.wait_secs, secs_per_work)
                    .with_work_max(in_period.min(proven).max(division.tile_work))
            }
        };
        candidates.iter().map(model).collect()
    }
}

impl Balancer for WaterFilling {
    /// By the models that come with the candidates: [`super::Estimator`].
    fn divide(&mut self, division: &Division<'_>) -> Shares {
        Shares::ByCostModel(Self::cost_models(division))
    }
}

/// Divides `work` so that the last one finishes as early as can be. If the bounds hold less than
/// `work`, all are raised in proportion.
///
/// # Panics
/// If there is no model.
pub fn water_fill(work: f64, models: &[CostModel]) -> Allocation {
    assert!(!models.is_empty());
    let capacity: f64 = models.iter().map(|model| model.work_max).sum();
    let shares = if capacity <= work {
        let bounds: Vec<f64> = models.iter().map(|model| model.work_max).collect();
        in_proportion(work, &bounds)
    } else {
        let level = level(work, models);
        let share = |model: &CostModel| {
            ((level - model.fixed_secs) / model.secs_per_work).clamp(0.0, model.work_max)
        };
        // Sums to `work` but for rounding, which the scaling takes away.
        in_proportion(work, &models.iter().map(share).collect::<Vec<_>>())
    };
    let used = models
        .iter()
        .zip(&shares)
        .filter(|(_, share)| **share > 0.0);
    let finish = used.map(|(model, share)| model.fixed_secs + model.secs_per_work * share);
    Allocation {
        finish_secs: finish.fold(0.0, f64::max),
        shares,
    }
}

/// T at which the models hold `work`, which is less than all bounds together.
fn level(work: f64, models: &[CostModel]) -> f64 {
    let mut corners = Vec::with_capacity(2 * models.len());
    for model in models {
        let speed = 1.0 / model.secs_per_work;
        // Each node adds its speed to the level's slope where its fixed cost is passed, and takes it away
        // again where its bound is reached: between corners held work rises linearly with T.
        corners.push((model.fixed_secs, speed));
        if model.work_max.is_finite() {
            corners.push((
                model.fixed_secs + model.secs_per_work * model.work_max,
                -speed,
            ));
        }
    }
    corners.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut level, mut held, mut speed) = (corners[0].0, 0.0, 0.0);
    for (corner, change) in corners {
        let next = held + speed * (corner - level);
        if next >= work {
            break;
        }
        (level, held, speed) = (corner, next, speed + change);
    }
    // Rounding may leave a trace of speed where all vessels are full.
    if speed > 0.0 {
        level + (work - held) / speed
    } else {
        level
    }
}

/// How much more than ever before a node may get at once.
const GROWTH_MAX: f64 = 4.0;
/// Share of what all nodes together could do beside frames at their pace by which each is left idle: near
/// nodes that have no time to spare cannot help when others are late. With 64 far nodes the 99th
/// percentile of frames at 60 a second is 1.33 times the optimum instead of 1.37.
const IDLE_SHARE: f64 = 0.1;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::Estimate;
    use super::*;

    #[test]
    fn nodes_with_fixed_cost_above_the_finish_are_idle() {
        let allocation = water_fill(
            100.0,
            &[
                CostModel::new(0.0, 0.001),
                CostModel::new(0.01, 0.002),
                CostModel::new(0.2, 0.0001),
            ],
        );
        // Without the third: T = (100 + 0.01/0.002) / (1000 + 500) = 0.07 s, below its 0.2 s.
        assert!(
            (allocation.finish_secs - 0.07).abs() < 1e-12,
            "{allocation:?}"
        );
        assert!((allocation.shares[0] - 70.0).abs() < 1e-9);
        assert!((allocation.shares[1] - 30.0).abs() < 1e-9);
        assert_eq!(allocation.shares[2], 0.0);
    }

    #[test]
    fn work_above_a_bound_goes_to_the_others() {
        let bounded = CostModel::new(0.0, 0.001).with_work_max(20.0);
        let allocation = water_fill(100.0, &[bounded, CostModel::new(0.0, 0.004)]);
        assert!((allocation.shares[0] - 20.0).abs() < 1e-9, "{allocation:?}");
        assert!((allocation.shares[1] - 80.0).abs() < 1e-9);
        assert!((allocation.finish_secs - 0.32).abs() < 1e-9);
    }

    #[test]
    fn spare_time_is_left_unless_the_farm_is_full() {
        let bounds = |period_secs: f64| -> Vec<f64> {
            let candidate = |node| Candidate {
                node: crate::NodeIndex(node),
                estimate: Some(Estimate {
                    fixed_secs: 0.001,
                    secs_per_work: 1e-3,
                }),
                wait_secs: 0.0,
                proven_work: 1e3,
                unmonitored_work: 0.0,
                margin_secs: 0.0,
            };
            let division = Division {
                work: 20.0,
                tile_work: 1.0,
                period_secs,
                candidates: &[0, 1].map(candidate),
            };
            let models = WaterFilling::cost_models(&division);
            models.iter().map(|model| model.work_max).collect()
        };
        // Half of 40 is idle, and each may do 20.
        let idle = 20.0 * 0.5 * IDLE_SHARE;
        assert!(
            bounds(0.02)
                .iter()
                .all(|work_max| (work_max - (20.0 - idle)).abs() < 1e-9)
        );
        // Nothing is idle.
        assert!(
            bounds(0.01)
                .iter()
                .all(|work_max| (work_max - 10.0).abs() < 1e-9)
        );
        // Frames come one by one.
        assert!(bounds(f64::INFINITY).iter().all(|work_max| *work_max > 1e3));
    }

    proptest! {
        #[test]
        fn no_exchange_of_work_finishes_earlier(
            models in prop::collection::vec((0.0..0.1f64, 1e-6..1e-2f64, 1.0..2e4f64), 1..30),
            work in 1.0..1e4f64,
        ) {
            let model = |&(fixed_secs, secs_per_work, work_max): &(f64, f64, f64)| CostModel::new(fixed_secs, secs_per_work).with_work_max(work_max);
            let models: Vec<CostModel> = models.iter().map(model).collect();
            let allocation = water_fill(work, &models);
            let capacity: f64 = models.iter().map(|model| model.work_max).sum();
            prop_assume!(capacity > work);
            for (model, &share) in models.iter().zip(&allocation.shares) {
                prop_assert!(share <= model.work_max * (1.0 + 1e-9));
                // Whoever is below the level is full; so nobody can take work off the last one.
                let finish = model.fixed_secs + model.secs_per_work * share;
                let full = share >= model.work_max * (1.0 - 1e-9);
                let level = allocation.finish_secs;
                prop_assert!(full || model.fixed_secs >= level * (1.0 - 1e-6)
                    || (finish - level).abs() <= 1e-6 * level, "{finish} of {level}");
            }
        }
    }
}
