//! Learned costs of a machine's devices, and the choice between using the best one or all.
//!
//! Whether a second device pays cannot be told from the costs alone: while it works, it takes memory
//! bandwidth, cores and power from the first. So frames are timed both ways, the better way is kept, and
//! the comparison is repeated now and then.

use crate::balancer::{CostModel, Estimator, Observation, water_fill};

/// Time that a device took for its share of a job.
pub(super) struct DeviceTiming {
    work: f64,
    secs: f64,
    busy_secs: f64,
}

impl DeviceTiming {
    /// `work` done in `secs`, of which `device_nanos` are by the device's own clock, 0 if it has none.
    pub(super) fn new(work: f64, secs: f64, device_nanos: u64) -> Self {
        let device_secs = device_nanos as f64 * 1e-9;
        let busy_secs = if device_nanos > 0 {
            device_secs.min(secs)
        } else {
            secs
        };
        Self {
            work,
            secs,
            busy_secs,
        }
    }
}

/// Class of similar jobs: using all devices may pay for long jobs and not for short ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct JobClass {
    pub(super) samples: u32,
    pub(super) max_depth: u32,
    /// log₂ of the pixels.
    pub(super) pixels_log2: u32,
}

/// Models per class of jobs; the least recently used are dropped.
pub(super) struct JobModels {
    devices: usize,
    classes: Vec<(JobClass, DeviceModels)>,
}

impl JobModels {
    pub(super) fn new(devices: usize) -> Self {
        Self {
            devices,
            classes: Vec::new(),
        }
    }

    pub(super) fn get_mut(&mut self, class: JobClass) -> &mut DeviceModels {
        let known = self.classes.iter().position(|(known, _)| *known == class);
        let entry = match known {
            Some(place) => self.classes.remove(place),
            None => (class, DeviceModels::new(self.devices)),
        };
        self.classes.truncate(CLASSES_MAX - 1);
        self.classes.insert(0, entry);
        &mut self.classes[0].1
    }
}

/// Costs of all devices for a class of jobs, and the durations with one and with all.
pub(super) struct DeviceModels {
    devices: Vec<Estimator>,
    phase: Phase,
    /// Jobs until the next phase.
    jobs_left: u32,
    /// Seconds per unit of work of the fastest job of the last trial, with the best device alone and with
    /// all devices.
    alone_pace: f64,
    together_pace: f64,
}

/// Purpose of the next jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    TryAlone,
    TryTogether,
    /// Uses the better way.
    Keep,
}

impl DeviceModels {
    pub(super) fn new(devices: usize) -> Self {
        Self {
            devices: vec![Estimator::default(); devices],
            phase: Phase::TryAlone,
            jobs_left: TRIAL_JOBS,
            alone_pace: f64::INFINITY,
            together_pace: f64::INFINITY,
        }
    }

    /// The work of each of the `usable` devices. While nothing is known of them, all work goes to the
    /// first.
    pub(super) fn divide(&mut self, work: f64, usable: &[usize]) -> Vec<f64> {
        let costs: Vec<CostModel> = usable.iter().map(|&i| self.cost_model(i, work)).collect();
        if self.goes_together() {
            return water_fill(work, &costs).shares;
        }
        // Alone: the device with the earliest finish for all the work, among those that have been timed.
        let known = |&place: &usize| self.devices[usable[place]].estimate().is_some();
        let finish = |place: usize| costs[place].fixed_secs + costs[place].secs_per_work * work;
        let best = (0..usable.len())
            .filter(known)
            .min_by(|&a, &b| finish(a).total_cmp(&finish(b)));
        let mut shares = vec![0.0; usable.len()];
        shares[best.unwrap_or(0)] = work;
        shares
    }

    fn goes_together(&self) -> bool {
        match self.phase {
            Phase::TryAlone => false,
            Phase::TryTogether => true,
            Phase::Keep => self.together_pace < (1.0 - GAIN_MIN) * self.alone_pace,
        }
    }

    /// Learns the duration of a whole job, divided or not.
    pub(super) fn judge(&mut self, work: f64, secs: f64, was_divided: bool) {
        if work <= 0.0 {
            return;
        }
        let pace = secs / work;
        // The first half of a trial compiles kernels or converges to the shares.
        let counts = self.jobs_left <= TRIAL_JOBS / 2;
        match self.phase {
            Phase::TryAlone if counts && !was_divided => {
                self.alone_pace = self.alone_pace.min(pace);
            }
            Phase::TryTogether if counts && was_divided => {
                self.together_pace = self.together_pace.min(pace);
            }
            _ => {}
        }
        self.jobs_left -= 1;
        if self.jobs_left == 0 {
            self.end_phase();
        }
    }

    fn end_phase(&mut self) {
        (self.phase, self.jobs_left) = match self.phase {
            Phase::TryAlone => (Phase::TryTogether, TRIAL_JOBS),
            Phase::TryTogether => (Phase::Keep, KEPT_JOBS),
            Phase::Keep => {
                (self.alone_pace, self.together_pace) = (f64::INFINITY, f64::INFINITY);
                (Phase::TryAlone, TRIAL_JOBS)
            }
        };
    }

    /// The cost model of a device for a job of `work`. An unknown device is bounded to a small share, a
    /// known one to a multiple of what it has proven.
    fn cost_model(&self, device: usize, work: f64) -> CostModel {
        let estimates = self.devices.iter().filter_map(Estimator::estimate);
        let paces = estimates.map(|estimate| estimate.secs_per_work);
        let quickest = paces.fold(f64::INFINITY, f64::min);
        let estimator = &self.devices[device];
        let (fixed_secs, secs_per_work) = match estimator.estimate() {
            Some(estimate) => (estimate.fixed_secs, estimate.secs_per_work),
            None if quickest.is_finite() => (0.0, quickest),
            None => (0.0, 1.0),
        };
        let work_max = (GROWTH_MAX * estimator.proven_work()).max(work * PROBE_SHARE);
        CostModel {
            fixed_secs,
            secs_per_work,
            work_max,
            // Tiles within a machine are not hedged.
            unmonitored_work: 0.0,
            margin_secs: 0.0,
        }
    }

    /// Learns from a device's share of a job.
    pub(super) fn learn(&mut self, device: usize, timing: &DeviceTiming) {
        if timing.work > 0.0 {
            self.devices[device].observe(&Observation {
                work: timing.work,
                response_secs: timing.secs,
                queue_secs: 0.0,
                busy_secs: timing.busy_secs,
                round_trip_secs: None,
            });
        }
    }
}

/// Maximum number of classes: a quality governor moves among a dozen settings.
const CLASSES_MAX: usize = 32;
/// Minimum gain in time for using all devices: less is noise and wasted power. Measured: a sixteen-core CPU
/// beside an H200 could gain 3.5 % in theory, and frames with it took 0.98 to 1.06 times as long.
const GAIN_MIN: f64 = 0.05;
/// Jobs per trial; the first half converges to the shares, starting from the smallest.
pub(super) const TRIAL_JOBS: u32 = 12;
/// Jobs until the next trials. A trial costs 12 jobs of the worse way, which take at most twice as long
/// where all devices are better: 1 % of the time.
const KEPT_JOBS: u32 = 1200;
/// Maximum share of a job for an unknown device.
const PROBE_SHARE: f64 = 1.0 / 32.0;
/// Growth factor: maximum share relative to the largest one so far.
const GROWTH_MAX: f64 = 4.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// Devices on virtual time. `slowdown` is how much longer the first takes while the second
    /// works too.
    struct Machine {
        secs_per_work: [f64; 2],
        slowdown: f64,
    }

    impl Machine {
        /// Seconds of a job as `models` divides it.
        fn job(&self, models: &mut DeviceModels, work: f64) -> f64 {
            let shares = models.divide(work, &[0, 1]);
            assert!((shares.iter().sum::<f64>() - work).abs() < 1e-6 * work);
            let is_divided = shares.iter().all(|share| *share > 0.0);
            let slowdown = if is_divided { self.slowdown } else { 1.0 };
            let mut longest = 0.0f64;
            for (device, &share) in shares.iter().enumerate() {
                let factor = if device == 0 { slowdown } else { 1.0 };
                let secs = share * self.secs_per_work[device] * factor;
                models.learn(device, &DeviceTiming::new(share, secs, 0));
                longest = longest.max(secs);
            }
            models.judge(work, longest, is_divided);
            longest
        }

        /// Seconds of many jobs over those of the best device alone.
        fn ratio_to_best_alone(&self) -> f64 {
            let (work, jobs) = (1e6, 6000);
            let mut models = DeviceModels::new(2);
            let spent: f64 = (0..jobs).map(|_| self.job(&mut models, work)).sum();
            let alone = self.secs_per_work[0].min(self.secs_per_work[1]);
            spent / (f64::from(jobs) * alone * work)
        }
    }

    #[test]
    fn two_devices_finish_as_early_as_they_can() {
        for speeds in [[1.0, 1.0], [3.0, 1.0], [1.0, 3.0], [10.0, 1.0]] {
            let machine = Machine {
                secs_per_work: speeds.map(|speed| 1e-8 / speed),
                slowdown: 1.0,
            };
            let best = speeds[0].max(speeds[1]) / (speeds[0] + speeds[1]);
            let ratio = machine.ratio_to_best_alone();
            assert!(ratio < 1.02 * best, "{speeds:?}: {ratio}, at best {best}");
        }
    }

    #[test]
    fn classes_of_jobs_do_not_mix() {
        let mut models = JobModels::new(2);
        let class = |samples| JobClass {
            samples,
            max_depth: 5,
            pixels_log2: 20,
        };
        let helped = Machine {
            secs_per_work: [1e-8, 1e-8],
            slowdown: 1.0,
        };
        let slowed = Machine {
            secs_per_work: [1e-9, 1e-8],
            slowdown: 1.5,
        };
        for _ in 0..2 * TRIAL_JOBS {
            helped.job(models.get_mut(class(16)), 16e6);
            slowed.job(models.get_mut(class(1)), 1e6);
        }
        assert!(models.get_mut(class(16)).goes_together());
        assert!(!models.get_mut(class(1)).goes_together());
        for samples in 0..2 * CLASSES_MAX as u32 {
            models.get_mut(class(samples));
        }
        assert_eq!(models.classes.len(), CLASSES_MAX);
    }

    #[test]
    fn a_device_that_slows_the_other_down_is_left_out() {
        for (speeds, slowdown) in [
            ([30.0, 1.0], 1.1),
            ([100.0, 1.0], 1.01),
            ([1000.0, 1.0], 1.0),
            ([4.0, 1.0], 1.5),
        ] {
            let machine = Machine {
                secs_per_work: speeds.map(|speed| 1e-8 / speed),
                slowdown,
            };
            let ratio = machine.ratio_to_best_alone();
            assert!(ratio < 1.02, "{speeds:?}, {slowdown}: {ratio}");
        }
    }
}
