//! The ball on in snooker: what a stroke has to hit, and its value.

use carom_text::text;

use crate::rules::{
    call::Call,
    layout::{BallPositions, object_balls},
    rack_state::Snooker,
    referee::JudgedShot,
    ruleset::RuleSet,
};

/// The set of balls on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TargetSet {
    Red,
    /// Any colour, at the player's nomination.
    Colour,
    /// This colour, in the order of the end.
    Last(u8),
}

impl TargetSet {
    fn includes(self, ball: u8) -> bool {
        match self {
            Self::Red => is_red(ball),
            Self::Colour => is_colour(ball),
            Self::Last(colour) => ball == colour,
        }
    }

    fn value(self) -> i32 {
        match self {
            Self::Red => 1,
            Self::Colour => 7,
            Self::Last(colour) => value(colour),
        }
    }
}

impl Snooker {
    pub(super) fn ball_on(self, positions: &BallPositions) -> TargetSet {
        let lies = |wanted: fn(u8) -> bool| {
            positions
                .iter()
                .map(|p| p.ball)
                .filter(|&b| wanted(b))
                .min()
        };
        if self.on_colour {
            return TargetSet::Colour;
        }
        match lies(is_red) {
            Some(_) => TargetSet::Red,
            None => TargetSet::Last(lies(is_colour).unwrap_or(BLACK)),
        }
    }

    /// The balls that may be hit first.
    pub(crate) fn legal_targets(self, positions: &BallPositions) -> Vec<u8> {
        let on = self.ball_on(positions);
        let mut balls = object_balls(positions);
        balls.retain(|&ball| self.free_ball || on.includes(ball));
        balls
    }

    /// The ball on, in words.
    pub(crate) fn legal_targets_text(self, positions: &BallPositions) -> String {
        let on = match self.ball_on(positions) {
            TargetSet::Red => text!("on-red").to_owned(),
            TargetSet::Colour => text!("on-colour").to_owned(),
            TargetSet::Last(colour) => RuleSet::Snooker.ball_name(colour),
        };
        if self.free_ball {
            text!("on-free-ball", on = on)
        } else {
            on
        }
    }
}

/// What a stroke has to hit, and its value.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShotTarget {
    pub(super) on: TargetSet,
    /// The colour that was nominated, or taken as nominated because it was hit; the free ball.
    pub(super) nominated: Option<u8>,
    pub(super) is_free: bool,
}

impl ShotTarget {
    /// Target of a shot. A missing nomination is taken from the ball that was hit first, so that a call
    /// is never required.
    pub(super) fn of(snooker: Snooker, shot: &JudgedShot<'_>) -> Self {
        let on = snooker.ball_on(&shot.report.before);
        let said = match shot.call {
            Some(Call::Pot { ball, .. }) => Some(ball),
            _ => shot.report.first_hit(),
        };
        let is_free = snooker.free_ball && said.is_some_and(|ball| !on.includes(ball));
        let nominated = said.filter(|&ball| is_free || on == TargetSet::Colour && is_colour(ball));
        Self {
            on,
            nominated,
            is_free,
        }
    }

    pub(super) fn allows(self, ball: u8) -> bool {
        match self.nominated {
            Some(nominated) if self.on == TargetSet::Colour || self.is_free => ball == nominated,
            _ => self.on.includes(ball),
        }
    }

    /// Points for potting a ball; none if it is not on. With a free ball the ball on counts too.
    pub(super) fn points(self, ball: u8) -> Option<i32> {
        if self.is_free && Some(ball) == self.nominated {
            return Some(self.on.value());
        }
        let counts = self.allows(ball) || self.is_free && self.on.includes(ball);
        counts.then(|| value(ball))
    }

    /// Points of a stroke without a foul: with a free ball in place of a colour the two are one (12).
    pub(super) fn score(self, potted: &[u8]) -> i32 {
        let points = || potted.iter().filter_map(|&ball| self.points(ball));
        match self.on {
            TargetSet::Last(_) => points().max().unwrap_or(0),
            TargetSet::Red | TargetSet::Colour => points().sum(),
        }
    }

    /// Value of the ball on, for a foul: the highest, for a colour that was not nominated.
    pub(super) fn value(self) -> i32 {
        match self.nominated {
            Some(colour) if !self.is_free => value(colour),
            _ => self.on.value(),
        }
    }

    pub(super) fn display_text(self) -> String {
        match (self.on, self.nominated) {
            (TargetSet::Colour | TargetSet::Red | TargetSet::Last(_), Some(ball)) => {
                RuleSet::Snooker.ball_name(ball)
            }
            (TargetSet::Last(ball), None) => RuleSet::Snooker.ball_name(ball),
            (TargetSet::Red, None) => text!("on-red").to_owned(),
            (TargetSet::Colour, None) => text!("on-colour").to_owned(),
        }
    }
}

pub(super) fn is_red(ball: u8) -> bool {
    (1..YELLOW).contains(&ball)
}

pub(super) fn is_colour(ball: u8) -> bool {
    (YELLOW..=BLACK).contains(&ball)
}

pub(super) fn value(ball: u8) -> i32 {
    match ball {
        YELLOW..=BLACK => i32::from(ball) - 14,
        1..YELLOW => 1,
        _ => 0,
    }
}

pub(super) const YELLOW: u8 = 16;
pub(super) const BLACK: u8 = 21;
