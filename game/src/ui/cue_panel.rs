//! Spin disc and power bar, which show the present values and can be clicked and dragged.

use carom_billiards::physics;
use carom_text::text;
use carom_window::theme::{INK, PANEL};
use egui::{
    Align2, Area, Color32, Context, CornerRadius, FontId, Id, Order, Pos2, Rect, Response, Role,
    Sense, Stroke, StrokeKind, Ui, Vec2, WidgetInfo,
};
use glam::DVec2;

use crate::input::{AimIntent, Intent};
use crate::play::{CueView, cue_speed_m_s};

/// Draws both in `column`, a part of the window of width [`super::layout::CUE_COLUMN`], and returns the
/// intent of the player's pointer.
pub fn panel(ctx: &Context, column: Rect, cue: &CueView) -> Option<Intent> {
    let disc_at = column.left_bottom() + Vec2::new(12.0, -2.0 * RADIUS - 20.0);
    let words_at = disc_at - Vec2::new(0.0, 2.0 * WORDS + 6.0);
    // As high as there is room for, centred in the column if possible.
    let room = words_at.y - column.top() - 2.0 * MARGIN - FOOT;
    let height = BAR.y.min(room).max(MARGIN);
    let middle = column.center().y - 0.5 * height - 20.0;
    let lowest = words_at.y - MARGIN - FOOT - height;
    let bar_at = Pos2::new(column.left() + MARGIN, middle.min(lowest));
    let bar = Vec2::new(BAR.x, height);
    let power = area(ctx, "power", bar_at, |ui| power_bar(ui, bar, cue.power));
    let tip = area(ctx, "spin", disc_at, |ui| spin_disc(ui, cue));
    words(ctx, words_at, cue);
    tip.or(power)
}

fn area<T>(
    ctx: &Context,
    name: &str,
    at: Pos2,
    draw: impl FnOnce(&mut Ui) -> Option<T>,
) -> Option<T> {
    let area = Area::new(Id::unique(name))
        .order(Order::Middle)
        .fixed_pos(at);
    area.show(ctx, draw).inner
}

fn power_bar(ui: &mut Ui, bar: Vec2, power: f64) -> Option<Intent> {
    let size = bar + Vec2::new(2.0 * ASIDE, FOOT);
    let (whole, response) = ui.allocate_exact_size(size, POINTER_ONLY);
    let speed = text!("cue-speed", speed = format!("{:.2}", cue_speed_m_s(power)));
    let words = text!(
        "cue-power",
        percent = format!("{:.0}", power * 100.0),
        speed = &*speed,
    );
    response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, &words));
    let frame = Rect::from_min_size(whole.min + Vec2::new(ASIDE, 4.0), bar);
    let painter = ui.painter();
    painter.rect_filled(whole, CornerRadius::same(8), PANEL);
    let top = frame.bottom() - frame.height() * power as f32;
    let filled = frame.with_min_y(top);
    painter.rect_filled(filled, CornerRadius::same(3), power_color(power as f32));
    for quarter in 1..4 {
        let y = frame.bottom() - frame.height() * quarter as f32 / 4.0;
        painter.hline(frame.left()..=frame.left() + 5.0, y, Stroke::new(1.0, INK));
    }
    let rim = Stroke::new(rim_width(&response), INK);
    painter.rect_stroke(frame, CornerRadius::same(3), rim, StrokeKind::Outside);
    let foot = frame.center_bottom() + Vec2::new(0.0, 6.0);
    painter.text(
        foot,
        Align2::CENTER_TOP,
        speed,
        FontId::proportional(13.0),
        INK,
    );
    let explained = response.on_hover_text(text!("cue-power-about"));
    let at = clicked_at(&explained)?;
    let share = (frame.bottom() - at.y) / frame.height();
    Some(Intent::Aim(AimIntent::SetPower(f64::from(
        share.clamp(0.0, 1.0),
    ))))
}

/// Draws the cue ball as seen along the cue, with the contact point and the ring beyond which the tip
/// slips off.
fn spin_disc(ui: &mut Ui, cue: &CueView) -> Option<Intent> {
    let size = Vec2::splat(2.0 * RADIUS + 8.0);
    let (rect, response) = ui.allocate_exact_size(size, POINTER_ONLY);
    let spin = text!(
        "cue-spin",
        right = format!("{:+.0}", cue.tip.x * 100.0),
        up = format!("{:+.0}", cue.tip.y * 100.0),
    );
    response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, &spin));
    let (center, painter) = (rect.center(), ui.painter());
    painter.circle_filled(center, RADIUS + 4.0, PANEL);
    painter.circle_filled(center, RADIUS, Color32::from_rgb(232, 226, 210));
    let limit = physics::Cue::default().miscue_offset();
    let ring = Stroke::new(rim_width(&response), Color32::from_gray(120));
    painter.circle_stroke(center, RADIUS * limit as f32, ring);
    let tip = center + Vec2::new(cue.tip.x as f32, -cue.tip.y as f32) * RADIUS;
    let slips = cue.tip.length() > limit;
    painter.circle_filled(tip, 6.0, if slips { SLIPS } else { TIP });
    if slips {
        // A cross in addition to the colour, for players who cannot distinguish the colours.
        for arm in [Vec2::new(4.0, 4.0), Vec2::new(4.0, -4.0)] {
            painter.line_segment([tip - arm, tip + arm], Stroke::new(2.0, INK));
        }
    }
    let explained = response.on_hover_text(text!("cue-spin-about"));
    let at = (clicked_at(&explained)? - center) / RADIUS;
    Some(Intent::Aim(AimIntent::SetTip(DVec2::new(
        f64::from(at.x),
        f64::from(-at.y),
    ))))
}

/// Draws notes above the disc, two lines at most.
fn words(ctx: &Context, at: Pos2, cue: &CueView) {
    let mut words = Vec::new();
    if cue.elevation_rad > 0.0005 {
        let degrees = format!("{:.1}", cue.elevation_rad.to_degrees());
        words.push((text!("cue-raised", degrees = degrees), INK));
    }
    if cue.tip.length() > physics::Cue::default().miscue_offset() {
        words.push((text!("cue-slips").to_owned(), carom_window::theme::ALARM));
    }
    if words.is_empty() {
        return;
    }
    let bottom = at + Vec2::new(0.0, (2 - words.len()) as f32 * WORDS);
    let drawn = Area::new(Id::unique("cue-words"))
        .order(Order::Middle)
        .interactable(false)
        .fixed_pos(bottom);
    drawn.show(ctx, |ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        for (text, color) in words {
            let size = Vec2::new(super::layout::CUE_COLUMN - 14.0, WORDS - 2.0);
            let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
            let font = FontId::proportional(13.0);
            let painter = ui.painter();
            painter.rect_filled(rect, CornerRadius::same(4), PANEL);
            painter.text(rect.center(), Align2::CENTER_CENTER, text, font, color);
        }
    });
}

/// Position at which the pointer presses a widget, if it does.
fn clicked_at(response: &Response) -> Option<Pos2> {
    // `clicked` covers a quick click, which is pressed and released within one frame.
    let held = response.is_pointer_button_down_on() || response.dragged() || response.clicked();
    held.then(|| response.interact_pointer_pos()).flatten()
}

fn rim_width(response: &Response) -> f32 {
    if response.hovered() { 2.0 } else { 1.0 }
}

fn power_color(power: f32) -> Color32 {
    let mix = |a: f32, b: f32| (a + (b - a) * power) as u8;
    Color32::from_rgb(mix(90.0, 235.0), mix(200.0, 80.0), mix(110.0, 50.0))
}

/// Sense of widgets without keyboard focus, as keys have their own actions.
const POINTER_ONLY: Sense = Sense::CLICK.union(Sense::DRAG);
const BAR: Vec2 = Vec2::new(18.0, 220.0);
const RADIUS: f32 = 46.0;
/// Margin beside the bar for the width of its figure.
const ASIDE: f32 = 21.0;
/// Height below the bar for its figure.
const FOOT: f32 = 34.0;
/// Height of a line of text.
const WORDS: f32 = 20.0;
const MARGIN: f32 = 8.0;
const TIP: Color32 = Color32::from_rgb(40, 90, 160);
const SLIPS: Color32 = Color32::from_rgb(190, 50, 30);

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;

    use super::*;
    use crate::play::Aim;

    /// The intents of a click at a place in the widget with this label, given as a share of its size.
    fn clicked(label: &str, place: Vec2) -> Vec<Intent> {
        let intents = RefCell::new(Vec::new());
        let cue = CueView::resting(DVec3::ZERO, &Aim::LEVEL);
        let mut harness = Harness::builder()
            .with_size(Vec2::new(1280.0, 720.0))
            .build_ui(|ui| {
                intents
                    .borrow_mut()
                    .extend(panel(ui.ctx(), ui.ctx().content_rect(), &cue))
            });
        harness.run();
        let widget = harness.get_by_label_contains(label).rect();
        let at = widget.min + place * widget.size();
        let press = |pressed| egui::Event::PointerButton {
            pos: at,
            button: egui::PointerButton::Primary,
            pressed,
            modifiers: egui::Modifiers::NONE,
        };
        for event in [egui::Event::PointerMoved(at), press(true), press(false)] {
            harness.event(event);
        }
        harness.step();
        harness.step();
        drop(harness);
        intents.into_inner()
    }

    #[test]
    fn a_click_on_the_disc_puts_the_tip_there() {
        let intents = clicked("Spin", Vec2::new(0.5, 0.25));
        let Some(Intent::Aim(AimIntent::SetTip(tip))) = intents.last() else {
            panic!("{intents:?}");
        };
        assert!(tip.x.abs() < 0.02 && (0.5..0.6).contains(&tip.y), "{tip}");
    }

    #[test]
    fn a_click_on_the_bar_sets_the_power() {
        let at = |share: f32| match clicked("Power", Vec2::new(0.5, share)).last() {
            Some(Intent::Aim(AimIntent::SetPower(power))) => *power,
            other => panic!("{other:?}"),
        };
        assert!(at(0.02) > 0.97 && at(0.98) < 1e-9);
        assert!(at(0.3) > at(0.6));
    }
}
