//! Patches: squares of the cloth that a material covers.

use carom_mpm::{Jelly, Material, Sand, Snow, Water};
use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::physics::Table;

/// What lies on a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum ParticleMaterial {
    /// Dry sand: balls plough through it and are stopped
    Sand,
    /// Snow: balls pack it
    Snow,
    /// Jelly that is glued to the cloth: balls bounce off it
    Jelly,
    /// Water that spreads and slows balls
    Water,
    /// Marbles of glass, two layers: balls scatter them
    Marbles,
}

/// A square of the cloth that is covered, by its place in a grid of [`ParticlePatch::EDGE_M`] from the table's middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ParticlePatch {
    /// What covers it.
    pub material: ParticleMaterial,
    /// Along x: column 0 begins at the middle.
    pub column: i16,
    /// Across it.
    pub row: i16,
}

/// Particles of one material, behind those of the groups before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParticleGroup {
    /// The material.
    pub material: ParticleMaterial,
    /// How many particles there are.
    pub count: u32,
}

/// How finely particles are simulated: `carom-bench particles --part precision` measures what each costs, and how far a
/// ball's way is from that at the finest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum ParticlePrecision {
    /// Cells of 15 mm: coarse grains, two thirds of the time a second of the shot
    Coarse,
    /// Cells of 12.5 mm
    #[default]
    Standard,
    /// Cells of 10 mm: fine grains, two to three times the time
    Fine,
}

impl ParticleMaterial {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Sand,
        Self::Snow,
        Self::Jelly,
        Self::Water,
        Self::Marbles,
    ];

    /// Radius of a marble, in m.
    pub const MARBLE_RADIUS_M: f64 = 0.008;

    /// How deep it lies, in m.
    pub fn depth_m(self) -> f64 {
        match self {
            Self::Sand | Self::Snow => 0.015,
            Self::Jelly => 0.045,
            Self::Water => 0.01,
            Self::Marbles => 4.0 * Self::MARBLE_RADIUS_M,
        }
    }

    /// The model; none of marbles, which are rigid bodies. Sand, snow and water are softer than real ones, whose sound would take a hundred times as many
    /// steps: a ball's weight presses sand by 4 %.
    pub(crate) fn model(self) -> Option<Material> {
        Some(match self {
            Self::Sand => Material::Sand(Sand {
                young_pa: 8e4,
                ..Sand::default()
            }),
            Self::Snow => Material::Snow(Snow {
                young_pa: 5e4,
                hardening: 4.0,
                ..Snow::default()
            }),
            Self::Jelly => Material::Jelly(Jelly {
                young_pa: 8e4,
                viscosity_pa_s: 5.0,
                ..Jelly::default()
            }),
            Self::Water => Material::Water(Water {
                sound_speed_m_s: 8.0,
                // As thick as syrup, and held by the cloth: it is to come to rest.
                viscosity_pa_s: 0.3,
                friction: 0.3,
                ..Water::default()
            }),
            Self::Marbles => return None,
        })
    }
}

impl ParticlePatch {
    /// Edge of the square, in m.
    pub const EDGE_M: f64 = 0.03;

    /// The patch around a point of the table in m; none beyond the range of numbers.
    pub fn around(material: ParticleMaterial, at: DVec2) -> Option<Self> {
        let place = (at / Self::EDGE_M).floor();
        let in_range = place.abs().max_element() < 1e4;
        in_range.then_some(Self {
            material,
            column: place.x as i16,
            row: place.y as i16,
        })
    }

    /// Corner of the smallest coordinates, in m.
    pub fn corner(&self) -> DVec2 {
        DVec2::new(self.column.into(), self.row.into()) * Self::EDGE_M
    }

    /// Whether all of it is on the table's cloth.
    pub fn is_on_cloth(&self, table: &Table) -> bool {
        let half = 0.5 * DVec2::new(table.length_m(), table.width_m());
        let (low, high) = (self.corner(), self.corner() + Self::EDGE_M);
        low.cmpge(-half).all() && high.cmple(half).all()
    }
}

impl ParticlePrecision {
    /// Edge of a cell of the grid in m, of which a particle has an eighth.
    pub fn cell_size_m(self) -> f64 {
        match self {
            Self::Coarse => 0.015,
            Self::Standard => 0.0125,
            Self::Fine => 0.01,
        }
    }
}
