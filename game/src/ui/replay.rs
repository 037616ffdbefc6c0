//! Page of replays: choice of the shot, time control, and actions.

use std::path::PathBuf;

use carom_text::text;
use carom_window::theme;
use egui::{Align2, ComboBox, Context, ScrollArea, Slider, Ui};

use super::form::explain;
use super::layout::Layout;
use crate::capture::replay::{ReplayCommand, ReplayPlayer};
use crate::capture::{RecordingKind, SavedRecording};
use crate::input::{Action, Bindings, ReplayControl};

/// Draws the page at the bottom, and returns the command of the player's pointer.
pub fn panel(
    ctx: &Context,
    layout: &mut Layout,
    player: &ReplayPlayer,
    kept: &[SavedRecording],
    film_percent: Option<u32>,
    bindings: &Bindings,
    now_secs: f64,
) -> Option<ReplayCommand> {
    layout.dock(ctx, "replay", Align2::CENTER_BOTTOM, |ui| {
        let page = theme::frame().show(ui, |ui| {
            ui.set_width(ui.available_width().min(WIDTH));
            let picked = clips(ui, player);
            let turned = time(ui, player, now_secs);
            let done = deeds(ui, player, kept, film_percent);
            explain(ui, keys(bindings));
            picked.or(turned).or(done)
        });
        page.inner
    })
}

fn clips(ui: &mut Ui, player: &ReplayPlayer) -> Option<ReplayCommand> {
    let clips = &player.recording().clips;
    let mut take = player.take();
    let words = |i: usize| {
        clips
            .get(i)
            .map_or("", |take| take.title.as_str())
            .to_owned()
    };
    let list = ComboBox::from_id_salt("clips")
        .width(ui.available_width() - 16.0)
        .truncate();
    let chosen = list.show_index(ui, &mut take, clips.len(), words);
    chosen
        .changed()
        .then_some(ReplayCommand::Control(ReplayControl::Pick(take)))
}

fn time(ui: &mut Ui, player: &ReplayPlayer, now_secs: f64) -> Option<ReplayCommand> {
    let clock = player.clock();
    let (mut moment, end) = (clock.moment_secs(now_secs), clock.end_secs());
    let mut control = None;
    ui.horizontal_wrapped(|ui| {
        let step = |ui: &mut Ui, words: &str, forward: bool| {
            let clicked = ui.button(words).clicked();
            clicked.then_some(ReplayControl::Step { forward })
        };
        control = step(ui, text!("replay-event-before"), false);
        let play = match clock.is_running() {
            true => text!("replay-pause"),
            false => text!("replay-play"),
        };
        if ui
            .add_sized([64.0, 30.0], egui::Button::new(play))
            .clicked()
        {
            control = Some(ReplayControl::Toggle);
        }
        control = control.or(step(ui, text!("replay-event-next"), true));
        for rate in ReplayControl::RATES {
            let is_chosen = clock.rate() == rate;
            if ui.selectable_label(is_chosen, rate_words(rate)).clicked() {
                control = Some(ReplayControl::Rate(rate));
            }
        }
    });
    ui.horizontal(|ui| {
        ui.spacing_mut().slider_width = (ui.available_width() - 140.0).max(60.0);
        let slider = Slider::new(&mut moment, 0.0..=end.max(1e-3)).show_value(false);
        if ui.add(slider).changed() {
            control = Some(ReplayControl::Seek(moment));
        }
        ui.monospace(text!(
            "replay-moment",
            moment = format!("{moment:5.2}"),
            end = format!("{end:.2}"),
        ));
    });
    ui.label(happening(player, moment));
    control.map(ReplayCommand::Control)
}

fn rate_words(rate: f64) -> String {
    match rate {
        1.0 => "1×".to_owned(),
        slow => format!("1/{:.0}×", 1.0 / slow),
    }
}

/// Description of the last event before a moment.
fn happening(player: &ReplayPlayer, moment_secs: f64) -> String {
    let past = player.timeline_events().iter();
    let last = past
        .take_while(|moment| moment.secs <= moment_secs + 1e-6)
        .last();
    last.map_or_else(
        || text!("replay-no-shot").to_owned(),
        |moment| {
            let secs = format!("{:.3}", moment.secs);
            text!("replay-happening", secs = secs, event = &*moment.words)
        },
    )
}

fn deeds(
    ui: &mut Ui,
    player: &ReplayPlayer,
    kept: &[SavedRecording],
    film_percent: Option<u32>,
) -> Option<ReplayCommand> {
    let mut command = None;
    ui.horizontal_wrapped(|ui| {
        if ui.button(text!("replay-save-shot")).clicked() {
            command = Some(ReplayCommand::Save(RecordingKind::Shot));
        }
        let count = player.recording().clips.len();
        if count > 1 && ui.button(text!("replay-save-all", count = count)).clicked() {
            command = Some(ReplayCommand::Save(RecordingKind::Match));
        }
        let film = match film_percent {
            Some(percent) => text!("replay-cancel-film", percent = percent),
            None => text!("replay-film").to_owned(),
        };
        let film = ui.button(film).on_hover_text(text!("replay-film-about"));
        if film.clicked() {
            command = Some(ReplayCommand::Film);
        }
        if let Some(path) = files(ui, kept) {
            command = Some(ReplayCommand::Open(path));
        }
        let play = ui.button(text!("replay-play-from-here"));
        if play
            .on_hover_text(text!("replay-play-from-here-about"))
            .clicked()
        {
            command = Some(ReplayCommand::Play);
        }
        if ui.button(text!("replay-close")).clicked() {
            command = Some(ReplayCommand::Close);
        }
    });
    command
}

/// Draws a list of the player's files, and returns the chosen one.
pub(super) fn files(ui: &mut Ui, kept: &[SavedRecording]) -> Option<PathBuf> {
    let mut command = None;
    ui.menu_button(text!("files-open"), |ui| {
        if kept.is_empty() {
            ui.label(text!("files-none"));
        }
        ScrollArea::vertical().max_height(260.0).show(ui, |ui| {
            for file in kept {
                if ui.button(&file.name).clicked() {
                    command = Some(file.path.clone());
                    ui.close();
                }
            }
        });
    });
    command
}

/// Line with the keys of the page.
fn keys(bindings: &Bindings) -> String {
    let words = |action| bindings.words(action);
    let speeds = [0, 1, 2].map(|place| words(Action::ReplaySpeed(place)));
    text!(
        "replay-keys",
        pause = words(Action::ReplayPause),
        back = words(Action::ReplayBack),
        forward = words(Action::ReplayForward),
        event_before = words(Action::ReplayEventBefore),
        event_next = words(Action::ReplayEventNext),
        speeds = speeds.join(" "),
        shot_before = words(Action::ReplayShotBefore),
        shot_next = words(Action::ReplayShotNext),
        close = words(Action::Menu),
    )
}

const WIDTH: f32 = 800.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_are_told_as_fractions() {
        assert_eq!(
            ReplayControl::RATES.map(rate_words),
            ["1×", "1/4×", "1/10×"]
        );
    }
}
