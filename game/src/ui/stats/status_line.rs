//! The first level: one line.

use carom_tracer::ImageSize;
use egui::Ui;

use super::glossary as terms;
use super::summary::StatsSummary;
use super::value_label::{figure, figure_or_alarm, ms, percent};
use super::{StatsInput, charts};

/// Draws the figures one after the other; they wrap where the window is narrow.
pub(super) fn show(ui: &mut Ui, board: &StatsSummary, sparkline: &[f32], facts: &StatsInput<'_>) {
    let rates = &board.rates;
    ui.horizontal_wrapped(|ui| {
        figure(ui, &terms::FPS, &format!("{:3.0}", rates.now));
        figure(ui, &terms::LOW_1, &format!("{:3.0}", rates.low_1_percent));
        charts::sparkline(ui, sparkline);
        figure(
            ui,
            &terms::PICTURES,
            &format!("{:4.1}", board.pictures_per_sec),
        );
        let nodes = format!("{}/{}", board.ready, board.nodes.len());
        figure_or_alarm(ui, &terms::NODES, &nodes, board.ready < board.nodes.len());
        if let Some(record) = &board.record {
            let late = record.makespan_secs > facts.period_secs.max(facts.lead_secs) * LATE;
            figure_or_alarm(
                ui,
                &terms::MAKESPAN,
                &format!("{} ms", ms(record.makespan_secs)),
                late,
            );
            if let Some(split) = record.critical_split() {
                figure(ui, &terms::NETWORK, &ms(split.network_secs));
                figure(ui, &terms::QUEUE, &ms(split.queue_secs));
                figure(ui, &terms::TRACE, &ms(split.trace_secs));
            }
            figure(
                ui,
                &terms::EFFICIENCY,
                &format!("{} %", percent(record.efficiency())),
            );
            let ImageSize { width, height } = ImageSize::new(record.width, record.height);
            figure(
                ui,
                &terms::SIZE,
                &format!("{width}x{height} x {}", record.samples),
            );
        }
        figure(ui, &terms::BITS, &format!("{:5.1}", board.mbit_per_sec));
        figure(ui, &terms::RATIO, &format!("{:.1}x", board.ratio));
        figure_or_alarm(ui, &terms::LATE, &board.late.to_string(), false);
        figure_or_alarm(ui, &terms::LOST, &board.lost.to_string(), board.lost > 0);
    });
}

/// A picture that takes so many times its budget is late.
const LATE: f64 = 1.5;
