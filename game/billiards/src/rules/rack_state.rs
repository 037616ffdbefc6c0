//! The state of a rack or frame that only one game has, in addition to what the referee stores for all.

use super::ball_group::BallGroup;

/// State of a rack of 8-ball.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Eight {
    /// The group of player 0, once the table is no longer open.
    pub(crate) first: Option<BallGroup>,
}

/// State of a rack of 9-ball.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Nine {
    /// Whether the next shot may be a push-out: it is the first after a legal break.
    pub(crate) may_push: bool,
}

/// State of straight pool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Straight {
    /// Number of balls of the current run.
    pub(crate) run: u32,
    /// Number of racks of fourteen so far: each is drawn anew.
    pub(crate) racks: u32,
}

/// State of a frame of snooker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Snooker {
    /// Whether a colour is on, after a red.
    pub(crate) on_colour: bool,
    /// Whether any ball may be nominated in place of the ball on (12).
    pub(crate) free_ball: bool,
    /// Points of both players in this frame.
    pub(crate) points: [i32; 2],
    /// Points of the current break.
    pub(crate) run: i32,
    /// Whether the black was spotted again after a tie.
    pub(crate) tied: bool,
}

/// State of a drill.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Drill {
    /// Number of completed attempts.
    pub(crate) attempts: u32,
}
