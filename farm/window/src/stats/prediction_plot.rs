//! Scatter plot of predicted against actual response times: the accuracy of the balancer's model of each
//! node.

use carom_text::text;
use egui::{Align2, Color32, FontId, Pos2, Sense, Stroke, Ui, Vec2};

use super::frame_record::FrameRecord;
use super::glossary as terms;
use super::palette;
use super::value_label::{explained, ms};
use crate::theme::{FAINT, INK};

/// Draws predicted (vertical) against actual (horizontal) response of each node, both on the same logarithmic
/// scale: points below the diagonal arrived later than predicted.
pub(super) fn show(ui: &mut Ui, record: &FrameRecord) {
    let points: Vec<(usize, f64, f64)> = record
        .took_part()
        .filter_map(|(index, node)| Some((index, node.predicted_secs?, node.response_secs)))
        .filter(|(_, predicted, actual)| *predicted > 0.0 && *actual > 0.0)
        .collect();
    let side = ui.available_width().min(SCATTER_SIDE);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(side, SCATTER_HEIGHT), Sense::hover());
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 2.0, Color32::from_black_alpha(120));
    let write = |at: Pos2, align: Align2, words: &str, color: Color32| {
        painter.text(at, align, words, FontId::monospace(10.0), color);
    };
    let all = || points.iter().flat_map(|(_, a, b)| [*a, *b]);
    let (low, high) = (
        all().fold(f64::INFINITY, f64::min),
        all().fold(0.0, f64::max),
    );
    if points.is_empty() {
        write(
            rect.center(),
            Align2::CENTER_CENTER,
            text!("stats-prediction-none"),
            FAINT,
        );
        return;
    }
    // A margin around the extremes, which also keeps the scale valid for a single point.
    let (low, high) = (low * 0.8, high * 1.25);
    // Position on the logarithmic scale, 0 to 1.
    let place = |secs: f64| ((secs / low).ln() / (high / low).ln()) as f32;
    let at = |predicted: f64, actual: f64| {
        rect.min + Vec2::new(place(actual), 1.0 - place(predicted)) * rect.size()
    };
    painter.line_segment([at(low, low), at(high, high)], Stroke::new(1.0, FAINT));
    let axis = text!("stats-prediction-predicted", low = ms(low), high = ms(high));
    let margin = Vec2::new(3.0, 1.0);
    write(rect.left_top() + margin, Align2::LEFT_TOP, &axis, FAINT);
    write(
        rect.right_bottom() - margin,
        Align2::RIGHT_BOTTOM,
        text!("stats-prediction-actual"),
        FAINT,
    );
    let mut words = Vec::new();
    for (index, predicted, actual) in points {
        let center = at(predicted, actual);
        painter.circle_filled(center, 3.0, palette::node(index));
        let beside = center + Vec2::new(4.0, 0.0);
        write(beside, Align2::LEFT_CENTER, &index.to_string(), INK);
        if response
            .hover_pos()
            .is_some_and(|pointer| pointer.distance(center) < NEAR)
        {
            words.push(text!(
                "stats-prediction-node",
                node = index,
                predicted = ms(predicted),
                actual = ms(actual)
            ));
        }
    }
    if words.is_empty() {
        explained(response, terms::PREDICTED.meaning());
    } else {
        response.on_hover_text_at_pointer(words.join("\n"));
    }
}

const SCATTER_SIDE: f32 = 420.0;
const SCATTER_HEIGHT: f32 = 110.0;
/// Maximum distance in points of the pointer from a point's mark.
const NEAR: f32 = 8.0;
