//! The configuration of a match.

use super::Player;
use crate::Result;
use crate::physics::{Engine, Table};
use crate::rules::RuleSet;

/// Configuration of a new match.
#[derive(Clone, Debug)]
pub struct MatchConfig {
    /// The game.
    pub rules: RuleSet,
    /// The players: as many as the game's [`crate::rules::RuleInfo::players`] allows.
    pub players: Vec<Player>,
    /// Racks, frames or points to win; 0 for the game's own.
    pub target: u32,
    /// Seed of the racks.
    pub seed: u32,
    /// The table; usually the one that the game's row names.
    pub table: Table,
    /// The simulation engine.
    pub engine: Engine,
}

impl MatchConfig {
    /// A game on its own table.
    ///
    /// # Errors
    /// [`crate::Error::Table`] if the table is not usable.
    pub fn new(rules: RuleSet, players: Vec<Player>, seed: u32) -> Result<Self> {
        let table = Table::built_in(rules.info().table)?;
        Ok(Self {
            rules,
            players,
            target: 0,
            seed,
            table,
            engine: Engine::default(),
        })
    }
}
