//! Tournaments of computer players, without a window: `carom tournament`.

use carom_billiards::ai::Level;
use carom_billiards::game_match::{Player, RoundRobin, RoundRobinResult};
use carom_billiards::rules::RuleSet;
use clap::Args;

/// Options of `carom tournament`.
#[derive(Clone, Debug, Args)]
pub struct MatchArgs {
    /// The game
    #[arg(long, value_enum, default_value_t = RuleSet::Eight)]
    pub rules: RuleSet,
    /// Two to four computers, each against each: ai:easy, ai:medium, ai:hard or ai:expert, separated by commas
    #[arg(long, default_value = "ai:easy,ai:hard")]
    pub players: String,
    /// Matches of each pair, 1 to 10000; the players take turns to begin
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

impl MatchArgs {
    /// Plays the matches and prints the results.
    ///
    /// # Errors
    /// If the players or the target are invalid for the game.
    pub fn run(&self) -> anyhow::Result<()> {
        let result = self.play()?;
        if self.json {
            println!("{}", serde_json::to_string_pretty(&result)?);
        } else {
            print!("{}", result.table());
        }
        Ok(())
    }

    fn play(&self) -> anyhow::Result<RoundRobinResult> {
        let players: Vec<Player> = self
            .players
            .split(',')
            .map(str::parse)
            .collect::<Result<_, _>>()?;
        let levels: Vec<Level> = players.iter().filter_map(Player::level).collect();
        if levels.len() != players.len() || !(2..=Level::ALL.len()).contains(&levels.len()) {
            anyhow::bail!(
                "`{}` are not two to four computers: try ai:easy,ai:hard",
                self.players
            );
        }
        let tournament = RoundRobin {
            rules: self.rules,
            levels,
            games: self.games,
            target: self.target,
            seed: self.seed,
        };
        Ok(tournament.play()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_to_four_computers_play_and_people_are_refused() {
        let result = |players: &str| {
            let args = MatchArgs {
                rules: RuleSet::Nine,
                players: players.to_owned(),
                games: 1,
                target: 1,
                seed: 1,
                json: false,
            };
            args.play()
        };
        for wrong in ["Ada,ai:easy", "ai:easy", "ai,ai,ai,ai,ai"] {
            let error = result(wrong).unwrap_err().to_string();
            assert!(error.contains("two to four computers"), "{error}");
        }
        assert_eq!(result("ai:easy,ai:hard").unwrap().pairs.len(), 1);
        assert_eq!(result("ai:easy,ai:medium,ai:hard").unwrap().pairs.len(), 3);
    }
}
