//! The traced scene: the room with its table and balls, and updates of their poses.

pub mod ball_materials;
pub mod cue_stick;
pub mod export;
mod potted_balls;
pub mod scene_builder;
pub mod scoreboard;
pub mod table_args;
pub mod table_scene;
pub mod table_style;
