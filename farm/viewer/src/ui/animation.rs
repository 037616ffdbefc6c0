//! Controls of a scene's animation.

use carom_farm::SceneAnimation;
use carom_text::text;
use egui::{ComboBox, Id, Slider, SliderClamping, Ui};

use crate::playback::{Playback, SPEEDS};

/// Draws the controls; returns whether another animation was chosen.
pub(crate) fn show(ui: &mut Ui, playback: &mut Playback) -> bool {
    let (chosen, secs) = playback.time().unwrap_or_default();
    let animations = playback.animations().clone();
    let name = |(number, animation): (usize, &SceneAnimation)| match animation.name.as_str() {
        "" => text!("view-animation-number", number = number),
        name => name.to_owned(),
    };
    if animations.len() > 1 {
        let shown = animations
            .get(chosen)
            .map(|animation| name((chosen, animation)));
        ComboBox::from_id_salt(Id::unique("view-animations"))
            .selected_text(shown.unwrap_or_default())
            .show_ui(ui, |ui| {
                for (number, animation) in animations.iter().enumerate() {
                    let label = name((number, animation));
                    if ui.selectable_label(number == chosen, label).clicked() {
                        playback.choose(number);
                    }
                }
            });
    }
    let label = match playback.is_playing() {
        true => text!("view-stop"),
        false => text!("view-play"),
    };
    if ui
        .button(label)
        .on_hover_text(text!("view-play-about"))
        .clicked()
    {
        playback.toggle();
    }
    let mut at_secs = secs;
    let slider = Slider::new(&mut at_secs, 0.0..=playback.duration_secs())
        .text(text!("view-time"))
        .suffix(" s")
        .fixed_decimals(2)
        // Clamping only edits avoids rounding the value each frame, which would stop a slow animation.
        .clamping(SliderClamping::Edits);
    if ui.add(slider).changed() {
        playback.seek(at_secs);
    }
    let [slowest, fastest] = SPEEDS;
    let slider = Slider::new(&mut playback.speed, slowest..=fastest)
        .logarithmic(true)
        .text(text!("view-speed"))
        .suffix(" ×")
        .max_decimals(2);
    ui.add(slider);
    playback.time().is_some_and(|(now, _)| now != chosen)
}
