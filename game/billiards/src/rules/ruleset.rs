//! The table of rules: a row for each game.

use carom_text::text;
use serde::{Deserialize, Serialize};

use super::layout::PlacementArea;

/// A game.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum RuleSet {
    /// A table without rules: everything is allowed
    #[default]
    Free,
    /// 8-ball: a group of seven each, then the 8
    Eight,
    /// 9-ball: always the lowest first, the 9 wins
    Nine,
    /// Straight pool, 14.1 continuous: any called ball is a point
    Straight,
    /// Snooker: reds and colours in turn, then the colours in order
    Snooker,
    /// Three-cushion carom: three cushions before the second ball
    ThreeCushion,
    /// Drill: ten balls in a line, a point for each until a miss
    LineUp,
    /// Drill: ten shots at a ball on the foot spot, from behind the head string
    SpotShots,
    /// Drill: three balls in order, five times, with the cue ball in hand at first
    PositionPlay,
    /// Drill: one layout a day, the same for everybody; three points at the first attempt
    DailyShot,
}

/// What must be called before a shot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Calls {
    /// Nothing.
    Nothing,
    /// The ball and its pocket, unless they are obvious.
    Pocket,
    /// The colour to be hit, unless it is obvious.
    Colour,
}

/// A game's row of the table of rules.
#[derive(Clone, Debug)]
pub struct RuleInfo {
    /// Display name.
    pub name: &'static str,
    /// Source of the rules.
    pub source: &'static str,
    /// The table that it is meant for, by its name for [`crate::physics::Table::built_in`].
    pub table: &'static str,
    /// Possible numbers of players.
    pub players: std::ops::RangeInclusive<usize>,
    /// Area in which the cue ball is in hand for the break.
    pub start: Option<PlacementArea>,
    /// Area in which it is in hand after it was lost.
    pub after_loss: PlacementArea,
    /// Area in which it is in hand after any foul.
    pub after_foul: Option<PlacementArea>,
    /// Whether a ball must reach a cushion after the contact.
    pub needs_rail: bool,
    /// Number of object balls that a break must drive to cushions, if it pots none.
    pub break_rails: usize,
    /// What a player must call.
    pub calls: Calls,
    /// Number of fouls in a row that is punished.
    pub fouls_in_row: Option<u8>,
    /// Default target of a match.
    pub target: u32,
    /// Unit of the target, `racks`, `frames`, `points` or `attempts`, which is part of the names of the
    /// texts `goal-…` and `target-…`.
    pub unit: &'static str,
}

impl RuleSet {
    /// All games; [`RuleSet::DRILLS`] are apart.
    pub const ALL: [Self; 6] = [
        Self::Free,
        Self::Eight,
        Self::Nine,
        Self::Straight,
        Self::Snooker,
        Self::ThreeCushion,
    ];

    /// The game's row.
    pub fn info(self) -> RuleInfo {
        let row = RULE_INFOS[self as usize].clone();
        RuleInfo {
            name: text!(row.name),
            ..row
        }
    }

    /// Whether one player is enough.
    pub fn is_for_one(self) -> bool {
        *self.info().players.start() == 1
    }

    /// A ball's name, with its article.
    pub fn ball_name(self, ball: u8) -> String {
        match (self, ball) {
            (Self::Snooker, 1..=21) => text!("ball-snooker", number = ball),
            (Self::ThreeCushion, 1..=2) => text!("ball-carom", number = ball),
            _ => text!("ball", number = ball),
        }
    }
}

const FREE: RuleInfo = RuleInfo {
    name: "game-free",
    source: "",
    table: "nine_foot",
    players: 1..=2,
    start: Some(PlacementArea::Anywhere),
    after_loss: PlacementArea::Anywhere,
    after_foul: None,
    needs_rail: false,
    break_rails: 0,
    calls: Calls::Nothing,
    fouls_in_row: None,
    target: 1,
    unit: "racks",
};

const POOL: RuleInfo = RuleInfo {
    players: 2..=2,
    start: Some(PlacementArea::Kitchen),
    after_foul: Some(PlacementArea::Anywhere),
    needs_rail: true,
    break_rails: 4,
    ..FREE
};

const DRILL: RuleInfo = RuleInfo {
    players: 1..=1,
    start: None,
    unit: "attempts",
    ..FREE
};

const RULE_INFOS: [RuleInfo; 10] = [
    FREE,
    RuleInfo {
        name: "game-eight",
        source: "WPA 3",
        calls: Calls::Pocket,
        ..POOL
    },
    RuleInfo {
        name: "game-nine",
        source: "WPA 2",
        fouls_in_row: Some(3),
        ..POOL
    },
    RuleInfo {
        name: "game-straight",
        source: "WPA 4",
        after_loss: PlacementArea::Kitchen,
        after_foul: None,
        break_rails: 2,
        calls: Calls::Pocket,
        fouls_in_row: Some(3),
        target: 50,
        unit: "points",
        ..POOL
    },
    RuleInfo {
        name: "game-snooker",
        source: "WPBSA 3",
        table: "snooker",
        players: 2..=2,
        start: Some(PlacementArea::D),
        after_loss: PlacementArea::D,
        calls: Calls::Colour,
        unit: "frames",
        ..FREE
    },
    RuleInfo {
        name: "game-three-cushion",
        source: "UMB 83",
        table: "carom",
        players: 2..=2,
        start: None,
        target: 10,
        unit: "points",
        ..FREE
    },
    RuleInfo {
        name: "game-line-up",
        start: Some(PlacementArea::Anywhere),
        target: 1,
        ..DRILL
    },
    RuleInfo {
        name: "game-spot-shots",
        target: 10,
        ..DRILL
    },
    RuleInfo {
        name: "game-position-play",
        start: Some(PlacementArea::Anywhere),
        target: 5,
        ..DRILL
    },
    RuleInfo {
        name: "game-daily-shot",
        target: 3,
        ..DRILL
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_game_has_its_row_and_its_table() {
        for rules in RuleSet::ALL.into_iter().chain(RuleSet::DRILLS) {
            let info = rules.info();
            crate::physics::Table::built_in(info.table).unwrap();
            assert!(info.target > 0 && *info.players.start() > 0);
        }
        for rules in RuleSet::DRILLS {
            assert!(rules.is_drill() && rules.info().players == (1..=1));
        }
        assert_eq!(RuleSet::DailyShot.info().name, "Daily shot");
        assert_eq!(RuleSet::Snooker.info().name, "Snooker");
        assert_eq!(RuleSet::ThreeCushion.info().source, "UMB 83");
    }
}
