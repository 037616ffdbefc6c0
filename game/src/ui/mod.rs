//! User interface over the picture, drawn in every frame independently of the farm: aim, power, panels,
//! pages.

pub mod aim;
pub mod cue_panel;
mod form;
pub mod help;
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
