//! Computer players: they strike through the same calls as people, and make errors as people do.
//!
//! ```text
//! Position ─► lines (pots by geometry) ─┐
//!          ─► hits (thin, full, by cushions) ─► strokes ─► simulated, judged, worth ─► the best few
//!                                                          again under the level's error ─► Decision
//! ```
//! They know the rules only through the [`Referee`]: the value of a stroke is that of its verdict and
//! of what the table then offers to the next player. The search is bounded by a number of simulated
//! shots and proceeds in a fixed order, so that the same position and seed give the same decision.

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

/// Input of the search: the table, and the state of the match.
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
