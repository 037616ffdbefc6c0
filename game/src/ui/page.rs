//! The pages over the table, and the facts that they show.

use carom_billiards::game_match::MatchView;

/// A page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Page {
    /// What there is to do.
    Top,
    /// What to play.
    NewGame,
    /// Whether the unfinished match is to be given up for a new game.
    GiveUp,
    /// The settings.
    Settings,
    /// Which key does what, and how that is changed.
    Keys,
    /// How the match ended, and what may come next.
    Result,
    /// What a newcomer may begin with.
    Welcome,
}

/// What pages show that is not in the settings.
#[derive(Clone, Copy, Debug)]
pub struct MenuInput<'a> {
    /// The match.
    pub view: &'a MatchView,
    /// Whether there is an unfinished match, which a new game would end.
    pub is_match_unfinished: bool,
    /// Whether a match waits while its player practises.
    pub is_match_waiting: bool,
    /// How sound is played, or why it is not.
    pub sound: &'a str,
    /// What draws the window.
    pub display: &'a str,
    /// The farm in a line: "1 of 2 nodes: …".
    pub farm: &'a str,
}
