//! Rows of pages with choices, and the small print that explains a choice.

use carom_window::theme;
use egui::{RichText, Ui};

/// Draws a row of a grid of two columns: a label, and controls.
///
/// The controls are in a column of their own, so that the row grows in height where they wrap.
pub(super) fn row(ui: &mut Ui, label: &str, controls: impl FnOnce(&mut Ui)) {
    ui.label(label);
    ui.vertical(controls);
    ui.end_row();
}

/// Draws small print.
pub(super) fn explain(ui: &mut Ui, words: impl Into<String>) {
    ui.label(RichText::new(words).color(theme::FAINT).small());
}
