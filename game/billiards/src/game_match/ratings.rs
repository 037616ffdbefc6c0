//! Ratings of computer players from round-robin matches.
//!
//! By the Bradley–Terry model ("Rank analysis of incomplete block designs", Biometrika 39, 1952) on
//! Elo's scale: a player rated 400 points higher wins ten times as often as the other. The ratings are
//! the maximum-likelihood estimates, and their errors follow from the Fisher information of the matches
//! (the Cramér–Rao bound).

use std::fmt::Write as _;

use serde::Serialize;

use super::{Tournament, TournamentResult};
use crate::Result;
use crate::ai::Level;
use crate::rules::RuleSet;

/// A round robin: matches of each level against each other.
#[derive(Clone, Debug)]
pub struct RoundRobin {
    /// The game.
    pub rules: RuleSet,
    /// The levels, two or more.
    pub levels: Vec<Level>,
    /// Number of matches of each pair.
    pub games: u32,
    /// Racks, frames or points that win a match; 0 for the game's own.
    pub target: u32,
    /// Seed of the racks and the errors: the same seed gives the same matches.
    pub seed: u32,
}

/// Result of a round robin.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RoundRobinResult {
    /// Results of each pair.
    pub pairs: Vec<TournamentResult>,
    /// Ratings of the levels, in the order given.
    pub ratings: Vec<LevelRating>,
}

/// A level's rating.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelRating {
    /// The level.
    pub name: String,
    /// Its rating.
    #[serde(flatten)]
    pub rating: Rating,
}

/// A rating on Elo's scale, relative to that of the first player.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Rating {
    /// Rating in points.
    pub points: f64,
    /// Standard error of the points.
    pub error: f64,
}

impl RoundRobin {
    /// Plays the matches.
    ///
    /// # Errors
    /// Those of [`Tournament::play`].
    pub fn play(&self) -> Result<RoundRobinResult> {
        let count = self.levels.len();
        let mut wins = vec![vec![0; count]; count];
        let mut results = Vec::new();
        let pairs = (1..count).flat_map(|second| (0..second).map(move |first| [first, second]));
        for [first, second] in pairs {
            let tournament = Tournament {
                rules: self.rules,
                levels: [self.levels[first], self.levels[second]],
                games: self.games,
                target: self.target,
                seed: self.seed,
            };
            let result = tournament.play()?;
            wins[first][second] = result.players[0].wins;
            wins[second][first] = result.players[1].wins;
            results.push(result);
        }
        let name = |level: &Level| level.key().to_owned();
        let names = self.levels.iter().map(name);
        let ratings = names
            .zip(ratings(&wins))
            .map(|(name, rating)| LevelRating { name, rating })
            .collect();
        Ok(RoundRobinResult {
            pairs: results,
            ratings,
        })
    }
}

impl RoundRobinResult {
    /// Formats the result as a table of text.
    pub fn table(&self) -> String {
        let mut table = String::new();
        for pair in &self.pairs {
            table += &pair.table();
            table.push('\n');
        }
        // Writing to a string cannot fail.
        let _ = writeln!(
            table,
            "{:<8} {:>7} {:>15}",
            "player", "rating", "standard error"
        );
        for LevelRating { name, rating } in &self.ratings {
            let Rating { points, error } = rating;
            let _ = writeln!(table, "{name:<8} {points:>7.0} {error:>15.0}");
        }
        table
    }
}

/// Ratings relative to the first player's; `wins[i][j]` are the matches that player i has won against
/// player j. Half a match is added to the wins of either player of a pair, so that a player who lost
/// all has a finite rating.
fn ratings(wins: &[Vec<u32>]) -> Vec<Rating> {
    let count = wins.len();
    let won = |i: usize, j: usize| f64::from(wins[i][j]) + 0.5;
    let mut points = vec![0.0; count];
    let mut inverse = vec![Vec::new(); count];
    for _ in 0..NEWTON_STEPS {
        let mut gradient = vec![0.0; count];
        let mut information = vec![vec![0.0; count]; count];
        for i in 0..count {
            for j in (0..count).filter(|&j| j != i) {
                let matches = won(i, j) + won(j, i);
                // The model's probability that i beats j; gradient and information are those of a
                // binomial likelihood.
                let share = 1.0 / (1.0 + libm::exp((points[j] - points[i]) * PER_POINT));
                gradient[i] += PER_POINT * (won(i, j) - matches * share);
                let weight = PER_POINT * PER_POINT * matches * share * (1.0 - share);
                information[i][i] += weight;
                information[i][j] -= weight;
            }
        }
        // Only differences of ratings are determined: the first is fixed. The information is the
        // negated Hessian of the log-likelihood, so that this is Newton's method.
        inverse = inverse_without_first(&information);
        for i in 1..count {
            let step: f64 = (1..count).map(|j| inverse[i][j] * gradient[j]).sum();
            points[i] += step.clamp(-STEP_MAX, STEP_MAX);
        }
    }
    let error = |i: usize| inverse[i].get(i).copied().unwrap_or(0.0).sqrt();
    let rating = |(i, &points): (usize, &f64)| Rating {
        points,
        error: error(i),
    };
    points.iter().enumerate().map(rating).collect()
}

/// The inverse of a positive definite matrix without its first row and column, whose places hold zeros:
/// Gauss–Jordan elimination on the matrix augmented by the identity.
fn inverse_without_first(matrix: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let count = matrix.len();
    let beside = |(i, row): (usize, &Vec<f64>)| -> Vec<f64> {
        let unit = (0..count).map(|j| f64::from(u8::from(i == j && i > 0)));
        row.iter().copied().chain(unit).collect()
    };
    let mut rows: Vec<_> = matrix.iter().enumerate().map(beside).collect();
    for pivot in 1..count {
        let scale = 1.0 / rows[pivot][pivot];
        let scaled: Vec<_> = rows[pivot].iter().map(|value| value * scale).collect();
        for (i, row) in rows.iter_mut().enumerate().skip(1) {
            let factor = row[pivot];
            if i != pivot {
                let pairs = row.iter_mut().zip(&scaled);
                pairs.for_each(|(value, of_pivot)| *value -= factor * of_pivot);
            }
        }
        rows[pivot] = scaled;
    }
    rows.into_iter().map(|row| row[count..].to_vec()).collect()
}

/// Change of the log-odds of a win per point: ln 10 / 400.
const PER_POINT: f64 = std::f64::consts::LN_10 / 400.0;
/// Number of Newton steps, far more than needed: near the optimum each doubles the digits.
const NEWTON_STEPS: u32 = 100;
/// Largest step in points, so that the first steps cannot overshoot.
const STEP_MAX: f64 = 200.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_players_have_elos_difference_and_its_binomial_error() {
        let half_added = ratings(&[vec![0, 99], vec![299, 0]]);
        let (won, lost) = (299.5f64, 99.5f64);
        let points = (won / lost).log10() * 400.0;
        assert!(
            (half_added[1].points - points).abs() < 1e-9,
            "{half_added:?}"
        );
        let share = won / (won + lost);
        let information = PER_POINT.powi(2) * (won + lost) * share * (1.0 - share);
        assert!((half_added[1].error - information.sqrt().recip()).abs() < 1e-9);
        assert_eq!(half_added[0], Rating::default());
    }

    #[test]
    fn ratings_give_back_the_strengths_that_made_the_results() {
        let strengths = [0.0, 120.0, 400.0, 650.0f64];
        let expected = |i: usize, j: usize| {
            let share = 1.0 / (1.0 + 10f64.powf((strengths[j] - strengths[i]) / 400.0));
            (1e6 * share).round() as u32
        };
        let wins: Vec<Vec<u32>> = (0..4)
            .map(|i| {
                (0..4)
                    .map(|j| if i == j { 0 } else { expected(i, j) })
                    .collect()
            })
            .collect();
        for (rating, strength) in ratings(&wins).iter().zip(strengths) {
            assert!((rating.points - strength).abs() < 0.01, "{rating:?}");
            assert!(rating.error < 1.0);
        }
    }

    #[test]
    fn a_player_who_lost_every_match_is_rated_with_a_wide_error() {
        let lost = ratings(&[vec![0, 0, 5], vec![20, 0, 18], vec![15, 2, 0]]);
        assert!(lost[1].points > lost[2].points && lost[2].points > 0.0);
        assert!(lost[1].points.is_finite() && lost[1].error > 100.0);
    }

    #[test]
    fn each_plays_each_and_the_stronger_is_rated_higher() {
        let tournament = RoundRobin {
            rules: RuleSet::Nine,
            levels: vec![Level::Easy, Level::Medium, Level::Hard],
            games: 6,
            target: 1,
            seed: 3,
        };
        let result = tournament.play().unwrap();
        assert_eq!(result.pairs.len(), 3);
        let points: Vec<f64> = result.ratings.iter().map(|of| of.rating.points).collect();
        assert!(points[0] < points[1] && points[1] < points[2], "{points:?}");
        let table = result.table();
        assert!(
            table.contains("standard error") && table.contains("hard"),
            "{table}"
        );
    }
}
