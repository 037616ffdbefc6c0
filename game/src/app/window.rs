//! An open window with its display and the state of its interface.

use std::sync::Arc;

use anyhow::anyhow;
use carom_window::display::{Display, Present, UiFrame};
use carom_window::input_batches::passes;
use carom_window::theme;
use egui_winit::State as EguiState;
use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

use crate::app::app_shell::AppShell;
use crate::app::session::GameSession;
use crate::input::Event;
use crate::settings::Settings;

/// An open window, and egui's state, whose textures live in the display.
pub(super) struct Screen {
    pub(super) window: Arc<Window>,
    pub(super) display: Display,
    pub(super) egui: egui::Context,
    pub(super) input: EguiState,
    /// Where the pointer was last, points.
    pointer: egui::Pos2,
}

impl Screen {
    /// Opens a display on a window.
    ///
    /// # Errors
    /// What was tried and what to install.
    pub(super) fn open(
        window: Arc<Window>,
        event_loop: &ActiveEventLoop,
        present: Option<Present>,
        settings: &Settings,
    ) -> anyhow::Result<Self> {
        let handle = event_loop.owned_display_handle();
        let display = Display::open(&window, &handle, present).map_err(|tried| {
            let tried: Vec<String> = tried.iter().map(ToString::to_string).collect();
            anyhow!(
                "the window cannot be drawn on ({}). A Vulkan driver helps, on Debian or Ubuntu \
                 `apt install mesa-vulkan-drivers`; `carom --headless` needs none",
                tried.join("; ")
            )
        })?;
        let name = display.name();
        tracing::info!("presenting with {name}");
        let egui = egui::Context::default();
        let scale = window.scale_factor() as f32;
        let input = EguiState::new(
            egui.clone(),
            egui::ViewportId::ROOT,
            &window,
            Some(scale),
            None,
            Some(2048),
        );
        let screen = Self {
            window,
            display,
            egui,
            input,
            pointer: egui::Pos2::ZERO,
        };
        screen.apply_theme(settings);
        Ok(screen)
    }

    /// Looks as the settings want it.
    pub(super) fn apply_theme(&self, settings: &Settings) {
        theme::apply(
            &self.egui,
            self.text_scale(settings),
            settings.reduced_motion,
        );
    }

    /// Text as large as the settings want it and the window has room for.
    pub(super) fn text_scale(&self, settings: &Settings) -> f32 {
        let size = self.window.inner_size();
        let points = egui::vec2(size.width as f32, size.height as f32);
        let points = points / self.window.scale_factor() as f32;
        theme::fitting_scale(settings.text_scale as f32, points)
    }

    /// Gives a page a press of a key, as a gamepad means it.
    pub(super) fn press(&mut self, (key, modifiers): (egui::Key, egui::Modifiers)) {
        let events = &mut self.input.egui_input_mut().events;
        events.extend([true, false].map(|pressed| egui::Event::Key {
            key,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers,
        }));
    }

    /// Whether the pointer, whose event this is, is over something of the interface.
    pub(super) fn is_over_panel(&mut self, event: Event) -> bool {
        match event {
            Event::Pointer(at) => self.pointer = egui::pos2(at.x as f32, at.y as f32),
            Event::Button { .. } | Event::Wheel(_) => {}
            _ => return false,
        }
        let layer = self.egui.layer_id_at(self.pointer);
        layer.is_some_and(|layer| layer.order != egui::Order::Background)
    }

    /// Draws the interface.
    pub(super) fn draw_interface(
        &mut self,
        session: &mut GameSession,
        shell: &mut AppShell,
        now_secs: f64,
    ) -> UiFrame {
        let raw = self.input.take_egui_input(&self.window);
        let name = self.display.name().to_owned();
        let mut output = egui::FullOutput::default();
        for raw in passes(raw) {
            output.append(self.egui.run_ui(raw, |ui| {
                shell.draw(ui.ctx(), session, now_secs, &name);
            }));
        }
        // What moves or fades is drawn again at once.
        let repaint = output.viewport_output.get(&egui::ViewportId::ROOT);
        if repaint.is_some_and(|viewport| viewport.repaint_delay.is_zero()) {
            session.redraw();
        }
        self.input
            .handle_platform_output(&self.window, output.platform_output);
        UiFrame {
            textures: output.textures_delta,
            primitives: self.egui.tessellate(output.shapes, output.pixels_per_point),
            pixels_per_point: output.pixels_per_point,
        }
    }
}
