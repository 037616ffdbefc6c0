//! Breaks sampled by another simulator, and a test whether ours have the same distribution.
//!
//! Two samples are compared as a whole, not by their means: by the largest distance of their cumulative
//! distributions, and the probability that two samples of one distribution are as far apart
//! (Kolmogorov–Smirnov, with Stephens' approximation; Press et al., "Numerical Recipes", 14.3). Many
//! comparisons have small p-values among them by chance, so that they are corrected together (Šidák).

use std::{collections::BTreeMap, path::Path};

use anyhow::{Context as _, ensure};
use serde::{Deserialize, Serialize};

use super::reference::read_file;

/// The draws of another simulator, by the name of the rack.
#[derive(Clone, Debug, Deserialize)]
pub struct ReferenceBreaks {
    racks: BTreeMap<String, RackSamples>,
}

/// Samples of one rack, one number a draw.
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

/// Summary of the draws of another simulator, compared with ours.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ReferenceSample {
    /// Number of draws.
    pub count: usize,
    /// Mean of all draws.
    pub mean: f64,
    /// Half of the 95 % confidence interval of the mean.
    pub mean_within: f64,
    /// p-value: probability that two samples of one distribution differ as much, 0 to 1.
    pub chance: f64,
}

/// Probability that two samples of one distribution are as far apart as these.
pub(super) fn chance(one: &[f64], other: &[f64]) -> f64 {
    let counts = [one, other].map(|sample| sample.len() as f64);
    let root = (counts[0] * counts[1] / (counts[0] + counts[1])).sqrt();
    // Stephens' correction for small samples; the series is the tail of Kolmogorov's distribution.
    let lambda = (root + 0.12 + 0.11 / root) * farthest(one, other);
    let term = |k: u32| {
        let sign = if k % 2 == 1 { 2.0 } else { -2.0 };
        sign * (-2.0 * (f64::from(k) * lambda).powi(2)).exp()
    };
    // Near 0 the series does not converge, and its sum is 1 to all digits.
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

/// Maximum size of a file: ten times the known one.
const FILE_BYTES_MAX: u64 = 400 << 10;
/// Minimum number of draws, from which on the approximation is good.
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
