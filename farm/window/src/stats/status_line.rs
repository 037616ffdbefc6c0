//! Line of the second level: figures of the farm.

use egui::Ui;

use super::glossary as terms;
use super::plain_words::LATE;
use super::summary::StatsSummary;
use super::value_label::{figure, figure_or_alarm, in_ms, ms, percent};
use super::{StatsInput, charts};

/// Draws the figures in a row, which wraps in a narrow window.
pub(super) fn show(ui: &mut Ui, summary: &StatsSummary, sparkline: &[f32], input: &StatsInput<'_>) {
    let rates = &summary.rates;
    ui.horizontal_wrapped(|ui| {
        figure(ui, &terms::LOW_1, format!("{:3.0}", rates.low_1_percent));
        charts::sparkline(ui, sparkline);
        let pictures = format!("{:4.1}", summary.pictures_per_sec);
        figure(ui, &terms::PICTURES, pictures);
        let (ready, nodes) = (summary.ready, summary.nodes.len());
        figure_or_alarm(ui, &terms::NODES, format!("{ready}/{nodes}"), ready < nodes);
        if let Some(record) = &summary.record {
            let late = record.makespan_secs > input.period_secs.max(input.lead_secs) * LATE;
            figure_or_alarm(ui, &terms::MAKESPAN, in_ms(record.makespan_secs), late);
            if let Some(split) = record.critical_split() {
                figure(ui, &terms::NETWORK, ms(split.network_secs));
                figure(ui, &terms::QUEUE, ms(split.queue_secs));
                figure(ui, &terms::TRACE, ms(split.trace_secs));
            }
            figure(ui, &terms::EFFICIENCY, percent(record.efficiency()));
            let size = format!("{}x{} x {}", record.width, record.height, record.samples);
            figure(ui, &terms::SIZE, size);
        }
        figure(ui, &terms::BITS, format!("{:5.1}", summary.mbit_per_sec));
        figure(ui, &terms::RATIO, format!("{:.1}x", summary.ratio));
        figure(ui, &terms::LATE, summary.late);
        figure_or_alarm(ui, &terms::LOST, summary.lost, summary.lost > 0);
    });
}
