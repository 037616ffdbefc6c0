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

/// A covered square of the cloth, by its indices in a grid of [`ParticlePatch::EDGE_M`] from the
/// table's middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ParticlePatch {
    /// The covering material.
    pub material: ParticleMaterial,
    /// Index along x: column 0 begins at the middle.
    pub column: i16,
    /// Index along y: row 0 begins at the middle.
    pub row: i16,
}

/// A run of consecutive particles of one material; groups follow one another in the order of particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParticleGroup {
    /// The material.
    pub material: ParticleMaterial,
    /// Number of particles.
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
    /// All materials.
    pub const ALL: [Self; 5] = [
        Self::Sand,
        Self::Snow,
        Self::Jelly,
        Self::Water,
        Self::Marbles,
    ];

    /// Radius of a marble, in m.
    pub const MARBLE_RADIUS_M: f64 = 0.008;

    /// Depth of a fresh layer, in m.
    pub fn depth_m(self) -> f64 {
        match self {
            Self::Sand | Self::Snow => 0.015,
            Self::Jelly => 0.045,
            Self::Water => 0.01,
            Self::Marbles => 4.0 * Self::MARBLE_RADIUS_M,
        }
    }

    /// Model of the material-point method; none for marbles, which are rigid bodies. Sand, snow and
    /// water are softer than real ones, whose speed of sound would need a hundred times as many steps:
    /// a ball's weight compresses sand by 4 %.
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
                // As viscous as syrup, with friction on the cloth, so that it comes to rest.
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

    /// The patch that contains a point of the table in m; none beyond the range of indices.
    pub fn around(material: ParticleMaterial, at: DVec2) -> Option<Self> {
        let place = (at / Self::EDGE_M).floor();
        let in_range = place.abs().max_element() < 1e4;
        in_range.then_some(Self {
            material,
            column: place.x as i16,
            row: place.y as i16,
        })
    }

    /// Corner with the smallest coordinates, in m.
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
    /// Edge of a grid cell in m; a particle has an eighth of its volume.
    pub fn cell_size_m(self) -> f64 {
        match self {
            Self::Coarse => 0.015,
            Self::Standard => 0.0125,
            Self::Fine => 0.01,
        }
    }
}
