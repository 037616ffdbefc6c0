//! Denoiser: a filter over traced radiance, guided by albedo, normal and depth.
//!
//! ```text
//! tiles ─▶ GuardedRegion: the tiles and a guard band ─▶ paths, first hits ─▶ filter ─▶ the tiles
//! ```
//!
//! A pixel's result depends only on what lies within [`SUPPORT`] pixels of it, and all of that is
//! traced with it, so denoised images do not depend on their partition into tiles either.

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

/// Radius in pixels, along each axis, of the area from which a denoised pixel takes light. A larger
/// one averages more, but needs a wider guard band around every run of tiles: from 9 on, one more
/// block of 8 pixels.
pub const SUPPORT: u32 = 8;
