//! The interface over the picture, drawn at once and without the farm: cue, aim, power, keys,
//! statistics.

pub mod aim;
pub mod cue_panel;
pub mod help;
pub mod input_batches;
mod keys;
pub mod match_hud;
pub mod menu;
pub mod new_game;
mod page;
pub mod practice;
mod preferences;
pub mod replay;
pub mod stats;
pub mod theme;
pub mod toasts;

use egui::{Align2, CornerRadius, FontId, Painter, Pos2, Rect, Vec2};

use self::theme::{INK, PANEL};

/// What the user interface shows this frame.
#[derive(Debug, Default)]
pub struct Overlay<'a> {
    /// A sentence for the player.
    pub notice: Option<&'a str>,
    /// Whether a page takes the lower part of the window.
    pub has_page: bool,
}

/// Draws the sentence near the bottom of a part of the window, or at its top over a page.
pub fn draw(painter: &Painter, room: Rect, overlay: &Overlay<'_>) {
    if let Some(notice) = overlay.notice {
        let (place, align) = if overlay.has_page {
            (room.center_top() + Vec2::new(0.0, 24.0), Align2::CENTER_TOP)
        } else {
            let bottom = room.center_bottom() - Vec2::new(0.0, 112.0);
            (bottom, Align2::CENTER_BOTTOM)
        };
        label(painter, place, align, notice, 16.0);
    }
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
