//! Controls beside the charts: balancing, the map over the picture, freezing of the charts, quality.

use carom_farm::quality::{QUALITY_LEVELS, QualityPreference};
use carom_farm::{Algorithm, Balancing, Distribution};
use carom_text::text;
use egui::{ComboBox, Ui};

use super::glossary as terms;
use super::maps::MapKind;
use super::recorder::Recorder;
use super::value_label::{figure, in_ms, ms, percent};
use super::{Stats, StatsCommand, StatsInput, StatsLevel, palette};
use crate::theme;

/// Draws the controls of balancing, map and freezing, and the state of the recording.
pub(super) fn show(ui: &mut Ui, stats: &mut Stats, input: &StatsInput<'_>) {
    ui.horizontal_wrapped(|ui| {
        balancing(ui, stats, input.balancing);
        distribution(ui, stats, input.distribution);
    });
    ui.horizontal(|ui| {
        ui.label(text!("stats-map"))
            .on_hover_text(text!("stats-map-about"));
        for (kind, id) in [
            (MapKind::None, "none"),
            (MapKind::Owner, "owner"),
            (MapKind::Cost, "cost"),
        ] {
            let label = text!(&format!("stats-map-{id}"));
            ui.selectable_value(&mut stats.maps.kind, kind, label)
                .on_hover_text(text!(&format!("stats-map-{id}-about")));
        }
    });
    if stats.maps.kind == MapKind::Cost {
        legend(ui);
    }
    freeze(ui, stats);
    if stats.level == StatsLevel::Recording
        && let Some(recorder) = &stats.recorder
    {
        recording(ui, recorder);
    }
}

fn balancing(ui: &mut Ui, stats: &mut Stats, now: Balancing) {
    let mut wanted = now;
    ComboBox::from_label(text!("stats-balancer"))
        .height(420.0)
        .selected_text(now.algorithm.name())
        .show_ui(ui, |ui| {
            for algorithm in Algorithm::ALL {
                ui.selectable_value(&mut wanted.algorithm, algorithm, algorithm.name())
                    .on_hover_text(about(algorithm));
            }
        })
        .response
        .on_hover_text(text!("stats-balancer-about"));
    ui.checkbox(&mut wanted.hedged, text!("stats-hedged"))
        .on_hover_text(text!("stats-hedged-about"));
    if wanted != now {
        stats.commands.push(StatsCommand::Balancing(wanted));
    }
}

fn distribution(ui: &mut Ui, stats: &mut Stats, now: Distribution) {
    let mut by_samples = now == Distribution::Samples;
    let changed = ui
        .checkbox(&mut by_samples, text!("stats-by-samples"))
        .on_hover_text(text!("stats-by-samples-about"))
        .changed();
    if changed {
        let wanted = match by_samples {
            true => Distribution::Samples,
            false => Distribution::Tiles,
        };
        stats.commands.push(StatsCommand::Distribution(wanted));
    }
}

fn about(algorithm: Algorithm) -> &'static str {
    let name = algorithm.name().replace('_', "-");
    text!(&format!("stats-algorithm-{name}"))
}

fn legend(ui: &mut Ui) {
    ui.horizontal(|ui| {
        ui.label(text!("stats-map-lowest"));
        let (rect, _) = ui.allocate_exact_size(egui::vec2(120.0, 10.0), egui::Sense::hover());
        let steps = 24;
        for step in 0..steps {
            let width = rect.width() / steps as f32;
            let left = rect.left() + width * step as f32;
            let part = egui::Rect::from_min_size(
                egui::pos2(left, rect.top()),
                egui::vec2(width, rect.height()),
            );
            let octaves = 4.0 * (step as f32 + 0.5) / steps as f32 - 2.0;
            ui.painter()
                .rect_filled(part, 0.0, palette::cost(octaves.exp2()));
        }
        ui.label(text!("stats-map-highest"));
    });
}

fn freeze(ui: &mut Ui, stats: &mut Stats) {
    ui.horizontal_wrapped(|ui| {
        let records = stats.history.records();
        let Some(frozen) = stats.frozen.clone() else {
            if ui
                .button(text!("stats-freeze"))
                .on_hover_text(text!("stats-freeze-about"))
                .clicked()
            {
                stats.freeze(usize::MAX);
            }
            return;
        };
        let place = records
            .iter()
            .position(|record| record.frame == frozen.frame)
            .unwrap_or(0);
        let (first, last) = (place == 0, place + 1 >= records.len());
        if ui
            .add_enabled(!first, egui::Button::new("<"))
            .on_hover_text(text!("stats-previous-about"))
            .clicked()
        {
            stats.freeze(place - 1);
        }
        if ui
            .add_enabled(!last, egui::Button::new(">"))
            .on_hover_text(text!("stats-next-about"))
            .clicked()
        {
            stats.freeze(place + 1);
        }
        if ui
            .button(text!("stats-resume"))
            .on_hover_text(text!("stats-resume-about"))
            .clicked()
        {
            stats.unfreeze();
        }
        ui.label(text!("stats-frozen", frame = frozen.frame));
    });
}

fn recording(ui: &mut Ui, recorder: &Recorder) {
    let state = recorder.state();
    ui.horizontal_wrapped(|ui| {
        let frames = text!(
            "stats-recording-frames",
            written = state.written,
            missed = state.left_out
        );
        figure(ui, &terms::RECORDING, frames);
        match &state.failure {
            Some(why) => {
                ui.colored_label(theme::ALARM, text!("stats-recording-stopped", why = why))
            }
            None => ui.label(text!("stats-recording-place", place = &state.place)),
        };
    });
}

/// Draws the results of each balancing that has been used.
pub(super) fn tallies(ui: &mut Ui, stats: &Stats) {
    for tally in stats.history.tallies() {
        ui.horizontal_wrapped(|ui| {
            ui.monospace(format!("{:<20}", tally.balancing.to_string()));
            figure(ui, &terms::TALLY_FRAMES, format!("{:5}", tally.frames));
            let efficiency = format!("{:>5}", percent(tally.efficiency()));
            figure(ui, &terms::TALLY_EFFICIENCY, efficiency);
            let deviation = format!("{:>8}", in_ms(tally.deviation_secs()));
            figure(ui, &terms::TALLY_SIGMA, deviation);
            let longest = format!("{:>8}", in_ms(tally.max_secs()));
            figure(ui, &terms::TALLY_MAX, longest);
        });
    }
}

/// Draws the quality preference and the levels with their cost on this farm; `carom-bench quality` measures
/// the error of each.
pub(super) fn quality(ui: &mut Ui, stats: &mut Stats, input: &StatsInput<'_>) {
    let mut wanted = input.preference;
    ui.horizontal(|ui| {
        for (preference, id) in [
            (QualityPreference::Smooth, "smooth"),
            (QualityPreference::Balanced, "balanced"),
            (QualityPreference::Fine, "fine"),
        ] {
            let label = text!(&format!("stats-quality-{id}"));
            ui.selectable_value(&mut wanted, preference, label)
                .on_hover_text(text!(&format!("stats-quality-{id}-about")));
        }
    });
    if wanted != input.preference {
        stats.commands.push(StatsCommand::QualityPreference(wanted));
    }
    for (stop, secs) in QUALITY_LEVELS.into_iter().zip(input.level_secs) {
        let size = stop.size(input.window);
        ui.horizontal_wrapped(|ui| {
            ui.monospace(if stop == input.stop { ">" } else { " " });
            let pixels = format!("{:4}x{:<4}", size.width, size.height);
            figure(ui, &terms::LEVEL_SCALE, pixels);
            let filter = if stop.denoise { "+" } else { " " };
            let samples = format!("{:2}{filter}", stop.samples);
            figure(ui, &terms::LEVEL_SAMPLES, samples);
            let cost = secs.map_or_else(|| "-".to_owned(), ms);
            figure(ui, &terms::LEVEL_MS, format!("{cost:>6}"));
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_algorithm_is_explained() {
        for algorithm in Algorithm::ALL {
            assert!(about(algorithm).ends_with('.'), "{algorithm:?}");
        }
    }
}
