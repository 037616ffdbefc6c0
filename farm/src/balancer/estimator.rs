//! Cost model of a node, y = A + B·w, from what it reports and what the client's clock confirms.
//!
//! A and B cannot be separated from y alone while w hardly changes (the regression is ill-conditioned, and
//! recursive least squares diverges). So the node reports how long it was busy: B = busy / w, A = y − queue
//! − busy. The report is not trusted: time that neither it nor the measured round trip explains counts as
//! work, as transfer grows with work too, so that a node gains nothing by claiming to be fast.

/// Learned cost of work w on a node: y = A + B·w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// A: seconds that a request takes however small it is.
    pub fixed_secs: f64,
    /// B: seconds per unit of work, above 0.
    pub secs_per_work: f64,
}

/// Standard errors of an [`Estimate`], from the scatter of the observations around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateError {
    /// Standard error of A, in seconds.
    pub fixed_secs: f64,
    /// Standard error of B, relative to B.
    pub pace: f64,
}

/// Observation of one request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Work that arrived, above 0.
    pub work: f64,
    /// Seconds from the request to the last tile.
    pub response_secs: f64,
    /// Seconds that the request waited behind earlier ones.
    pub queue_secs: f64,
    /// Seconds that the node reports to have been busy.
    pub busy_secs: f64,
    /// Measured round-trip time in seconds; absent until there is one.
    pub round_trip_secs: Option<f64>,
}

/// Filtered cost of one node.
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimator {
    fixed: Option<f64>,
    fixed_surprise: f64,
    /// Mean square of the errors of A, in square seconds.
    fixed_scatter: Option<f64>,
    /// From all observations including lateness: divides work.
    pace: Pace,
    /// From arrived work only: predicts arrivals. Lateness must not count here, or the timeout of a node
    /// that never answers would double each time.
    delivered: Pace,
    proven_work: f64,
    /// Decaying maximum of the work per request.
    usual_work: f64,
    /// Whether all estimates come from the first tiles of the first request.
    provisional: bool,
}

/// Filter of B in its logarithm: a node twice as fast is as surprising as one half as fast.
#[derive(Clone, Copy, Debug, Default)]
struct Pace {
    secs_per_work: Option<f64>,
    surprise: f64,
    /// Mean square of its logarithmic errors.
    scatter: Option<f64>,
}

impl Estimator {
    /// Learns from the first tiles of a node's first request. Their cost may be far from the average: the
    /// observation of the whole request replaces them.
    pub fn observe_first(&mut self, seen: &Observation) {
        self.observe(seen);
        self.provisional = true;
    }

    /// Learns from work that has arrived.
    pub fn observe(&mut self, seen: &Observation) {
        if std::mem::take(&mut self.provisional) {
            *self = Self::default();
        }
        let (fixed, work_secs) = Self::split(seen);
        let pace = work_secs / seen.work;
        self.usual_work = seen.work.max(USUAL_KEPT * self.usual_work);
        // A request of little work says little about the pace, and weighs less in proportion.
        let weight = seen.work / self.usual_work;
        // A request that waited behind another one shows only the answer's latency, which is less than A.
        if seen.queue_secs <= 0.0 || self.fixed.is_none() {
            self.observe_fixed(fixed);
        }
        // Within the allowance, the client's clock supports any speed that a node claims, so the step up is
        // limited; beyond twice the allowance, the timed part is off by a factor of two at most.
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

    /// Seconds of an observation that count as work.
    pub fn work_secs(seen: &Observation) -> f64 {
        Self::split(seen).1
    }

    /// Splits an observation into seconds of fixed cost and seconds of work.
    fn split(seen: &Observation) -> (f64, f64) {
        let response = seen.response_secs.max(0.0);
        let busy = seen.busy_secs.clamp(0.0, response);
        // Time that neither the queue nor the report explains. Up to the allowance it is latency; beyond
        // that it counts as work, so that a node that reports too little gains nothing.
        let unexplained = (response - seen.queue_secs.max(0.0) - busy).max(0.0);
        let fixed = unexplained.min(Self::allowance(seen));
        (fixed, busy + unexplained - fixed)
    }

    /// Maximum fixed cost in seconds that the client's clock supports. A request that waited in the queue
    /// was transferred meanwhile: only the answer's latency is left.
    fn allowance(seen: &Observation) -> f64 {
        match seen.round_trip_secs {
            None => f64::INFINITY,
            Some(trip) if seen.queue_secs > 0.0 => trip + QUEUED_JITTER_SECS,
            Some(trip) => 2.0 * trip + JITTER_SECS,
        }
    }

    /// Lets the next observation count in full, however little work it is.
    pub fn expect_little(&mut self) {
        self.usual_work = 0.0;
    }

    /// Learns that `work` had not arrived after `secs`, of which the request may have waited `queue_secs`:
    /// the node is at least as slow as that. `missed` says that nothing at all had arrived, so that the
    /// true pace is probably far from the bound.
    pub fn observe_late(&mut self, work: f64, secs: f64, queue_secs: f64, missed: bool) {
        let spent = secs - queue_secs - self.fixed.unwrap_or(0.0);
        let factor = if missed { MISSED_FACTOR } else { 1.0 };
        let pace = factor * spent / work;
        // A lower bound of the pace can only show that the node is slower than believed.
        if pace > self.pace.secs_per_work.unwrap_or(SECS_PER_WORK_MIN) {
            self.pace.observe(pace, 1.0, 0.0);
        }
    }

    /// The cost by which to divide work; `None` until something has arrived or been missed.
    pub fn estimate(&self) -> Option<Estimate> {
        Some(Estimate {
            fixed_secs: self.fixed.unwrap_or(0.0),
            secs_per_work: self.pace.secs_per_work?,
        })
    }

    /// Standard errors of [`Estimator::estimate`]; `None` until work has arrived twice.
    pub fn error(&self) -> Option<EstimateError> {
        // Variance of an exponential moving average with gain g over independent errors: σ²·g / (2 − g).
        let share = GAIN / (2.0 - GAIN);
        Some(EstimateError {
            fixed_secs: (share * self.fixed_scatter?).sqrt(),
            pace: (share * self.pace.scatter?).sqrt(),
        })
    }

    /// The cost by which to predict arrivals; `None` until work has arrived.
    pub fn delivered(&self) -> Option<Estimate> {
        Some(Estimate {
            fixed_secs: self.fixed.unwrap_or(0.0),
            secs_per_work: self.delivered.secs_per_work?,
        })
    }

    /// The most work that arrived for one request.
    pub fn proven_work(&self) -> f64 {
        self.proven_work
    }

    /// Updates A, which rises slowly: one late packet does not mean a longer path.
    fn observe_fixed(&mut self, fixed: f64) {
        let Some(known) = self.fixed else {
            self.fixed = Some(fixed);
            return;
        };
        let error = fixed - known;
        let surprising = error.abs() > SURPRISE * known + JITTER_SECS;
        // Two large errors of the same sign in a row are a real change, which the filter alone would take
        // many requests to follow; a single outlier must not move it.
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
    /// Updates B. `weight`, up to 1, is smaller for less work, whose timing is noisier. The logarithmic
    /// error counts as no less than `error_min`.
    fn observe(&mut self, seen: f64, weight: f64, error_min: f64) {
        let Some(known) = self.secs_per_work else {
            self.secs_per_work = Some(seen);
            return;
        };
        let error = (seen / known).ln().max(error_min);
        let surprising = error.abs() > SURPRISE && weight > SURPRISE;
        let changed = surprising && error * self.surprise > 0.0;
        let gain = if changed { 1.0 } else { GAIN * weight };
        // Filtered in the logarithm: halving and doubling are errors of equal size, and the pace stays
        // positive.
        self.secs_per_work = Some(known * (gain * error).exp());
        self.scatter = Some(mean_square(self.scatter, error, weight));
        self.surprise = if surprising { error } else { 0.0 };
    }
}

/// Exponential moving average of squared errors.
fn mean_square(known: Option<f64>, error: f64, weight: f64) -> f64 {
    let square = error * error;
    known.map_or(square, |mean| {
        mean + GAIN_SCATTER * weight * (square - mean)
    })
}

/// Gain of the filters.
const GAIN: f64 = 0.25;
/// Gain of the mean squares, which scatter more.
const GAIN_SCATTER: f64 = 0.1;
/// Gain for a fixed cost that seems to have grown.
const GAIN_FIXED_UP: f64 = 0.1;
/// Two errors in a row of at least this relative size and the same sign are a change, and taken over in
/// full.
const SURPRISE: f64 = 0.25;
/// Maximum speed-up per observation that the client's clock cannot confirm, as a logarithm: a factor of 2.
const SPEED_UP_MAX: f64 = std::f64::consts::LN_2;
/// Decay of the usual work per smaller request.
const USUAL_KEPT: f64 = 0.95;
/// Seconds of latency jitter that are expected.
const JITTER_SECS: f64 = 2e-3;
/// The same for a request that waited in the queue, where the message before was delayed as well.
const QUEUED_JITTER_SECS: f64 = 0.2e-3;
/// Assumed pace, relative to the lower bound, of a node that has delivered nothing in time.
const MISSED_FACTOR: f64 = 2.0;
/// Lower limit of the pace: 10¹² samples per second, faster than any device.
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

    /// Over many nodes, the actual errors of estimates match their standard errors.
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
