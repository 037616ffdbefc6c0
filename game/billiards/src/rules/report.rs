//! The report of a shot, as a referee sees it.

use super::layout::BallPositions;

/// An event of a shot. The cue ball of the player at the table is 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShotEvent {
    /// Two balls met.
    Contact {
        /// A ball.
        one: u8,
        /// Another.
        other: u8,
    },
    /// A ball was driven to a cushion: one that it touched at the start counts only after it had
    /// left it (WPA 8.4).
    Cushion {
        /// The ball.
        ball: u8,
    },
    /// A ball fell into a pocket.
    Pocketed {
        /// The ball.
        ball: u8,
        /// Index into [`super::TableLayout::pockets`].
        pocket: usize,
    },
    /// A ball was driven off the table.
    LeftTable {
        /// The ball.
        ball: u8,
    },
}

/// Report of a whole shot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShotReport {
    /// The events, in the order of time.
    pub events: Vec<ShotEvent>,
    /// The balls on the table before the stroke.
    pub before: BallPositions,
    /// The balls on the table after it.
    pub after: BallPositions,
    /// Balls that touched the cue ball before the stroke.
    pub frozen: Vec<u8>,
    /// Whether the tip slipped off the ball. No foul by itself.
    pub miscue: bool,
    /// The ball that was so near that the tip met the cue ball twice, if any.
    pub double_hit: Option<u8>,
    /// A ball that the cue ball flew over before it had touched any.
    pub jumped: Option<u8>,
    /// Largest x of the cue ball's centre until its first contact with a ball, in m.
    pub reach_x_m: f64,
}

impl ShotReport {
    /// The ball that the cue ball touched first.
    pub fn first_hit(&self) -> Option<u8> {
        self.contacts().next()
    }

    /// The balls that the cue ball touched, in order.
    pub fn contacts(&self) -> impl Iterator<Item = u8> {
        self.events.iter().filter_map(|happening| match *happening {
            ShotEvent::Contact { one: 0, other } => Some(other),
            ShotEvent::Contact { one, other: 0 } => Some(one),
            _ => None,
        })
    }

    /// The balls that fell, in order, with their pockets; the cue ball among them.
    pub fn pocketed(&self) -> impl Iterator<Item = (u8, usize)> {
        self.events.iter().filter_map(|happening| match *happening {
            ShotEvent::Pocketed { ball, pocket } => Some((ball, pocket)),
            _ => None,
        })
    }

    /// The object balls that fell, in order.
    pub fn potted(&self) -> Vec<u8> {
        let balls = self.pocketed().map(|(ball, _)| ball);
        balls.filter(|&ball| ball != 0).collect()
    }

    /// The balls that were driven off the table, the cue ball among them.
    pub fn off_table(&self) -> impl Iterator<Item = u8> {
        self.events.iter().filter_map(|happening| match *happening {
            ShotEvent::LeftTable { ball } => Some(ball),
            _ => None,
        })
    }

    /// The pocket into which the cue ball fell.
    pub fn scratch(&self) -> Option<usize> {
        self.pocketed()
            .find_map(|(ball, pocket)| (ball == 0).then_some(pocket))
    }

    /// Whether the cue ball is gone.
    pub fn lost_cue_ball(&self) -> bool {
        self.scratch().is_some() || self.off_table().any(|ball| ball == 0)
    }

    /// Whether after the cue ball's first contact any ball was driven to a cushion. One that falls
    /// or leaves the table counts (WPA 8.4).
    pub fn rail_after_contact(&self) -> bool {
        let after = self.events.iter().skip_while(
            |h| !matches!(h, ShotEvent::Contact { one, other } if *one == 0 || *other == 0),
        );
        after.skip(1).any(|happening| {
            matches!(
                happening,
                ShotEvent::Cushion { .. }
                    | ShotEvent::Pocketed { .. }
                    | ShotEvent::LeftTable { .. }
            )
        })
    }

    /// Number of object balls that were driven to a cushion, fell, or left the table.
    pub fn balls_to_rails(&self) -> usize {
        let mut balls: Vec<u8> = self
            .events
            .iter()
            .filter_map(|happening| match *happening {
                ShotEvent::Cushion { ball }
                | ShotEvent::Pocketed { ball, .. }
                | ShotEvent::LeftTable { ball }
                    if ball != 0 =>
                {
                    Some(ball)
                }
                _ => None,
            })
            .collect();
        balls.sort_unstable();
        balls.dedup();
        balls.len()
    }

    /// Whether the cue ball was driven to a cushion.
    pub fn cue_ball_to_rail(&self) -> bool {
        self.events.contains(&ShotEvent::Cushion { ball: 0 })
    }
}
