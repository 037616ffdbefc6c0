//! The earliest common finish: nodes are filled like vessels whose floors are their fixed costs.
//!
//! Minimise T subject to Σ xᵢ = W and Aᵢ + Bᵢ·xᵢ ≤ T wherever xᵢ > 0. The optimum leaves out
//! exactly the nodes with Aᵢ ≥ T, and T = (W + Σ Aᵢ/Bᵢ) / Σ 1/Bᵢ over the others. With bounds
//! xᵢ ≤ cᵢ the level rises along a polyline whose corners are known, so that the optimum is still
//! found by one sweep in O(n log n).

use super::{Balancer, Candidate, Division, Outcome, Shares, in_proportion};

/// See [`crate::Algorithm::WaterFilling`].
#[derive(Debug, Default)]
pub struct WaterFilling;

/// A vessel: y = a + b·x for x up to `cap`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Seconds until the first work could come.
    pub a_secs: f64,
    /// Seconds per unit of work, above 0.
    pub b_secs: f64,
    /// The most work that it may get, above 0, perhaps infinite.
    pub cap: f64,
    /// Of work up to `mute_work` nothing is heard before its end, when it is too late to ask
    /// others: whole tiles are dealt so that it ends earlier than the rest by `guard_secs`.
    pub mute_work: f64,
    /// See `mute_work`.
    pub guard_secs: f64,
}

impl Line {
    /// y = a + b·x for any x.
    pub const fn new(a_secs: f64, b_secs: f64) -> Self {
        Self {
            a_secs,
            b_secs,
            cap: f64::INFINITY,
            mute_work: 0.0,
            guard_secs: 0.0,
        }
    }

    /// The same for x up to `cap`.
    pub const fn capped(self, cap: f64) -> Self {
        Self { cap, ..self }
    }

    /// The most work that is through at `finish_secs`.
    pub fn room(&self, finish_secs: f64) -> f64 {
        let room = ((finish_secs - self.a_secs) / self.b_secs).min(self.cap);
        if room > self.mute_work {
            return room;
        }
        room - self.guard_secs / self.b_secs
    }
}

/// Work divided over [`Line`]s.
#[derive(Clone, Debug, PartialEq)]
pub struct Filling {
    /// Seconds until the last one finishes.
    pub finish_secs: f64,
    /// The work of each.
    pub shares: Vec<f64>,
}

impl WaterFilling {
    /// The lines of `division`'s candidates.
    ///
    /// A node may get no more than `GROWTH_MAX` times what it has been seen to deliver, and, with
    /// frames pipelined, a little less than it can do in a frame's period, or its queue would grow. One
    /// that has delivered nothing is taken to be as fast as the others on average and gets a
    /// quarter of an equal share.
    pub fn lines(division: &Division<'_>) -> Vec<Line> {
        let candidates = division.candidates;
        let known: Vec<_> = candidates.iter().filter_map(|node| node.estimate).collect();
        let count = known.len().max(1) as f64;
        let mean_speed = known
            .iter()
            .map(|line| 1.0 / line.secs_per_work)
            .sum::<f64>()
            / count;
        let mean_fixed = known.iter().map(|line| line.fixed_secs).sum::<f64>() / count;
        let probe = division.work / (GROWTH_MAX * candidates.len() as f64);
        let busy = (division.work / (division.period_secs * mean_speed * count)).min(1.0);
        let busy_secs_max = division.period_secs * (1.0 - IDLE_SHARE * (1.0 - busy));
        let line = |candidate: &Candidate| {
            let (fixed_secs, b_secs) = match candidate.estimate {
                Some(estimate) => (estimate.fixed_secs, estimate.secs_per_work),
                None if mean_speed > 0.0 => (mean_fixed, 1.0 / mean_speed),
                None => (0.0, 1.0),
            };
            let in_period = busy_secs_max / b_secs;
            let proven = (GROWTH_MAX * candidate.proven_work).max(probe);
            Line {
                mute_work: candidate.mute_work,
                guard_secs: candidate.guard_secs,
                ..Line::new(fixed_secs + candidate.wait_secs, b_secs)
                    .capped(in_period.min(proven).max(division.tile_work))
            }
        };
        candidates.iter().map(line).collect()
    }
}

impl Balancer for WaterFilling {
    fn divide(&mut self, division: &Division<'_>) -> Shares {
        Shares::Lines(Self::lines(division))
    }

    /// The lines come with the candidates: [`super::Estimator`].
    fn learn(&mut self, _outcome: &Outcome) {}
}

/// Divides `work` so that the last one finishes as early as can be. If the caps hold less than
/// `work`, all are raised in proportion.
///
/// # Panics
/// If there is no line.
pub fn fill(work: f64, lines: &[Line]) -> Filling {
    assert!(!lines.is_empty());
    let capacity: f64 = lines.iter().map(|line| line.cap).sum();
    let shares = if capacity <= work {
        let caps: Vec<f64> = lines.iter().map(|line| line.cap).collect();
        in_proportion(work, &caps)
    } else {
        let level = level(work, lines);
        let share = |line: &Line| ((level - line.a_secs) / line.b_secs).clamp(0.0, line.cap);
        in_proportion(work, &lines.iter().map(share).collect::<Vec<_>>())
    };
    let used = lines.iter().zip(&shares).filter(|(_, share)| **share > 0.0);
    let finish = used.map(|(line, share)| line.a_secs + line.b_secs * share);
    Filling {
        finish_secs: finish.fold(0.0, f64::max),
        shares,
    }
}

/// T at which the lines hold `work`, which is less than all caps together.
fn level(work: f64, lines: &[Line]) -> f64 {
    let mut corners = Vec::with_capacity(2 * lines.len());
    for line in lines {
        let speed = 1.0 / line.b_secs;
        corners.push((line.a_secs, speed));
        if line.cap.is_finite() {
            corners.push((line.a_secs + line.b_secs * line.cap, -speed));
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
    fn nodes_whose_fixed_cost_exceeds_the_finish_are_left_out() {
        let filling = fill(
            100.0,
            &[
                Line::new(0.0, 0.001),
                Line::new(0.01, 0.002),
                Line::new(0.2, 0.0001),
            ],
        );
        // Without the third: T = (100 + 0.01/0.002) / (1000 + 500) = 0.07 s, below its 0.2 s.
        assert!((filling.finish_secs - 0.07).abs() < 1e-12, "{filling:?}");
        assert!((filling.shares[0] - 70.0).abs() < 1e-9);
        assert!((filling.shares[1] - 30.0).abs() < 1e-9);
        assert_eq!(filling.shares[2], 0.0);
    }

    #[test]
    fn what_a_cap_keeps_out_goes_to_the_others() {
        let capped = Line::new(0.0, 0.001).capped(20.0);
        let filling = fill(100.0, &[capped, Line::new(0.0, 0.004)]);
        assert!((filling.shares[0] - 20.0).abs() < 1e-9, "{filling:?}");
        assert!((filling.shares[1] - 80.0).abs() < 1e-9);
        assert!((filling.finish_secs - 0.32).abs() < 1e-9);
    }

    #[test]
    fn nodes_are_left_some_time_to_help_while_others_have_some() {
        let caps = |period_secs: f64| -> Vec<f64> {
            let candidate = |node| Candidate {
                node: crate::NodeIndex(node),
                estimate: Some(Estimate {
                    fixed_secs: 0.001,
                    secs_per_work: 1e-3,
                }),
                wait_secs: 0.0,
                proven_work: 1e3,
                mute_work: 0.0,
                guard_secs: 0.0,
            };
            let division = Division {
                work: 20.0,
                tile_work: 1.0,
                period_secs,
                candidates: &[0, 1].map(candidate),
            };
            let lines = WaterFilling::lines(&division);
            lines.iter().map(|line| line.cap).collect()
        };
        // Half of 40 is idle, and each may do 20.
        let idle = 20.0 * 0.5 * IDLE_SHARE;
        assert!(
            caps(0.02)
                .iter()
                .all(|cap| (cap - (20.0 - idle)).abs() < 1e-9)
        );
        // Nothing is idle.
        assert!(caps(0.01).iter().all(|cap| (cap - 10.0).abs() < 1e-9));
        // Frames come one by one.
        assert!(caps(f64::INFINITY).iter().all(|cap| *cap > 1e3));
    }

    proptest! {
        #[test]
        fn no_exchange_between_two_nodes_finishes_earlier(
            lines in prop::collection::vec((0.0..0.1f64, 1e-6..1e-2f64, 1.0..2e4f64), 1..30),
            work in 1.0..1e4f64,
        ) {
            let line = |&(a_secs, b_secs, cap): &(f64, f64, f64)| Line::new(a_secs, b_secs).capped(cap);
            let lines: Vec<Line> = lines.iter().map(line).collect();
            let filling = fill(work, &lines);
            let capacity: f64 = lines.iter().map(|line| line.cap).sum();
            prop_assume!(capacity > work);
            for (line, &share) in lines.iter().zip(&filling.shares) {
                prop_assert!(share <= line.cap * (1.0 + 1e-9));
                // Whoever is below the level is full; so nobody can take work off the last one.
                let finish = line.a_secs + line.b_secs * share;
                let full = share >= line.cap * (1.0 - 1e-9);
                let level = filling.finish_secs;
                prop_assert!(full || line.a_secs >= level * (1.0 - 1e-6)
                    || (finish - level).abs() <= 1e-6 * level, "{finish} of {level}");
            }
        }
    }
}
