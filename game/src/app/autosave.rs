//! Autosave of the match: after every action, in one file.

use std::path::PathBuf;

use carom_billiards::game_match::{Match, MatchSave};

/// A match's file, and how much of the match is in it.
#[derive(Debug, Default)]
pub(super) struct Autosave {
    path: Option<PathBuf>,
    /// Actions of the match in the file.
    saved: Option<usize>,
}

impl Autosave {
    /// Saves from now on, to `path`, in which `contest` is already.
    pub(super) fn begin(&mut self, path: PathBuf, contest: &Match) {
        self.path = Some(path);
        self.saved = Some(contest.action_count());
    }

    /// Saves at the next update, whatever the file holds.
    pub(super) fn invalidate(&mut self) {
        self.saved = None;
    }

    /// Saves the match if an action was added to it.
    pub(super) fn update(&mut self, contest: &Match) {
        let Some(path) = &self.path else {
            return;
        };
        let actions = contest.action_count();
        if self.saved.replace(actions) == Some(actions) {
            return;
        }
        if let Err(why) = MatchSave::of(contest).save(path) {
            tracing::error!("{why}");
        }
    }
}
