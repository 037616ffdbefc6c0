//! What happens to radiance after it has been traced.
//!
//! ```text
//! tiles ─▶ Region: the tiles and a guard band ─▶ paths, first hits ─▶ filter ─▶ the tiles
//! ```
//!
//! A pixel's result depends on what lies within [`SUPPORT`] pixels of it and on nothing else, and
//! all of that is traced with it, so that denoised pictures too do not depend on the partition.

mod filter;
mod noisy;
mod outline;
mod planes;
mod region;
mod variance;
pub(crate) mod weights;

pub(crate) use filter::FilterMemory;
pub(crate) use noisy::{NoisyPixels, NoisyTile, NoisyTracer, Sums, in_parts, trace_denoised};
pub(crate) use region::Region;

/// Pixels from which a denoised pixel takes light, in each direction. Wider finds more to average
/// and costs every run of tiles a wider guard band.
pub const SUPPORT: u32 = 5;
