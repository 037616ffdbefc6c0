//! Page of the practice table: balls follow the pointer, balls and particles are added and removed.

use carom_billiards::physics::ParticleMaterial;
use carom_text::text;
use carom_window::theme;
use clap::ValueEnum as _;
use egui::{Align2, Color32, Context, FontId, RichText, Stroke, Ui};
use glam::DVec2;

use super::aim::AimOverlay;
use super::form::explain;
use super::layout::Layout;
use super::replay;
use crate::camera::Projection;
use crate::capture::SavedRecording;
use crate::play::practice::{Practice, PracticeCommand};
use crate::play::tricks::TrickTable;
use crate::settings::value_name;

/// Draws the page at the bottom, and returns the player's command.
pub fn panel(
    ctx: &Context,
    layout: &mut Layout,
    practice: &Practice,
    kept: &[SavedRecording],
) -> Option<PracticeCommand> {
    layout.dock(ctx, "practice", Align2::CENTER_BOTTOM, |ui| {
        let mut command = None;
        theme::frame().show(ui, |ui| {
            ui.set_width(ui.available_width().min(WIDTH));
            let words = match practice.held().and_then(|held| held.fault) {
                Some(fault) => fault.to_string(),
                None => text!("practice-how").to_owned(),
            };
            ui.horizontal_wrapped(|ui| {
                ui.label(RichText::new(text!("menu-practice-table")).strong());
                ui.label(words);
            });
            let lying = practice.numbers();
            ui.horizontal_wrapped(|ui| {
                // Tight spacing, so that all fit in a row if the window is wide enough.
                ui.spacing_mut().item_spacing.x = 4.0;
                ui.spacing_mut().button_padding.x = 8.0;
                for number in 0..=NUMBER_MAX {
                    let is_there = lying.contains(&number);
                    if ui.selectable_label(is_there, ball_words(number)).clicked() {
                        command = Some(if is_there {
                            PracticeCommand::TakeAway(number)
                        } else {
                            PracticeCommand::Add(number)
                        });
                    }
                }
            });
            ui.horizontal_wrapped(|ui| {
                let brush = brushes(ui, practice);
                command = command.take().or(brush);
            });
            ui.horizontal_wrapped(|ui| {
                if ui.button(text!("practice-play")).clicked() {
                    command = Some(PracticeCommand::Play);
                }
                if ui.button(text!("practice-save")).clicked() {
                    command = Some(PracticeCommand::Save);
                }
                if let Some(path) = replay::files(ui, kept) {
                    command = Some(PracticeCommand::Open(path));
                }
                if ui.button(text!("practice-discard")).clicked() {
                    command = Some(PracticeCommand::Close);
                }
                explain(ui, text!("practice-esc"));
            });
        });
        command
    })
}

/// Draws the choice of brushes and trick tables.
fn brushes(ui: &mut Ui, practice: &Practice) -> Option<PracticeCommand> {
    let mut command = None;
    for material in ParticleMaterial::ALL {
        let is_chosen = practice.brush() == Some(material);
        let name = text!(&format!("practice-{}", value_name(&material)));
        if ui.selectable_label(is_chosen, name).clicked() {
            let brush = Some(material).filter(|_| !is_chosen);
            command = Some(PracticeCommand::Brush(brush));
        }
    }
    if practice.world().particles().is_some() && ui.button(text!("practice-sweep")).clicked() {
        command = Some(PracticeCommand::Sweep);
    }
    ui.menu_button(text!("practice-tricks"), |ui| {
        for trick in TrickTable::value_variants() {
            if ui
                .button(text!(&format!("practice-{}", value_name(trick))))
                .clicked()
            {
                command = Some(PracticeCommand::Trick(*trick));
                ui.close();
            }
        }
    });
    if practice.brush().is_none() {
        explain(ui, text!("practice-paint"));
    }
    command
}

/// The command of the pointer over balls and cloth, seen through `projection`.
pub fn hand(
    ctx: &Context,
    projection: &Projection,
    practice: &Practice,
) -> Option<PracticeCommand> {
    let radius_m = practice.world().table().ball().radius_m;
    let free = !ctx.egui_wants_pointer_input();
    ctx.input(|input| {
        let at = input.pointer.latest_pos()?;
        let film = DVec2::new(f64::from(at.x), f64::from(at.y));
        let place = projection.world_from_film(film, radius_m)?.truncate();
        match practice.held() {
            None if practice.brush().is_some() => {
                let paints = free && input.pointer.primary_down();
                // At the cloth's height, as the layer of particles is lower than balls.
                let place = projection.world_from_film(film, 0.0)?.truncate();
                (paints && practice.is_bare(place)).then_some(PracticeCommand::Paint(place))
            }
            None if free && input.pointer.primary_pressed() => Some(PracticeCommand::Grab(place)),
            Some(_) if !input.pointer.primary_down() => Some(PracticeCommand::LetGo),
            Some(held) if held.at != place => Some(PracticeCommand::Drag(place)),
            _ => None,
        }
    })
}

/// Draws a ring around the held ball, which shows whether it may be placed there.
pub fn ring(overlay: &AimOverlay<'_>, practice: &Practice) {
    let Some(held) = practice.held() else {
        return;
    };
    let center = held.at.extend(overlay.ball_radius_m);
    let Some((at, radius)) = overlay.disc(center, 1.35 * overlay.ball_radius_m) else {
        return;
    };
    let (sign, color) = match held.fault {
        None => (text!("practice-free"), FREE),
        Some(_) => ("✖", theme::ALARM),
    };
    let painter = overlay.painter;
    painter.circle_stroke(at, radius, Stroke::new(2.5, color));
    let above = at - egui::vec2(0.0, radius + 4.0);
    let font = FontId::proportional(18.0);
    painter.text(above, Align2::CENTER_BOTTOM, sign, font, color);
}

fn ball_words(number: u8) -> String {
    match number {
        0 => text!("practice-cue-ball").to_owned(),
        number => number.to_string(),
    }
}

const WIDTH: f32 = 700.0;
/// Largest number of a pool ball.
const NUMBER_MAX: u8 = 15;
const FREE: Color32 = Color32::from_rgb(150, 230, 160);
