//! Display of a frame and the interface in the window: through a GPU, or without one.

mod fault;
pub mod gpu;
pub mod raster;
pub mod software;

use std::sync::Arc;

use carom_text::text;
use carom_tracer::{ImageSize, SceneUpdate};
use clap::ValueEnum;
use egui::{ClippedPrimitive, TexturesDelta};
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

pub use fault::DisplayFault;
pub use gpu::GpuDisplay;
pub use software::SoftwareDisplay;

/// A picture to show, stretched over the whole window.
#[derive(Clone, Debug)]
pub struct DisplayFrame {
    /// Differs for each picture.
    pub serial: u64,
    /// Pixels across and down.
    pub size: ImageSize,
    /// sRGB and 255, row-major from the top left.
    pub rgba: Vec<[u8; 4]>,
    /// What it was taken of.
    pub update: SceneUpdate,
}

/// What egui wants on the screen.
pub struct UiFrame {
    /// Textures to take in before and to drop after drawing.
    pub textures: TexturesDelta,
    /// Triangles in points.
    pub primitives: Vec<ClippedPrimitive>,
    /// Pixels of a point.
    pub pixels_per_point: f32,
}

impl Drop for UiFrame {
    fn drop(&mut self) {
        // egui insists in debug builds that deltas are taken in; each display has done so by now.
        self.textures.clear();
    }
}

/// How pictures get into the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Present {
    /// Vulkan (or the system's own interface, such as Metal).
    Vulkan,
    /// OpenGL.
    Gl,
    /// The CPU.
    Software,
}

/// An open window's screen.
pub enum Display {
    /// Through a GPU.
    Gpu(Box<GpuDisplay>),
    /// Without one.
    Software(Box<SoftwareDisplay>),
}

impl Display {
    /// Opens the first way that works, in the order Vulkan, OpenGL, software; or the one that is
    /// `forced`.
    ///
    /// # Errors
    /// Each way that was tried, with its reason.
    pub fn open(
        window: &Arc<Window>,
        display: &OwnedDisplayHandle,
        forced: Option<Present>,
    ) -> Result<Self, Vec<DisplayFault>> {
        let ways = forced.map_or(
            vec![Present::Vulkan, Present::Gl, Present::Software],
            |way| vec![way],
        );
        let mut tried = Vec::new();
        for way in ways {
            match Self::open_one(window, display, way) {
                Ok(mut opened) => {
                    for reason in &tried {
                        tracing::info!("{reason}");
                    }
                    let size = window.inner_size();
                    opened.resize(ImageSize::new(size.width, size.height));
                    return Ok(opened);
                }
                Err(fault) => {
                    let fault = Box::new(fault);
                    tried.push(DisplayFault::Way { way, fault });
                }
            }
        }
        Err(tried)
    }

    /// Follows the window's size; a size of 0 shows nothing.
    pub fn resize(&mut self, size: ImageSize) {
        match self {
            Self::Gpu(display) => display.resize(size),
            Self::Software(display) => display.resize(size),
        }
    }

    /// Draws and shows a frame: the picture, and the user interface over it. A frame that the
    /// window cannot take at the moment is left out.
    ///
    /// # Errors
    /// Why this display can show nothing any more.
    pub fn show(
        &mut self,
        picture: Option<&DisplayFrame>,
        ui: &UiFrame,
    ) -> Result<(), DisplayFault> {
        match self {
            Self::Gpu(display) => display.show(picture, ui),
            Self::Software(display) => display.show(picture, ui),
        }
    }

    /// For people.
    pub fn name(&self) -> &str {
        match self {
            Self::Gpu(display) => display.name(),
            Self::Software(_) => text!("display-software"),
        }
    }

    /// Whether the window already is drawn without a GPU.
    pub fn is_software(&self) -> bool {
        matches!(self, Self::Software(_))
    }

    fn open_one(
        window: &Arc<Window>,
        display: &OwnedDisplayHandle,
        way: Present,
    ) -> Result<Self, DisplayFault> {
        let gpu = |backends| {
            GpuDisplay::open(window.clone(), display, backends).map(|gpu| Self::Gpu(Box::new(gpu)))
        };
        match way {
            Present::Vulkan => gpu(wgpu::Backends::PRIMARY),
            Present::Gl => gpu(wgpu::Backends::GL),
            Present::Software => SoftwareDisplay::open(window.clone(), display.clone())
                .map(|software| Self::Software(Box::new(software))),
        }
    }
}

impl Present {
    fn words(self) -> &'static str {
        match self {
            Self::Vulkan => text!("display-vulkan"),
            Self::Gl => text!("display-opengl"),
            Self::Software => "software",
        }
    }
}
