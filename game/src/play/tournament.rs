//! Tournaments of computer players, without a window: `carom tournament`.

use carom_billiards::ai::Level;
use carom_billiards::game_match::{Player, Tournament, TournamentResult};
use carom_billiards::rules::RuleSet;
use clap::Args;

/// Options of `carom tournament`.
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

impl MatchArgs {
    /// Plays the matches and prints what they came to.
    ///
    /// # Errors
    /// A sentence for players or a target that the game does not have.
    pub fn run(&self) -> anyhow::Result<()> {
        let tally = self.play()?;
        if self.json {
            println!("{}", serde_json::to_string_pretty(&tally)?);
        } else {
            print!("{}", tally.table());
        }
        Ok(())
    }

    fn play(&self) -> anyhow::Result<TournamentResult> {
        let players = Player::list(&self.players)?;
        let levels: Vec<Level> = players.iter().filter_map(Player::level).collect();
        let Ok(levels) = levels.try_into() else {
            anyhow::bail!(
                "`{}` are not two computers: try ai:easy,ai:hard",
                self.players
            );
        };
        let tournament = Tournament {
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
    fn people_are_refused() {
        let args = MatchArgs {
            rules: RuleSet::Nine,
            players: "2".to_owned(),
            games: 1,
            target: 0,
            seed: 1,
            json: false,
        };
        assert!(
            args.play()
                .unwrap_err()
                .to_string()
                .contains("two computers")
        );
    }
}
