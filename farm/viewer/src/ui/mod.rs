//! Interface over the picture, and what is done in a pass of it.

pub(crate) mod animation;
pub(crate) mod help;
pub(crate) mod notices;
pub(crate) mod panel;

use egui::Ui;

use crate::viewer::Viewer;

impl Viewer {
    /// Draws the interface and does what the person at it wants.
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
