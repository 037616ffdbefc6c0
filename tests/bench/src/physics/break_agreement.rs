//! Agreement of a whole table of break statistics with another simulator, corrected for multiple
//! comparisons (Šidák).

use std::fmt;

use serde::Serialize;

use super::breaks::BreakStatistic;

/// All comparisons of a table of statistics.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BreakAgreement {
    /// Number of statistics of which there are draws of both simulators.
    pub comparisons: usize,
    /// Smallest p-value of the comparisons.
    pub chance_least: f64,
    /// Probability that as many comparisons of equal simulators have as small a p-value among them:
    /// Šidák's correction.
    pub chance_together: f64,
    /// Number of statistics of the references' single shots.
    pub shots: usize,
    /// Number of these outside the middle 95 % of our draws.
    pub outside: usize,
    /// Probability of as many or more, for equal simulators.
    pub outside_chance: f64,
}

impl BreakAgreement {
    /// Agreement over the rows of a table.
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

/// Binomial probability of `least` or more of `count` independent events with the probability `each`.
fn at_least(least: usize, count: usize, each: f64) -> f64 {
    let exactly = |k: usize| {
        let ways: f64 = (0..k)
            .map(|i| (count - i) as f64 / (i + 1) as f64)
            .product();
        ways * each.powi(k as i32) * (1.0 - each).powi((count - k) as i32)
    };
    1.0 - (0..least).map(exactly).sum::<f64>()
}

/// Significance level: share of tables of equal simulators that are rejected.
pub const CHANCE_TOGETHER_MIN: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chances_of_draws_follow_the_binomial_law() {
        assert_eq!(at_least(0, 12, 0.05), 1.0);
        assert!((at_least(1, 12, 0.05) - (1.0 - 0.95f64.powi(12))).abs() < 1e-12);
        assert!((at_least(12, 12, 0.5) - 0.5f64.powi(12)).abs() < 1e-12);
    }
}
