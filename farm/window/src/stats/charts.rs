//! Charts of the last pictures: curves over a scale that is labelled with its maximum.

use std::sync::Arc;

use carom_text::text;
use egui::{Align2, Color32, FontId, Pos2, Rect, Response, Sense, Shape, Stroke, Ui, Vec2};

use super::frame_record::FrameRecord;
use super::glossary::{self as terms, Term};
use super::palette;
use super::value_label::{explained, marked, ms};
use crate::theme::{FAINT, INK};

/// Upper ends of the charts' scales, with hysteresis, so that they do not follow every spike.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Scales {
    makespan: Scale,
    response: Scale,
    redraws: Scale,
}

#[derive(Clone, Copy, Debug, Default)]
struct Scale {
    top: f32,
}

impl Scale {
    /// A round number above `highest`; it only falls when less than a third of it is used.
    fn over(&mut self, highest: f32) -> f32 {
        let needed = round_up(highest * 1.05);
        if needed > self.top || needed * 3.0 < self.top {
            self.top = needed;
        }
        self.top
    }
}

/// The next larger of 1, 2, 5 and 10 times a power of ten.
fn round_up(value: f32) -> f32 {
    let value = value.max(1e-3);
    let decade = 10f32.powf(value.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|step| step * decade);
    steps
        .into_iter()
        .find(|step| *step >= value)
        .unwrap_or(10.0 * decade)
}

/// Curve of a quantity over the pictures.
struct Curve<'a> {
    term: &'a Term,
    color: Color32,
    values: Vec<f32>,
}

/// Chart of curves over a scale from 0 to `top`, in `unit`.
struct Chart<'a> {
    top: f32,
    unit: &'a str,
    curves: &'a [Curve<'a>],
    limit: Option<f32>,
}

impl Scales {
    /// Draws the charts of `records`; returns the index of the record that was clicked.
    pub(super) fn show(
        &mut self,
        ui: &mut Ui,
        records: &[&Arc<FrameRecord>],
        inspected: u64,
    ) -> Option<usize> {
        let curve = |term, color, value: fn(&FrameRecord) -> f64| Curve {
            term,
            color,
            values: records.iter().map(|record| value(record) as f32).collect(),
        };
        let makespans = [
            curve(&terms::MAKESPAN, palette::ACTUAL, |r| r.makespan_secs * 1e3),
            curve(&terms::IDEAL, palette::IDEAL, |r| r.ideal_secs * 1e3),
        ];
        let responses = [
            curve(&terms::TALLY_MAX, palette::ACTUAL, |r| {
                response_max_secs(r) * 1e3
            }),
            curve(&terms::TALLY_SIGMA, palette::IDEAL, |r| {
                r.response_mean_and_deviation().1 * 1e3
            }),
        ];
        let efficiencies = [curve(&terms::EFFICIENCY, palette::IDEAL, |r| {
            r.efficiency() * 1e2
        })];
        let charts = [
            Chart {
                top: self.makespan.over(highest(&makespans)),
                unit: "ms",
                curves: &makespans,
                limit: None,
            },
            Chart {
                top: self.response.over(highest(&responses)),
                unit: "ms",
                curves: &responses,
                limit: None,
            },
            Chart {
                top: 100.0,
                unit: "%",
                curves: &efficiencies,
                limit: None,
            },
        ];
        let mut pressed = None;
        for chart in charts {
            let (rect, response) = chart.show(ui);
            marks(ui, rect, records, inspected);
            let under = response
                .hover_pos()
                .and_then(|at| place_at(at, rect, records.len()));
            if response.clicked() {
                pressed = under.or(pressed);
            }
            if let Some(record) = under.map(|place| records[place]) {
                response.on_hover_text_at_pointer(tell(record));
            }
        }
        pressed
    }

    /// Draws the intervals between redraws, with the budget as a line.
    pub(super) fn redraws(&mut self, ui: &mut Ui, intervals_ms: Vec<f32>, budget_ms: f32) {
        let curves = [Curve {
            term: &terms::REDRAWS,
            color: palette::ACTUAL,
            values: intervals_ms,
        }];
        let top = self.redraws.over(highest(&curves).max(budget_ms));
        Chart {
            top,
            unit: "ms",
            curves: &curves,
            limit: Some(budget_ms),
        }
        .show(ui);
    }
}

impl Chart<'_> {
    fn show(&self, ui: &mut Ui) -> (Rect, Response) {
        ui.horizontal_wrapped(|ui| {
            for curve in self.curves {
                let newest = curve.values.last().copied().unwrap_or(0.0);
                let newest = format!("{newest:5.1} {}", self.unit);
                marked(ui, curve.term, newest, curve.color);
            }
        });
        let size = Vec2::new(ui.available_width(), HEIGHT);
        let (rect, response) = ui.allocate_exact_size(size, Sense::click());
        let painter = ui.painter().with_clip_rect(rect);
        painter.rect_filled(rect, 2.0, Color32::from_black_alpha(120));
        let y = |value: f32| rect.bottom() - rect.height() * (value / self.top).clamp(0.0, 1.0);
        if let Some(limit) = self.limit {
            painter.hline(rect.x_range(), y(limit), Stroke::new(1.0, palette::LIMIT));
        }
        for curve in self.curves {
            let point =
                |(i, value): (usize, &f32)| Pos2::new(x_of(i, rect, curve.values.len()), y(*value));
            let points: Vec<Pos2> = curve.values.iter().enumerate().map(point).collect();
            painter.add(Shape::line(points, Stroke::new(1.5, curve.color)));
        }
        let top = format!("{} {}", self.top, self.unit);
        painter.text(
            rect.left_top() + Vec2::new(3.0, 1.0),
            Align2::LEFT_TOP,
            top,
            FontId::monospace(10.0),
            FAINT,
        );
        (rect, response)
    }
}

/// Marks where the balancing changed, with its new name, and which picture is inspected.
fn marks(ui: &Ui, rect: Rect, records: &[&Arc<FrameRecord>], inspected: u64) {
    let painter = ui.painter().with_clip_rect(rect);
    let count = records.len();
    for (i, pair) in records.windows(2).enumerate() {
        if pair[0].balancing != pair[1].balancing {
            let x = x_of(i + 1, rect, count);
            painter.vline(x, rect.y_range(), Stroke::new(1.0, INK));
            let name = pair[1].balancing.to_string();
            let name = painter.layout_no_wrap(name, FontId::monospace(10.0), INK);
            // Left of the line if the chart ends before the name would.
            let left = (x + 3.0).min(rect.right() - name.size().x);
            let at = Pos2::new(left, rect.bottom() - 1.0 - name.size().y);
            painter.galley(at, name, INK);
        }
    }
    if let Some(place) = records.iter().position(|record| record.frame == inspected)
        && place + 1 < count
    {
        painter.vline(
            x_of(place, rect, count),
            rect.y_range(),
            Stroke::new(1.0, palette::LIMIT),
        );
    }
}

/// Draws the times of the last pictures as a small curve inside a line of text.
pub(super) fn sparkline(ui: &mut Ui, values: &[f32]) {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(60.0, 12.0), Sense::hover());
    let top = values.iter().copied().fold(1e-3, f32::max);
    let point = |(i, value): (usize, &f32)| {
        Pos2::new(
            x_of(i, rect, values.len()),
            rect.bottom() - rect.height() * value / top,
        )
    };
    let points: Vec<Pos2> = values.iter().enumerate().map(point).collect();
    ui.painter()
        .add(Shape::line(points, Stroke::new(1.0, palette::ACTUAL)));
    explained(response, text!("stats-sparkline-about"));
}

fn tell(record: &FrameRecord) -> String {
    let (mean, deviation) = record.response_mean_and_deviation();
    text!(
        "stats-chart-frame",
        frame = record.frame,
        balancing = record.balancing.to_string(),
        makespan = ms(record.makespan_secs),
        ideal = ms(record.ideal_secs),
        mean = ms(mean),
        deviation = ms(deviation),
    )
}

fn response_max_secs(record: &FrameRecord) -> f64 {
    record
        .took_part()
        .map(|(_, node)| node.response_secs)
        .fold(0.0, f64::max)
}

fn highest(curves: &[Curve<'_>]) -> f32 {
    curves
        .iter()
        .flat_map(|curve| &curve.values)
        .copied()
        .fold(0.0, f32::max)
}

fn x_of(i: usize, rect: Rect, count: usize) -> f32 {
    rect.left() + rect.width() * (i as f32 + 0.5) / count.max(1) as f32
}

fn place_at(at: Pos2, rect: Rect, count: usize) -> Option<usize> {
    let place = ((at.x - rect.left()) / rect.width() * count as f32).max(0.0) as usize;
    (count > 0).then(|| place.min(count - 1))
}

/// Number of pictures in a chart: about one per point of its width.
pub(super) const PICTURES: usize = 240;
const HEIGHT: f32 = 54.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_is_round_holds_all_and_does_not_swing() {
        for (value, top) in [
            (0.9, 1.0),
            (1.2, 2.0),
            (4.0, 5.0),
            (17.0, 20.0),
            (480.0, 1000.0),
        ] {
            assert!(
                (Scale::default().over(value) - top).abs() < 1e-3 * top,
                "{value}"
            );
        }
        let mut scale = Scale::default();
        assert_eq!(scale.over(17.0), 20.0);
        assert_eq!(scale.over(8.0), 20.0);
        assert!((scale.over(1.7) - 2.0).abs() < 1e-5);
    }

    #[test]
    fn pointing_at_a_chart_finds_the_frame_drawn_there() {
        let rect = Rect::from_min_size(Pos2::new(10.0, 0.0), Vec2::new(300.0, 50.0));
        for count in [1, 7, 240, 600] {
            for i in 0..count {
                let at = Pos2::new(x_of(i, rect, count), 5.0);
                assert_eq!(place_at(at, rect, count), Some(i));
            }
        }
        assert_eq!(place_at(rect.min, rect, 0), None);
    }
}
