//! Page of the settings. Each choice has an explanation, with measured figures where it is a trade-off.

use std::thread::available_parallelism;

use carom_billiards::physics::Engine;
use carom_text::text;
use carom_window::theme;
use clap::ValueEnum;
use egui::{Grid, RichText, ScrollArea, Slider, Ui};

use super::form::{explain, row};
use super::page::{MenuInput, Page};
use crate::input::MouseSettings;
use crate::settings::{
    Settings, SettingsStore, engine_cost, engine_cost_table, particle_cost, value_name,
};

/// Draws the settings and changes them; returns a page to be opened.
pub(super) fn page(ui: &mut Ui, store: &mut SettingsStore, input: MenuInput<'_>) -> Option<Page> {
    let mut wanted = None;
    ui.set_width(640.0_f32.min(ui.ctx().content_rect().width() - 60.0));
    ui.heading(text!("menu-settings"));
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
                    ui.label(text!("setting-keys"));
                    if ui.button(text!("setting-keys-change")).clicked() {
                        wanted = Some(Page::Keys);
                    }
                    ui.end_row();
                    advanced(ui, &mut store.settings);
                });
            for warning in store.warnings() {
                ui.label(RichText::new(warning).color(theme::ALARM));
            }
        });
    ui.horizontal_wrapped(|ui| {
        if ui.button(text!("settings-restore")).clicked() {
            store.settings = Settings {
                window: store.settings.window,
                lesson: store.settings.lesson,
                ..Settings::default()
            };
        }
        let kept = match store.path() {
            Some(path) => text!("settings-saved", path = path.display().to_string()),
            None => text!("settings-not-saved").to_owned(),
        };
        explain(ui, kept);
    });
    wanted
}

fn game(ui: &mut Ui, settings: &mut Settings) {
    choice(ui, "aim-aids", &mut settings.aim_aids);
    choice(ui, "ball-marks", &mut settings.ball_marks);
    choice(ui, "ball-set", &mut settings.style.balls);
    choice(ui, "cloth", &mut settings.style.cloth);
    choice(ui, "cue", &mut settings.style.cue);
    choice(ui, "pockets", &mut settings.table.pockets);
    choice(ui, "table-speed", &mut settings.table.speed);
}

fn picture(ui: &mut Ui, settings: &mut Settings, input: MenuInput<'_>) {
    choice(ui, "brightness", &mut settings.style.brightness);
    choice(ui, "quality", &mut settings.quality);
    choice(ui, "resolution", &mut settings.resolution);
    choice(ui, "particles", &mut settings.style.particles);
    row(ui, text!("setting-farm"), |ui| {
        ui.label(input.farm);
        explain(ui, text!("setting-display", display = input.display));
    });
    threads(ui, &mut settings.threads);
    ui.label(text!("setting-window"));
    ui.checkbox(&mut settings.fullscreen, text!("setting-fullscreen"));
    ui.end_row();
}

/// Draws the number of CPU threads, of which 0 is one per core.
fn threads(ui: &mut Ui, threads: &mut u16) {
    row(ui, text!("setting-threads"), |ui| {
        let cores = available_parallelism().map_or(1, |cores| cores.get() as u16);
        let max = cores.max(*threads).min(Settings::THREADS_MAX);
        let slider = Slider::new(threads, 0..=max)
            .custom_formatter(|count, _| match count {
                0.0 => text!("setting-threads-all").to_owned(),
                count => count.to_string(),
            })
            .text(text!("setting-threads-count"));
        ui.add(slider);
        explain(ui, text!("setting-threads-about", count = *threads));
    });
}

fn interface(ui: &mut Ui, settings: &mut Settings) {
    row(ui, text!("setting-text-scale"), |ui| {
        ui.horizontal_wrapped(|ui| {
            for percent in TEXT_PERCENTS {
                let scale = f64::from(percent) / 100.0;
                let words = text!("setting-percent", percent = percent);
                ui.selectable_value(&mut settings.text_scale, scale, words);
            }
        });
    });
    row(ui, text!("setting-motion"), |ui| {
        ui.checkbox(
            &mut settings.reduced_motion,
            text!("setting-reduced-motion"),
        );
        explain(ui, text!("setting-reduced-motion-about"));
    });
}

fn sound(ui: &mut Ui, settings: &mut Settings, input: MenuInput<'_>) {
    row(ui, text!("setting-sound"), |ui| {
        let mut percent = (settings.volume * 100.0).round() as i32;
        let slider = Slider::new(&mut percent, 0..=100)
            .suffix(text!("setting-percent-suffix"))
            .text(text!("setting-volume"));
        if ui.add(slider).changed() {
            settings.volume = f64::from(percent) / 100.0;
        }
        explain(ui, input.sound);
    });
}

fn advanced(ui: &mut Ui, settings: &mut Settings) {
    row(ui, text!("setting-physics"), |ui| {
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
        explain(ui, engine_cost(&settings.physics));
    });
    choice(ui, "particle-precision", &mut settings.particle_precision);
    row(ui, "", |ui| {
        explain(ui, particle_cost(settings.particle_precision))
    });
}

fn mouse(ui: &mut Ui, mouse: &mut MouseSettings) {
    row(ui, text!("setting-mouse"), |ui| {
        let [min, max] = MouseSettings::SPEED.map(|speed| (100.0 * speed) as i32);
        let mut percent = (100.0 * mouse.speed).round() as i32;
        let slider = Slider::new(&mut percent, min..=max)
            .logarithmic(true)
            .suffix(text!("setting-percent-suffix"))
            .text(text!("setting-mouse-speed"));
        if ui.add(slider).changed() {
            mouse.speed = f64::from(percent) / 100.0;
        }
        ui.checkbox(&mut mouse.inverts_pitch, text!("setting-invert-pitch"));
    });
}

/// Draws a row of choices and the explanation of the chosen one; `key` is that of the settings file.
fn choice<T: ValueEnum + PartialEq + Copy>(ui: &mut Ui, key: &str, chosen: &mut T) {
    row(ui, text!(&format!("setting-{key}")), |ui| {
        ui.horizontal_wrapped(|ui| {
            for value in T::value_variants() {
                let name = text!(&format!("setting-{key}-{}", value_name(value)));
                ui.selectable_value(chosen, *value, name);
            }
        });
        let name = value_name(chosen);
        explain(ui, text!(&format!("setting-{key}-{name}-about")));
    });
}

const TEXT_PERCENTS: [u32; 6] = [75, 100, 125, 150, 200, 250];
/// The offered engines: the ends of the trade-off between cost and error, and two in between.
const ENGINES: [&str; 4] = ["exact", "rapier-60", "rapier-240", "rapier-1000"];

#[cfg(test)]
mod tests {
    use carom_billiards::physics::{ParticlePrecision, PocketSize, TableSpeed};

    use super::*;
    use crate::particles::ParticleDetail;
    use crate::play::{AimAids, BallMarks};
    use crate::scene::ball_materials::BallSet;
    use crate::scene::table_style::{Brightness, ClothColour, CueStyle};
    use carom_farm::quality::{QualityPreference, Resolution};

    /// The sentence of each choice is that of the command line.
    fn check<T: ValueEnum>(key: &str) {
        assert_ne!(text!(&format!("setting-{key}")), "", "{key}");
        for value in T::value_variants() {
            let name = value_name(value);
            assert_ne!(text!(&format!("setting-{key}-{name}")), "", "{key} {name}");
            let help = value.to_possible_value().unwrap().get_help().cloned();
            assert_eq!(
                text!(&format!("setting-{key}-{name}-about")),
                help.unwrap_or_default().to_string()
            );
        }
    }

    #[test]
    fn every_choice_has_its_texts() {
        check::<AimAids>("aim-aids");
        check::<BallMarks>("ball-marks");
        check::<BallSet>("ball-set");
        check::<ClothColour>("cloth");
        check::<CueStyle>("cue");
        check::<PocketSize>("pockets");
        check::<TableSpeed>("table-speed");
        check::<Brightness>("brightness");
        check::<QualityPreference>("quality");
        check::<Resolution>("resolution");
        check::<ParticleDetail>("particles");
        check::<ParticlePrecision>("particle-precision");
    }

    #[test]
    fn every_engine_that_is_offered_can_be_played() {
        for name in ENGINES {
            assert_eq!(name.parse::<Engine>().unwrap().to_string(), name);
        }
    }
}
