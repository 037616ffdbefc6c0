//! Controls beside the running charts: how pictures are divided, which map is over the picture,
//! and whether the charts stand still.

use carom_farm::{Algorithm, Balancing, Distribution};
use egui::{ComboBox, Ui};

use super::glossary as terms;
use super::maps::MapKind;
use super::recorder::Recorder;
use super::value_label::{figure, ms, percent};
use super::{Stats, StatsCommand, StatsInput, StatsLevel, palette};
use crate::frame::quality::{QUALITY_LEVELS, QualityPreference};

/// Algorithm, map, freeze, and what the recording does.
pub(super) fn show(ui: &mut Ui, stats: &mut Stats, input: &StatsInput<'_>) {
    ui.horizontal_wrapped(|ui| {
        balancing(ui, stats, input.balancing);
        distribution(ui, stats, input.distribution);
    });
    ui.horizontal(|ui| {
        ui.label("Map").on_hover_text("The map drawn over each tile of the inspected frame.");
        for (kind, word, meaning) in [
            (MapKind::None, "none", "No map."),
            (MapKind::Owner, "owner", "A colour and a number for each node: the node that delivered each tile first."),
            (MapKind::Cost, "cost", "Learned cost of each tile: dark blue is a quarter of the mean or less, green the mean, yellow four times the mean or more."),
        ] {
            ui.selectable_value(&mut stats.maps.kind, kind, word).on_hover_text(meaning);
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
    ComboBox::from_label("balancer")
        .height(420.0)
        .selected_text(now.algorithm.name())
        .show_ui(ui, |ui| {
            for algorithm in Algorithm::ALL {
                ui.selectable_value(&mut wanted.algorithm, algorithm, algorithm.name())
                    .on_hover_text(about(algorithm));
            }
        })
        .response
        .on_hover_text(
            "The balancing algorithm from the next frame on. The charts mark the change.",
        );
    ui.checkbox(&mut wanted.hedged, "hedged")
        .on_hover_text("Hedging: late tiles are requested from other nodes too, and the first result wins. Repeats under 2 % of the work; without it a frame waits for its slowest node.");
    if wanted != now {
        stats.commands.push(StatsCommand::Balancing(wanted));
    }
}

fn distribution(ui: &mut Ui, stats: &mut Stats, now: Distribution) {
    let mut by_samples = now == Distribution::Samples;
    let changed = ui.checkbox(&mut by_samples, "by samples").on_hover_text("While nothing moves, each node traces other samples of the whole frame instead of its own tiles. A lost node then costs noise instead of tiles; the frame crosses the network once for each node.").changed();
    if changed {
        let wanted = if by_samples {
            Distribution::Samples
        } else {
            Distribution::Tiles
        };
        stats.commands.push(StatsCommand::Distribution(wanted));
    }
}

fn about(algorithm: Algorithm) -> &'static str {
    match algorithm {
        Algorithm::Equal => "The same number of tiles for each node.",
        Algorithm::Naive => "In proportion to each node's last speed (tiles per response time).",
        Algorithm::NaiveMean => "In proportion to the mean of each node's speeds so far.",
        Algorithm::NaiveFrozen => {
            "In proportion to the mean of each node's first 60 speeds, fixed from then on."
        }
        Algorithm::Ab => {
            "y = A + B·x with averages over the whole run, after 60 frames in equal parts."
        }
        Algorithm::AbExponential => "y = A + B·x with moving averages.",
        Algorithm::Cycles => {
            "Each share moves by a fraction of its distance from the mean time until all times are within 2 %."
        }
        Algorithm::Pull => {
            "Work stealing: nodes hold as few tiles as the round trip needs and get more as they deliver."
        }
        Algorithm::WaterFilling => {
            "y = A + B·w with filtered A and B and the cost of each tile: the earliest common finish."
        }
        Algorithm::Own => "An algorithm of the application's own.",
    }
}

fn legend(ui: &mut Ui) {
    ui.horizontal(|ui| {
        ui.label("1/4");
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
        ui.label("4 times the mean");
    });
}

fn freeze(ui: &mut Ui, stats: &mut Stats) {
    ui.horizontal_wrapped(|ui| {
        let records = stats.history.records();
        let Some(frozen) = stats.frozen.clone() else {
            if ui
                .button("Freeze")
                .on_hover_text(
                    "Freeze the charts at the newest frame. Click a chart to choose another frame.",
                )
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
            .on_hover_text("Previous frame.")
            .clicked()
        {
            stats.freeze(place - 1);
        }
        if ui
            .add_enabled(!last, egui::Button::new(">"))
            .on_hover_text("Next frame.")
            .clicked()
        {
            stats.freeze(place + 1);
        }
        if ui
            .button("Go on")
            .on_hover_text("Resume live charts.")
            .clicked()
        {
            stats.unfreeze();
        }
        ui.label(format!("Frozen at frame {}", frozen.frame));
    });
}

fn recording(ui: &mut Ui, recorder: &Recorder) {
    let state = recorder.state();
    ui.horizontal_wrapped(|ui| {
        figure(
            ui,
            &terms::RECORDING,
            &format!("{} written, {} left out", state.written, state.left_out),
        );
        match &state.failure {
            Some(why) => {
                ui.colored_label(crate::ui::theme::ALARM, format!("Recording stopped: {why}"))
            }
            None => ui.label(format!("to {}", state.place)),
        };
    });
}

/// What each way of dividing that has been used has reached.
pub(super) fn tallies(ui: &mut Ui, stats: &Stats) {
    for tally in stats.history.tallies() {
        ui.horizontal_wrapped(|ui| {
            ui.monospace(format!("{:<20}", tally.balancing.to_string()));
            figure(ui, &terms::TALLY_FRAMES, &format!("{:5}", tally.frames));
            figure(
                ui,
                &terms::TALLY_EFFICIENCY,
                &format!("{:>3} %", percent(tally.efficiency())),
            );
            figure(
                ui,
                &terms::TALLY_SIGMA,
                &format!("{:>5} ms", ms(tally.deviation_secs())),
            );
            figure(
                ui,
                &terms::TALLY_MAX,
                &format!("{:>5} ms", ms(tally.max_secs())),
            );
        });
    }
}

/// The quality preference, and its stops: what each costs here; `carom-bench quality`
/// measures how far each is from the truth.
pub(super) fn quality(ui: &mut Ui, stats: &mut Stats, input: &StatsInput<'_>) {
    let mut wanted = input.preference;
    ui.horizontal(|ui| {
        for (preference, word, meaning) in DIALS {
            ui.selectable_value(&mut wanted, preference, word)
                .on_hover_text(meaning);
        }
    });
    if wanted != input.preference {
        stats.commands.push(StatsCommand::QualityPreference(wanted));
    }
    for (stop, secs) in QUALITY_LEVELS.into_iter().zip(input.level_secs) {
        let size = stop.size(input.window);
        ui.horizontal_wrapped(|ui| {
            ui.monospace(if stop == input.stop { ">" } else { " " });
            figure(
                ui,
                &terms::LEVEL_SCALE,
                &format!("{:4}x{:<4}", size.width, size.height),
            );
            let filter = if stop.denoise { "+" } else { " " };
            let samples = format!("{:2}{filter}", stop.samples);
            figure(ui, &terms::LEVEL_SAMPLES, &samples);
            figure(
                ui,
                &terms::LEVEL_MS,
                &format!("{:>6}", secs.map_or_else(|| "-".to_owned(), ms)),
            );
        });
    }
}

const DIALS: [(QualityPreference, &str, &str); 3] = [
    (
        QualityPreference::Smooth,
        "smooth",
        "60 frames per second, at 426x240 pixels or more.",
    ),
    (
        QualityPreference::Balanced,
        "balanced",
        "60 frames per second at sufficient resolution, else 30: twice the samples.",
    ),
    (
        QualityPreference::Fine,
        "fine",
        "15 frames per second: four times the samples, a seventh of the squared error.",
    ),
];
