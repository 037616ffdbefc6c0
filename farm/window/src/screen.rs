//! Open window with its display and the state of its interface.

use std::sync::Arc;
use std::time::Duration;

use carom_tracer::ImageSize;
use egui::{Ui, ViewportId};
use egui_winit::State as EguiState;
use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

use crate::connection::WindowError;
use crate::display::{Display, Present, UiFrame};
use crate::input_batches::passes;
use crate::theme;

/// Open window with egui's state, whose textures are in the display.
pub struct Screen {
    /// The window.
    pub window: Arc<Window>,
    /// The display of pictures and interface.
    pub display: Display,
    /// egui's context.
    pub egui: egui::Context,
    /// Collector of the interface's input.
    pub input: EguiState,
}

/// Output of an interface pass, ready to be shown.
pub struct Interface {
    /// What to draw.
    pub frame: UiFrame,
    /// Time after which it must be drawn again even without events.
    pub repaint_delay: Duration,
}

impl Screen {
    /// Opens a display on a window, with the given presentation or else the first that works. Errors name the
    /// command `instead`, which needs no window.
    ///
    /// # Errors
    /// [`WindowError::NotDrawnOn`] if no presentation works.
    pub fn open(
        window: Arc<Window>,
        event_loop: &ActiveEventLoop,
        present: Option<Present>,
        instead: &'static str,
    ) -> Result<Self, WindowError> {
        let handle = event_loop.owned_display_handle();
        let display = Display::open(&window, &handle, present).map_err(|tried| {
            let tried: Vec<String> = tried.iter().map(ToString::to_string).collect();
            WindowError::NotDrawnOn {
                tried: tried.join("; "),
                instead,
            }
        })?;
        let name = display.name();
        tracing::info!("presenting with {name}");
        let egui = egui::Context::default();
        let scale = window.scale_factor() as f32;
        let input = EguiState::new(
            egui.clone(),
            ViewportId::ROOT,
            &window,
            Some(scale),
            None,
            Some(TEXTURE_EDGE_MAX),
        );
        Ok(Self {
            window,
            display,
            egui,
            input,
        })
    }

    /// Size of the window in pixels.
    pub fn size(&self) -> ImageSize {
        let size = self.window.inner_size();
        ImageSize::new(size.width, size.height)
    }

    /// The largest text scale for which the window has room, at most `wanted`.
    pub fn text_scale(&self, wanted: f32) -> f32 {
        let size = self.window.inner_size();
        let points = egui::vec2(size.width as f32, size.height as f32);
        theme::fitting_scale(wanted, points / self.window.scale_factor() as f32)
    }

    /// Sends a key press and release to the interface, for input of another device.
    pub fn press(&mut self, (key, modifiers): (egui::Key, egui::Modifiers)) {
        let events = &mut self.input.egui_input_mut().events;
        events.extend([true, false].map(|pressed| egui::Event::Key {
            key,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers,
        }));
    }

    /// Whether a panel of the interface lies at a position in points.
    pub fn is_panel_at(&self, place: egui::Pos2) -> bool {
        let layer = self.egui.layer_id_at(place);
        layer.is_some_and(|layer| layer.order != egui::Order::Background)
    }

    /// Runs the interface on the events since the last call.
    pub fn run_interface(&mut self, mut draw: impl FnMut(&mut Ui)) -> Interface {
        let raw = self.input.take_egui_input(&self.window);
        let mut output = egui::FullOutput::default();
        for raw in passes(raw) {
            output.append(self.egui.run_ui(raw, &mut draw));
        }
        let viewport = output.viewport_output.get(&ViewportId::ROOT);
        let repaint_delay = viewport.map_or(Duration::MAX, |viewport| viewport.repaint_delay);
        self.input
            .handle_platform_output(&self.window, output.platform_output);
        let frame = UiFrame {
            textures: output.textures_delta,
            primitives: self.egui.tessellate(output.shapes, output.pixels_per_point),
            pixels_per_point: output.pixels_per_point,
        };
        Interface {
            frame,
            repaint_delay,
        }
    }
}

/// Maximum edge of a texture in pixels that every display supports.
const TEXTURE_EDGE_MAX: usize = 2048;
