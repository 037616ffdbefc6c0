//! Practice beside a match: a free table with the balls of a layout, while the match waits.

use carom_billiards::game_match::Match;
use carom_billiards::rules::RuleSet;
use carom_text::text;

use super::GameSession;
use crate::input::MatchIntent;
use crate::play::practice::PracticeLayout;
use crate::play::{Game, free_table};

/// A match that waits while its player practises.
pub(super) struct InterruptedMatch {
    game: Box<Game>,
    /// What is practised.
    layout: PracticeLayout,
}

impl InterruptedMatch {
    /// The match that waits, or the one that is played.
    pub(super) fn contest<'a>(waiting: Option<&'a Self>, played: &'a Game) -> &'a Match {
        waiting.map_or(played, |waiting| &waiting.game).contest()
    }
}

impl GameSession {
    /// Plays on from a layout: on the free table, or on one beside the match, in the same room.
    ///
    /// # Errors
    /// A sentence if the balls cannot lie like this; all stays as it was.
    pub(super) fn play_from(&mut self, layout: PracticeLayout) -> carom_billiards::Result<()> {
        if self.game.contest().referee().rules() == RuleSet::Free {
            self.game.lay(&layout)?;
            if let Some(waiting) = &mut self.interrupted {
                waiting.layout = layout;
            }
            return Ok(());
        }
        let (table, seed) = (
            self.game.table().clone(),
            self.game.contest().referee().seed(),
        );
        let mut practice = Game::of(free_table(table, seed)?);
        practice.inherit_options(&self.game);
        practice.set_framing(self.game.framing());
        practice.lay(&layout)?;
        let game = Box::new(std::mem::replace(&mut self.game, practice));
        self.interrupted = Some(InterruptedMatch { game, layout });
        self.modes.notify(text!("match-waits").to_owned());
        Ok(())
    }

    /// Whether a match waits until practice is over.
    pub fn has_interrupted_match(&self) -> bool {
        self.interrupted.is_some()
    }

    /// Goes back to the match that waits, if there is one.
    pub fn resume_match(&mut self) {
        if let Some(mut waiting) = self.interrupted.take() {
            waiting.game.inherit_options(&self.game);
            self.game = *waiting.game;
            self.is_dirty = true;
        }
    }

    /// Lays the balls that are practised beside a match again, if the intent is to rack them; false if not.
    pub(super) fn lays_again(&mut self, intent: MatchIntent) -> bool {
        let Some(waiting) = &self.interrupted else {
            return false;
        };
        if intent != MatchIntent::Rack {
            return false;
        }
        if let Err(why) = self.game.lay(&waiting.layout) {
            self.modes.notify(why.to_string());
        }
        true
    }
}
