//! Particles for the tracer: those of the physics and of dust, as clouds of small balls and as fluid
//! surfaces.

mod bed;
mod chalk;

use std::sync::Arc;

use carom_billiards::physics::World;
use carom_tracer::ParticleCloud;
use clap::ValueEnum;
use glam::Vec3;

pub use bed::BedMoment;
pub use chalk::ChalkPuff;

/// How many particles are traced. They cost where they are in the picture, and nothing where there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ParticleDetail {
    /// No dust
    Off,
    /// A quarter of the dust: up to 400 specks of chalk at a stroke
    #[default]
    Some,
    /// All of the dust: up to 1600 specks of chalk at a stroke
    All,
}

impl ParticleDetail {
    /// Stride of the traced specks among all; 0 for none.
    pub(crate) const fn stride(self) -> usize {
        match self {
            Self::Off => 0,
            Self::Some => 4,
            Self::All => 1,
        }
    }
}

/// All particles at a moment.
#[derive(Clone, Debug, Default)]
pub struct ParticleMoment {
    /// Dust of the present shot, and the time since its stroke in s.
    pub dust: Option<(Arc<ChalkPuff>, f64)>,
    /// Particles on the table.
    pub bed: Option<BedMoment>,
}

impl ParticleMoment {
    /// The particles at rest on a table.
    pub fn lying(world: &World) -> Self {
        let bed = world.particles().map(Arc::clone);
        Self {
            dust: None,
            bed: bed.map(BedMoment::Lying),
        }
    }

    /// The clouds to be traced, on a cloth of this albedo: dust at a level of detail, particles on the
    /// table all.
    pub fn clouds(&self, detail: ParticleDetail, cloth: Vec3) -> Vec<ParticleCloud> {
        let dust = self.dust.iter();
        let dust = dust.flat_map(|(puff, secs)| puff.clouds(*secs, detail));
        let bed = self.bed.iter().flat_map(|bed| bed.clouds(cloth));
        dust.chain(bed).collect()
    }
}
