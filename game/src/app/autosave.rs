//! Autosave of the match to a file after every action.

use std::path::PathBuf;

use carom_billiards::game_match::{Match, MatchSave};

/// File of the match, and the saved part.
#[derive(Debug, Default)]
pub(super) struct Autosave {
    path: Option<PathBuf>,
    /// Number of the match's actions in the file; none if it holds another match.
    saved: Option<usize>,
}

impl Autosave {
    /// Enables saving to `path`, which already holds `contest`.
    pub(super) fn begin(&mut self, path: PathBuf, contest: &Match) {
        self.path = Some(path);
        self.saved = Some(contest.action_count());
    }

    /// Forces a save at the next update.
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
