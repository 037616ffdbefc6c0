//! The interface over the picture, drawn at once and without the farm: cue, aim, power, keys,
//! statistics.

pub mod aim;
pub mod cue_panel;
pub mod help;
pub mod input_batches;
mod keys;
pub mod layout;
pub mod lessons;
pub mod match_hud;
pub mod menu;
pub mod new_game;
mod page;
pub mod practice;
mod preferences;
pub mod replay;
pub mod stats;
pub mod theme;
pub mod toasts;
