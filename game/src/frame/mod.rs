//! Path of frames from the farm to the window: scheduling, accumulation, reprojection, cross-fade.

pub mod accumulation;
pub mod cross_fade;
pub mod farm_startup;
pub mod opening_still;
pub mod pipeline;
pub mod reprojection;
pub mod scheduler;
