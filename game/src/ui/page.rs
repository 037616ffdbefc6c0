//! The pages over the table, and the input that they show.

use carom_billiards::game_match::MatchView;

/// Page over the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Page {
    /// Main menu.
    Top,
    /// Choice of a new game.
    NewGame,
    /// Confirmation that an unfinished match is abandoned for a new game.
    GiveUp,
    /// Settings.
    Settings,
    /// Key bindings.
    Keys,
    /// Result of the match, and the next choices.
    Result,
    /// First choices of a new player.
    Welcome,
}

/// State that pages show in addition to the settings.
#[derive(Clone, Copy, Debug)]
pub struct MenuInput<'a> {
    /// The match.
    pub view: &'a MatchView,
    /// Whether there is an unfinished match, which a new game would end.
    pub is_match_unfinished: bool,
    /// Whether a match is suspended during practice.
    pub is_match_waiting: bool,
    /// Description of the sound output, or the reason why there is none.
    pub sound: &'a str,
    /// Name of the display that draws the window.
    pub display: &'a str,
    /// Status of the farm in a line, such as "1 of 2 nodes: …".
    pub farm: &'a str,
}
