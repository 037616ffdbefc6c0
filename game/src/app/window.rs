//! The game in its window: its look as the settings want it, and its interface.

use carom_window::display::UiFrame;
use carom_window::screen::Screen;
use carom_window::theme;

use crate::app::app_shell::AppShell;
use crate::app::session::GameSession;
use crate::input::Event;
use crate::settings::Settings;

/// Looks as the settings want it.
pub(super) fn apply_theme(screen: &Screen, settings: &Settings) {
    let scale = text_scale(screen, settings);
    theme::apply(&screen.egui, scale, settings.reduced_motion);
}

/// Text as large as the settings want it and the window has room for.
pub(super) fn text_scale(screen: &Screen, settings: &Settings) -> f32 {
    screen.text_scale(settings.text_scale as f32)
}

/// Whether the pointer, whose event this is, is over something of the interface. `pointer` is where it was
/// last, in points.
pub(super) fn is_over_panel(screen: &Screen, pointer: &mut egui::Pos2, event: Event) -> bool {
    match event {
        Event::Pointer(at) => *pointer = egui::pos2(at.x as f32, at.y as f32),
        Event::Button { .. } | Event::Wheel(_) => {}
        _ => return false,
    }
    screen.is_panel_at(*pointer)
}

/// Draws the interface.
pub(super) fn draw_interface(
    screen: &mut Screen,
    session: &mut GameSession,
    shell: &mut AppShell,
    now_secs: f64,
) -> UiFrame {
    let name = screen.display.name().to_owned();
    let interface = screen.run_interface(|ui| shell.draw(ui.ctx(), session, now_secs, &name));
    // What moves or fades is drawn again at once.
    if interface.repaint_delay.is_zero() {
        session.redraw();
    }
    interface.frame
}
