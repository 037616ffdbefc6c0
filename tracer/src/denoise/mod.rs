//! Denoiser: a filter over traced radiance, guided by albedo, normal and depth.
//!
//! ```text
//! tiles ─▶ GuardedRegion: the tiles and a guard band ─▶ paths, first hits ─▶ filter ─▶ the tiles
//! ```
//!
//! A pixel's result depends on what lies within [`SUPPORT`] pixels of it and on nothing else, and
//! all of that is traced with it, so that denoised pictures too do not depend on the partition.

mod edge_supersampling;
mod filter;
mod frame;
mod guard_band;
mod input;
mod neighbourhood;
mod soa_image;
mod variance;
pub(crate) mod weights;

pub(crate) use filter::FilterMemory;
#[cfg(feature = "gpu")]
pub(crate) use frame::in_parts;
pub(crate) use frame::trace_denoised;
#[cfg(feature = "gpu")]
pub(crate) use guard_band::{GuardedRegion, REGION_SAMPLES, RegionLimits};
pub(crate) use input::{DenoiseInput, DenoiseInputTile, DenoiseSource, SampleSums};

/// Pixels from which a denoised pixel takes light, in each direction. Wider finds more to average
/// and costs every run of tiles a wider guard band, from 9 on by a block of 8 pixels more.
pub const SUPPORT: u32 = 8;
