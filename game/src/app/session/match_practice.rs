//! Practice during a match: a free table with the balls of a layout, while the match is suspended.

use carom_billiards::game_match::Match;
use carom_billiards::rules::RuleSet;
use carom_text::text;

use super::GameSession;
use crate::input::MatchIntent;
use crate::play::practice::PracticeLayout;
use crate::play::{Game, free_table};

/// A match that is suspended while its player practises.
pub(super) struct InterruptedMatch {
    game: Box<Game>,
    /// The practised layout.
    layout: PracticeLayout,
}

impl InterruptedMatch {
    /// The suspended match, or the one that is played.
    pub(super) fn contest<'a>(waiting: Option<&'a Self>, played: &'a Game) -> &'a Match {
        waiting.map_or(played, |waiting| &waiting.game).contest()
    }
}

impl GameSession {
    /// Continues play from a layout: on the present free table, or on a new one in the same room while the
    /// match is suspended.
    ///
    /// # Errors
    /// If the balls cannot be placed like this; nothing has changed then.
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

    /// Whether a match is suspended.
    pub fn has_interrupted_match(&self) -> bool {
        self.interrupted.is_some()
    }

    /// Resumes the suspended match, if there is one.
    pub fn resume_match(&mut self) {
        if let Some(mut waiting) = self.interrupted.take() {
            waiting.game.inherit_options(&self.game);
            self.game = *waiting.game;
            self.is_dirty = true;
        }
    }

    /// Restores the practised layout if the intent is to rack the balls during practice; returns whether it
    /// was handled.
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
