//! Pictures of a [`carom_farm::Farm`] in a window, for the applications that show them.
//!
//! ```text
//! picture ─▶ display ─▶ window (Vulkan, OpenGL or the processor)
//! egui ──────────┘▲
//! Farm ─▶ stats ──┘ panels over the picture, in the look of theme
//! ```
//!
//! Only [`display`] knows wgpu and softbuffer.

pub mod display;
pub mod input_batches;
pub mod stats;
pub mod theme;
