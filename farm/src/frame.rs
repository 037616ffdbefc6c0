//! Frames as an application submits and receives them.

use carom_protocol::{FrameId, PixelFormat};
use carom_tracer::{ImageSize, RenderSettings, SceneUpdate, Tile};

use crate::stats::FrameStats;

/// A frame to trace.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSpec {
    /// Camera and poses.
    pub update: SceneUpdate,
    /// Size in pixels.
    pub size: ImageSize,
    /// Samples, maximum depth and seed.
    pub settings: RenderSettings,
    /// Format of the returned pixels.
    pub format: PixelFormat,
}

/// A finished frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The id returned by [`crate::Farm::submit`].
    pub id: FrameId,
    /// Size in pixels.
    pub size: ImageSize,
    /// The pixels, row-major from the top left.
    pub pixels: Pixels,
    /// Tiles that were incomplete at the deadline: their pixels are black or, where samples are divided,
    /// the mean of those that had arrived. The frame is delivered again once complete, unless a later one
    /// has reached its deadline by then.
    pub missing: Vec<Tile>,
    /// Its statistics.
    pub stats: FrameStats,
}

/// Pixels in the requested format.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// [`PixelFormat::Srgb8`] with an opaque alpha of 255, as a window's texture takes them.
    Srgb8(Vec<[u8; 4]>),
    /// [`PixelFormat::LinearF16`] and [`PixelFormat::LinearF32`].
    Linear(Vec<[f32; 3]>),
}
