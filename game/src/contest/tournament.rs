//! Matches of computers against each other, without a window: `carom match`.

use std::fmt::Write as _;
use std::sync::atomic::AtomicBool;

use clap::Args;
use serde::Serialize;

use super::{Level, Match, Player, Setup};
use crate::ai::{Skill, think};
use crate::rules::{RuleSet, Verdict};

/// Options of `carom match`.
#[derive(Clone, Debug, Args)]
pub struct MatchArgs {
    /// The game
    #[arg(long, value_enum, default_value_t = RuleSet::Eight)]
    pub rules: RuleSet,
    /// Two computers: ai:easy, ai:medium, ai:hard or ai:expert, separated by a comma
    #[arg(long, default_value = "ai:easy,ai:hard")]
    pub players: String,
    /// Matches to play, 1 to 10000; the players take turns to begin
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub games: u32,
    /// Racks, frames or points that win a match; 0 for the game's own
    #[arg(long, default_value_t = 0)]
    pub target: u32,
    /// Draws the racks and the errors: the same seed gives the same matches
    #[arg(long, default_value_t = 1)]
    pub seed: u32,
    /// Print JSON in place of a table
    #[arg(long)]
    pub json: bool,
}

/// What a series of matches came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tally {
    /// The game.
    pub rules: RuleSet,
    /// The players' side of it.
    pub players: Vec<Side>,
    /// Matches without an end within [`SHOTS_MAX`] shots.
    pub unfinished: u32,
    /// Shots of all matches.
    pub shots: u32,
}

/// One player's side of a series.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Side {
    /// Who.
    pub name: String,
    /// Matches won.
    pub wins: u32,
    /// Shots played.
    pub shots: u32,
    /// Of those, fouls.
    pub fouls: u32,
    /// Balls potted as the rules want it; points by caroms.
    pub pots: u32,
}

impl MatchArgs {
    /// Plays the matches and prints what they came to.
    ///
    /// # Errors
    /// A sentence for players or a target that the game does not have.
    pub fn run(&self) -> anyhow::Result<()> {
        let tally = self.play().map_err(anyhow::Error::msg)?;
        if self.json {
            println!("{}", serde_json::to_string_pretty(&tally)?);
        } else {
            print!("{}", tally.table());
        }
        Ok(())
    }

    /// Plays the matches.
    ///
    /// # Errors
    /// As [`MatchArgs::run`].
    pub fn play(&self) -> Result<Tally, String> {
        if self.rules == RuleSet::Free {
            return Err("the free table has no end and no winner: choose another game".to_owned());
        }
        let players = Player::list(&self.players)?;
        let levels: Vec<Level> = players.iter().filter_map(Player::level).collect();
        let [first, second] = levels[..] else {
            return Err(format!(
                "`{}` are not two computers: try ai:easy,ai:hard",
                self.players
            ));
        };
        let mut tally = Tally::new(self.rules, [first, second]);
        for game in 0..self.games {
            let swapped = game % 2 == 1;
            let order = if swapped {
                [second, first]
            } else {
                [first, second]
            };
            let seed = self.seed.wrapping_add(game.wrapping_mul(SEED_STEP));
            let players = order.map(Player::Computer).to_vec();
            let setup = Setup {
                target: self.target,
                ..Setup::new(self.rules, players, seed)?
            };
            let mut game = Match::new(setup)?;
            play_out(&mut game, SHOTS_MAX)?;
            tally.add(&game, swapped);
        }
        Ok(tally)
    }
}

/// Lets the computers play until the match is over, or for so many shots.
///
/// # Errors
/// A sentence if a person is to play.
pub fn play_out(game: &mut Match, shots_max: u32) -> Result<(), String> {
    for _ in 0..shots_max {
        let Some(player) = game.at_table() else {
            return Ok(());
        };
        let level = player.level();
        let level = level.ok_or_else(|| format!("it is the turn of {player}, a person"))?;
        game.play_computer(&level.into())?;
    }
    Ok(())
}

impl Match {
    /// Thinks for the player at the table and plays what comes of it, errors included: one shot, or a
    /// choice that gives the table to the other.
    ///
    /// # Errors
    /// A sentence if the decision cannot be carried out.
    pub fn play_computer(&mut self, skill: &Skill) -> Result<Option<Verdict>, String> {
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

impl Tally {
    fn new(rules: RuleSet, levels: [Level; 2]) -> Self {
        let side = |level: Level| Side {
            name: level.words().to_owned(),
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

    /// For people to read.
    pub fn table(&self) -> String {
        let mut table = format!(
            "{}\n{:<8} {:>5} {:>7} {:>7} {:>9}\n",
            self.rules.sheet().name,
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

/// A match that lasts longer has no end: the longest seen has about 600 shots.
const SHOTS_MAX: u32 = 3000;
/// Keeps the racks of one match apart from those of the next.
const SEED_STEP: u32 = 7919;

#[cfg(test)]
mod tests {
    use super::*;

    fn series(rules: RuleSet, players: &str, target: u32, games: u32) -> Tally {
        let args = MatchArgs {
            rules,
            players: players.to_owned(),
            games,
            target,
            seed: 3,
            json: false,
        };
        args.play().unwrap()
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
            let tally = series(rules, "ai:easy,ai:medium", target, 1);
            assert_eq!(tally.unfinished, 0, "{rules:?}");
            let wins: u32 = tally.players.iter().map(|side| side.wins).sum();
            assert_eq!(wins, 1, "{rules:?}");
            assert!(tally.shots > 0 && tally.table().contains("easy"));
        }
    }

    #[test]
    fn the_stronger_wins_and_the_same_seed_gives_the_same_matches() {
        let tally = series(RuleSet::Nine, "ai:easy,ai:hard", 1, 8);
        assert!(tally.players[1].wins > tally.players[0].wins, "{tally:?}");
        let few = series(RuleSet::Nine, "ai:easy,ai:hard", 1, 2);
        assert_eq!(few, series(RuleSet::Nine, "ai:easy,ai:hard", 1, 2));
    }

    #[test]
    fn people_and_games_without_an_end_are_refused() {
        let args = |rules, players: &str| MatchArgs {
            rules,
            players: players.to_owned(),
            games: 1,
            target: 0,
            seed: 1,
            json: false,
        };
        assert!(
            args(RuleSet::Nine, "2")
                .play()
                .unwrap_err()
                .contains("two computers")
        );
        assert!(
            args(RuleSet::Free, "ai,ai")
                .play()
                .unwrap_err()
                .contains("no end")
        );
        let too_long = MatchArgs {
            target: 5000,
            ..args(RuleSet::Nine, "ai,ai")
        };
        assert!(too_long.play().unwrap_err().contains("too long"));
    }
}
