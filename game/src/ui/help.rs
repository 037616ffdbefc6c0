//! Help on keys and mouse, generated from the action map: the panel, and `CONTROLS.md`.

use carom_text::text;
use carom_window::theme;
use egui::{Align2, Area, Color32, Context, Grid, Id, Order, RichText, ScrollArea};

use crate::input::{Action, Bindings, Group};

/// Draws all controls at the centre of the window, under their headings.
pub fn panel(ctx: &Context, bindings: &Bindings) {
    Area::new(Id::unique("help"))
        .order(Order::Foreground)
        .anchor(Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .show(ctx, |ui| {
            theme::frame()
                .fill(theme::PANEL.to_opaque())
                .show(ui, |ui| {
                    ui.heading(text!("menu-keys"));
                    let room = ctx.content_rect().size() - egui::vec2(60.0, 130.0);
                    ui.set_max_width(room.x);
                    ScrollArea::vertical()
                        .max_height(room.y.max(80.0))
                        .show(ui, |ui| table(ui, bindings));
                    let close = text!("controls-close", keys = bindings.words(Action::Help));
                    ui.label(RichText::new(close).color(theme::FAINT));
                });
        });
}

/// Draws the controls as a grid of two columns, under their headings.
pub fn table(ui: &mut egui::Ui, bindings: &Bindings) {
    let width = ui.available_width();
    Grid::new("controls")
        .num_columns(2)
        .max_col_width(0.5 * width - 12.0)
        .spacing([24.0, 4.0])
        .show(ui, |ui| {
            let row = |ui: &mut egui::Ui, keys: &str, does: &str, color: Color32| {
                ui.label(RichText::new(keys).color(color));
                ui.label(does);
                ui.end_row();
            };
            for group in Group::ALL {
                ui.label(RichText::new(group.title()).strong());
                ui.end_row();
                if group == Group::Aim {
                    let [mouse, does] = aim_by_mouse();
                    row(ui, mouse, does, theme::ACCENT);
                }
                for control in group.controls() {
                    let keys = bindings.words(control.action);
                    row(ui, &keys, control.does(), theme::ACCENT);
                }
            }
        });
}

/// Label and description of the one control without a binding.
fn aim_by_mouse() -> [&'static str; 2] {
    [text!("controls-mouse"), text!("controls-mouse-aims")]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Set `CAROM_REWRITE=1` to write the file.
    #[test]
    fn controls_file_matches_the_action_map() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/CONTROLS.md");
        let expected = markdown(&Bindings::default());
        if std::env::var_os("CAROM_REWRITE").is_some() {
            std::fs::write(path, expected).unwrap();
        } else {
            let written = std::fs::read_to_string(path).unwrap();
            assert_eq!(written, expected, "`CAROM_REWRITE=1 cargo test` writes it");
        }
    }

    fn markdown(bindings: &Bindings) -> String {
        let mut text = String::from(
            "# Controls\n\nThe keys of a new installation. Every one can be changed in the settings (Esc). Gamepads need a build \
             with `--features gamepad`; buttons have the names of an Xbox controller.\n",
        );
        for group in Group::ALL {
            text.push_str(&format!(
                "\n## {}\n\n| key or mouse | gamepad | action |\n|---|---|---|\n",
                group.title()
            ));
            if group == Group::Aim {
                let [mouse, does] = aim_by_mouse();
                text.push_str(&format!("| {mouse} | | {does} |\n"));
            }
            for control in group.controls() {
                let keys = bindings.words(control.action);
                let gamepad = bindings.gamepad_words(control.action);
                text.push_str(&format!("| {keys} | {gamepad} | {} |\n", control.does()));
            }
        }
        text
    }
}
