//! First level: the qualities of the picture that matter to a player, in plain words.

use carom_text::text;
use egui::{RichText, Ui};

use super::StatsInput;
use super::glossary as terms;
use super::summary::StatsSummary;
use super::value_label::{figure, figure_or_alarm, in_ms, percent};
use crate::theme;

/// Draws smoothness, latency and sharpness of the picture, who traces it, and the farm's faults.
pub(super) fn show(ui: &mut Ui, summary: &StatsSummary, input: &StatsInput<'_>) {
    ui.horizontal_wrapped(|ui| {
        figure(ui, &terms::FPS, format!("{:3.0}", summary.rates.now));
        let pictures = format!("{:.0}", summary.pictures_per_sec);
        let pictures = text!("stats-pictures-per-second", pictures = pictures);
        figure(ui, &terms::NEW_PICTURES, pictures);
        if let Some(record) = &summary.record {
            let is_late = record.makespan_secs > input.period_secs.max(input.lead_secs) * LATE;
            figure_or_alarm(ui, &terms::DELAY, in_ms(record.makespan_secs), is_late);
            let share = f64::from(record.width) / f64::from(input.window.width.max(1));
            figure(ui, &terms::SHARPNESS, percent(share));
        }
        figure(ui, &terms::MADE_BY, made_by(summary));
    });
    if let Some(trouble) = trouble(summary) {
        ui.label(RichText::new(trouble).color(theme::ALARM));
    }
}

/// The device of the only ready node, or the number of ready nodes.
fn made_by(summary: &StatsSummary) -> String {
    let mut ready = summary.nodes.iter().filter(|node| node.is_ready);
    match (ready.next(), ready.count()) {
        (None, _) => text!("stats-made-by-nobody").to_owned(),
        (Some(node), 0) if node.device.is_empty() => node.name.clone(),
        (Some(node), 0) => node.device.clone(),
        (Some(_), others) => text!("stats-made-by-machines", count = others + 1),
    }
}

/// A sentence about nodes that do not contribute, with the reason.
fn trouble(summary: &StatsSummary) -> Option<String> {
    let mut absent = summary.nodes.iter().filter(|node| !node.is_ready);
    let first = absent.next()?;
    Some(text!(
        "stats-absent",
        others = absent.count(),
        name = &first.name,
        why = &first.state_sentence
    ))
}

/// Multiple of its budget above which a picture counts as late.
pub(super) const LATE: f64 = 1.5;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::summary::NodeSummary;

    fn summary(nodes: &[(&str, bool)]) -> StatsSummary {
        let node = |&(name, is_ready): &(&str, bool)| NodeSummary {
            name: name.to_owned(),
            device: format!("{name}'s GPU"),
            state_sentence: "its connection broke".to_owned(),
            is_ready,
            ..NodeSummary::default()
        };
        StatsSummary {
            nodes: nodes.iter().map(node).collect(),
            ..StatsSummary::default()
        }
    }

    #[test]
    fn who_makes_the_picture_is_a_device_or_a_number_of_machines() {
        for (nodes, words) in [
            (&[][..], "nobody yet"),
            (&[("desk", true)], "desk's GPU"),
            (&[("desk", true), ("gone", false)], "desk's GPU"),
            (&[("desk", true), ("attic", true)], "2 machines"),
        ] {
            assert_eq!(made_by(&summary(nodes)), words);
        }
    }

    #[test]
    fn machines_that_do_not_help_are_named_with_the_reason() {
        assert_eq!(trouble(&summary(&[("desk", true)])), None);
        let one = trouble(&summary(&[("desk", true), ("gone", false)]));
        assert_eq!(one.unwrap(), "gone does not help: its connection broke");
        let many = trouble(&summary(&[("gone", false), ("b", false), ("c", false)]));
        assert!(many.unwrap().ends_with("Nor do 2 other machines"));
    }
}
