//! The simulation of billiards: laws of motion and contact, and shots played out from them.
//!
//! ```text
//! Table + BallLayout ─► World ── strike(Stroke) ─► Shot ── poses_at(t) ─► the picture
//!                         ▲                          │ ── events() ─────► rules, sound
//!                         └───────── adopt ◄─────────┘
//! ```
//! A shot is simulated as a whole at the stroke, which takes milliseconds, from event to event: between
//! two events every ball moves with constant acceleration, known in closed form ([`Cloth`]), and at the
//! events the laws set the velocities.
//! The simulation knows no clock, no frame rate and no randomness: the same world and stroke give the
//! same bits on every run, in every build, on every machine. With plain rapier ([`Engine::Rapier`])
//! this holds for one build on one machine, as its solver promises no more.
//!
//! A ball that is struck or knocked upwards flies. Contacts in the air obey the same laws in three
//! dimensions, at times that are as exact, because a parabola has a constant acceleration too.
//!
//! ```
//! use carom_billiards::physics::{Stroke, Table, World};
//!
//! let table = Table::nine_foot();
//! let rack = table.rack_eight(7);
//! let mut world = World::new(table, rack)?;
//! let shot = world.strike(Stroke::straight(0.0, 8.0))?;
//! for frame in 0..(shot.duration_secs() * 60.0) as u32 {
//!     let poses = shot.poses_at(f64::from(frame) / 60.0);
//!     assert_eq!(poses.len(), 16);
//! }
//! world.adopt(&shot);
//! # Ok::<(), carom_billiards::Error>(())
//! ```

mod aim_line;
mod ball;
mod ball_ball;
mod ball_in_motion;
mod built_in_tables;
mod clipped_contact;
mod cloth;
mod contact;
mod contact_cluster;
mod contact_time;
mod cue_impact;
mod cushion;
mod cushion_edge;
mod engine;
mod event;
mod event_engine;
mod event_queue;
mod flight;
mod jaw_contact;
mod laws;
mod motion;
mod orientation;
mod particles;
mod rack;
mod rapier_engine;
mod rebound;
mod recording;
mod shot;
mod slate_impact;
mod static_contact;
mod table;
mod table_spec;
mod trajectory;
mod world;

pub use aim_line::{AimContact, AimLine, predict};
pub use ball::{BallBody, BallPose, BallState, Phase};
pub use ball_ball::{BallBallLaw, CLUSTER_ENERGY_J, CLUSTER_SPEED_M_S};
pub use built_in_tables::{PocketSize, TableOptions};
pub use cloth::{Cloth, TableSpeed};
pub use cue_impact::{Cue, Stroke};
pub use cushion::CushionLaw;
pub use engine::{Engine, Rapier};
pub use event::{Event, EventKind, Surface};
pub use event_engine::{SHOT_EVENTS_MAX, SHOT_SECS_MAX};
pub use flight::HOP_LEAST_M;
pub use laws::Laws;
pub(crate) use particles::BedSave;
pub use particles::{
    ParticleBed, ParticleGroup, ParticleMaterial, ParticlePatch, ParticlePrecision, ParticleTrack,
};
pub use rack::BallLayout;
pub use rebound::{REBOUND_ENERGY_J, REBOUND_SPEED_M_S};
pub use recording::{BYTES_MAX, CLIPS_MAX, Clip, Recording, TITLE_BYTES_MAX};
pub use shot::Shot;
pub use slate_impact::BounceLaw;
pub use table::{Circle, Cushion, Nose, Pocket, Rails, Table, TableParts};
pub use table_spec::{PocketSpec, TableSpec};
pub use world::World;
