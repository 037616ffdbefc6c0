//! What is drawn over the picture, at once and without the farm: cue, aim, power,
//! keys, figures.

pub mod aim;
pub mod board;
pub mod cue_panel;
pub mod help;
mod keys;
pub mod menu;
pub mod new_game;
pub mod notes;
mod preferences;
pub mod theme;

use egui::{Align2, CornerRadius, FontId, Painter, Pos2, Rect, Vec2};

use self::theme::{INK, PANEL};
use crate::director::Figures;

/// What the user interface shows this frame.
#[derive(Debug, Default)]
pub struct Overlay<'a> {
    /// A sentence for the player.
    pub notice: Option<&'a str>,
    /// The figures, if they are shown.
    pub figures: Option<&'a str>,
}

/// Draws the figures at the top and the sentence near the bottom.
pub fn draw(painter: &Painter, screen: Rect, overlay: &Overlay<'_>) {
    if let Some(figures) = overlay.figures {
        label(
            painter,
            screen.left_top() + Vec2::new(12.0, 10.0),
            Align2::LEFT_TOP,
            figures,
            13.0,
        );
    }
    if let Some(notice) = overlay.notice {
        let bottom = screen.center_bottom() - Vec2::new(0.0, 64.0);
        label(painter, bottom, Align2::CENTER_BOTTOM, notice, 16.0);
    }
}

/// The line of figures; every number says its unit. `guessed` is the share of the picture on show
/// that the newest traced one did not hold, if it was moved.
pub fn figures_line(
    figures: &Figures,
    guessed: Option<f64>,
    fps: f64,
    nodes: (usize, usize),
    present: &str,
) -> String {
    let Figures {
        size,
        samples,
        makespan_secs,
        tiles,
        reissued_tiles,
        skipped,
        lead_secs,
        ..
    } = *figures;
    let moved = guessed.map_or(String::new(), |share| {
        format!(", moved ({:.1} % guessed)", share * 1e2)
    });
    format!(
        "{fps:.0} fps | {:.1} ms a picture, asked {:.0} ms ahead | {}/{} nodes | {tiles} tiles, \
         {reissued_tiles} asked again | {}x{} px, {samples} spp{moved} | {skipped} skipped | {present}",
        makespan_secs * 1e3,
        lead_secs * 1e3,
        nodes.0,
        nodes.1,
        size.width,
        size.height,
    )
}

fn label(painter: &Painter, at: Pos2, align: Align2, text: &str, size: f32) {
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(size), INK);
    let rect = align.anchor_size(at, galley.size());
    painter.rect_filled(
        rect.expand2(Vec2::new(7.0, 4.0)),
        CornerRadius::same(4),
        PANEL,
    );
    painter.galley(rect.min, galley, INK);
}
