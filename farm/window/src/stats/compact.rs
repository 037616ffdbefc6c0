//! Remaining figures of the second level: rates, and the latency breakdown of the last picture.

use carom_farm::LatencySplit;
use carom_text::text;
use egui::{Rect, RichText, Sense, Shape, Ui, Vec2, epaint::Mesh};

use super::glossary as terms;
use super::summary::StatsSummary;
use super::value_label::{figure, figure_or_alarm, in_ms, marked, ms, percent};
use super::{StatsInput, palette};

/// Draws the figures for which the line has no room.
pub(super) fn show(ui: &mut Ui, summary: &StatsSummary, input: &StatsInput<'_>) {
    let rates = &summary.rates;
    ui.horizontal_wrapped(|ui| {
        figure(ui, &terms::FPS_MEAN, format!("{:3.0}", rates.mean));
        figure(ui, &terms::LOW_01, format!("{:3.0}", rates.low_01_percent));
        figure(ui, &terms::DRAW, in_ms(input.draw_secs));
        figure(ui, &terms::LEAD, in_ms(input.lead_secs));
        figure(ui, &terms::SKIPPED, input.skipped);
        if let Some(share) = input.disocclusion_fraction {
            figure(ui, &terms::GUESSED, format!("{:.1} %", share * 1e2));
        }
        figure(ui, &terms::REISSUED, summary.late + summary.lost);
        figure(ui, &terms::TWICE, summary.twice);
        figure_or_alarm(ui, &terms::DROPPED, summary.dropped, summary.dropped > 0);
        figure(ui, &terms::DISPLAY, input.present);
    });
    if let Some(record) = &summary.record {
        ui.horizontal_wrapped(|ui| {
            figure(ui, &terms::IDEAL, in_ms(record.ideal_secs));
            figure(ui, &terms::IDLE, percent(record.idle()));
            if let Some(index) = record.straggler {
                let node = text!("stats-straggler", node = index);
                figure(ui, &terms::STRAGGLER, node);
            }
        });
        if let Some(split) = record.critical_split() {
            critical_path(ui, &split);
        }
    }
    ui.label(RichText::new(summary.diagnosis()).strong());
}

/// Draws a bar of the six stages, with their names and times below.
fn critical_path(ui: &mut Ui, split: &LatencySplit) {
    let stages = terms::stages(split);
    let sum: f64 = stages.iter().map(|(_, secs)| secs).sum();
    let width = ui.available_width().min(BAR_WIDTH);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(width, BAR_HEIGHT), Sense::hover());
    let mut mesh = Mesh::default();
    let mut left = rect.left();
    let pointer = response.hover_pos();
    let mut under = None;
    for ((term, secs), color) in stages.iter().zip(palette::STAGES) {
        let part = Vec2::new(rect.width() * (secs / sum.max(1e-9)) as f32, rect.height());
        let stage = Rect::from_min_size(egui::pos2(left, rect.top()), part);
        mesh.add_colored_rect(stage, color);
        left = stage.right();
        if pointer.is_some_and(|pointer| stage.contains(pointer)) {
            under = Some((term, secs));
        }
    }
    ui.painter().add(Shape::mesh(mesh));
    if let Some((term, secs)) = under {
        response.on_hover_ui_at_pointer(|ui| {
            ui.set_max_width(320.0);
            let (label, meaning) = (term.label(), term.meaning());
            ui.label(format!("{label} {}. {meaning}", in_ms(*secs)));
        });
    }
    ui.horizontal_wrapped(|ui| {
        for ((term, secs), color) in stages.iter().zip(palette::STAGES) {
            marked(ui, term, ms(*secs), color);
        }
    });
}

const BAR_WIDTH: f32 = 560.0;
const BAR_HEIGHT: f32 = 12.0;
