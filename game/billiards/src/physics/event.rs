//! The events of a shot, for sound, rules and display.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// An event of a shot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Since the stroke, in s.
    pub time_secs: f64,
    /// What happened.
    pub kind: EventKind,
}

/// Kind of an event, with the balls by number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum EventKind {
    /// The tip struck the cue ball.
    Strike {
        /// Speed of the cue in m/s.
        speed_m_s: f64,
    },
    /// The tip slipped off the ball.
    Miscue {
        /// Distance from the ball's centre to the tip, in ball radii.
        offset: f64,
    },
    /// Two balls met.
    BallBall {
        /// The first ball.
        first: u8,
        /// The second ball.
        second: u8,
        /// Point of contact, in m.
        point: DVec3,
        /// Speed of approach along the line of centres, in m/s.
        speed_m_s: f64,
    },
    /// A ball met a cushion or a jaw.
    Cushion {
        /// The ball.
        ball: u8,
        /// Point of contact, in m.
        point: DVec3,
        /// Speed into the cushion, in m/s.
        speed_m_s: f64,
    },
    /// A ball fell into a pocket, to its depth, or passed the rim of one without depth.
    Pocketed {
        /// The ball.
        ball: u8,
        /// Index into the table's pockets.
        pocket: usize,
        /// Speed in m/s.
        speed_m_s: f64,
    },
    /// A ball in the air fell onto something, or knocked against the inside of a pocket.
    Bounces {
        /// The ball.
        ball: u8,
        /// The surface.
        surface: Surface,
        /// Point of contact, in m.
        point: DVec3,
        /// Speed into the surface, in m/s.
        speed_m_s: f64,
    },
    /// A sliding ball began to roll.
    Rolls {
        /// The ball.
        ball: u8,
    },
    /// A ball came to rest.
    Rests {
        /// The ball.
        ball: u8,
    },
    /// A ball left the table: it passed its outer edge, from where it falls to the floor, or it
    /// came to rest on a rail.
    LeftTable {
        /// The ball.
        ball: u8,
        /// Position of its centre, in m.
        point: DVec3,
        /// Speed in m/s.
        speed_m_s: f64,
    },
}

impl EventKind {
    /// Whether it ends an aim line: the cue ball touched something or is gone.
    pub(crate) fn stops_aim_line(&self) -> bool {
        match *self {
            Self::BallBall { first, second, .. } => first == 0 || second == 0,
            Self::Cushion { ball, .. }
            | Self::Pocketed { ball, .. }
            | Self::LeftTable { ball, .. } => ball == 0,
            Self::Strike { .. }
            | Self::Miscue { .. }
            | Self::Bounces { .. }
            | Self::Rolls { .. }
            | Self::Rests { .. } => false,
        }
    }
}

/// A surface off which a ball bounces, other than balls and cushions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Surface {
    /// The cloth over the slate.
    Cloth,
    /// The top of a cushion or rail.
    Rail,
    /// The rim or the wall of a pocket.
    Pocket,
}
