//! Theme of all panels: colours with sufficient contrast over any picture, and text sizes.

use egui::{
    Color32, Context, CornerRadius, FontDefinitions, FontFamily, FontId, Frame, Margin, Plugin,
    Stroke, StrokeKind, TextStyle, Ui,
};

/// Background of text: dark and semi-transparent, so that text in [`INK`] keeps a contrast above 7 to 1 over
/// any picture.
pub const PANEL: Color32 = Color32::from_rgba_premultiplied(10, 12, 14, 215);
/// Text.
pub const INK: Color32 = Color32::from_rgb(235, 235, 230);
/// Secondary, explanatory text.
pub const FAINT: Color32 = Color32::from_rgb(176, 178, 176);
/// Keys, headings and selected items.
pub const ACCENT: Color32 = Color32::from_rgb(240, 200, 110);
/// Outline of the item with the keyboard focus.
pub const FOCUS: Color32 = Color32::from_rgb(120, 200, 255);
/// Errors; always with words that say so.
pub const ALARM: Color32 = Color32::from_rgb(255, 150, 120);

/// Applies the theme to `ctx`; call it once, and again when the user changes one of the arguments.
///
/// `text_scale`, from 0.75 to 2.5, scales text and panels alike. With `reduced_motion` nothing slides or
/// fades.
pub fn apply(ctx: &Context, text_scale: f32, reduced_motion: bool) {
    ctx.set_theme(egui::Theme::Dark);
    ctx.set_fonts(fonts());
    ctx.add_plugin(FocusOutline);
    set_scale(ctx, text_scale);
    // Zooming is controlled by the settings alone.
    ctx.options_mut(|options| options.zoom_with_keyboard = false);
    ctx.all_styles_mut(|style| {
        style.text_styles = [
            (TextStyle::Heading, FontId::proportional(22.0)),
            (TextStyle::Body, FontId::proportional(15.0)),
            (TextStyle::Button, FontId::proportional(15.0)),
            (TextStyle::Small, FontId::proportional(12.5)),
            (TextStyle::Monospace, FontId::monospace(13.0)),
        ]
        .into();
        let visuals = &mut style.visuals;
        visuals.override_text_color = Some(INK);
        visuals.weak_text_color = Some(FAINT);
        visuals.warn_fg_color = ACCENT;
        visuals.error_fg_color = ALARM;
        visuals.window_fill = Color32::from_rgb(22, 25, 28);
        visuals.panel_fill = visuals.window_fill;
        visuals.selection.bg_fill = Color32::from_rgb(110, 84, 30);
        visuals.selection.stroke = Stroke::new(2.0, ACCENT);
        visuals.widgets.hovered.bg_stroke = Stroke::new(1.0, ACCENT);
        // egui uses this for both pressed and focused widgets, which FocusOutline distinguishes.
        visuals.widgets.active.bg_stroke = Stroke::new(1.0, ACCENT);
        // Scroll bars beside the content, not over it.
        style.spacing.scroll = egui::style::ScrollStyle {
            bar_width: 8.0,
            ..egui::style::ScrollStyle::solid()
        };
        style.spacing.button_padding = egui::vec2(12.0, 6.0);
        style.spacing.item_spacing = egui::vec2(10.0, 7.0);
        if reduced_motion {
            style.animation_time = 0.0;
            style.scroll_animation = egui::style::ScrollAnimation::none();
        }
    });
}

/// Outline around the focused widget at some distance from its edge, where egui never draws the hover mark,
/// so that it is visible from afar.
struct FocusOutline;

impl Plugin for FocusOutline {
    fn debug_name(&self) -> &'static str {
        "focus-outline"
    }

    fn on_end_pass(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx();
        let focused = ctx.memory(|memory| memory.focused());
        let Some(shown) = focused.and_then(|id| ctx.read_response(id)) else {
            return;
        };
        // A widget scrolled out of sight gets no outline.
        let visible = shown.interact_rect.intersect(shown.rect);
        if visible.is_positive() {
            ctx.layer_painter(shown.layer_id).rect_stroke(
                visible.expand(1.0),
                CornerRadius::same(6),
                Stroke::new(2.0, FOCUS),
                StrokeKind::Outside,
            );
        }
    }
}

/// Scales text and panels immediately: [`Context::set_zoom_factor`] would only take effect in the next pass,
/// after the window was measured.
pub fn set_scale(ctx: &Context, text_scale: f32) {
    ctx.options_mut(|options| options.zoom_factor = text_scale);
}

/// The largest text scale up to `text_scale` for a window whose size in points at scale 1 is given: panels
/// need [`ROOM`].
pub fn fitting_scale(text_scale: f32, window: egui::Vec2) -> f32 {
    let most = (window / ROOM).min_elem();
    text_scale.min(most).max(SCALE_MIN)
}

/// Size of the smallest window, in points, that holds all panels of the game.
pub const ROOM: egui::Vec2 = egui::Vec2::new(640.0, 360.0);
/// Minimum scale, since a minimised window has a size of 0.
const SCALE_MIN: f32 = 0.1;

/// egui's fonts. Glyphs that the proportional font lacks, such as symbols of ball groups, come from the
/// monospace font.
fn fonts() -> FontDefinitions {
    let mut fonts = FontDefinitions::default();
    let families = &mut fonts.families;
    let figures = families.get(&FontFamily::Monospace).cloned();
    let text = families.entry(FontFamily::Proportional).or_default();
    for name in figures.unwrap_or_default() {
        if !text.contains(&name) {
            text.push(name);
        }
    }
    fonts
}

/// Frame of panels over the picture.
pub fn frame() -> Frame {
    Frame::new()
        .fill(PANEL)
        .corner_radius(CornerRadius::same(8))
        .inner_margin(Margin::symmetric(14, 10))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_scale_counts_from_the_first_frame() {
        let ctx = Context::default();
        apply(&ctx, 2.0, false);
        assert_eq!(ctx.zoom_factor(), 2.0);
        let mut sizes = Vec::new();
        for _ in 0..2 {
            let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(640.0, 360.0));
            let raw = egui::RawInput {
                screen_rect: Some(screen),
                ..egui::RawInput::default()
            };
            let output = ctx.run_ui(raw, |ui| sizes.push(ui.ctx().content_rect().size()));
            output.drop_without_applying_deltas();
        }
        assert_eq!(sizes[0], sizes[1]);
    }
}
