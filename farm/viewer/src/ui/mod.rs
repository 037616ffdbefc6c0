//! User interface over the picture, and the steps of one pass of it.

pub(crate) mod animation;
pub(crate) mod help;
pub(crate) mod notices;
pub(crate) mod panel;

use egui::Ui;

use crate::viewer::Viewer;

impl Viewer {
    /// Runs a pass of the interface: handles input, draws, and passes the wanted state to the renderer.
    pub fn draw(&mut self, ui: &mut Ui, now_secs: f64, present: &str) {
        self.take_news(now_secs);
        self.press(ui);
        self.play(ui, now_secs);
        let mut room = self.draw_stats(ui, now_secs, present);
        if self.has_panel && self.document.is_some() {
            room = panel::show(ui.ctx(), room, self);
        }
        let standing = self.standing();
        notices::show(ui.ctx(), room, self, &self.toasts, &standing);
        if self.has_help {
            help::show(ui.ctx());
        }
        self.look(ui, now_secs);
        self.follow();
    }
}
