//! The shots of a match as a recording, for replay and sharing.

use super::{Match, TurnRecord};
use crate::Result;
use crate::physics::{Clip, Recording, TITLE_BYTES_MAX};

impl Match {
    /// All shots, also those that were taken back, each with the player and the outcome. They are
    /// simulated again, which gives the same shots and takes a few milliseconds each, seconds with
    /// particles.
    ///
    /// # Errors
    /// Those of [`crate::physics::World::strike`], which did not occur in the match.
    pub fn recording(&self) -> Result<Recording> {
        let undone = self.undone.iter().map(|undone| (&undone.turn, " (undone)"));
        let mut turns: Vec<_> = self
            .past
            .iter()
            .map(|turn| (turn, ""))
            .chain(undone)
            .collect();
        turns.sort_by_key(|(turn, _)| turn.number);
        let clip = |(index, &(turn, mark)): (usize, &(&TurnRecord, &str))| {
            Ok(Clip {
                title: self.title(index + 1, turn, mark),
                shot: turn.world().strike(turn.stroke)?,
            })
        };
        Ok(Recording {
            table: self.world().table().name().to_owned(),
            clips: turns.iter().enumerate().map(clip).collect::<Result<_>>()?,
        })
    }

    fn title(&self, number: usize, turn: &TurnRecord, mark: &str) -> String {
        let mut title = format!("{number}. {}{mark}", self.players()[turn.player]);
        let sentences = self.verdict_text(turn.player, &turn.verdict);
        if !sentences.is_empty() {
            title += &format!(": {}", sentences.join(". "));
        }
        let letters = title.chars().filter(|letter| !letter.is_control());
        let mut bytes = 0;
        letters
            .take_while(|letter| {
                bytes += letter.len_utf8();
                bytes <= TITLE_BYTES_MAX
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::game_match::{MatchConfig, Player, play_out};
    use crate::rules::RuleSet;

    #[test]
    fn a_match_is_recorded_as_it_was_played() {
        let players = Player::list("ai:easy,ai:easy").unwrap();
        let mut game = Match::new(MatchConfig::new(RuleSet::Nine, players, 5).unwrap()).unwrap();
        assert!(game.recording().unwrap().clips.is_empty());
        play_out(&mut game, 5).unwrap();
        let recording = game.recording().unwrap();
        assert_eq!(recording.clips.len(), game.turns().len());
        assert!(recording.clips[0].title.starts_with("1. Computer (easy)"));
        let last = &recording.clips[recording.clips.len() - 1];
        let cue_ball = |balls: &[crate::physics::BallState]| balls[0].position;
        // Potted balls are spotted after a shot: a ball that was not potted lies where the shot left
        // it.
        let after = game.world().balls();
        let stayed = last
            .shot
            .final_states()
            .into_iter()
            .find(|ball| ball.number != 0 && ball.phase.is_on_table());
        let stayed = stayed.unwrap();
        let lies = after
            .iter()
            .find(|ball| ball.number == stayed.number)
            .unwrap();
        assert_eq!(lies.position, stayed.position);
        let again = Recording::from_bytes(&recording.to_bytes().unwrap()).unwrap();
        let (one, two) = (&again.clips[0].shot, &recording.clips[0].shot);
        assert_eq!(cue_ball(&one.states_at(0.3)), cue_ball(&two.states_at(0.3)));
    }
}
