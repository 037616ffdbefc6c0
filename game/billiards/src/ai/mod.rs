//! The computer as a player: it strikes through the same calls as a person, and errs as one.
//!
//! ```text
//! Position ─► lines (pots by geometry) ─┐
//!          ─► hits (thin, full, by cushions) ─► strokes ─► simulated, judged, worth ─► the best few
//!                                                          again under the level's error ─► Decision
//! ```
//! It knows the rules only through the [`Referee`]: a stroke is worth what the verdict on it says and
//! what the table then offers to whoever is next. Thinking is bounded by a number of simulated shots
//! and takes everything in a fixed order, so that the same position and seed give the same decision.

mod ball_placement;
mod contact_candidates;
mod evaluation;
mod level;
mod pot_candidates;
mod search;
mod skill;
mod worker;

pub use level::Level;
pub use search::{Decision, think};
pub use skill::Skill;
pub use worker::AiWorker;

use crate::physics::World;
use crate::rules::{BallPositions, Referee, TableLayout};
use crate::shot_report::ball_positions;

/// What the computer looks at: the table, and where the match stands.
#[derive(Clone, Debug)]
pub struct Position {
    /// The marks of the table.
    pub layout: TableLayout,
    /// The balls.
    pub world: World,
    /// The rules.
    pub referee: Referee,
}

impl Position {
    pub(crate) fn ball_positions(&self) -> BallPositions {
        ball_positions(&self.world.balls())
    }
}
