//! The game's window: theme, text size, and drawing of the interface.

use carom_window::display::UiFrame;
use carom_window::screen::Screen;
use carom_window::theme;

use crate::app::app_shell::AppShell;
use crate::app::session::GameSession;
use crate::input::Event;
use crate::settings::Settings;

/// Applies the settings' text size and reduced motion to the theme.
pub(super) fn apply_theme(screen: &Screen, settings: &Settings) {
    let scale = text_scale(screen, settings);
    theme::apply(&screen.egui, scale, settings.reduced_motion);
}

/// Scale of text by the settings, limited by the window's size.
pub(super) fn text_scale(screen: &Screen, settings: &Settings) -> f32 {
    screen.text_scale(settings.text_scale as f32)
}

/// Whether a pointer event is over the interface; false for other events. `pointer` is its last position in
/// points, which is updated.
pub(super) fn is_over_panel(screen: &Screen, pointer: &mut egui::Pos2, event: Event) -> bool {
    match event {
        Event::Pointer(at) => *pointer = egui::pos2(at.x as f32, at.y as f32),
        Event::Button { .. } | Event::Wheel(_) => {}
        _ => return false,
    }
    screen.is_panel_at(*pointer)
}

/// Draws the interface and returns its shapes.
pub(super) fn draw_interface(
    screen: &mut Screen,
    session: &mut GameSession,
    shell: &mut AppShell,
    now_secs: f64,
) -> UiFrame {
    let name = screen.display.name().to_owned();
    let interface = screen.run_interface(|ui| shell.draw(ui.ctx(), session, now_secs, &name));
    // Animations of the interface need another redraw at once.
    if interface.repaint_delay.is_zero() {
        session.redraw();
    }
    interface.frame
}
