//! Quality levels of moving pictures, and the control loop that selects one to hold the frame time.

use carom_tracer::{ImageSize, RenderSettings};

/// What is given up first where the farm cannot make frames that are both many and fine.
///
/// Twice the time for a frame is twice the samples, and four times the samples of a pixel have 7 times
/// less squared error (relMSE 1.7e-3 at 4, 2.4e-4 at 16: `carom-farm compare` prints it).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum QualityPreference {
    /// 60 frames a second where 426x240 pixels allow it
    Smooth,
    /// 60 a second where they are fine enough, else 30: twice the samples
    #[default]
    Balanced,
    /// 15 a second: four times the samples, a seventh of the error
    Fine,
}

/// Pixels of the sharpest picture that is traced, along an edge of the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Resolution {
    /// Half of the window's along each edge: a quarter of the work, soft edges
    Half,
    /// Three quarters of the window's along each edge: 56 % of the work
    ThreeQuarters,
    /// A traced pixel for each of the window
    #[default]
    Full,
}

impl Resolution {
    /// The sharpest picture in a window of `window` pixels.
    pub fn size(self, window: ImageSize) -> ImageSize {
        match self {
            // A window without pixels has no picture.
            _ if window.pixels() == 0 => window,
            Self::Half => window.scaled(0.5),
            Self::ThreeQuarters => window.scaled(0.75),
            Self::Full => window,
        }
    }
}

/// Resolution and samples of a moving picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QualityLevel {
    /// Edge length relative to the window's.
    pub scale: f64,
    /// Paths per traced pixel.
    pub samples: u32,
    /// Whether it is denoised.
    pub denoise: bool,
}

impl QualityLevel {
    /// Cost per pixel of the window, in paths.
    pub fn cost(self) -> f64 {
        self.scale * self.scale * paths(self.samples, self.denoise)
    }

    /// The picture's size for a window of `window` pixels.
    pub fn size(self, window: ImageSize) -> ImageSize {
        window.scaled(self.scale)
    }
}

/// Cost per traced pixel in paths, including the denoiser.
fn paths(samples: u32, denoise: bool) -> f64 {
    f64::from(samples) + if denoise { FILTER_PATHS } else { 0.0 }
}

/// Levels from the coarsest to the finest, each at 1.3 to 2.3 times the cost of the one before. All are
/// denoised, as a picture of few samples is too noisy otherwise. Those before [`COARSEST`] are for large
/// windows.
pub const QUALITY_LEVELS: [QualityLevel; 13] = [
    denoised(0.112, 1),
    denoised(0.16, 1),
    denoised(0.23, 1),
    denoised(1.0 / 3.0, 1),
    denoised(0.375, 1),
    denoised(0.375, 2),
    denoised(0.375, 4),
    denoised(0.5, 4),
    denoised(0.625, 4),
    denoised(0.75, 4),
    denoised(1.0, 4),
    denoised(1.0, 8),
    denoised(1.0, 16),
];

/// Index of the coarsest level for windows of up to 1280 × 720: 426 × 240.
const COARSEST: usize = 3;
/// Minimum number of pixels of moving pictures in larger windows.
const PIXELS_MIN: usize = 426 * 240;

/// Index of the coarsest level for a window. A farm that is too slow for it makes fewer pictures per
/// second, and those in between are reprojected.
fn coarsest(window: ImageSize) -> usize {
    let is_enough = |level: &QualityLevel| level.size(window).pixels() >= PIXELS_MIN;
    let enough = QUALITY_LEVELS[..COARSEST].iter().position(is_enough);
    enough.unwrap_or(COARSEST)
}

/// Controller that selects a [`QualityLevel`] and the frame period from how long pictures actually took.
///
/// It learns the cost of a path on the farm, for noisy and for denoised pictures (a picture's fixed cost is
/// spread over its paths), and moves along [`QUALITY_LEVELS`]: down at once when the next picture would be
/// late, up one level only after several pictures with clear headroom. Each step down doubles the number of
/// such pictures required.
#[derive(Clone, Debug)]
pub struct Quality {
    preference: QualityPreference,
    /// Fixed level in place of the selection.
    fixed: Option<QualityLevel>,
    period_secs: f64,
    stop: usize,
    /// Cost of noisy and of denoised pictures.
    secs_per_path: [Option<f64>; 2],
    roomy: u32,
    patience: u32,
}

impl Default for Quality {
    /// Begins with a coarse level, so that the first picture comes at once.
    fn default() -> Self {
        Self {
            preference: QualityPreference::default(),
            fixed: None,
            period_secs: STEADY_PERIOD_SECS,
            stop: COARSEST,
            secs_per_path: [None; 2],
            roomy: 0,
            patience: PATIENCE_MIN,
        }
    }
}

impl Quality {
    /// The quality preference.
    pub fn preference(&self) -> QualityPreference {
        self.preference
    }

    /// Sets the quality preference from the next picture on.
    pub fn set_quality_preference(&mut self, preference: QualityPreference) {
        self.preference = preference;
        self.period_secs = match preference {
            QualityPreference::Smooth => SMOOTH_PERIOD_SECS,
            QualityPreference::Balanced => STEADY_PERIOD_SECS,
            QualityPreference::Fine => FINE_PERIOD_SECS,
        };
    }

    /// Fixes the level, at as many pictures per second as the farm can make: for measurements.
    pub fn fix(&mut self, level: QualityLevel) {
        self.fixed = Some(level);
    }

    /// Learns that a picture of `pixels` with `settings` kept the farm busy for `busy_secs`.
    pub fn observe(
        &mut self,
        pixels: usize,
        settings: &RenderSettings,
        window: ImageSize,
        busy_secs: f64,
    ) {
        let cost =
            busy_secs.max(1e-6) / (pixels as f64 * paths(settings.samples, settings.denoise));
        let kind = usize::from(settings.denoise);
        match self.secs_per_path[kind] {
            // A change of the farm's speed applies to both kinds of pictures. The mean of costs, not of
            // speeds: one slow picture weighs more than one fast one.
            Some(old) => {
                let change = 1.0 + SMOOTHING * (cost / old - 1.0);
                for known in self.secs_per_path.iter_mut().flatten() {
                    *known *= change;
                }
            }
            None => self.secs_per_path[kind] = Some(cost),
        }
        self.pace(window);
        self.choose(window);
    }

    /// Predicted seconds of a picture of `level`; `None` before the first picture.
    pub fn secs(&self, level: QualityLevel, window: ImageSize) -> Option<f64> {
        let [noisy, denoised] = self.secs_per_path;
        let known = if level.denoise {
            denoised.or(noisy)
        } else {
            noisy.or(denoised)
        };
        Some(level.cost() * window.pixels() as f64 * known?)
    }

    /// Seconds between moving pictures: 1/60 where the farm can make them fine enough, else 1/30; for a
    /// fixed level, as long as one takes.
    pub fn period_secs(&self) -> f64 {
        self.period_secs
    }

    /// Level of the next moving picture.
    pub fn level(&self) -> QualityLevel {
        self.fixed.unwrap_or(QUALITY_LEVELS[self.stop])
    }

    /// Paths per pixel that fit into `secs` at full resolution, at least 1.
    pub fn samples_within(&self, secs: f64, window: ImageSize) -> u32 {
        let one = self.secs(noisy(1.0, 1), window);
        // The cast saturates.
        one.map_or(1, |one| ((secs / one) as u32).clamp(1, 64))
    }

    fn pace(&mut self, window: ImageSize) {
        if let Some(level) = self.fixed {
            self.period_secs = self.secs(level, window).unwrap_or(self.period_secs);
            return;
        }
        if self.preference != QualityPreference::Balanced {
            return;
        }
        let secs = self.secs(SMOOTH_LEVEL, window).unwrap_or(0.0);
        // Hysteresis: between the two bounds the period stays.
        if secs > SMOOTH_PERIOD_SECS * LATE {
            self.period_secs = STEADY_PERIOD_SECS;
        } else if secs <= SMOOTH_PERIOD_SECS * ROOMY {
            self.period_secs = SMOOTH_PERIOD_SECS;
        }
    }

    fn choose(&mut self, window: ImageSize) {
        let target_secs = self.period_secs;
        let secs = |stop: usize| self.secs(QUALITY_LEVELS[stop], window).unwrap_or(0.0);
        let coarsest = coarsest(window);
        if secs(self.stop) > target_secs * LATE && self.stop > coarsest {
            // Directly down to the finest level that fits.
            let fits = |stop: &usize| secs(*stop) <= target_secs;
            self.stop = (coarsest..self.stop).rev().find(fits).unwrap_or(coarsest);
            self.roomy = 0;
            self.patience = (self.patience * 2).min(PATIENCE_MAX);
            return;
        }
        let next = (self.stop + 1).max(coarsest);
        if next == QUALITY_LEVELS.len() || secs(next) > target_secs * ROOMY {
            self.roomy = 0;
            return;
        }
        self.roomy += 1;
        if self.roomy >= self.patience {
            self.stop = next;
            self.roomy = 0;
            // Successful steps up slowly undo the doublings.
            self.patience = (self.patience - 1).max(PATIENCE_MIN);
        }
    }
}

const fn noisy(scale: f64, samples: u32) -> QualityLevel {
    QualityLevel {
        scale,
        samples,
        denoise: false,
    }
}

const fn denoised(scale: f64, samples: u32) -> QualityLevel {
    QualityLevel {
        denoise: true,
        ..noisy(scale, samples)
    }
}

/// Cost of the denoiser on a CPU per pixel, in paths; a GPU's is learned.
const FILTER_PATHS: f64 = 2.0;

/// Period where the farm cannot keep [`SMOOTH_PERIOD_SECS`]: an application can move the pictures in
/// between with [`carom_tracer::reproject`].
pub const STEADY_PERIOD_SECS: f64 = 1.0 / 30.0;
/// Period of [`QualityPreference::Fine`].
const FINE_PERIOD_SECS: f64 = 1.0 / 15.0;
/// Period of a common display.
pub const SMOOTH_PERIOD_SECS: f64 = 1.0 / 60.0;
/// Coarsest level for which twice the frame rate is worth having.
const SMOOTH_LEVEL: QualityLevel = denoised(0.375, 4);
/// Gain of the cost filter: half of a change is learned in three pictures.
const SMOOTHING: f64 = 0.2;
/// Factor over the target from which the picture gets coarser.
const LATE: f64 = 1.15;
/// Share of the target below which the picture may get finer.
const ROOMY: f64 = 0.85;
const PATIENCE_MIN: u32 = 3;
const PATIENCE_MAX: u32 = 48;

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: ImageSize = ImageSize::new(1280, 720);

    /// A farm of `speed` paths per second, whose denoiser takes as long as `filter_paths` per pixel.
    #[derive(Clone, Copy)]
    struct Load {
        speed: f64,
        filter_paths: f64,
    }

    impl Load {
        fn of(speed: f64) -> Self {
            let filter_paths = FILTER_PATHS;
            Self {
                speed,
                filter_paths,
            }
        }

        fn secs(self, level: QualityLevel) -> f64 {
            let filter = if level.denoise {
                self.filter_paths
            } else {
                0.0
            };
            let paths = f64::from(level.samples) + filter;
            0.0015 + level.size(WINDOW).pixels() as f64 * paths / self.speed
        }
    }

    /// Plays pictures on farms of the given loads.
    fn play_loads(quality: &mut Quality, loads: impl Iterator<Item = Load>) -> Vec<QualityLevel> {
        let picture = |load: Load| {
            let level = quality.level();
            let settings = RenderSettings {
                samples: level.samples,
                denoise: level.denoise,
                ..RenderSettings::default()
            };
            let pixels = level.size(WINDOW).pixels();
            quality.observe(pixels, &settings, WINDOW, load.secs(level));
            level
        };
        loads.map(picture).collect()
    }

    fn play(
        quality: &mut Quality,
        pictures: usize,
        speed: impl Fn(usize) -> f64,
    ) -> Vec<QualityLevel> {
        play_loads(quality, (0..pictures).map(|i| Load::of(speed(i))))
    }

    fn secs(level: QualityLevel, speed: f64) -> f64 {
        Load::of(speed).secs(level)
    }

    fn stop_of(level: &QualityLevel) -> usize {
        QUALITY_LEVELS
            .iter()
            .position(|stop| stop == level)
            .unwrap()
    }

    fn changes(levels: &[QualityLevel]) -> usize {
        let pairs = levels.windows(2);
        pairs.filter(|pair| pair[0] != pair[1]).count()
    }

    /// ±33 %, the spread of a busy machine, in a fixed pattern.
    fn noise(i: usize) -> f64 {
        1.0 + 0.33 * ((i * 7919 % 101) as f64 / 50.0 - 1.0)
    }

    #[test]
    fn the_ladder_rises_in_small_steps() {
        for pair in QUALITY_LEVELS.windows(2) {
            let rise = pair[1].cost() / pair[0].cost();
            assert!((1.2..=2.3).contains(&rise), "{pair:?} rises {rise} times");
        }
    }

    #[test]
    fn it_fills_the_target_and_does_not_exceed_it() {
        for speed in [1.1e7, 3e7, 2e8, 3e9] {
            let mut quality = Quality::default();
            let last = *play(&mut quality, 200, |_| speed).last().unwrap();
            assert!(
                secs(last, speed) <= quality.period_secs() * LATE,
                "{last:?} at {speed}"
            );
            if let Some(finer) = QUALITY_LEVELS.get(stop_of(&last) + 1) {
                assert!(
                    secs(*finer, speed) > quality.period_secs() * ROOMY * 0.9,
                    "{last:?} at {speed}"
                );
            }
        }
    }

    #[test]
    fn a_slow_farm_is_noticed_with_the_first_picture_that_is_late() {
        let mut quality = Quality::default();
        play(&mut quality, 100, |_| 1e8);
        let paths_per_sec = |quality: &Quality| quality.level().cost() / quality.period_secs();
        let before = paths_per_sec(&quality);
        play(&mut quality, 1, |_| 1.2e7);
        assert!(paths_per_sec(&quality) < before);
        let levels = play(&mut quality, 12, |_| 1.2e7);
        assert!(secs(*levels.last().unwrap(), 1.2e7) <= quality.period_secs() * LATE);
    }

    #[test]
    fn noise_of_a_third_does_not_make_it_swing() {
        let mut quality = Quality::default();
        let levels = play(&mut quality, 1000, |i| 1.2e7 * noise(i));
        let changes = changes(&levels[200..]);
        assert!(changes <= 20, "{changes} changes in 800 pictures");
    }

    /// Steps of four times, with noise: it settles after each within 100 pictures.
    #[test]
    fn it_follows_steps_of_the_load_and_rests_between_them() {
        for low in [1.1e7, 4e7, 1.7e8] {
            let mut quality = Quality::default();
            let speed = |step: usize| {
                if step.is_multiple_of(2) {
                    low
                } else {
                    4.0 * low
                }
            };
            let mut stops = Vec::new();
            for step in 0..6 {
                let levels = play(&mut quality, 400, |i| speed(step) * noise(i));
                let changes = changes(&levels[100..]);
                assert!(changes <= 8, "{changes} in step {step} from {low}");
                let late = |level: &&QualityLevel| {
                    secs(**level, speed(step)) > quality.period_secs() * LATE * 1.15
                };
                let late = levels[100..].iter().filter(late).count();
                assert!(late <= 6, "{late} late in step {step} from {low}");
                stops.push(stop_of(levels.last().unwrap()) as f64 / quality.period_secs());
            }
            for pair in stops.chunks(2) {
                assert!(pair[1] > pair[0], "{stops:?} from {low}");
            }
        }
    }

    /// The denoiser costs a GPU next to nothing, and some CPUs more than assumed.
    #[test]
    fn it_rests_whatever_the_filter_costs() {
        for filter_paths in [0.1, 2.0, 9.0] {
            for speed in [8e7, 1.3e8, 1.7e8, 2.2e8, 4e8] {
                let mut quality = Quality::default();
                let load = |i| Load {
                    speed: speed * (1.0 + 0.3 * (noise(i) - 1.0)),
                    filter_paths,
                };
                let levels = play_loads(&mut quality, (0..1000).map(load));
                let changes = changes(&levels[200..]);
                assert!(changes <= 8, "{changes} at {speed}, {filter_paths}");
                let last = Load {
                    speed,
                    filter_paths,
                }
                .secs(*levels.last().unwrap());
                let late = quality.period_secs() * LATE * 1.1;
                assert!(last <= late, "{last} s at {speed}, {filter_paths}");
            }
        }
    }

    #[test]
    fn pictures_come_60_times_a_second_where_they_can_be_fine_enough() {
        let period = |speed: f64| {
            let mut quality = Quality::default();
            play(&mut quality, 200, |_| speed);
            quality.period_secs()
        };
        assert_eq!(period(3e7), STEADY_PERIOD_SECS);
        assert_eq!(period(3e8), SMOOTH_PERIOD_SECS);
    }

    #[test]
    fn the_dial_trades_pictures_for_paths() {
        let level = |preference: QualityPreference| {
            let mut quality = Quality::default();
            quality.set_quality_preference(preference);
            play(&mut quality, 200, |_| 3e7);
            (quality.period_secs(), quality.level().cost())
        };
        let (smooth, balanced, fine) = (
            level(QualityPreference::Smooth),
            level(QualityPreference::Balanced),
            level(QualityPreference::Fine),
        );
        assert!(smooth.0 < balanced.0 && balanced.0 < fine.0);
        assert!(
            fine.1 > 1.5 * balanced.1 && balanced.1 > 1.5 * smooth.1,
            "{fine:?} {balanced:?} {smooth:?}"
        );
    }

    /// Of a farm that is too slow for 30 a second there are fewer.
    #[test]
    fn no_picture_is_coarser_than_426_by_240() {
        for (width, height) in [(1280, 720), (1920, 1080), (3840, 2160)] {
            let window = ImageSize::new(width, height);
            let mut quality = Quality::default();
            for _ in 0..100 {
                let level = quality.level();
                let pixels = level.size(window).pixels();
                let settings = RenderSettings {
                    samples: level.samples,
                    denoise: level.denoise,
                    ..RenderSettings::default()
                };
                quality.observe(pixels, &settings, window, pixels as f64 * 1e-6);
            }
            let pixels = quality.level().size(window).pixels();
            assert!(
                (PIXELS_MIN..2 * PIXELS_MIN).contains(&pixels),
                "{pixels} of {width}"
            );
            assert!(quality.level().denoise);
        }
    }

    #[test]
    fn a_tiny_window_still_has_a_pixel() {
        assert_eq!(
            QUALITY_LEVELS[0].size(ImageSize::new(1, 1)),
            ImageSize::new(1, 1)
        );
    }
}
