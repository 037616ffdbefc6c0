//! What is drawn over the picture, at once and without the farm: cue, aim, power,
//! keys, figures.

pub mod aim;
pub mod help;
mod keys;
pub mod menu;
pub mod notes;
mod preferences;
pub mod theme;

use egui::{Align2, Color32, CornerRadius, FontId, Painter, Pos2, Rect, Stroke, StrokeKind, Vec2};

use self::theme::{INK, PANEL};
use crate::director::Figures;
use crate::play::{CueView, cue_speed_m_s};

/// What the user interface shows this frame.
#[derive(Debug, Default)]
pub struct Overlay<'a> {
    /// The cue, if there is one.
    pub cue: Option<&'a CueView>,
    /// A sentence for the player.
    pub notice: Option<&'a str>,
    /// The figures, if they are shown.
    pub figures: Option<&'a str>,
}

/// Draws the panels: figures at the top, power at the left, the tip at the lower left, and the
/// sentence near the bottom.
pub fn draw(painter: &Painter, screen: Rect, overlay: &Overlay<'_>) {
    if let Some(cue) = overlay.cue {
        draw_tip(painter, screen, cue);
        if let Some(power) = cue.power {
            draw_power(painter, screen, power);
        }
    }
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

fn draw_power(painter: &Painter, screen: Rect, power: f64) {
    let frame = Rect::from_min_size(
        Pos2::new(screen.left() + 24.0, screen.center().y - 110.0),
        Vec2::new(16.0, 220.0),
    );
    painter.rect_filled(frame.expand(3.0), CornerRadius::same(5), PANEL);
    let filled = Rect::from_min_max(
        Pos2::new(frame.left(), frame.bottom() - frame.height() * power as f32),
        frame.max,
    );
    painter.rect_filled(filled, CornerRadius::same(3), power_color(power as f32));
    painter.rect_stroke(
        frame,
        CornerRadius::same(3),
        Stroke::new(1.0, INK),
        StrokeKind::Outside,
    );
    let speed = format!("{:.1} m/s", cue_speed_m_s(power));
    label(
        painter,
        frame.center_bottom() + Vec2::new(14.0, 10.0),
        Align2::CENTER_TOP,
        &speed,
        14.0,
    );
}

fn power_color(power: f32) -> Color32 {
    let mix = |a: f32, b: f32| (a + (b - a) * power) as u8;
    Color32::from_rgb(mix(90.0, 235.0), mix(200.0, 80.0), mix(110.0, 50.0))
}

/// The cue ball as the player sees it along the cue, with the tip's place.
fn draw_tip(painter: &Painter, screen: Rect, cue: &CueView) {
    const RADIUS: f32 = 26.0;
    let center = screen.left_bottom() + Vec2::new(44.0, -44.0);
    painter.circle_filled(center, RADIUS + 3.0, PANEL);
    painter.circle_filled(center, RADIUS, Color32::from_rgb(232, 226, 210));
    painter.circle_stroke(
        center,
        RADIUS * 0.5,
        Stroke::new(1.0, Color32::from_gray(150)),
    );
    let tip = Vec2::new(cue.tip.x as f32, -cue.tip.y as f32) * RADIUS;
    painter.circle_filled(center + tip, 5.0, Color32::from_rgb(40, 90, 160));
    if cue.elevation_rad > 0.0 {
        let beside = center + Vec2::new(RADIUS + 14.0, 0.0);
        let angle = format!("cue raised {:.1}°", cue.elevation_rad.to_degrees());
        label(painter, beside, Align2::LEFT_CENTER, &angle, 14.0);
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
