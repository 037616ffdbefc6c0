//! Reasons why a window cannot be drawn on.

use super::Present;

/// A reason why a display cannot be opened, or can show nothing any more.
#[derive(Debug, thiserror::Error)]
pub enum DisplayFault {
    /// The window gives no surface.
    #[error("no surface: {0}")]
    NoSurface(wgpu::CreateSurfaceError),
    /// No adapter can draw on the surface.
    #[error("no adapter: {0}")]
    NoAdapter(wgpu::RequestAdapterError),
    /// The adapter gives no device.
    #[error("no device: {0}")]
    NoDevice(wgpu::RequestDeviceError),
    /// The adapter and the surface have no format in common.
    #[error("the adapter cannot show this window")]
    NoFormat,
    /// A lost surface cannot be made again.
    #[error("the surface was lost: {0}")]
    SurfaceLost(wgpu::CreateSurfaceError),
    /// The surface has refused too many frames in a row.
    #[error("the surface {0}")]
    Refused(&'static str),
    /// The window's memory cannot be had or shown.
    #[error("{0}")]
    Memory(#[from] softbuffer::SoftBufferError),
    /// A way of presenting that was tried.
    #[error("{}: {fault}", way.words())]
    Way {
        /// The way.
        way: Present,
        /// Why it does not work.
        fault: Box<DisplayFault>,
    },
}
