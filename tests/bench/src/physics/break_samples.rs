//! Breaks sampled by another simulator, and a test whether ours are of the same distribution.
//!
//! Two samples are compared as a whole, not by their means: the largest distance of their cumulative
//! distributions, and how often two samples of one lottery lie as far apart (Kolmogorov–Smirnov, with
//! Stephens' approximation; Press et al., "Numerical Recipes", 14.3). Many comparisons bring forth
//! small chances by themselves, so that they are judged together (Šidák).

use std::{collections::BTreeMap, fmt, path::Path};

use anyhow::{Context as _, ensure};
use serde::{Deserialize, Serialize};

use super::{breaks::BreakStatistic, reference::read_file};

/// The draws of another simulator, by the name of the rack.
#[derive(Clone, Debug, Deserialize)]
pub struct ReferenceBreaks {
    racks: BTreeMap<String, RackSamples>,
}

/// Of one rack, one number a draw.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct RackSamples {
    pub(super) energy_kept: Vec<f64>,
    pub(super) spread_m: Vec<f64>,
    pub(super) pocketed: Vec<f64>,
}

impl ReferenceBreaks {
    /// Reads a file.
    ///
    /// # Errors
    /// A sentence with the file and what is wrong in it.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let read = read_file(path, FILE_BYTES_MAX).and_then(|json| Self::parse(&json));
        read.with_context(|| format!("the draws of breaks {}", path.display()))
    }

    fn parse(json: &str) -> anyhow::Result<Self> {
        let draws: Self = serde_json::from_str(json)?;
        for (name, rack) in &draws.racks {
            for values in [&rack.energy_kept, &rack.spread_m, &rack.pocketed] {
                let count = values.len();
                ensure!(
                    count >= DRAWS_MIN,
                    "{name} has {count} draws, not {DRAWS_MIN}"
                );
            }
        }
        Ok(draws)
    }

    pub(super) fn of(&self, rack: &str) -> Option<&RackSamples> {
        self.racks.get(rack)
    }
}

/// The draws of another simulator beside ours.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ReferenceSample {
    /// Draws.
    pub count: usize,
    /// Over all of them.
    pub mean: f64,
    /// Half of the 95 % confidence interval of the mean.
    pub mean_within: f64,
    /// How often two samples of one lottery differ as much, 0 to 1.
    pub chance: f64,
}

/// All comparisons of a table of statistics together.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BreakAgreement {
    /// Statistics of which there are draws of both simulators.
    pub comparisons: usize,
    /// The smallest chance of them.
    pub chance_least: f64,
    /// How often so many comparisons of equal simulators have as small a chance among them.
    pub chance_together: f64,
    /// Single shots of the references beside our draws.
    pub shots: usize,
    /// How many of their statistics are outside of the middle 95 % of our draws.
    pub outside: usize,
    /// How often as many or more are, of equal simulators.
    pub outside_chance: f64,
}

impl BreakAgreement {
    /// Over the rows of a table.
    pub fn of(rows: &[BreakStatistic]) -> Self {
        let chances: Vec<f64> = rows
            .iter()
            .filter_map(|row| Some(row.theirs?.chance))
            .collect();
        let fits: Vec<bool> = rows
            .iter()
            .filter_map(BreakStatistic::reference_fits)
            .collect();
        let chance_least = chances.iter().copied().fold(1.0, f64::min);
        let outside = fits.iter().filter(|&&fits| !fits).count();
        Self {
            comparisons: chances.len(),
            chance_least,
            chance_together: 1.0 - (1.0 - chance_least).powi(chances.len() as i32),
            shots: fits.len(),
            outside,
            outside_chance: at_least(outside, fits.len(), 0.05),
        }
    }
}

impl fmt::Display for BreakAgreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} of {} statistics of single shots are outside of the middle 95 % of our draws: as many or \
             more are in {:.0} % of such tables",
            self.outside,
            self.shots,
            100.0 * self.outside_chance
        )?;
        write!(
            f,
            "{} comparisons with their own draws: smallest chance {:.3}, which {:.0} % of such tables of \
             equal simulators have (bar {:.0} %)",
            self.comparisons,
            self.chance_least,
            100.0 * self.chance_together,
            100.0 * CHANCE_TOGETHER_MIN
        )
    }
}

/// How often two samples of one lottery lie as far apart as these.
pub(super) fn chance(one: &[f64], other: &[f64]) -> f64 {
    let counts = [one, other].map(|sample| sample.len() as f64);
    let root = (counts[0] * counts[1] / (counts[0] + counts[1])).sqrt();
    let lambda = (root + 0.12 + 0.11 / root) * farthest(one, other);
    let term = |k: u32| {
        let sign = if k % 2 == 1 { 2.0 } else { -2.0 };
        sign * (-2.0 * (f64::from(k) * lambda).powi(2)).exp()
    };
    // Near 0 the series does not converge, and the sum is 1 to all digits.
    if lambda < 0.2 {
        1.0
    } else {
        (1..=100).map(term).sum::<f64>().clamp(0.0, 1.0)
    }
}

/// The largest distance of the cumulative distributions of two samples.
fn farthest(one: &[f64], other: &[f64]) -> f64 {
    let share = |sample: &[f64], value: f64| {
        let below = sample.iter().filter(|&&v| v <= value).count();
        below as f64 / sample.len() as f64
    };
    let values = one.iter().chain(other);
    values
        .map(|&value| (share(one, value) - share(other, value)).abs())
        .fold(0.0, f64::max)
}

/// The chance of `least` or more of `count` things that happen with a chance each.
fn at_least(least: usize, count: usize, each: f64) -> f64 {
    let exactly = |k: usize| {
        let ways: f64 = (0..k)
            .map(|i| (count - i) as f64 / (i + 1) as f64)
            .product();
        ways * each.powi(k as i32) * (1.0 - each).powi((count - k) as i32)
    };
    1.0 - (0..least).map(exactly).sum::<f64>()
}

/// Tables of equal simulators are refused this often.
pub const CHANCE_TOGETHER_MIN: f64 = 0.01;
/// Ten times the known file.
const FILE_BYTES_MAX: u64 = 400 << 10;
/// The approximation is good from here on.
const DRAWS_MIN: usize = 20;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lottery_agrees_with_itself_and_not_with_another() {
        // Equally spread, so that the distances are known: of n values each moved by a share s of
        // their range the distributions are s apart.
        let sample = |n: usize, by: f64| -> Vec<f64> {
            (0..n).map(|i| (i as f64 + 0.5) / n as f64 + by).collect()
        };
        assert_eq!(chance(&sample(200, 0.0), &sample(400, 0.0)), 1.0);
        assert!((farthest(&sample(200, 0.0), &sample(400, 0.1)) - 0.1).abs() < 0.006);
        // The table of Press et al.: Q(1.36) = 0.05, Q(1.63) = 0.01.
        let root = (200.0f64 * 400.0 / 600.0).sqrt();
        for (lambda, expected) in [(1.36, 0.049), (1.63, 0.01)] {
            let by = lambda / (root + 0.12 + 0.11 / root);
            let found = chance(&sample(200, 0.0), &sample(400, by));
            assert!(
                (0.5..2.0).contains(&(found / expected)),
                "{lambda}: {found}"
            );
        }
    }

    #[test]
    fn chances_of_many_draws_are_those_of_the_binomial_law() {
        assert_eq!(at_least(0, 12, 0.05), 1.0);
        assert!((at_least(1, 12, 0.05) - (1.0 - 0.95f64.powi(12))).abs() < 1e-12);
        assert!((at_least(12, 12, 0.5) - 0.5f64.powi(12)).abs() < 1e-12);
    }

    #[test]
    fn what_is_wrong_with_a_file_is_said() {
        let short = r#"{"racks":{"tight":{"energy_kept":[1],"spread_m":[],"pocketed":[]}}}"#;
        for (text, words) in [
            ("{}", "missing field `racks`"),
            (short, "tight has 1 draws"),
        ] {
            let error = format!("{:#}", ReferenceBreaks::parse(text).unwrap_err());
            assert!(error.contains(words), "{error}");
        }
    }
}
