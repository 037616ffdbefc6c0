//! The log of a match: player, call, potted balls, outcome and next turn of each shot.

use carom_text::text;

use super::Match;
use crate::rules::{self, Call, Verdict};

impl Match {
    /// Adds a shot to the log.
    pub(super) fn log_shot(
        &mut self,
        player: usize,
        call: Option<Call>,
        potted: &[u8],
        verdict: &Verdict,
    ) {
        let number = self.now.shots;
        let call = call.map_or_else(|| NONE.to_owned(), |call| self.call_text(call));
        let rules = self.referee().rules();
        let names: Vec<String> = potted.iter().map(|&ball| rules.ball_name(ball)).collect();
        let potted = match names.is_empty() {
            true => NONE.to_owned(),
            false => names.join(", "),
        };
        let name = self.players[player].to_string();
        let line = text!(
            "log-shot",
            number = number,
            player = name,
            call = call,
            potted = potted
        );
        self.now.log.push(line);
        self.log_choice(player, verdict);
    }

    /// Adds the sentences of a verdict and the next turn to the log.
    pub(super) fn log_choice(&mut self, player: usize, verdict: &Verdict) {
        let sentences = self.verdict_text(player, verdict);
        self.now.log.extend(sentences.iter().cloned());
        self.now.banner = (!sentences.is_empty()).then(|| sentences.join(". "));
        let turn = self.referee().turn();
        self.now.log.push(match self.referee().winner() {
            Some(winner) => self.result_text(winner),
            None => text!("log-next", player = self.players[turn].to_string()),
        });
        let extra = self.now.log.len().saturating_sub(LOG_MAX);
        self.now.log.drain(..extra);
    }

    /// A verdict's lines as whole sentences: those about the player of the shot begin with the name.
    pub(super) fn verdict_text(&self, player: usize, verdict: &Verdict) -> Vec<String> {
        let name = &self.players[player];
        let sentence = |line: &String| match line.starts_with(char::is_lowercase) {
            true => rules::capital(&format!("{name} {line}")),
            false => line.clone(),
        };
        verdict.lines.iter().map(sentence).collect()
    }
}

/// Argument of the log's message for no call, or no ball.
const NONE: &str = "none";
/// Maximum number of lines: as many as anyone would scroll through.
const LOG_MAX: usize = 4000;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ai::Level;
    use crate::game_match::{MatchConfig, Player};
    use crate::physics::Stroke;
    use crate::rules::RuleSet;

    fn after(strokes: &[(f64, f64)]) -> Match {
        let players = vec![
            Player::Human("You".to_owned()),
            Player::Computer(Level::Medium),
        ];
        let mut game = Match::new(MatchConfig::new(RuleSet::Nine, players, 3).unwrap()).unwrap();
        for &(direction_rad, speed_m_s) in strokes {
            let stroke = Stroke::straight(direction_rad, speed_m_s);
            let shot = game.strike(stroke).unwrap();
            game.finish(stroke, &shot);
        }
        game
    }

    #[test]
    fn fouls_name_who_fouled() {
        let game = after(&[(1.5, 0.1), (1.5, 0.1)]);
        let told = |who: &str| format!("{who} fouled: the cue ball touched no ball");
        let banner = game.view().banner.unwrap();
        assert!(banner.starts_with(&told("Computer (medium)")), "{banner}");
        let mut log = game.log().iter();
        assert!(
            log.any(|line| line.starts_with(&told("You"))),
            "{:?}",
            game.log()
        );
    }

    #[test]
    fn winners_are_told_in_plain_english() {
        let mut game = after(&[]);
        game.concede();
        assert_eq!(game.view().prompt, "Computer (medium) won the match");
        assert_eq!(game.view().banner.unwrap(), "You conceded");
        let mut game = after(&[(1.5, 0.1)]);
        game.concede();
        assert_eq!(game.view().prompt, "You won the match");
        assert_eq!(game.log().last().unwrap(), "You won the match");
    }

    #[test]
    fn the_log_tells_pots_calls_and_turns() {
        let mut game = after(&[(0.0, 9.0)]);
        let potted = game.turns()[0].verdict.pots.clone();
        let first = &game.log()[0];
        assert!(first.starts_with("1. You: "), "{first}");
        for ball in potted {
            assert!(first.contains(&format!("the {ball}")), "{first}");
        }
        game.call(Some(Call::PushOut));
        let stroke = Stroke::straight(0.3, 1.0);
        let shot = game.strike(stroke).unwrap();
        game.finish(stroke, &shot);
        let log = game.log();
        assert!(
            log.iter().any(|line| line.contains("called a push-out")),
            "{log:?}"
        );
        assert!(log.last().unwrap().starts_with("Next: "), "{log:?}");
    }
}
