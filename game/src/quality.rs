//! How large and how smooth a picture can be while things move: the dial that holds the frame
//! time.

use carom_tracer::ImageSize;
use clap::ValueEnum;

/// What is given up first where the farm cannot make pictures that are both many and fine.
///
/// Twice the time for a picture is twice the paths, and four times the paths of a pixel have 7 times
/// less squared error (relMSE 2.0e-3 at 4, 3.0e-4 at 16: `carom-farm compare` prints it).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Dial {
    /// 60 pictures a second, however coarse
    Smooth,
    /// 60 a second where they are fine enough, else 30: twice the paths
    #[default]
    Balanced,
    /// 15 a second: four times the paths, a seventh of the error
    Fine,
}

/// What a moving picture is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Pixels along an edge, as a share of the window's.
    pub scale: f64,
    /// Paths per pixel.
    pub samples: u32,
}

impl Level {
    /// Paths per pixel of the window.
    pub fn cost(self) -> f64 {
        self.scale * self.scale * f64::from(self.samples)
    }

    /// The picture's size for a window of `window` pixels.
    pub fn size(self, window: ImageSize) -> ImageSize {
        let edge = |pixels: u32| ((f64::from(pixels) * self.scale).round() as u32).max(1);
        ImageSize::new(edge(window.width), edge(window.height))
    }
}

/// From the coarsest to the finest: each costs 1.3 to 2 times as much as the one before.
pub const LADDER: [Level; 14] = [
    level(0.125, 1),
    level(0.1875, 1),
    level(0.25, 1),
    level(0.25, 2),
    level(0.375, 1),
    level(0.375, 2),
    level(0.5, 2),
    level(0.5, 3),
    level(0.625, 3),
    level(0.75, 4),
    level(1.0, 4),
    level(1.0, 6),
    level(1.0, 10),
    level(1.0, 16),
];

/// Chooses a [`Level`], and how often there is a picture, from how long pictures really took.
///
/// It learns what a path costs the farm (a fixed cost of each picture is spread over its paths)
/// and moves along [`LADDER`]: down at once when the next picture would be late, up one stop only
/// after several pictures that leave clear room, and a stop that had to be left is not tried again
/// before a pause that doubles each time.
#[derive(Clone, Debug)]
pub struct Quality {
    dial: Dial,
    period_secs: f64,
    stop: usize,
    secs_per_path: Option<f64>,
    roomy: u32,
    patience: u32,
}

impl Default for Quality {
    /// Begins coarse, so that the first picture comes at once.
    fn default() -> Self {
        Self {
            dial: Dial::default(),
            period_secs: STEADY_PERIOD_SECS,
            stop: 2,
            secs_per_path: None,
            roomy: 0,
            patience: PATIENCE_MIN,
        }
    }
}

impl Quality {
    /// What is given up first.
    pub fn dial(&self) -> Dial {
        self.dial
    }

    /// Gives up something else first, from the next picture on.
    pub fn set_dial(&mut self, dial: Dial) {
        self.dial = dial;
        self.period_secs = match dial {
            Dial::Smooth => SMOOTH_PERIOD_SECS,
            Dial::Balanced => STEADY_PERIOD_SECS,
            Dial::Fine => FINE_PERIOD_SECS,
        };
    }

    /// Takes in that a picture of `pixels` at `samples` kept the farm busy for `busy_secs`.
    pub fn observe(&mut self, pixels: usize, samples: u32, window: ImageSize, busy_secs: f64) {
        let paths = pixels as f64 * f64::from(samples);
        let cost = busy_secs.max(1e-6) / paths;
        // The mean of costs, not of speeds: one slow picture weighs more than one fast one.
        let smooth = |old: f64| old + SMOOTHING * (cost - old);
        let cost = self.secs_per_path.map_or(cost, smooth);
        self.secs_per_path = Some(cost);
        self.pace(cost, window);
        self.choose(cost, window);
    }

    /// Seconds from one moving picture to the next: 60 a second where the farm can make them fine
    /// enough, else 30.
    pub fn period_secs(&self) -> f64 {
        self.period_secs
    }

    /// What a path costs the farm, in seconds; absent before the first picture.
    pub fn secs_per_path(&self) -> Option<f64> {
        self.secs_per_path
    }

    /// What the next moving picture should be.
    pub fn level(&self) -> Level {
        LADDER[self.stop]
    }

    /// Paths per pixel that fit into `secs` at full resolution, at least 1.
    pub fn samples_within(&self, secs: f64, window: ImageSize) -> u32 {
        let paths = self.secs_per_path.map_or(0.0, |cost| secs / cost);
        ((paths / window.pixels().max(1) as f64) as u32).clamp(1, 64)
    }

    fn pace(&mut self, secs_per_path: f64, window: ImageSize) {
        if self.dial != Dial::Balanced {
            return;
        }
        let secs = SMOOTH_LEVEL.cost() * window.pixels() as f64 * secs_per_path;
        if secs > SMOOTH_PERIOD_SECS * LATE {
            self.period_secs = STEADY_PERIOD_SECS;
        } else if secs <= SMOOTH_PERIOD_SECS * ROOMY {
            self.period_secs = SMOOTH_PERIOD_SECS;
        }
    }

    fn choose(&mut self, secs_per_path: f64, window: ImageSize) {
        let target_secs = self.period_secs;
        let secs = |stop: usize| LADDER[stop].cost() * window.pixels() as f64 * secs_per_path;
        if secs(self.stop) > target_secs * LATE {
            let fits = |stop: &usize| secs(*stop) <= target_secs;
            self.stop = (0..self.stop).rev().find(fits).unwrap_or(0);
            self.roomy = 0;
            self.patience = (self.patience * 2).min(PATIENCE_MAX);
            return;
        }
        let next = self.stop + 1;
        if next == LADDER.len() || secs(next) > target_secs * ROOMY {
            self.roomy = 0;
            return;
        }
        self.roomy += 1;
        if self.roomy >= self.patience {
            self.stop = next;
            self.roomy = 0;
            self.patience = (self.patience - 1).max(PATIENCE_MIN);
        }
    }
}

const fn level(scale: f64, samples: u32) -> Level {
    Level { scale, samples }
}

/// Where the farm cannot keep [`SMOOTH_PERIOD_SECS`]: in between, pictures are moved by
/// [`crate::warp`].
pub const STEADY_PERIOD_SECS: f64 = 1.0 / 30.0;
/// For those who would rather see fewer and finer ones.
const FINE_PERIOD_SECS: f64 = 1.0 / 15.0;
/// A common display's rate.
pub const SMOOTH_PERIOD_SECS: f64 = 1.0 / 60.0;
/// Coarser pictures than this are not worth having twice as many of.
const SMOOTH_LEVEL: Level = level(0.5, 3);
/// Weight of the newest picture: half of a change is learned in three pictures.
const SMOOTHING: f64 = 0.2;
/// Over the target by this much, the picture gets coarser.
const LATE: f64 = 1.15;
/// Under the target by this much, the picture may get finer.
const ROOMY: f64 = 0.85;
const PATIENCE_MIN: u32 = 3;
const PATIENCE_MAX: u32 = 48;

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: ImageSize = ImageSize::new(1280, 720);

    /// Plays `pictures` on a farm of `speed(i)` paths per second and a fixed cost per picture.
    fn play(quality: &mut Quality, pictures: usize, speed: impl Fn(usize) -> f64) -> Vec<Level> {
        (0..pictures)
            .map(|i| {
                let level = quality.level();
                let pixels = level.size(WINDOW).pixels();
                let busy = 0.0015 + pixels as f64 * f64::from(level.samples) / speed(i);
                quality.observe(pixels, level.samples, WINDOW, busy);
                level
            })
            .collect()
    }

    fn secs(level: Level, speed: f64) -> f64 {
        0.0015 + level.cost() * WINDOW.pixels() as f64 / speed
    }

    #[test]
    fn the_ladder_rises_in_small_steps() {
        for pair in LADDER.windows(2) {
            let rise = pair[1].cost() / pair[0].cost();
            assert!((1.1..=2.3).contains(&rise), "{pair:?} rises {rise} times");
        }
    }

    #[test]
    fn it_fills_the_target_and_does_not_exceed_it() {
        for speed in [2e6, 8e6, 3e7, 2e8, 3e9] {
            let mut quality = Quality::default();
            let last = *play(&mut quality, 200, |_| speed).last().unwrap();
            assert!(
                secs(last, speed) <= quality.period_secs() * LATE,
                "{last:?} at {speed}"
            );
            let stop = LADDER.iter().position(|level| *level == last).unwrap();
            if let Some(finer) = LADDER.get(stop + 1) {
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
        play(&mut quality, 1, |_| 1e7);
        assert!(paths_per_sec(&quality) < before);
        let levels = play(&mut quality, 12, |_| 1e7);
        assert!(secs(*levels.last().unwrap(), 1e7) <= quality.period_secs() * LATE);
    }

    #[test]
    fn noise_of_a_third_does_not_make_it_swing() {
        let mut quality = Quality::default();
        // A fixed pattern with the spread of a busy machine: ±33 %.
        let speed = |i: usize| 1.2e7 * (1.0 + 0.33 * ((i * 7919 % 101) as f64 / 50.0 - 1.0));
        let levels = play(&mut quality, 1000, speed);
        let changes = levels[200..]
            .windows(2)
            .filter(|pair| pair[0] != pair[1])
            .count();
        assert!(changes <= 20, "{changes} changes in 800 pictures");
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
        let level = |dial: Dial| {
            let mut quality = Quality::default();
            quality.set_dial(dial);
            play(&mut quality, 200, |_| 3e7);
            (quality.period_secs(), quality.level().cost())
        };
        let (smooth, balanced, fine) = (
            level(Dial::Smooth),
            level(Dial::Balanced),
            level(Dial::Fine),
        );
        assert!(smooth.0 < balanced.0 && balanced.0 < fine.0);
        assert!(
            fine.1 > 1.5 * balanced.1 && balanced.1 > 1.5 * smooth.1,
            "{fine:?} {balanced:?} {smooth:?}"
        );
    }

    #[test]
    fn a_tiny_window_still_has_a_pixel() {
        assert_eq!(LADDER[0].size(ImageSize::new(1, 1)), ImageSize::new(1, 1));
    }
}
