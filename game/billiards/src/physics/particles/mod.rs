//! Particles on the table: sand, snow, jelly, water and marbles that balls roll through.
//!
//! ```text
//! patches ─▶ ParticleBed ─┬─ a step of 1/480 s ─▶ impulses on balls ─▶ event engine
//!    ▲                    ▼                                               │
//! practice table     ParticleTrack, 60 a second ◀── to the end of the shot ┘
//! ```
//! Up to the first contact with particles a shot is the same as without them, and that part is
//! predicted. The particles are those of [`carom_mpm`]. A table without any is simulated as if there
//! were none in the world.
//! With them a shot costs the steps of its particles, some seconds of a core:
//! `carom-bench particles --part precision` prints how many, and the settings show them beside each
//! [`ParticlePrecision`].

mod bed;
mod first_touch;
mod height_map;
mod marbles;
mod patch;
mod run;
mod save;
mod track;

pub use bed::ParticleBed;
pub use patch::{ParticleGroup, ParticleMaterial, ParticlePatch, ParticlePrecision};
pub(crate) use run::run;
pub(crate) use save::BedSave;
pub use track::ParticleTrack;
