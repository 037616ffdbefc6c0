//! The state of a rack or frame that only one game has, beside what the referee keeps for all.

use super::ball_group::BallGroup;

/// What 8-ball remembers of a rack.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Eight {
    /// The group of player 0, once the table is no longer open.
    pub(crate) first: Option<BallGroup>,
}

/// What 9-ball remembers of a rack.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Nine {
    /// Whether the next shot may be a push-out: it is the first after a legal break.
    pub(crate) may_push: bool,
}

/// What straight pool remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Straight {
    /// Balls of the run that is on.
    pub(crate) run: u32,
    /// Racks of fourteen so far: each is drawn anew.
    pub(crate) racks: u32,
}

/// What snooker remembers of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Snooker {
    /// Whether a colour is on, after a red.
    pub(crate) on_colour: bool,
    /// Whether any ball may be nominated in place of the ball on (12).
    pub(crate) free_ball: bool,
    /// Points of both players in this frame.
    pub(crate) points: [i32; 2],
    /// Points of the break that is on.
    pub(crate) run: i32,
    /// Whether the black was spotted again after a tie.
    pub(crate) tied: bool,
}

/// What a drill remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Drill {
    /// Attempts that are over.
    pub(crate) attempts: u32,
}
