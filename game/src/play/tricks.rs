//! Trick tables: particles on the cloth, and a shot through them.

use carom_billiards::physics::{
    BallLayout, ParticleBed, ParticleMaterial, ParticlePatch, ParticlePrecision, Stroke, Table,
    World,
};
use clap::ValueEnum;
use glam::DVec2;
use std::sync::Arc;

/// A trick table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TrickTable {
    /// A strip of sand across the middle of the table
    SandTrap,
    /// A patch of snow
    SnowPatch,
    /// A bumper of jelly
    JellyBumper,
    /// A drink that was spilled
    SpilledDrink,
    /// A bowl of marbles, tipped out
    BowlOfMarbles,
}

impl TrickTable {
    /// The covered patches of the cloth.
    pub fn patches(self) -> Vec<ParticlePatch> {
        let (material, columns, rows) = match self {
            Self::SandTrap => (ParticleMaterial::Sand, 0..8, -5..5),
            Self::SnowPatch => (ParticleMaterial::Snow, 0..8, -5..5),
            Self::JellyBumper => (ParticleMaterial::Jelly, 3..5, -5..5),
            Self::SpilledDrink => (ParticleMaterial::Water, 0..7, -4..4),
            Self::BowlOfMarbles => (ParticleMaterial::Marbles, 0..8, -4..4),
        };
        let columns = columns.into_iter();
        let squares = columns.flat_map(|column| rows.clone().map(move |row| (column, row)));
        let patch = |(column, row)| ParticlePatch {
            material,
            column,
            row,
        };
        let is_in_bowl = |patch: &ParticlePatch| {
            let middle = patch.corner() + 0.5 * ParticlePatch::EDGE_M;
            self != Self::BowlOfMarbles || middle.distance(DVec2::new(0.12, 0.0)) < BOWL_RADIUS_M
        };
        squares.map(patch).filter(is_in_bowl).collect()
    }

    /// Speed of the cue. In sand it is so low that the ball stays in the trap.
    fn speed_m_s(self) -> f64 {
        match self {
            Self::SandTrap => 1.1,
            Self::SnowPatch | Self::JellyBumper | Self::SpilledDrink | Self::BowlOfMarbles => 3.0,
        }
    }

    /// A table with the particles, the cue ball in front of them and balls beside and behind them, and the
    /// stroke through them.
    ///
    /// # Errors
    /// If the table is too small.
    pub fn world(
        self,
        table: &Table,
        precision: ParticlePrecision,
    ) -> carom_billiards::Result<(World, Stroke)> {
        let places = [(0, [-0.35, 0.02]), (1, [0.5, 0.03]), (9, [0.12, 0.26])];
        let balls = places.map(|(number, at)| table.resting_ball(number, at.into()));
        let balls = balls.to_vec();
        let bed = ParticleBed::new(table, &balls, &self.patches(), precision)?;
        let mut world = World::new(table.clone(), BallLayout { balls })?;
        world.set_particles(Some(Arc::new(bed)));
        Ok((world, Stroke::straight(0.0, self.speed_m_s())))
    }
}

/// Radius of the patch of marbles.
const BOWL_RADIUS_M: f64 = 0.115;
