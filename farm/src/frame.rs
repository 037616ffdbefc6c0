//! Frames as an application asks for them and gets them.

use carom_protocol::{FrameId, PixelFormat};
use carom_tracer::{ImageSize, RenderSettings, SceneUpdate, Tile};

use crate::stats::FrameStats;

/// A frame to trace.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSpec {
    /// Camera and poses.
    pub update: SceneUpdate,
    /// Pixels.
    pub size: ImageSize,
    /// Samples, maximum depth and seed.
    pub settings: RenderSettings,
    /// How pixels come back.
    pub format: PixelFormat,
}

/// A finished frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// What [`crate::Farm::submit`] returned.
    pub id: FrameId,
    /// Pixels across and down.
    pub size: ImageSize,
    /// The pixels, row-major from the top left.
    pub pixels: Pixels,
    /// Tiles that were not whole when the picture had to be shown: their pixels are black or, where
    /// samples are divided, the mean of those that were there. The picture comes again when it is
    /// whole, unless a later one has had to be shown by then.
    pub missing: Vec<Tile>,
    /// How it was made.
    pub stats: FrameStats,
}

/// Pixels in the format that was asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// [`PixelFormat::Srgb8`], and 255 for opaque: as a window's texture takes them.
    Srgb8(Vec<[u8; 4]>),
    /// [`PixelFormat::LinearF16`] and [`PixelFormat::LinearF32`].
    Linear(Vec<[f32; 3]>),
}
