//! The pages over the table, and the facts that they show.

/// A page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Page {
    /// What there is to do.
    Top,
    /// What to play.
    NewGame,
    /// The settings.
    Settings,
    /// Which key does what, and how that is changed.
    Keys,
}

/// What pages show that is not in the settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct MenuInput<'a> {
    /// Whether the free table is played, on which the balls are racked at will.
    pub is_free_table: bool,
    /// How sound is played, or why it is not.
    pub sound: &'a str,
    /// What draws the window.
    pub display: &'a str,
    /// The farm in a line: "1 of 2 nodes: …".
    pub farm: &'a str,
}
