//! Layout of the panels: the line at the top, the others beside and below the picture, or all in one
//! scrolling column if the window is too small for that.

use std::sync::Arc;

use carom_text::text;
use egui::{
    Area, CollapsingHeader, Context, Frame, Id, LayerId, Margin, Order, Pos2, Rect, ScrollArea, Ui,
    Vec2,
};

use super::frame_record::FrameRecord;
use super::{
    Stats, StatsInput, StatsLevel, charts, compact, controls, gantt, plain_words, prediction_plot,
    status_line,
};
use crate::theme;

/// Draws the panels of the level; returns the part of the screen that they leave free.
pub(super) fn draw(stats: &mut Stats, ctx: &Context, input: &StatsInput<'_>) -> Rect {
    let screen = ctx.content_rect();
    if stats.level >= StatsLevel::Full {
        maps(stats, ctx, screen);
    }
    let is_wide = screen.width() >= WIDE.x && screen.height() >= WIDE.y;
    let height = match stats.level {
        StatsLevel::Line | StatsLevel::Card => screen.height() - BELOW_CARD,
        _ if is_wide => screen.height(),
        _ => SHARE_OF_SMALL * screen.height(),
    };
    let above = Rect::from_min_size(screen.min, Vec2::new(screen.width(), height));
    let above = panel(ctx, "stats-line", above, false, |ui| {
        let area = ScrollArea::vertical()
            .id_salt("line")
            .auto_shrink([false, true]);
        area.show(ui, |ui| {
            line(ui, stats, input);
            if stats.level >= StatsLevel::Full && !is_wide {
                column(ui, stats, input);
                nodes(ui, stats, f32::INFINITY);
            }
        });
    });
    let top = stats
        .line
        .bottom(stats.level, screen.size(), above.bottom());
    if stats.level < StatsLevel::Full || !is_wide {
        return screen.with_min_y(top);
    }
    let table_height = stats.rows.height().min(TABLE_SHARE * screen.height()) + TABLE_MARGIN;
    let table = Rect::from_min_max(
        Pos2::new(screen.left(), screen.bottom() - table_height),
        screen.max,
    );
    let side = Rect::from_min_max(
        Pos2::new(screen.right() - SIDE_WIDTH, top + GAP),
        Pos2::new(screen.right(), table.top() - GAP),
    );
    panel(ctx, "stats-side", side, true, |ui| {
        let area = ScrollArea::vertical()
            .id_salt("side")
            .auto_shrink([false, true]);
        area.show(ui, |ui| column(ui, stats, input));
    });
    panel(ctx, "stats-nodes", table, true, |ui| {
        nodes(ui, stats, table_height - TABLE_MARGIN);
    });
    Rect::from_min_max(
        Pos2::new(screen.left(), top),
        Pos2::new(side.left(), table.top()),
    )
}

/// A panel of the width of `room`, and at most or, if it `fills`, exactly of its height; returns the part of
/// the screen that it occupies.
fn panel(ctx: &Context, id: &str, room: Rect, fills: bool, add: impl FnOnce(&mut Ui)) -> Rect {
    let area = Area::new(Id::unique(id))
        .order(Order::Middle)
        .fixed_pos(room.min)
        .constrain(false);
    let shown = area.show(ctx, |ui| {
        let inner = room.size() - 2.0 * Vec2::new(f32::from(MARGIN.left), f32::from(MARGIN.top));
        frame().show(ui, |ui| {
            ui.set_max_size(inner.max(Vec2::splat(1.0)));
            ui.style_mut().interaction.selectable_labels = false;
            let spacing = &mut ui.style_mut().spacing;
            spacing.item_spacing = Vec2::new(10.0, 3.0);
            spacing.interact_size.y = 16.0;
            spacing.button_padding = Vec2::new(8.0, 2.0);
            ui.set_min_size(Vec2::new(inner.x, if fills { inner.y } else { 0.0 }));
            add(ui);
        });
    });
    shown.response.rect
}

fn line(ui: &mut Ui, stats: &Stats, input: &StatsInput<'_>) {
    let records = stats.history.records();
    let newest = records.iter().skip(records.len().saturating_sub(SPARKLINE));
    let sparkline: Vec<f32> = newest.map(|record| record.makespan_secs as f32).collect();
    plain_words::show(ui, &stats.summary, input);
    if stats.level > StatsLevel::Line {
        status_line::show(ui, &stats.summary, &sparkline, input);
    }
    if stats.level == StatsLevel::Card {
        compact::show(ui, &stats.summary, input);
    }
}

/// Everything but the line and the nodes, in one column.
fn column(ui: &mut Ui, stats: &mut Stats, input: &StatsInput<'_>) {
    ui.set_min_width(ui.available_width());
    controls::show(ui, stats, input);
    compact::show(ui, &stats.summary, input);
    let inspected: Option<Arc<FrameRecord>> = stats.inspected().cloned();
    if let Some(record) = &inspected {
        section(ui, text!("stats-section-gantt"), true, |ui| {
            gantt::show(ui, record)
        });
    }
    section(ui, text!("stats-section-frames"), true, |ui| {
        if let Some(place) = time_series(
            ui,
            stats,
            inspected.as_ref().map_or(0, |record| record.frame),
        ) {
            stats.freeze(place);
        }
    });
    if let Some(record) = &inspected {
        section(ui, text!("stats-section-prediction"), true, |ui| {
            prediction_plot::show(ui, record)
        });
    }
    section(ui, text!("stats-section-redraws"), false, |ui| {
        let intervals = stats.redraws.intervals_secs();
        let newest = intervals
            .iter()
            .skip(intervals.len().saturating_sub(charts::PICTURES));
        let newest: Vec<f32> = newest.map(|secs| (secs * 1e3) as f32).collect();
        stats
            .scales
            .redraws(ui, newest, (input.period_secs * 1e3) as f32);
    });
    section(ui, text!("stats-section-algorithms"), true, |ui| {
        controls::tallies(ui, stats)
    });
    section(ui, text!("stats-section-quality"), false, |ui| {
        controls::quality(ui, stats, input)
    });
}

/// Draws the charts; returns the index in the history of a picture that was clicked.
fn time_series(ui: &mut Ui, stats: &mut Stats, inspected: u64) -> Option<usize> {
    let records = stats.history.records();
    let before = records.len().saturating_sub(charts::PICTURES);
    let newest: Vec<&Arc<FrameRecord>> = records.iter().skip(before).collect();
    let pressed = stats.scales.show(ui, &newest, inspected);
    pressed.map(|place| before + place)
}

fn nodes(ui: &mut Ui, stats: &Stats, height: f32) {
    stats.rows.show(ui, height.min(stats.rows.height()));
}

fn section(ui: &mut Ui, title: &str, is_open: bool, add: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(title)
        .default_open(is_open)
        .show_unindented(ui, add);
}

fn maps(stats: &mut Stats, ctx: &Context, screen: Rect) {
    let Some(record) = stats.inspected().cloned() else {
        return;
    };
    let painter = ctx.layer_painter(LayerId::background());
    stats.maps.draw(ctx, &painter, screen, &record);
    let over_panel = ctx.egui_is_using_pointer() || ctx.is_pointer_over_egui();
    let Some(pointer) = ctx.pointer_hover_pos().filter(|_| !over_panel) else {
        return;
    };
    if let Some(words) = stats.maps.tell(pointer, screen, &record) {
        egui::Tooltip::always_open(
            ctx.clone(),
            LayerId::background(),
            Id::unique("tile"),
            egui::PopupAnchor::Pointer,
        )
        .show(|ui| ui.label(words));
    }
}

fn frame() -> Frame {
    theme::frame().inner_margin(MARGIN).corner_radius(0)
}

const MARGIN: Margin = Margin::symmetric(8, 6);
/// Minimum size of a window, in points, with room for panels beside the picture.
const WIDE: Vec2 = Vec2::new(1000.0, 560.0);
const SIDE_WIDTH: f32 = 440.0;
/// Height in points that a line or card leaves to the picture, however large the text is.
const BELOW_CARD: f32 = 40.0;
/// Share of a small window's height that all statistics occupy.
const SHARE_OF_SMALL: f32 = 0.62;
/// Maximum share of a wide window's height that the table of nodes occupies.
const TABLE_SHARE: f32 = 0.3;
const TABLE_MARGIN: f32 = 12.0;
const GAP: f32 = 2.0;
/// Number of pictures in the line's curve.
const SPARKLINE: usize = 60;
