//! Series of matches between computer players.

use std::fmt::Write as _;
use std::sync::atomic::AtomicBool;

use serde::Serialize;

use super::{Match, MatchConfig, Player};
use crate::ai::{Level, Skill, think};
use crate::rules::{RuleSet, Verdict};
use crate::{Result, RuleFault};

/// A series of matches between two computers.
#[derive(Clone, Debug)]
pub struct Tournament {
    /// The game.
    pub rules: RuleSet,
    /// Levels of the two; they alternate in beginning.
    pub levels: [Level; 2],
    /// Number of matches.
    pub games: u32,
    /// Racks, frames or points that win a match; 0 for the game's own.
    pub target: u32,
    /// Seed of the racks and the errors: the same seed gives the same matches.
    pub seed: u32,
}

/// Result of a series of matches.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TournamentResult {
    /// The game.
    pub rules: RuleSet,
    /// Results of each player.
    pub players: Vec<PlayerTally>,
    /// Matches without an end within [`SHOTS_MAX`] shots.
    pub unfinished: u32,
    /// Shots of all matches.
    pub shots: u32,
}

/// Result of one player in a series.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlayerTally {
    /// Name of the level.
    pub name: String,
    /// Matches won.
    pub wins: u32,
    /// Shots played.
    pub shots: u32,
    /// Number of fouls among them.
    pub fouls: u32,
    /// Legally potted balls; in carom, points.
    pub pots: u32,
}

impl Tournament {
    /// Plays the matches.
    ///
    /// # Errors
    /// [`RuleFault`]s for a game without an end, or a target that the game does not have.
    pub fn play(&self) -> Result<TournamentResult> {
        if self.rules == RuleSet::Free {
            return Err(RuleFault::NoWinner.into());
        }
        let [first, second] = self.levels;
        let mut tally = TournamentResult::new(self.rules, [first, second]);
        for game in 0..self.games {
            let swapped = game % 2 == 1;
            let order = if swapped {
                [second, first]
            } else {
                [first, second]
            };
            let seed = self.seed.wrapping_add(game.wrapping_mul(SEED_STEP));
            let players = order.map(Player::Computer).to_vec();
            let config = MatchConfig {
                target: self.target,
                ..MatchConfig::new(self.rules, players, seed)?
            };
            let mut game = Match::new(config)?;
            play_out(&mut game, SHOTS_MAX)?;
            tally.add(&game, swapped);
        }
        Ok(tally)
    }
}

/// Lets the computers play until the match is over, for at most `shots_max` shots.
///
/// # Errors
/// [`RuleFault::PersonsTurn`] if a person is to play.
pub fn play_out(game: &mut Match, shots_max: u32) -> Result<()> {
    for _ in 0..shots_max {
        let Some(player) = game.at_table() else {
            return Ok(());
        };
        let level = player
            .level()
            .ok_or_else(|| RuleFault::PersonsTurn(player.name()))?;
        game.play_computer(&level.into())?;
    }
    Ok(())
}

impl Match {
    /// Searches for the player at the table and carries the decision out, with errors: one shot, or a
    /// choice that gives the table to the other.
    ///
    /// # Errors
    /// Those of [`Match::carry_out`].
    pub fn play_computer(&mut self, skill: &Skill) -> Result<Option<Verdict>> {
        let decision = think(
            &self.position(),
            skill,
            self.draw_seed(),
            &AtomicBool::new(false),
        );
        let Some((stroke, shot)) = self.carry_out(&decision, skill)? else {
            return Ok(None);
        };
        Ok(Some(self.finish(stroke, &shot).clone()))
    }
}

impl TournamentResult {
    fn new(rules: RuleSet, levels: [Level; 2]) -> Self {
        let side = |level: Level| PlayerTally {
            name: level.key().to_owned(),
            wins: 0,
            shots: 0,
            fouls: 0,
            pots: 0,
        };
        Self {
            rules,
            players: levels.map(side).to_vec(),
            unfinished: 0,
            shots: 0,
        }
    }

    fn add(&mut self, game: &Match, swapped: bool) {
        let side = |player: usize| if swapped { 1 - player } else { player };
        match game.referee().winner() {
            Some(winner) => self.players[side(winner)].wins += 1,
            None => self.unfinished += 1,
        }
        for turn in game.turns() {
            let side = &mut self.players[side(turn.player)];
            side.shots += 1;
            side.fouls += u32::from(turn.verdict.is_foul());
            let caroms = turn.verdict.points.max(0) as u32;
            side.pots += if self.rules == RuleSet::ThreeCushion {
                caroms
            } else {
                turn.verdict.pots.len() as u32
            };
            self.shots += 1;
        }
    }

    /// Formats the result as a table of text.
    pub fn table(&self) -> String {
        let mut table = format!(
            "{}\n{:<8} {:>5} {:>7} {:>7} {:>9}\n",
            self.rules.info().name,
            "player",
            "wins",
            "shots",
            "fouls",
            "per shot"
        );
        for side in &self.players {
            let per_shot = f64::from(side.pots) / f64::from(side.shots.max(1));
            // Writing to a string cannot fail.
            let _ = writeln!(
                table,
                "{:<8} {:>5} {:>7} {:>7} {:>9.2}",
                side.name, side.wins, side.shots, side.fouls, per_shot
            );
        }
        let _ = writeln!(table, "unfinished: {}", self.unfinished);
        table
    }
}

/// Maximum number of shots, after which a match counts as unfinished: the longest seen has about 600.
const SHOTS_MAX: u32 = 3000;
/// Difference of the seeds of consecutive matches, which keeps their racks apart.
const SEED_STEP: u32 = 7919;

#[cfg(test)]
mod tests {
    use super::*;

    fn series(rules: RuleSet, levels: [Level; 2], target: u32, games: u32) -> TournamentResult {
        let tournament = Tournament {
            rules,
            levels,
            games,
            target,
            seed: 3,
        };
        tournament.play().unwrap()
    }

    #[test]
    fn a_whole_match_of_computers_ends_in_each_game() {
        for (rules, target) in [
            (RuleSet::Eight, 1),
            (RuleSet::Nine, 1),
            (RuleSet::Straight, 6),
            (RuleSet::Snooker, 1),
            (RuleSet::ThreeCushion, 1),
        ] {
            let tally = series(rules, [Level::Easy, Level::Medium], target, 1);
            assert_eq!(tally.unfinished, 0, "{rules:?}");
            let wins: u32 = tally.players.iter().map(|side| side.wins).sum();
            assert_eq!(wins, 1, "{rules:?}");
            assert!(tally.shots > 0 && tally.table().contains("easy"));
        }
    }

    #[test]
    fn stronger_players_win_and_seeds_repeat_matches() {
        let tally = series(RuleSet::Nine, [Level::Easy, Level::Hard], 1, 8);
        assert!(tally.players[1].wins > tally.players[0].wins, "{tally:?}");
        let few = series(RuleSet::Nine, [Level::Easy, Level::Hard], 1, 2);
        assert_eq!(few, series(RuleSet::Nine, [Level::Easy, Level::Hard], 1, 2));
    }

    #[test]
    fn games_without_an_end_and_too_long_ones_are_refused() {
        let refused = |rules, target| {
            let tournament = Tournament {
                rules,
                levels: [Level::Medium; 2],
                games: 1,
                target,
                seed: 1,
            };
            tournament.play().unwrap_err().to_string()
        };
        assert!(refused(RuleSet::Free, 0).contains("no end"));
        assert!(refused(RuleSet::Nine, 5000).contains("too long"));
    }
}
