//! Billiards without a window: physics, the rules of six games, computer players, and matches.
//!
//! ```text
//!            Stroke                Shot               ShotReport             Verdict
//! player ─────────────▶ physics ─────────▶ game_match ───────────▶ rules ─────────────▶ game_match
//!   ▲                   World::strike      what happened           Referee::judge       whose turn
//!   └── ai::think ◀───────────────────────────────── position ◀───────────────────────────────┘
//! ```
//!
//! - [`physics`]: tables, laws of motion and contact, and whole shots computed event by event;
//! - [`rules`]: free of physics, what happened goes in and a verdict comes out;
//! - [`ai`]: the computer as a player, through the same calls as a person;
//! - [`game_match`]: players, a table, the rules, and what has happened so far.
//!
//! The crate knows no clock, no window, no frame rate and no randomness of the machine: the same
//! strokes give the same bits.
//!
//! ```
//! use carom_billiards::game_match::{Match, MatchConfig, Player};
//! use carom_billiards::physics::Stroke;
//! use carom_billiards::rules::RuleSet;
//!
//! let players = Player::list("Ada,Bo")?;
//! let mut game = Match::new(MatchConfig::new(RuleSet::Nine, players, 7)?)?;
//! let stroke = Stroke::straight(0.0, 8.0);
//! let shot = game.strike(stroke)?;
//! let verdict = game.finish(stroke, &shot);
//! println!("{}", verdict.lines.join("; "));
//! # Ok::<(), carom_billiards::Error>(())
//! ```

#![cfg_attr(
    test,
    allow(
        clippy::disallowed_methods,
        reason = "tests compare with the system's functions"
    )
)]

pub mod ai;
mod deterministic_math;
mod error;
mod file_format;
pub mod game_match;
pub mod physics;
pub mod rng;
pub mod rules;
pub mod shot_report;

pub use error::{
    EngineFault, Error, FileFault, LayoutFault, ParticleFault, PlacementFault, PlayersFault,
    Result, RuleFault, StrokeFault, TableFault,
};
