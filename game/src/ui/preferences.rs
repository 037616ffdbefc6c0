//! The page of settings. Each choice explains itself; what it trades is said with measured figures.

use carom_billiards::physics::Engine;
use clap::ValueEnum;
use egui::{Grid, RichText, ScrollArea, Slider, Ui};

use super::page::{MenuInput, Page};
use super::theme;
use crate::input::MouseSettings;
use crate::settings::{Settings, SettingsStore, engine_cost, engine_cost_table};

/// Draws the settings and changes them; returns the page that was asked for.
pub(super) fn page(ui: &mut Ui, store: &mut SettingsStore, input: MenuInput<'_>) -> Option<Page> {
    let mut wanted = None;
    ui.set_width(640.0_f32.min(ui.ctx().content_rect().width() - 60.0));
    ui.heading("Settings");
    let height = ui.ctx().content_rect().height() - 170.0;
    ScrollArea::vertical()
        .max_height(height.max(80.0))
        .show(ui, |ui| {
            Grid::new("settings")
                .num_columns(2)
                .spacing([20.0, 12.0])
                .show(ui, |ui| {
                    game(ui, &mut store.settings);
                    picture(ui, &mut store.settings, input);
                    interface(ui, &mut store.settings);
                    sound(ui, &mut store.settings, input);
                    mouse(ui, &mut store.settings.mouse);
                    ui.label("Keys");
                    if ui.button("Change the controls").clicked() {
                        wanted = Some(Page::Keys);
                    }
                    ui.end_row();
                    advanced(ui, &mut store.settings);
                });
            for warning in store.warnings() {
                ui.label(RichText::new(warning).color(theme::ALARM));
            }
        });
    ui.horizontal(|ui| {
        if ui.button("Restore the defaults").clicked() {
            store.settings = Settings {
                window: store.settings.window,
                lesson: store.settings.lesson,
                ..Settings::default()
            };
        }
        let kept = match store.path() {
            Some(path) => format!("Saved in {}", path.display()),
            None => "Not saved: this platform has no folder for settings".to_owned(),
        };
        ui.label(RichText::new(kept).color(theme::FAINT).small());
    });
    wanted
}

fn game(ui: &mut Ui, settings: &mut Settings) {
    choice(ui, "Aim aids", &mut settings.aim_aids);
    choice(ui, "Marked balls", &mut settings.ball_marks);
    choice(ui, "Balls", &mut settings.ball_set);
    choice(ui, "Cloth", &mut settings.cloth);
    choice(ui, "Cue", &mut settings.cue);
    choice(ui, "Pockets of the next game", &mut settings.pockets);
    choice(
        ui,
        "Table speed of the next game",
        &mut settings.table_speed,
    );
}

fn picture(ui: &mut Ui, settings: &mut Settings, input: MenuInput<'_>) {
    choice(ui, "Brightness", &mut settings.brightness);
    choice(ui, "While things move", &mut settings.quality);
    choice(ui, "Resolution", &mut settings.resolution);
    ui.label("Rendered by");
    ui.vertical(|ui| {
        ui.label(input.farm);
        explain(ui, &format!("Presented through {}", input.display));
    });
    ui.end_row();
    ui.label("Window");
    ui.checkbox(&mut settings.fullscreen, "Fullscreen");
    ui.end_row();
}

fn interface(ui: &mut Ui, settings: &mut Settings) {
    ui.label("Text size");
    // In a column, which a row of the grid grows with where it wraps.
    ui.vertical(|ui| {
        ui.horizontal_wrapped(|ui| {
            for percent in TEXT_PERCENTS {
                let scale = f64::from(percent) / 100.0;
                ui.selectable_value(&mut settings.text_scale, scale, format!("{percent} %"));
            }
        });
    });
    ui.end_row();
    ui.label("Motion");
    ui.vertical(|ui| {
        ui.checkbox(&mut settings.reduced_motion, "Reduced motion");
        explain(
            ui,
            "The camera cuts instead of gliding; panels do not slide or fade",
        );
    });
    ui.end_row();
}

fn sound(ui: &mut Ui, settings: &mut Settings, input: MenuInput<'_>) {
    ui.label("Sound");
    ui.vertical(|ui| {
        let mut percent = (settings.volume * 100.0).round() as i32;
        let slider = Slider::new(&mut percent, 0..=100)
            .suffix(" %")
            .text("Volume");
        if ui.add(slider).changed() {
            settings.volume = f64::from(percent) / 100.0;
        }
        explain(ui, input.sound);
    });
    ui.end_row();
}

fn advanced(ui: &mut Ui, settings: &mut Settings) {
    ui.label("Advanced: physics");
    ui.vertical(|ui| {
        ui.horizontal_wrapped(|ui| {
            for name in ENGINES {
                let engine: Engine = name.parse().unwrap_or_default();
                ui.selectable_value(&mut settings.physics, engine, name)
                    .on_hover_ui(|ui| {
                        let table = RichText::new(engine_cost_table()).monospace();
                        ui.add(egui::Label::new(table).extend());
                    });
            }
        });
        explain(ui, &engine_cost(&settings.physics));
    });
    ui.end_row();
}

fn mouse(ui: &mut Ui, mouse: &mut MouseSettings) {
    ui.label("Mouse");
    ui.vertical(|ui| {
        let [min, max] = MouseSettings::SPEED.map(|speed| (100.0 * speed) as i32);
        let mut percent = (100.0 * mouse.speed).round() as i32;
        let slider = Slider::new(&mut percent, min..=max)
            .logarithmic(true)
            .suffix(" %")
            .text("Speed");
        if ui.add(slider).changed() {
            mouse.speed = f64::from(percent) / 100.0;
        }
        ui.checkbox(&mut mouse.inverts_pitch, "Invert the camera's up and down");
    });
    ui.end_row();
}

/// A row of names, and the sentence of the one that is chosen.
fn choice<T: ValueEnum + PartialEq + Copy>(ui: &mut Ui, label: &str, chosen: &mut T) {
    ui.label(label);
    ui.vertical(|ui| {
        ui.horizontal_wrapped(|ui| {
            for value in T::value_variants() {
                let name = value.to_possible_value();
                let name = name.map_or(String::new(), |name| capital(name.get_name()));
                ui.selectable_value(chosen, *value, name);
            }
        });
        let help = chosen.to_possible_value();
        let help = help.as_ref().and_then(|value| value.get_help());
        explain(ui, &help.map_or(String::new(), ToString::to_string));
    });
    ui.end_row();
}

fn explain(ui: &mut Ui, words: &str) {
    ui.label(RichText::new(words).color(theme::FAINT).small());
}

fn capital(word: &str) -> String {
    let mut letters = word.chars();
    let first = letters.next().map(char::to_uppercase);
    first.into_iter().flatten().chain(letters).collect()
}

const TEXT_PERCENTS: [u32; 6] = [75, 100, 125, 150, 200, 250];
/// The ends of the trade, and what is between.
const ENGINES: [&str; 4] = ["exact", "rapier-60", "rapier-240", "rapier-1000"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_engine_that_is_offered_can_be_played() {
        for name in ENGINES {
            assert_eq!(name.parse::<Engine>().unwrap().to_string(), name);
        }
    }
}
