//! The material point method for jelly, water, sand and snow in two-way contact with rigid balls, and
//! beside it ballistic dust and marbles as discrete elements.
//!
//! ```text
//!             ┌────────────────────── a substep ──────────────────────┐
//! particles ──▶ p2g ─────────▶ grid ─────────▶ coupling ─────▶ g2p ───▶ particles
//!             move, strain,   free fall,     impulses with   velocities
//!             scatter         obstacles      balls           gathered
//! ```
//!
//! Moving least squares MPM (Hu et al. 2018) with the affine transfers of APIC (Jiang et al. 2015),
//! quadratic B-splines and explicit symplectic substeps, whose length the speed of sound bounds (CFL
//! condition). [`Marbles`] are discrete elements. All quantities are in SI units, z up. The crate uses no
//! clock, no window and no random numbers; on one instruction set the same steps give the same bits,
//! whatever the number of rayon's threads.
//!
//! ```
//! use carom_mpm::{Ball, Bodies, Material, Obstacle, Region, Sand, Settings, Simulation};
//! use glam::{DVec3, Vec3};
//!
//! let mut simulation = Simulation::new(Settings::default())?;
//! let strip = Region::Cuboid { min: Vec3::ZERO, max: Vec3::new(0.1, 0.2, 0.02) };
//! simulation.fill(&strip, Material::Sand(Sand::default()), Vec3::ZERO)?;
//!
//! let mut ball = Ball::new(DVec3::new(-0.03, 0.1, 0.0286), 0.0286, 0.17);
//! ball.velocity.x = 2.0;
//! let slate = Obstacle::plane(DVec3::ZERO, DVec3::Z);
//! let mut bodies = Bodies { balls: vec![ball], obstacles: vec![slate] };
//! for _ in 0..6 {
//!     simulation.step(1.0 / 60.0, &mut bodies)?;
//! }
//! assert!(bodies.balls[0].velocity.x < 1.9);
//! # Ok::<(), carom_mpm::Error>(())
//! ```
//!
//! With the feature `gpu`, `GpuSimulation` runs the same method in WGSL.
//!
//! Forces on balls are divided between caller and crate: the caller sets [`Ball::acceleration`] from all
//! forces but those of particles, and [`Ball::impulse`] returns what particles contributed.

mod body;
mod coupling;
mod dust;
mod error;
mod g2p;
#[cfg(feature = "gpu")]
mod gpu;
mod grid;
mod lanes;
mod marble;
mod marble_contact;
mod marbles;
mod material;
mod p2g;
mod packet;
mod region;
mod settings;
mod simulation;
mod snapshot;
mod storage;
mod svd;
mod tile;
mod totals;
mod touch;

pub use body::{Ball, Bodies, Grip, Obstacle, Solid};
pub use dust::{Dust, Grain, Speck};
pub use error::{Error, Result};
#[cfg(feature = "gpu")]
pub use gpu::{
    GPU_BALLS_MAX, GPU_BLOCKS_MAX, GPU_MATERIALS_MAX, GPU_OBSTACLES_MAX, Gpu, GpuSimulation,
};
pub use marble::{Marble, MarbleState};
pub use marbles::{MarbleSnapshot, Marbles};
pub use material::{Jelly, Material, Sand, Snow, Water};
pub use region::Region;
pub use settings::{PARTICLES_MAX, REST_SECS, Settings};
pub use simulation::{Simulation, StepReport};
pub use snapshot::Snapshot;
pub use storage::Particle;
pub use totals::Totals;
