//! A number with its name and its definition, and how numbers are written.

use std::fmt::Display;

use egui::text::{LayoutJob, TextFormat};
use egui::{Color32, FontId, Label, Response, Sense, Ui};

use super::glossary::Term;
use crate::theme::{ALARM, FAINT, INK};

/// Writes a figure; under the pointer its definition shows.
pub(super) fn figure(ui: &mut Ui, term: &Term, value: impl Display) -> Response {
    written(ui, LayoutJob::default(), term, value, INK)
}

/// The same, told to be bad by a mark and a colour if `is_bad`.
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

/// A figure whose curve or bar has a colour, which stands before it.
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
    // Name and value stay in one line.
    let label = Label::new(job).extend().selectable(false);
    explained(ui.add(label.sense(Sense::hover())), term.meaning())
}

/// Shows a definition under the pointer.
pub(super) fn explained(response: Response, meaning: &str) -> Response {
    response.on_hover_ui(|ui| {
        ui.set_max_width(320.0);
        ui.label(meaning);
    })
}

/// Milliseconds with a digit behind the point, two below 10: as wide for 0.01 as for 9999.
pub(super) fn ms(secs: f64) -> String {
    let ms = secs * 1e3;
    if ms.abs() < 9.995 {
        format!("{ms:.2}")
    } else {
        format!("{ms:.1}")
    }
}

/// The same with its unit.
pub(super) fn in_ms(secs: f64) -> String {
    ms(secs) + " ms"
}

/// Per cent without a digit behind the point, with its unit.
pub(super) fn percent(share: f64) -> String {
    format!("{:.0} %", share * 1e2)
}

/// Of figures, in points.
const SIZE: f32 = 12.5;
