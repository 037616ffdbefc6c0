//! Cost model of a node: y = A + B·w, from what it reports and what the client's clock allows.
//!
//! A and B cannot be told apart from y alone while w hardly changes (a recursive least-squares
//! fit diverged). So the node reports how long it was busy: B = busy / w, A = y − queue − busy.
//! The report is advisory: what neither it nor the measured round trip explains counts as work,
//! because transfer grows with work too, so that a node gains nothing by claiming to be quick.

/// Learned cost of work on a node: y = A + B·w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// A: seconds that a request takes however small it is.
    pub fixed_secs: f64,
    /// B: seconds per unit of work, above 0.
    pub secs_per_work: f64,
}

/// How far an [`Estimate`] may be off: a standard error of each part, from how much the answers
/// scatter around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateError {
    /// Of A, in seconds.
    pub fixed_secs: f64,
    /// Of B, as a share of it.
    pub pace: f64,
}

/// A run as the estimator sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Work that came, above 0.
    pub work: f64,
    /// Seconds from the request to the last of it.
    pub response_secs: f64,
    /// Seconds that the request waited behind earlier ones.
    pub queue_secs: f64,
    /// Seconds that the node says it worked.
    pub busy_secs: f64,
    /// The measured round trip; absent until there is one.
    pub round_trip_secs: Option<f64>,
}

/// Filter of the cost of one node.
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimator {
    fixed: Option<f64>,
    fixed_surprise: f64,
    /// Mean square of how far off A was.
    fixed_scatter: Option<f64>,
    /// From all that is known, lateness too: what work is divided by.
    pace: Pace,
    /// From work that came: what it is waited for by. Lateness must not count here, or a node
    /// that never answers would be waited for twice as long each time.
    delivered: Pace,
    proven_work: f64,
    /// The most work of the last runs.
    usual_work: f64,
    /// Whether all that is known comes from the first tiles of the first run.
    provisional: bool,
}

/// Filters B in proportion: a node twice as fast is as surprising as one half as fast.
#[derive(Clone, Copy, Debug, Default)]
struct Pace {
    secs_per_work: Option<f64>,
    surprise: f64,
    /// Mean square of how far off it was, as a share.
    scatter: Option<f64>,
}

impl Estimator {
    /// Takes note of the first tiles of a node's first run. They may be far cheaper or dearer than
    /// the others: what comes of the whole run replaces them.
    pub fn observe_first(&mut self, seen: &Observation) {
        self.observe(seen);
        self.provisional = true;
    }

    /// Takes note of work that came.
    pub fn observe(&mut self, seen: &Observation) {
        if std::mem::take(&mut self.provisional) {
            *self = Self::default();
        }
        let (fixed, work_secs) = Self::split(seen);
        let pace = work_secs / seen.work;
        self.usual_work = seen.work.max(USUAL_KEPT * self.usual_work);
        let weight = seen.work / self.usual_work;
        // A request that waited behind another shows only the answer's way, which is less than A.
        if seen.queue_secs <= 0.0 || self.fixed.is_none() {
            self.observe_fixed(fixed);
        }
        // What comes within the allowance would support any speed that its node claims; from twice
        // that on, what is timed here is off by a factor of two at most.
        let is_timed = seen.response_secs - seen.queue_secs > 2.0 * Self::allowance(seen);
        let error_min = if is_timed {
            f64::NEG_INFINITY
        } else {
            -SPEED_UP_MAX
        };
        self.pace
            .observe(pace.max(SECS_PER_WORK_MIN), weight, error_min);
        self.delivered
            .observe(pace.max(SECS_PER_WORK_MIN), weight, error_min);
        self.proven_work = self.proven_work.max(seen.work);
    }

    /// Seconds that counted as work.
    pub fn work_secs(seen: &Observation) -> f64 {
        Self::split(seen).1
    }

    /// Seconds that are fixed cost, and seconds that are work.
    fn split(seen: &Observation) -> (f64, f64) {
        let response = seen.response_secs.max(0.0);
        let busy = seen.busy_secs.clamp(0.0, response);
        // What the client has timed and neither the queue nor the node's report explains. Up to the round
        // trip it is the way; beyond that it counts as work, so that a node that reports too little gains
        // nothing.
        let unexplained = (response - seen.queue_secs.max(0.0) - busy).max(0.0);
        let fixed = unexplained.min(Self::allowance(seen));
        (fixed, busy + unexplained - fixed)
    }

    /// Seconds that may be fixed cost, from what the client has timed. A request that has waited was
    /// on its way meanwhile: only the answer's way is left.
    fn allowance(seen: &Observation) -> f64 {
        match seen.round_trip_secs {
            None => f64::INFINITY,
            Some(trip) if seen.queue_secs > 0.0 => trip + QUEUED_JITTER_SECS,
            Some(trip) => 2.0 * trip + JITTER_SECS,
        }
    }

    /// Lets the next run count in full, however small it is.
    pub fn expect_little(&mut self) {
        self.usual_work = 0.0;
    }

    /// Takes note that `work` had not come after `secs`, of which the request may have waited
    /// `queue_secs`: the node is at least as slow as that. `missed` says that nothing at all had
    /// come, which is most likely far from the bound.
    pub fn observe_late(&mut self, work: f64, secs: f64, queue_secs: f64, missed: bool) {
        let spent = secs - queue_secs - self.fixed.unwrap_or(0.0);
        let factor = if missed { MISSED_FACTOR } else { 1.0 };
        let pace = factor * spent / work;
        // A bound from below: it can only tell that the node is slower than believed.
        if pace > self.pace.secs_per_work.unwrap_or(SECS_PER_WORK_MIN) {
            self.pace.observe(pace, 1.0, 0.0);
        }
    }

    /// The cost to divide work by; absent until something has come or been missed.
    pub fn estimate(&self) -> Option<Estimate> {
        Some(Estimate {
            fixed_secs: self.fixed.unwrap_or(0.0),
            secs_per_work: self.pace.secs_per_work?,
        })
    }

    /// How far [`Estimator::estimate`] may be off; absent until work has come twice.
    pub fn error(&self) -> Option<EstimateError> {
        // Of a mean that forgets with gain g, for errors that do not depend on each other.
        let share = GAIN / (2.0 - GAIN);
        Some(EstimateError {
            fixed_secs: (share * self.fixed_scatter?).sqrt(),
            pace: (share * self.pace.scatter?).sqrt(),
        })
    }

    /// The cost of work that came; absent until some has.
    pub fn delivered(&self) -> Option<Estimate> {
        Some(Estimate {
            fixed_secs: self.fixed.unwrap_or(0.0),
            secs_per_work: self.delivered.secs_per_work?,
        })
    }

    /// The most work that came in one run.
    pub fn proven_work(&self) -> f64 {
        self.proven_work
    }

    /// A rises slowly: one late packet is no longer way.
    fn observe_fixed(&mut self, fixed: f64) {
        let Some(known) = self.fixed else {
            self.fixed = Some(fixed);
            return;
        };
        let error = fixed - known;
        let surprising = error.abs() > SURPRISE * known + JITTER_SECS;
        // Two surprises of one sign in a row: a filter alone would take many requests to follow a real
        // change, and one outlier alone must not move it.
        let changed = surprising && error * self.fixed_surprise > 0.0;
        let gain = match (changed, error > 0.0) {
            (true, _) => 1.0,
            (false, true) => GAIN_FIXED_UP,
            (false, false) => GAIN,
        };
        self.fixed = Some(known + gain * error);
        self.fixed_scatter = Some(mean_square(self.fixed_scatter, error, 1.0));
        self.fixed_surprise = if surprising { error } else { 0.0 };
    }
}

impl Pace {
    /// `weight` is up to 1: what came of little work tells little. An error, as a logarithm, counts
    /// as no less than `error_min`.
    fn observe(&mut self, seen: f64, weight: f64, error_min: f64) {
        let Some(known) = self.secs_per_work else {
            self.secs_per_work = Some(seen);
            return;
        };
        let error = (seen / known).ln().max(error_min);
        let surprising = error.abs() > SURPRISE && weight > SURPRISE;
        let changed = surprising && error * self.surprise > 0.0;
        let gain = if changed { 1.0 } else { GAIN * weight };
        // Filtered as a logarithm: halving and doubling are errors of one size, and the pace stays above
        // 0.
        self.secs_per_work = Some(known * (gain * error).exp());
        self.scatter = Some(mean_square(self.scatter, error, weight));
        self.surprise = if surprising { error } else { 0.0 };
    }
}

/// Takes an error of a weight into a mean that forgets.
fn mean_square(known: Option<f64>, error: f64, weight: f64) -> f64 {
    let square = error * error;
    known.map_or(square, |mean| {
        mean + GAIN_SCATTER * weight * (square - mean)
    })
}

/// Share of an error that is believed at once.
const GAIN: f64 = 0.25;
/// The same of its square: squares scatter more.
const GAIN_SCATTER: f64 = 0.1;
/// The same for a fixed cost that seems to have grown.
const GAIN_FIXED_UP: f64 = 0.1;
/// Two errors in a row of this size and one sign are a change, and believed wholly.
const SURPRISE: f64 = 0.25;
/// The most that a node is believed to have become faster by what the client cannot time, as a
/// logarithm: twice.
const SPEED_UP_MAX: f64 = std::f64::consts::LN_2;
/// What is left of the usual work with each smaller run.
const USUAL_KEPT: f64 = 0.95;
/// Seconds that packets may be late without being news.
const JITTER_SECS: f64 = 2e-3;
/// The same where the message before has been late as well.
const QUEUED_JITTER_SECS: f64 = 0.2e-3;
/// How much slower than the bound a node is taken to be that has delivered nothing in time.
const MISSED_FACTOR: f64 = 2.0;
/// A thousand gigasamples a second: nothing is faster.
const SECS_PER_WORK_MIN: f64 = 1e-12;

#[cfg(test)]
mod tests {
    use super::*;

    fn honest(work: f64, a: f64, b: f64) -> Observation {
        Observation {
            work,
            response_secs: a + b * work,
            queue_secs: 0.0,
            busy_secs: b * work,
            round_trip_secs: Some(a),
        }
    }

    #[test]
    fn fixed_cost_and_pace_are_told_apart() {
        let mut estimator = Estimator::default();
        for _ in 0..50 {
            estimator.observe(&honest(1e5, 0.03, 2e-7));
        }
        let estimate = estimator.estimate().unwrap();
        assert!((estimate.fixed_secs - 0.03).abs() < 1e-9);
        assert!((estimate.secs_per_work - 2e-7).abs() < 1e-15);
    }

    #[test]
    fn a_change_is_believed_after_two_runs_and_an_outlier_is_not() {
        let mut estimator = Estimator::default();
        (0..10).for_each(|_| estimator.observe(&honest(1e5, 0.01, 1e-7)));
        estimator.observe(&honest(1e5, 0.01, 4e-7));
        let after_one = estimator.estimate().unwrap().secs_per_work;
        assert!(after_one < 1.5e-7, "{after_one}");
        estimator.observe(&honest(1e5, 0.01, 4e-7));
        let after_two = estimator.estimate().unwrap().secs_per_work;
        assert!((after_two - 4e-7).abs() < 1e-12, "{after_two}");
    }

    #[test]
    fn a_whole_run_replaces_what_its_first_tiles_promised() {
        let mut estimator = Estimator::default();
        estimator.observe_first(&honest(1e3, 0.01, 1e-8));
        estimator.observe(&honest(1e5, 0.01, 1e-7));
        let estimate = estimator.estimate().unwrap();
        assert!((estimate.secs_per_work - 1e-7).abs() < 1e-15);
    }

    #[test]
    fn a_node_gains_nothing_by_claiming_to_be_quick() {
        let (mut honest_node, mut liar) = (Estimator::default(), Estimator::default());
        let truth = honest(1e6, 0.002, 1e-7);
        let busy_secs = 0.0;
        for _ in 0..20 {
            honest_node.observe(&truth);
            liar.observe(&Observation { busy_secs, ..truth });
        }
        let finish = |estimator: Estimator| {
            let estimate = estimator.estimate().unwrap();
            estimate.fixed_secs + estimate.secs_per_work * 4e6
        };
        assert!(finish(liar) > 0.95 * finish(honest_node));
    }

    /// Of as many nodes: how far estimates are off, over how far they say that they may be.
    #[test]
    fn errors_are_as_large_as_estimates_are_off() {
        let noise = |i| 2.0 * f64::from(carom_tracer::sampling::uniforms(i, 0, 0, 0)[0]) - 1.0;
        let (mut off, mut said) = ([0.0; 2], [0.0; 2]);
        for node in 0..400 {
            let mut estimator = Estimator::default();
            for i in 0..60 {
                let key = 2 * (100 * node + i);
                let (a, b) = (
                    0.01 + 1e-3 * noise(key),
                    1e-7 * (0.1 * noise(key + 1)).exp(),
                );
                let round_trip_secs = Some(0.01);
                estimator.observe(&Observation {
                    round_trip_secs,
                    ..honest(1e5, a, b)
                });
            }
            let (is, error) = (estimator.estimate().unwrap(), estimator.error().unwrap());
            off[0] += (is.fixed_secs - 0.01).powi(2);
            off[1] += (is.secs_per_work / 1e-7 - 1.0).powi(2);
            said[0] += error.fixed_secs.powi(2);
            said[1] += error.pace.powi(2);
        }
        let ratio = |i: usize| f64::sqrt(off[i] / said[i]);
        assert!((0.67..1.5).contains(&ratio(0)), "A: {}", ratio(0));
        assert!((0.67..1.5).contains(&ratio(1)), "B: {}", ratio(1));
    }

    #[test]
    fn a_tile_of_a_node_that_is_not_used_counts_in_full() {
        let after_two_tiles = |probed: bool| {
            let mut estimator = Estimator::default();
            (0..10).for_each(|_| estimator.observe(&honest(1e5, 0.01, 1e-6)));
            for _ in 0..2 {
                if probed {
                    estimator.expect_little();
                }
                estimator.observe(&honest(1e4, 0.01, 4e-6));
            }
            estimator.estimate().unwrap().secs_per_work
        };
        assert!((after_two_tiles(true) - 4e-6).abs() < 1e-12);
        assert!(after_two_tiles(false) < 1.5e-6);
    }

    #[test]
    fn a_node_that_never_delivers_is_demoted() {
        let mut estimator = Estimator::default();
        estimator.observe(&honest(1e5, 0.001, 1e-7));
        for _ in 0..8 {
            let pace = estimator.estimate().unwrap().secs_per_work;
            estimator.observe_late(1e5, 0.001 + 1.05 * pace * 1e5, 0.0, true);
        }
        assert!(estimator.estimate().unwrap().secs_per_work > 1e-5);
        assert_eq!(estimator.delivered().unwrap().secs_per_work, 1e-7);
    }
}
