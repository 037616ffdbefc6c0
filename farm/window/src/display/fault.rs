//! Reasons why a window cannot be drawn on.

use super::Present;

/// Reason why a display cannot be opened or has stopped working.
#[derive(Debug, thiserror::Error)]
pub enum DisplayFault {
    /// No surface can be created for the window.
    #[error("no surface: {0}")]
    NoSurface(wgpu::CreateSurfaceError),
    /// No adapter can draw on the surface.
    #[error("no adapter: {0}")]
    NoAdapter(wgpu::RequestAdapterError),
    /// The adapter provides no device.
    #[error("no device: {0}")]
    NoDevice(wgpu::RequestDeviceError),
    /// The adapter and the surface have no format in common.
    #[error("the adapter cannot show this window")]
    NoFormat,
    /// A lost surface cannot be created again.
    #[error("the surface was lost: {0}")]
    SurfaceLost(wgpu::CreateSurfaceError),
    /// The surface has refused too many frames in a row.
    #[error("the surface {0}")]
    Refused(&'static str),
    /// The window's buffer cannot be allocated or presented.
    #[error("{0}")]
    Memory(#[from] softbuffer::SoftBufferError),
    /// A presentation that was tried.
    #[error("{}: {fault}", way.words())]
    Way {
        /// The presentation.
        way: Present,
        /// The reason why it does not work.
        fault: Box<DisplayFault>,
    },
}
