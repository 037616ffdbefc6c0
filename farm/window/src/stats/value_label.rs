//! Labelled value with a tooltip, and the formats of values.

use std::fmt::Display;

use egui::text::{LayoutJob, TextFormat};
use egui::{Color32, FontId, Label, Response, Sense, Ui};

use super::glossary::Term;
use crate::theme::{ALARM, FAINT, INK};

/// Draws a figure with its label; its definition is a tooltip.
pub(super) fn figure(ui: &mut Ui, term: &Term, value: impl Display) -> Response {
    written(ui, LayoutJob::default(), term, value, INK)
}

/// As [`figure`], marked by a sign and a colour if `is_bad`.
pub(super) fn figure_or_alarm(
    ui: &mut Ui,
    term: &Term,
    value: impl Display,
    is_bad: bool,
) -> Response {
    match is_bad {
        true => written(ui, LayoutJob::default(), term, format!("{value}!"), ALARM),
        false => figure(ui, term, value),
    }
}

/// As [`figure`], after a mark in the colour of its curve or bar.
pub(super) fn marked(ui: &mut Ui, term: &Term, value: impl Display, mark: Color32) -> Response {
    let mut job = LayoutJob::default();
    let format = TextFormat::simple(FontId::monospace(SIZE), mark);
    job.append("■ ", 0.0, format);
    written(ui, job, term, value, INK)
}

fn written(
    ui: &mut Ui,
    mut job: LayoutJob,
    term: &Term,
    value: impl Display,
    color: Color32,
) -> Response {
    let font = FontId::monospace(SIZE);
    job.append(term.label(), 0.0, TextFormat::simple(font.clone(), FAINT));
    job.append(" ", 0.0, TextFormat::simple(font.clone(), FAINT));
    job.append(&value.to_string(), 0.0, TextFormat::simple(font, color));
    // Keeps label and value in one line.
    let label = Label::new(job).extend().selectable(false);
    explained(ui.add(label.sense(Sense::hover())), term.meaning())
}

/// Adds a definition as a tooltip.
pub(super) fn explained(response: Response, meaning: &str) -> Response {
    response.on_hover_ui(|ui| {
        ui.set_max_width(320.0);
        ui.label(meaning);
    })
}

/// Milliseconds with one decimal, or two below 10, so that 0.01 is as wide as 99.9.
pub(super) fn ms(secs: f64) -> String {
    let ms = secs * 1e3;
    if ms.abs() < 9.995 {
        format!("{ms:.2}")
    } else {
        format!("{ms:.1}")
    }
}

/// As [`ms`], with the unit.
pub(super) fn in_ms(secs: f64) -> String {
    ms(secs) + " ms"
}

/// Percentage without decimals, with the sign.
pub(super) fn percent(share: f64) -> String {
    format!("{:.0} %", share * 1e2)
}

/// Text size of figures in points.
const SIZE: f32 = 12.5;
