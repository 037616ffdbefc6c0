//! Display of a picture and the interface in a window: through a GPU or in software.

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

/// Picture to be shown, stretched over the whole window.
#[derive(Clone, Debug)]
pub struct DisplayFrame {
    /// Number that differs for each picture.
    pub serial: u64,
    /// Its size in pixels.
    pub size: ImageSize,
    /// Pixels in sRGB with alpha 255, row-major from the top left.
    pub rgba: Vec<[u8; 4]>,
    /// The scene update that the picture shows.
    pub update: SceneUpdate,
}

/// Output of egui to be drawn.
pub struct UiFrame {
    /// Textures to update before drawing and to free after it.
    pub textures: TexturesDelta,
    /// Triangles, with positions in points.
    pub primitives: Vec<ClippedPrimitive>,
    /// Pixels per point.
    pub pixels_per_point: f32,
}

impl Drop for UiFrame {
    fn drop(&mut self) {
        // egui asserts in debug builds that deltas are applied; each display has done so by now.
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
    /// Drawing on a GPU.
    Gpu(Box<GpuDisplay>),
    /// Drawing on the CPU.
    Software(Box<SoftwareDisplay>),
}

impl Display {
    /// Opens the first presentation that works, in the order Vulkan, OpenGL, software; or only the one that
    /// is `forced`.
    ///
    /// # Errors
    /// Each presentation that was tried, with its reason.
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

    /// Adapts to the window's size; nothing is drawn on a size of 0.
    pub fn resize(&mut self, size: ImageSize) {
        match self {
            Self::Gpu(display) => display.resize(size),
            Self::Software(display) => display.resize(size),
        }
    }

    /// Draws and presents a frame: the picture, and the user interface over it. The frame is skipped if the
    /// window cannot accept it at the moment.
    ///
    /// # Errors
    /// The reason why this display has stopped working.
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

    /// The display's name for the user.
    pub fn name(&self) -> &str {
        match self {
            Self::Gpu(display) => display.name(),
            Self::Software(_) => text!("display-software"),
        }
    }

    /// Whether the window is drawn without a GPU.
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
