//! Notices: messages, and a line about the current picture.

use carom_farm::SCENE_FILES;
use carom_text::text;
use carom_window::theme;
use carom_window::toasts::Toasts;
use egui::{Align2, Area, Context, Id, Order, Rect, RichText, Ui, Vec2};

use crate::viewer::Viewer;

/// Draws the notices in a part of the window.
pub(crate) fn show(
    ctx: &Context,
    room: Rect,
    viewer: &Viewer,
    toasts: &Toasts,
    standing: &[String],
) {
    if !(toasts.is_empty() && standing.is_empty()) {
        place(ctx, "view-notes", room, Align2::CENTER_TOP, |ui| {
            toasts.show(ui, standing)
        });
    }
    let is_empty = viewer.document.is_none() && viewer.reading.is_none();
    if let Some(why) = &viewer.refusal {
        card(ctx, room, |ui| {
            ui.label(RichText::new(why).color(theme::ALARM));
            ui.label(RichText::new(text!("view-refusal-close")).color(theme::FAINT));
        });
    } else if is_empty || viewer.is_hovered {
        card(ctx, room, |ui| {
            ui.heading(text!("view-drop"));
            let endings = SCENE_FILES.map(|ending| format!(".{ending}")).join(", ");
            ui.label(text!("view-drop-endings", endings = endings));
            ui.label(RichText::new(text!("view-hint")).color(theme::FAINT));
        });
    }
    if let Some(file) = viewer.file_name() {
        let line = line(viewer, &file);
        place(ctx, "view-line", room, Align2::CENTER_BOTTOM, |ui| {
            theme::frame().show(ui, |ui| ui.label(RichText::new(line).small()));
        });
    }
}

/// A line with the file's name and its picture's progress.
fn line(viewer: &Viewer, file: &str) -> String {
    let samples = viewer.picture.as_ref().filter(|picture| !picture.is_draft);
    match samples {
        Some(picture) => text!(
            "view-line",
            file = file,
            samples = picture.samples,
            all = viewer.samples
        ),
        None => text!("view-line-draft", file = file),
    }
}

/// Draws a card in the middle, for what must be read first.
fn card(ctx: &Context, room: Rect, draw: impl FnOnce(&mut Ui)) {
    place(ctx, "view-card", room, Align2::CENTER_CENTER, |ui| {
        let frame = theme::frame().fill(theme::PANEL.to_opaque());
        frame.show(ui, |ui| {
            ui.set_max_width(CARD_WIDTH.min(ui.available_width()));
            draw(ui);
        });
    });
}

fn place(ctx: &Context, id: &str, room: Rect, at: Align2, draw: impl FnOnce(&mut Ui)) {
    let toward = |align: egui::Align| match align {
        egui::Align::Min => GAP,
        egui::Align::Center => 0.0,
        egui::Align::Max => -GAP,
    };
    Area::new(Id::unique(id))
        .order(Order::Middle)
        .constrain_to(room)
        .anchor(at, Vec2::new(toward(at.x()), toward(at.y())))
        .show(ctx, |ui| {
            ui.set_max_width((room.width() - 2.0 * GAP).max(GAP));
            draw(ui);
        });
}

const CARD_WIDTH: f32 = 520.0;
/// Distance of a notice from the window's edge in points.
const GAP: f32 = 8.0;
