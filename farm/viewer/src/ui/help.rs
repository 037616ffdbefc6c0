//! Help: a list of all controls over the picture.

use carom_text::text;
use carom_window::theme;
use egui::{Align2, Area, Context, Grid, Id, Order, RichText, ScrollArea, Vec2};

use crate::controls::CONTROLS;

/// Draws the controls in the middle of the window.
pub(crate) fn show(ctx: &Context) {
    Area::new(Id::unique("view-help"))
        .order(Order::Foreground)
        .anchor(Align2::CENTER_CENTER, Vec2::ZERO)
        .show(ctx, |ui| {
            let frame = theme::frame().fill(theme::PANEL.to_opaque());
            frame.show(ui, |ui| {
                ui.heading(text!("view-help"));
                let room = ctx.content_rect().size() - Vec2::new(60.0, 120.0);
                ui.set_max_width(room.x);
                let area = ScrollArea::vertical().max_height(room.y.max(80.0));
                area.show(ui, |ui| {
                    let grid = Grid::new("view-controls").num_columns(2);
                    grid.spacing([24.0, 4.0]).show(ui, |ui| {
                        for id in CONTROLS {
                            let keys = text!(&format!("view-key-{id}"));
                            ui.label(RichText::new(keys).color(theme::ACCENT));
                            ui.label(text!(&format!("view-does-{id}")));
                            ui.end_row();
                        }
                    });
                });
                ui.label(RichText::new(text!("view-help-close")).color(theme::FAINT));
            });
        });
}
