//! Rows of pages on which something is chosen, and the small print that explains a choice.

use carom_window::theme;
use egui::{RichText, Ui};

/// A row of a grid of two columns: what it is about, and what can be chosen.
///
/// The controls stand in a column, which a row of the grid grows with where it wraps.
pub(super) fn row(ui: &mut Ui, label: &str, controls: impl FnOnce(&mut Ui)) {
    ui.label(label);
    ui.vertical(controls);
    ui.end_row();
}

/// Small print.
pub(super) fn explain(ui: &mut Ui, words: impl Into<String>) {
    ui.label(RichText::new(words).color(theme::FAINT).small());
}
