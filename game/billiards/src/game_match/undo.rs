//! Undo and redo of shots.

use super::{Match, MatchAction, Snapshot, TURNS_MAX, TurnRecord};

/// A shot that was taken back.
#[derive(Clone, Debug)]
pub(super) struct UndoneTurn {
    pub(super) turn: TurnRecord,
    after: Snapshot,
    actions: Vec<MatchAction>,
}

impl Match {
    /// Takes the last shot back, with the choices since. False if there is none, or in a drill, whose
    /// attempts count.
    pub fn undo(&mut self) -> bool {
        if self.undo_count() == 0 {
            return false;
        }
        let Some(turn) = self.past.pop() else {
            return false;
        };
        let after = std::mem::replace(&mut self.now, turn.before.clone());
        let actions = self.actions.split_off(turn.actions_before);
        self.redoable += 1;
        self.undone.push(UndoneTurn {
            turn,
            after,
            actions,
        });
        if self.undone.len() > TURNS_MAX {
            self.undone.remove(0);
        }
        true
    }

    /// Number of shots that can be taken back.
    pub(super) fn undo_count(&self) -> usize {
        match self.referee().rules().is_drill() {
            true => 0,
            false => self.past.len(),
        }
    }

    /// Reverts the last undo. False if there is none, or if something was done since.
    pub fn redo(&mut self) -> bool {
        if self.redoable == 0 {
            return false;
        }
        let Some(undone) = self.undone.pop() else {
            return false;
        };
        self.redoable -= 1;
        self.past.push(undone.turn);
        self.now = undone.after;
        self.actions.extend(undone.actions);
        true
    }

    /// Whether [`Match::redo`] has something to do.
    pub fn may_redo(&self) -> bool {
        self.redoable > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::game_match::{MatchConfig, Player};
    use crate::physics::Stroke;
    use crate::rules::RuleSet;

    fn play(game: &mut Match, stroke: Stroke) {
        let shot = game.strike(stroke).unwrap();
        game.finish(stroke, &shot);
    }

    fn nine() -> Match {
        let players = Player::list("Ada,Bo").unwrap();
        Match::new(MatchConfig::new(RuleSet::Nine, players, 3).unwrap()).unwrap()
    }

    #[test]
    fn redo_restores_what_undo_took_back() {
        let mut game = nine();
        for speed in [8.0, 0.3, 2.0] {
            play(&mut game, Stroke::straight(0.1, speed));
        }
        let (view, actions) = (game.view(), game.action_count());
        assert!(!game.may_redo() && !game.redo());
        assert!(game.undo() && game.undo() && game.may_redo());
        assert!(game.redo() && game.redo() && !game.redo());
        assert_eq!((game.view(), game.action_count()), (view, actions));
        game.undo();
        play(&mut game, Stroke::straight(0.1, 1.0));
        assert!(!game.redo(), "another shot was played");
    }

    #[test]
    fn undone_shots_stay_in_the_recording() {
        let mut game = nine();
        for speed in [8.0, 2.0] {
            play(&mut game, Stroke::straight(0.1, speed));
        }
        game.undo();
        play(&mut game, Stroke::straight(0.1, 3.0));
        let clips = game.recording().unwrap().clips;
        let titles: Vec<&str> = clips.iter().map(|clip| clip.title.as_str()).collect();
        assert_eq!(clips.len(), 3);
        let undone: Vec<bool> = titles.iter().map(|t| t.contains("(undone)")).collect();
        assert_eq!(undone, [false, true, false], "{titles:?}");
    }
}
